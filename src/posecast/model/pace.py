"""The pace network: from the shape of a path to speed, step rate and facing along it."""

from __future__ import annotations

from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor, nn

from posecast.errors import ConfigError
from posecast.model.head import reset_linear

INPUTS = ("curvature", "average_speed")
"""Read at every point of a path; the texts speak of the curvature alone, the code reads both."""

OUTPUTS = ("speed", "step_rate", "facing_cos", "facing_sin")
"""Said of every point; facing is the angle from the path's direction."""

_INITIAL_DEVIATION = 0.01
"""Of the learned first state."""


class PaceState(NamedTuple):
    """What a delayed network remembers of the points it has read.

    Args:
        hidden: of its recurrent layer.
        read: how many points.
    """

    hidden: Float[Tensor, "1 batch hidden"]
    read: int


class PaceNetwork(nn.Module):
    """A gated recurrent layer along a path, point by point, and a linear one.

    Inputs and outputs are numbers of about one: whoever trains it scales them.

    Args:
        hidden: units, in each direction.
        delay: ``None``: the layer runs along the whole path in both directions. Otherwise it runs
            forwards only and speaks of a point that many points later: a path may still grow. Past
            its end it reads learned tokens.

    Raises:
        ConfigError: no units, or a negative delay.

    Source: Pavllo et al. 2018, section 3.4, and 2020, section 3.7; sizes of the code: 30 units,
    6424 parameters, and with a delay of 100 points 3216.
    """

    def __init__(self, *, hidden: int = 30, delay: int | None = None) -> None:
        super().__init__()
        if hidden < 1 or (delay is not None and delay < 0):
            raise ConfigError(
                f"hidden is {hidden} and delay is {delay}; expected a unit or more, and no "
                "negative delay"
            )
        self.delay = delay
        both = delay is None
        self.recurrent = nn.GRU(len(INPUTS), hidden, batch_first=True, bidirectional=both)
        self.initial = nn.Parameter(torch.zeros(2 if both else 1, hidden))
        self.end = None if both else nn.Parameter(torch.zeros(len(INPUTS)))
        self.output = nn.Linear(hidden * (2 if both else 1), len(OUTPUTS))
        self.reset_parameters()

    def reset_parameters(self, generator: torch.Generator | None = None) -> None:
        """Draw all weights anew, as PyTorch does; the first state is N(0, 0.01), the token 0."""
        bound = self.recurrent.hidden_size**-0.5
        with torch.no_grad():
            for weight in self.recurrent.parameters():
                weight.uniform_(-bound, bound, generator=generator)
            self.initial.normal_(0, _INITIAL_DEVIATION, generator=generator)
            if self.end is not None:
                self.end.zero_()
        reset_linear(self.output, generator)

    def forward(
        self, points: Float[Tensor, "batch points inputs"]
    ) -> Float[Tensor, "batch points outputs"]:
        """The pace at every point of whole paths."""
        first = self.initial[:, None].expand(-1, len(points), -1).contiguous()
        if self.end is not None and self.delay is not None:
            tokens = self.end.expand(len(points), self.delay, -1)
            points = torch.cat([points, tokens], dim=1)
        read, _ = self.recurrent(points, first)
        return self.output(read[:, self.delay or 0 :])

    def start(self, batch: int) -> PaceState:
        """Before a path is read point by point.

        Raises:
            ConfigError: the network needs the whole path.
        """
        if self.delay is None:
            raise ConfigError(
                "this pace network reads the whole path at once; take a delayed one for paths that "
                "grow"
            )
        return PaceState(self.initial[:, None].expand(-1, batch, -1).contiguous(), 0)

    def read(
        self, points: Float[Tensor, "batch points inputs"], state: PaceState, *, ends: bool = False
    ) -> tuple[Float[Tensor, "batch _ outputs"], PaceState]:
        """Read on: the pace at the points that can be spoken of now.

        Args:
            points: those that follow the ones read so far, any number.
            state: from ``start``, or from the call before.
            ends: whether the path ends here, so that all that is left is said.
        """
        assert self.delay is not None, "only start gives a state"
        assert self.end is not None
        if ends:
            points = torch.cat([points, self.end.expand(len(points), self.delay, -1)], dim=1)
        count = points.shape[1]
        if not count:
            return self.output(points.new_zeros(len(points), 0, self.output.in_features)), state
        read, hidden = self.recurrent(points, state.hidden)
        silent = min(max(self.delay - state.read, 0), count)
        return self.output(read[:, silent:]), PaceState(hidden, state.read + count)
