"""A convolutional backbone: dilated convolutions in time that see no later frame."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor, nn

from posecast.errors import ConfigError
from posecast.model.head import reset_linear
from posecast.model.products import linear
from posecast.model.recurrent import State, Summary

_MOST_FRAMES = 100_000
"""A state of more would not fit into memory; no recording is as long."""


class ConvolutionalBackbone(nn.Module):
    """Causal convolutions over frames ever farther apart (Pavllo et al. 2020).

    Layer k reads ``widths[k]`` frames that are ``dilations[k]`` apart, the newest last; rectified
    units follow all layers but the last. Every other layer, the second first, adds to what it read
    last, so that gradients have a way around it. The last layer is the head: what it reads is the
    context, ``widths[-1]`` frames side by side, so that with a dense head the network has no layer
    more than that of the paper, and any other head can take its place.

    Before the first frame there are zeros. What the paper leaves open, the activation and where the
    skip connections begin, is as said here.

    Args:
        input_dim: numbers a frame.
        channels: units a layer, 1024 as published.
        widths: frames that each layer reads; (2, 2, 2, 2, 2) as published. The last one decides the
            receptive field: with 1, 2, 3 it is 16, 32, 48 frames.
        dilations: how many frames apart they are, for each layer.

    Raises:
        ConfigError: no layers, unequally many widths and dilations, or one below 1.
    """

    def __init__(
        self,
        input_dim: int,
        channels: int = 1024,
        widths: tuple[int, ...] | list[int] = (2, 2, 2, 2, 2),
        dilations: tuple[int, ...] | list[int] = (1, 2, 4, 8, 16),
    ) -> None:
        super().__init__()
        if channels < 1:
            raise ConfigError(f"channels: {channels}; expected 1 or more")
        if not widths or len(widths) != len(dilations):
            raise ConfigError(
                f"widths: {len(widths)} layers, dilations: {len(dilations)}; give both for every "
                "layer, and one layer or more"
            )
        if min(*widths, *dilations) < 1:
            raise ConfigError(
                f"widths {list(widths)}, dilations {list(dilations)}; expected 1 or more of each"
            )
        self.widths, self.dilations = tuple(widths), tuple(dilations)
        if self.receptive_field > _MOST_FRAMES:
            raise ConfigError(
                f"widths and dilations make a receptive field of {self.receptive_field} frames; "
                f"expected at most {_MOST_FRAMES}"
            )
        self.sizes = (input_dim, *(channels,) * (len(widths) - 1))
        self.layers = nn.ModuleList(
            nn.Linear(width * size, channels)
            for width, size in zip(self.widths[:-1], self.sizes[:-1], strict=True)
        )

    @property
    def context_dim(self) -> int:
        """Size of the summary: what the last layer reads."""
        return self.widths[-1] * self.sizes[-1]

    @property
    def receptive_field(self) -> int:
        """Frames that the context depends on."""
        return 1 + sum(self._reach)

    @property
    def _reach(self) -> tuple[int, ...]:
        """How many frames each layer looks back."""
        pairs = zip(self.widths, self.dilations, strict=True)
        return tuple((width - 1) * dilation for width, dilation in pairs)

    def reset_parameters(self, generator: torch.Generator | None = None) -> None:
        """Draw all weights anew, as PyTorch does."""
        for layer in self.layers:
            reset_linear(layer, generator)

    def initial_state(self, batch: int) -> State:
        """For each layer the frames it looks back on: zeros."""
        like = next(self.layers.parameters(), torch.empty(0))
        return tuple(
            like.new_zeros(batch, reach, size)
            for reach, size in zip(self._reach, self.sizes, strict=True)
        )

    def forward(self, frames: Float[Tensor, "batch frames inputs"], state: State) -> Summary:
        """Read frames, the oldest first."""
        after: list[Tensor] = []
        for number, past in enumerate(state):
            seen = torch.cat([past.to(frames), frames], dim=1)
            after.append(seen[:, seen.shape[1] - past.shape[1] :])
            taps = self._taps(seen, number, frames.shape[1])
            if number == len(self.layers):
                return Summary(taps, tuple(after))
            layer = self.layers[number]
            assert isinstance(layer, nn.Linear)
            made = linear(taps, layer.weight, layer.bias).relu()
            frames = frames + made if number % 2 else made
        raise AssertionError("a state has one part for every layer")

    def _taps(self, seen: Tensor, number: int, frames: int) -> Tensor:
        """What a layer reads for each of the newest frames, side by side."""
        width, dilation = self.widths[number], self.dilations[number]
        taps = [seen[:, tap * dilation : tap * dilation + frames] for tap in range(width)]
        return torch.cat(taps, dim=-1) if width > 1 else taps[0]
