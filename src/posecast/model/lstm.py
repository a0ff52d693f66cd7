"""Stacks of LSTM cells, wired as usual or with the delay of the released acRNN code."""

from __future__ import annotations

import math
from typing import Literal, get_args

import torch
from jaxtyping import Float
from torch import Tensor, nn

from posecast.errors import ConfigError
from posecast.model.recurrent import State, Summary, check_stack

Wiring = Literal["stacked", "delayed"]


class LSTMBackbone(nn.Module):
    """A stack of long short-term memory cells (Zhou et al. 2018; Andreou et al. 2022, section 5).

    Two biases a cell, as PyTorch has them, so that parameters are those of the papers.

    Args:
        input_dim: numbers a frame.
        hidden: units a layer.
        layers: how many layers.
        wiring: ``stacked``: each layer reads what the one below puts out in the same frame;
            ``delayed``: what it put out in the frame before, as the code of Zhou et al. does, so
            that an input reaches the output after as many more frames as there are layers above
            the first.
        initial_state: ``zero``: zeros; ``learned``: trained vectors, the same for every sequence,
            drawn from a normal distribution with standard deviation 0.01.

    Raises:
        ConfigError: an unknown choice, or a number of layers outside 1 to 100.
    """

    def __init__(
        self,
        input_dim: int,
        hidden: int = 1024,
        layers: int = 3,
        wiring: Wiring = "stacked",
        initial_state: Literal["learned", "zero"] = "zero",
    ) -> None:
        super().__init__()
        check_stack(layers, initial_state)
        if wiring not in get_args(Wiring):
            raise ConfigError(f"wiring: {wiring!r} is not known; choose 'stacked' or 'delayed'")
        self.delayed = wiring == "delayed"
        self.layers = nn.ModuleList(
            nn.LSTM(input_dim if layer == 0 else hidden, hidden, batch_first=True)
            for layer in range(layers)
        )
        self.hidden = hidden
        self.first: nn.Parameter | None = None
        if initial_state == "learned":
            self.first = nn.Parameter(torch.empty(2 * layers, hidden))
        self.reset_parameters()

    @property
    def context_dim(self) -> int:
        """Size of the summary: the units of the last layer."""
        return self.hidden

    def reset_parameters(self, generator: torch.Generator | None = None) -> None:
        """Draw all weights anew: PyTorch's uniform; the first state from N(0, 0.01)."""
        bound = 1 / math.sqrt(self.hidden)
        for weight in self.layers.parameters():
            nn.init.uniform_(weight, -bound, bound, generator=generator)
        if self.first is not None:
            nn.init.normal_(self.first, std=0.01, generator=generator)

    def initial_state(self, batch: int) -> State:
        """For each layer its output, then its cell: two tensors (batch, hidden)."""
        if self.first is not None:
            return tuple(part.expand(batch, -1) for part in self.first)
        zero = next(self.layers.parameters()).new_zeros(batch, self.hidden)
        return (zero,) * (2 * len(self.layers))

    def forward(self, frames: Float[Tensor, "batch frames inputs"], state: State) -> Summary:
        """Read frames, the oldest first."""
        after: list[Tensor] = []
        context = frames
        for number, layer in enumerate(self.layers):
            output, cell = state[2 * number], state[2 * number + 1]
            if self.delayed and number:
                below = state[2 * number - 2]
                context = torch.cat([below[:, None], context[:, :-1]], dim=1)
            context, output, cell = _read(layer, context, output, cell)
            after += [output, cell]
        return Summary(context, tuple(after))


def _read(
    layer: nn.Module, frames: Tensor, output: Tensor, cell: Tensor
) -> tuple[Tensor, Tensor, Tensor]:
    """Outputs after each frame, and output and cell after the last."""
    assert isinstance(layer, nn.LSTM)
    # On a CPU a cell has less around it, which pays for a single frame and for no more; other
    # devices have not been timed.
    plain = frames.device.type != "cpu" or torch.compiler.is_compiling()
    if not plain and frames.shape[1] == 1:
        output, cell = torch.lstm_cell(frames[:, 0], (output, cell), *layer.all_weights[0])
        return output[:, None], output, cell
    # cuDNN refuses a state that is not contiguous, as a learned one is not: one row for all.
    before = (output[None].contiguous(), cell[None].contiguous())
    outputs, (output, cell) = layer(frames, before)
    return outputs, output[0], cell[0]
