"""Controls: what steers a forecaster, prepared for its backbone."""

from __future__ import annotations

from itertools import pairwise

import torch
from jaxtyping import Float
from torch import Tensor, nn

from posecast.model.head import reset_linear


class ControlLayers(nn.Module):
    """Linear layers, each followed by a leaky rectification (Pavllo et al. 2020, section 3.4).

    Args:
        input_dim: controls a frame.
        hidden: units of every layer.
        layers: how many layers.
        slope: of the rectification, for negative values.
    """

    def __init__(
        self, input_dim: int, *, hidden: int = 30, layers: int = 2, slope: float = 0.05
    ) -> None:
        super().__init__()
        self.input_dim = input_dim
        self.output_dim = hidden
        self.slope = slope
        sizes = [input_dim] + [hidden] * layers
        self.layers = nn.ModuleList(nn.Linear(below, above) for below, above in pairwise(sizes))

    def reset_parameters(self, generator: torch.Generator | None = None) -> None:
        """Draw all weights anew, as PyTorch does."""
        for layer in self.layers:
            reset_linear(layer, generator)

    def forward(
        self, controls: Float[Tensor, "*batch controls"]
    ) -> Float[Tensor, "*batch outputs"]:
        """What the backbone reads beside the features."""
        for layer in self.layers:
            controls = nn.functional.leaky_relu(layer(controls), self.slope)
        return controls
