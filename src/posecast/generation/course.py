"""Course: a path with a pace, and when each place of it is reached."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import torch
from jaxtyping import Float
from torch import Tensor

from posecast.errors import ConfigError
from posecast.motion.path import Path
from posecast.motion.tracks import FACING, SPEED, STEP_RATE

TIME = "time"
"""Track of a path: seconds from its start to the place."""


@dataclass(frozen=True, eq=False)
class Course:
    """What is followed: a path with tracks of speed, step rate, time and facing.

    Args:
        path: with the scalar tracks ``speed`` (m/s, positive), ``step_rate`` (rad/s) and ``time``
            (s, ascending), and the directions ``facing``.

    Raises:
        ConfigError: a track is missing, or time stands still.
    """

    path: Path

    def __post_init__(self) -> None:
        there = {*self.path.scalars, *self.path.directions}
        missing = [name for name in (SPEED, STEP_RATE, TIME, FACING) if name not in there]
        if missing:
            raise ConfigError(
                f"the path has no {' and no '.join(missing)}; give it a pace first "
                "(generation.annotate)"
            )
        if not (self.path.scalars[TIME].diff() > 0).all():
            raise ConfigError("time stands still along the path; expected every speed above 0")

    @cached_property
    def _lap(self) -> float:
        """Seconds for all of the path; of a closed one, once around."""
        time, path = self.path.scalars[TIME], self.path
        if not path.closed:
            return float(time[-1])
        speed = path.scalars[SPEED]
        return float(time[-1]) + 2 * path.spacing / float(speed[-1] + speed[0])

    @property
    def duration(self) -> float:
        """Seconds from the start to the end; of a closed path, once around."""
        return self._lap

    def distance(self, time: Float[Tensor, "*times"]) -> Float[Tensor, "*times"]:
        """Arc length reached after some seconds, metres.

        Before the start, and beyond the end of an open path, the pace there goes on.
        """
        times, places = self.path.scalars[TIME], self.path.distances
        laps = torch.zeros_like(time)
        if self.path.closed:
            laps = torch.floor(time / self._lap)
            end = times.new_tensor([self._lap])
            times = torch.cat([times, end])
            places = torch.cat([places, places.new_tensor([self.path.length])])
        within = time - laps * self._lap
        after = torch.searchsorted(times, within.contiguous()).clamp(1, len(times) - 1)
        span = times[after] - times[after - 1]
        share = (within - times[after - 1]) / span
        found = places[after - 1] + share * (places[after] - places[after - 1])
        return found + laps * self.path.length

    def arrival(self, distance: Float[Tensor, "*places"]) -> Float[Tensor, "*places"]:
        """Seconds after which some arc lengths of the path are reached."""
        return self.path.scalar(TIME, distance)


def timed(path: Path) -> Course:
    """A course that walks a path at the speeds it has, from its first point on.

    Args:
        path: with the tracks ``speed``, ``step_rate`` and ``facing``.
    """
    if SPEED not in path.scalars:
        raise ConfigError("the path has no track 'speed', m/s; give it one")
    speed = path.scalars[SPEED]
    spans = 2 * path.spacing / (speed[1:] + speed[:-1])
    return Course(path.with_scalar(TIME, torch.cat([speed.new_zeros(1), spans.cumsum(0)])))
