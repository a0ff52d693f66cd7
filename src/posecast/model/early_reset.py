"""Gated recurrent units as they were first published: reset before the product, one bias."""

from __future__ import annotations

from typing import Literal

import torch
from jaxtyping import Float
from torch import Tensor, nn

from posecast.model.products import linear
from posecast.model.recurrent import State, Summary, check_stack


class EarlyResetGRUBackbone(nn.Module):
    """A stack of gated recurrent units that forget before they multiply (Cho et al. 2014, eq. 8).

        r = sigmoid(W_r [x, h] + b_r)        z likewise
        n = tanh(W_n [x, r h] + b_n)         h' = z h + (1 - z) n

    It is TensorFlow's first cell, that of Martinez et al. 2017 and of what was built on their code.
    ``GRUBackbone``, PyTorch's cell, resets the product instead and has twice as many biases.

    Args:
        input_dim: numbers a frame.
        hidden: units a layer.
        layers: how many layers; each reads the one below.
        initial_state: ``zero``: zeros; ``learned``: one trained vector a layer, the same for every
            sequence, drawn from a normal distribution with standard deviation 0.01.
        gate_bias: biases of both gates when weights are drawn; 1 in TensorFlow.
    """

    def __init__(
        self,
        input_dim: int,
        hidden: int = 1024,
        layers: int = 1,
        initial_state: Literal["learned", "zero"] = "zero",
        gate_bias: float = 1.0,
    ) -> None:
        super().__init__()
        check_stack(layers, initial_state)
        self.hidden, self.gate_bias = hidden, gate_bias
        sizes = [input_dim] + [hidden] * (layers - 1)
        # r, z, n from above to below.
        self.from_below = nn.ParameterList(torch.empty(3 * hidden, size) for size in sizes)
        self.from_state = nn.ParameterList(torch.empty(3 * hidden, hidden) for _ in sizes)
        self.bias = nn.ParameterList(torch.empty(3 * hidden) for _ in sizes)
        self.first: nn.Parameter | None = None
        if initial_state == "learned":
            self.first = nn.Parameter(torch.empty(layers, hidden))
        self.reset_parameters()

    @property
    def context_dim(self) -> int:
        """Size of the summary: the units of the last layer."""
        return self.hidden

    def reset_parameters(self, generator: torch.Generator | None = None) -> None:
        """Draw all weights anew: uniform as Glorot and Bengio 2010 have it, both gates together."""
        gates = 2 * self.hidden
        for below, own, bias in zip(self.from_below, self.from_state, self.bias, strict=True):
            inputs = below.shape[1] + self.hidden
            for rows, outputs in ((slice(gates), gates), (slice(gates, None), self.hidden)):
                bound = (6 / (inputs + outputs)) ** 0.5
                for weight in (below, own):
                    nn.init.uniform_(weight[rows], -bound, bound, generator=generator)
            nn.init.constant_(bias[:gates], self.gate_bias)
            nn.init.zeros_(bias[gates:])
        if self.first is not None:
            nn.init.normal_(self.first, std=0.01, generator=generator)

    def initial_state(self, batch: int) -> State:
        """One tensor (batch, hidden) a layer."""
        if self.first is not None:
            return tuple(layer.expand(batch, -1) for layer in self.first)
        zero = self.bias[0].new_zeros(batch, self.hidden)
        return (zero,) * len(self.bias)

    def forward(self, frames: Float[Tensor, "batch frames inputs"], state: State) -> Summary:
        """Read frames, the oldest first."""
        after: list[Tensor] = []
        weights = zip(self.from_below, self.from_state, self.bias, state, strict=True)
        for below, own, bias, before in weights:
            frames, last = self._read(linear(frames, below, bias), own, before)
            after.append(last)
        return Summary(frames, tuple(after))

    def _read(self, sums: Tensor, weight: Tensor, state: Tensor) -> tuple[Tensor, Tensor]:
        """A layer's state after each frame, and after the last, from what the frames add."""
        gates = 2 * self.hidden
        nothing = weight.new_zeros(gates)
        states: list[Tensor] = []
        for frame in sums.unbind(1):
            both = torch.sigmoid(frame[:, :gates] + linear(state, weight[:gates], nothing))
            reset, keep = both.chunk(2, dim=1)
            new = frame[:, gates:] + linear(reset * state, weight[gates:], nothing[: self.hidden])
            state = torch.lerp(new.tanh(), state, keep)
            states.append(state)
        return torch.stack(states, dim=1), state
