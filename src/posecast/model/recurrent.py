"""Recurrent backbones: stacks of gated units that carry a summary of the past along."""

from __future__ import annotations

import math
from typing import Literal, NamedTuple, Protocol

import torch
from jaxtyping import Float
from torch import Tensor, nn

from posecast.errors import ConfigError
from posecast.model.gru_kernel import GRULayer
from posecast.model.products import packing_pays

_LEAST_UNITS = 256
"""For layers of fewer units PyTorch's own loop is the faster one, in training as in use."""

_MOST_LAYERS = 100
"""More would be made for minutes before anything could be said about them."""

State = tuple[Tensor, ...]
"""What a backbone remembers; every tensor has the batch as its first axis."""


class Summary(NamedTuple):
    """What a backbone returns.

    Args:
        context: summary of the past after each of the frames it read.
        state: what it needs in order to read on.
    """

    context: Float[Tensor, "batch frames context"]
    state: State


class Backbone(Protocol):
    """Summarizes the past.

    Law: one call over ten frames equals a call over four, then over six with the state in between.
    """

    @property
    def context_dim(self) -> int:
        """Size of the summary."""
        ...

    def initial_state(self, batch: int) -> State:
        """The state before anything was read, for a batch of this size."""
        ...

    def __call__(self, frames: Float[Tensor, "batch frames inputs"], state: State) -> Summary:
        """Read frames and carry the state on."""
        ...

    def reset_parameters(self, generator: torch.Generator | None = None) -> None:
        """Draw all weights anew."""
        ...


def check_stack(layers: int, initial_state: str) -> None:
    """Refuse what no stack of recurrent layers can be made of.

    Raises:
        ConfigError: a number of layers out of range, or an unknown first state.
    """
    if not 1 <= layers <= _MOST_LAYERS:
        raise ConfigError(f"layers: {layers}; expected 1 to {_MOST_LAYERS}")
    if initial_state not in ("learned", "zero"):
        raise ConfigError(
            f"initial_state: {initial_state!r} is not known; choose 'learned' or 'zero'"
        )


class GRUBackbone(nn.Module):
    """A stack of gated recurrent units (Cho et al. 2014), as in Pavllo et al. 2018, section 3.1.

    Args:
        input_dim: numbers a frame.
        hidden: units a layer.
        layers: how many layers; each reads the one below.
        initial_state: ``learned``: one trained vector a layer, the same for every sequence, drawn
            from a normal distribution with standard deviation 0.01; ``zero``: zeros.
    """

    def __init__(
        self,
        input_dim: int,
        hidden: int = 1000,
        layers: int = 2,
        initial_state: Literal["learned", "zero"] = "learned",
    ) -> None:
        super().__init__()
        check_stack(layers, initial_state)
        self.gru = nn.GRU(input_dim, hidden, layers, batch_first=True)
        self.first: nn.Parameter | None = None
        if initial_state == "learned":
            self.first = nn.Parameter(torch.empty(layers, hidden))
        self._layers: tuple[object, list[GRULayer]] | None = None
        self.reset_parameters()

    @property
    def context_dim(self) -> int:
        """Size of the summary: the units of the last layer."""
        return self.gru.hidden_size

    def reset_parameters(self, generator: torch.Generator | None = None) -> None:
        """Draw all weights anew: PyTorch's uniform; the first state from N(0, 0.01)."""
        bound = 1 / math.sqrt(self.gru.hidden_size)
        for weight in self.gru.parameters():
            nn.init.uniform_(weight, -bound, bound, generator=generator)
        if self.first is not None:
            nn.init.normal_(self.first, std=0.01, generator=generator)

    def initial_state(self, batch: int) -> State:
        """One tensor (batch, hidden) a layer."""
        self._layers = None
        if self.first is not None:
            return tuple(layer.expand(batch, -1) for layer in self.first)
        zero = next(self.gru.parameters()).new_zeros(batch, self.gru.hidden_size)
        return (zero,) * self.gru.num_layers

    def forward(self, frames: Float[Tensor, "batch frames inputs"], state: State) -> Summary:
        """Read frames, the oldest first."""
        if frames.shape[1] == 1 and torch.compiler.is_compiling():
            return self._read_one(frames, state)  # compilers see through cells, not into layers
        if frames.device.type != "cpu" or torch.compiler.is_compiling():
            context, stacked = self.gru(frames, torch.stack(state))
            return Summary(context, tuple(stacked.unbind(0)))
        if self._kernel_pays(frames, state):
            return self._read_by_kernel(frames, state)
        if frames.shape[1] == 1:
            return self._read_one(frames, state)
        context, stacked = self.gru(frames, torch.stack(state))
        return Summary(context, tuple(stacked.unbind(0)))

    def _kernel_pays(self, frames: Tensor, state: State) -> bool:
        """Whether ``gru_kernel`` is faster than PyTorch's own loop."""
        if self.gru.hidden_size < _LEAST_UNITS:
            return False
        if torch.is_grad_enabled():
            tensors = (frames, *state, *self.gru.parameters())
            if any(tensor.requires_grad for tensor in tensors):
                return True
        return packing_pays(len(frames), like=frames)

    def _read_one(self, frames: Tensor, state: State) -> Summary:
        """Read a single frame; the same as ``self.gru`` with less around it."""
        after: list[Tensor] = []
        context = frames[:, 0]
        for before, weights in zip(state, self.gru.all_weights, strict=True):
            context = torch.gru_cell(context, before, *weights)
            after.append(context)
        return Summary(context[:, None], tuple(after))

    def _read_by_kernel(self, frames: Tensor, state: State) -> Summary:
        """Read frames with ``gru_kernel``."""
        context = frames.transpose(0, 1).contiguous()
        last: list[Tensor] = []
        for layer, before in zip(self._current_layers(), state, strict=True):
            context, after = layer(context, before)
            last.append(after)
        return Summary(context.transpose(0, 1), tuple(last))

    def _current_layers(self) -> list[GRULayer]:
        """The layers with the weights as they are: kept for as long as those do not change.

        They are also made anew for every ``initial_state``, in case weights were changed in a way
        that PyTorch does not count, through ``data``.
        """
        weights = list(self.gru.parameters())
        counts = tuple(0 if weight.is_inference() else weight._version for weight in weights)
        places = tuple(weight.data_ptr() for weight in weights)
        key = (torch.is_grad_enabled(), torch.is_inference_mode_enabled(), counts, places)
        if self._layers is None or self._layers[0] != key:
            self._layers = (key, [GRULayer(*four) for four in self.gru.all_weights])
        return self._layers[1]

    def __getstate__(self) -> dict[str, object]:
        """A copy starts without the layers kept here."""
        return {**super().__getstate__(), "_layers": None}
