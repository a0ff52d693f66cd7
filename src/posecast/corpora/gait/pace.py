"""Pace: which speed somebody intends, and how they travel a path with it, slowing in bends."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from posecast.corpora.gait.path import Path
from posecast.corpora.gait.signals import Sampled, Wobble, smooth, smooth_cover, step

GRAVITY = 9.81
"""m/s^2."""

GRID_RATE = 120
"""Samples per second of everything that is planned ahead of the frames; not the frame rate."""


class Change(NamedTuple):
    """From ``begin`` on, for ``seconds``, the intended speed goes smoothly to ``speed`` (m/s)."""

    begin: float
    seconds: float
    speed: float


@dataclass(frozen=True)
class Program:
    """The speed somebody intends, as a first speed in m/s and changes of it in order of time."""

    first: float
    changes: tuple[Change, ...] = ()

    def speed(self, times: Float[ndarray, " times"]) -> Float[ndarray, " times"]:
        """Intended speed, m/s; exactly zero while standing."""
        speeds = np.full_like(times, self.first)
        level = self.first
        for change in self.changes:
            speeds += (change.speed - level) * step((times - change.begin) / change.seconds)
            level = change.speed
        resting = np.zeros_like(times, dtype=bool)
        for begin, end in self.rests():
            resting |= (times >= begin) & (times <= end)
        return np.where(resting, 0.0, np.maximum(speeds, 0.0))

    def rests(self) -> list[tuple[float, float]]:
        """Stretches of standing still, as (begin, end) in seconds; both may be infinite."""
        found: list[tuple[float, float]] = []
        since, level = -np.inf, self.first
        for change in self.changes:
            if level == 0.0 and change.speed > 0.0:
                found.append((since, change.begin))
            since, level = change.begin + change.seconds, change.speed
        if level == 0.0:
            found.append((since, np.inf))
        return found


@dataclass(frozen=True, eq=False)
class Journey:
    """A path travelled over time.

    Args:
        path: where it leads.
        times: the planning grid, seconds; frame 0 of a clip lies at 0.
        distance: arc length travelled, metres, by time.
        speed: its rate, m/s, by time.
        rests: stretches of standing still, in seconds.
    """

    path: Path
    times: Float[ndarray, " grid"]
    distance: Sampled
    speed: Sampled
    rests: Sequence[tuple[float, float]]

    def sampled(self, values: Float[ndarray, "grid *channels"]) -> Sampled:
        """A curve from values on the planning grid."""
        return Sampled(float(self.times[0]), GRID_RATE, values)


def planning_times(seconds: float, margin: float) -> Float[ndarray, " grid"]:
    """The planning grid of a clip: its duration and a margin on both sides."""
    edge = int(np.ceil(margin * GRID_RATE))
    return np.arange(-edge, int(np.ceil(seconds * GRID_RATE)) + edge + 1) / GRID_RATE


def travel(
    path: Path,
    program: Program,
    times: Float[ndarray, " grid"],
    *,
    restlessness: Wobble,
    sideways: float,
) -> Journey:
    """Follow a path at the intended speed, slower where it bends.

    With intended speed p(t) and the bends' factor c(s), the speed is p(t) c(s): the integral of
    ds / c(s) over the way equals the integral of p(t) over the time.

    Args:
        restlessness: relative variation of the speed over time, small.
        sideways: the largest comfortable sideways acceleration, m/s^2.
    """
    intended = program.speed(times) * np.exp(0.045 * restlessness(times))
    distances = path.distances
    factor = _bends(path, sideways, float(intended.max()))
    cost = np.concatenate([[0.0], np.cumsum((1 / factor[1:] + 1 / factor[:-1]) / 2)])
    cost /= path.curve.rate
    progress = np.concatenate([[0.0], np.cumsum((intended[1:] + intended[:-1]) / 2)]) / GRID_RATE
    progress += np.interp(0.0, distances, cost) - np.interp(0.0, times, progress)
    distance = np.interp(progress, cost, distances)
    speed = intended * np.interp(distance, distances, factor)
    start = float(times[0])
    return Journey(
        path,
        times,
        Sampled(start, GRID_RATE, distance),
        Sampled(start, GRID_RATE, speed),
        program.rests(),
    )


def _bends(path: Path, sideways: float, speed: float) -> Float[ndarray, " samples"]:
    """Factor on the speed along a path, 1 where it is straight; smooth, and early enough."""
    curvature = path.at(path.distances).curvature
    limit = np.sqrt(sideways / np.maximum(np.abs(curvature), 1e-9)) / speed
    slower = np.maximum(0.0, 1 - limit)
    ahead = round(0.25 * speed * path.curve.rate)
    return 1 - smooth(smooth_cover(slower, max(ahead, 1)), max(0.06 * speed * path.curve.rate, 1.0))
