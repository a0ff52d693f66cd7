"""The discriminator: from the features of frames to whether somebody really moved like that."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor, nn

from posecast.errors import ConfigError
from posecast.model.head import reset_linear
from posecast.model.recurrent import GRUBackbone


class Discriminator(nn.Module):
    """Reads a motion to its end, then says once how real it looks (Gui et al. 2018).

    A linear layer with rectified units, one layer of gated recurrent units that starts at zeros,
    and a linear layer on its last state. It draws nothing, so that training with it beside a
    forecaster leaves the forecaster's own draws alone.

    Args:
        feature_dim: numbers a frame.
        hidden: units of the first linear layer and of the recurrent one.

    Raises:
        ConfigError: no units.
    """

    def __init__(self, feature_dim: int, hidden: int = 1024) -> None:
        super().__init__()
        if hidden < 1:
            raise ConfigError(f"hidden is {hidden}; expected 1 or more")
        self.input = nn.Linear(feature_dim, hidden)
        self.recurrent = GRUBackbone(hidden, hidden, layers=1, initial_state="zero")
        self.output = nn.Linear(hidden, 1)

    def reset_parameters(self, generator: torch.Generator | None = None) -> None:
        """Draw all weights anew, as PyTorch does, from ``generator`` (``None``: its own)."""
        reset_linear(self.input, generator)
        self.recurrent.reset_parameters(generator)
        reset_linear(self.output, generator)

    def forward(self, frames: Float[Tensor, "batch frames features"]) -> Float[Tensor, " batch"]:
        """The logit of the probability that the frames are true ones, the oldest first."""
        inputs = torch.relu(self.input(frames))
        context, _ = self.recurrent(inputs, self.recurrent.initial_state(len(frames)))
        return self.output(context[:, -1])[:, 0]
