"""Paths on the floor by arc length: straight, arc, s-curve, figure eight, corners, wandering."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import chain, cycle, repeat
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from posecast.corpora.gait.signals import Sampled, Wobble, smooth

SAMPLES_PER_METER = 100
"""Resolution of a path."""


class Place(NamedTuple):
    """Where a path is at some arc lengths, and how it goes on there.

    Args:
        position: x and z, metres.
        heading: direction of the path, radians from +z towards +x, not wrapped.
        curvature: change of heading by arc length, 1/m; positive towards +x, the left hand.
    """

    position: Float[ndarray, "places 2"]
    heading: Float[ndarray, " places"]
    curvature: Float[ndarray, " places"]


@dataclass(frozen=True, eq=False)
class Path:
    """A smooth curve; arc length 0 lies at the origin of the floor, negative ones before it."""

    curve: Sampled

    def at(self, distance: Float[ndarray, " places"]) -> Place:
        """Read the curve at some arc lengths, in metres."""
        values = self.curve(distance)
        return Place(values[:, :2], values[:, 2], values[:, 3])

    @property
    def distances(self) -> Float[ndarray, " samples"]:
        """Arc lengths at which the curve is sampled, metres."""
        return self.curve.start + np.arange(len(self.curve.values)) / self.curve.rate


class Piece(NamedTuple):
    """A stretch of constant curvature: metres, 1/m."""

    length: float
    curvature: float


def draw_path(
    kind: str, generator: np.random.Generator, *, before: float, ahead: float, scale: float
) -> Path:
    """Draw a path of some kind, with a random first heading.

    Args:
        kind: one of ``PATHS``.
        before, ahead: metres of path needed before and after arc length 0.
        scale: typical radius of a gentle curve, metres: larger for fast runners.
    """
    heading = generator.uniform(-np.pi, np.pi)
    offset = generator.uniform(0.0, 2.0) * scale
    meander = Wobble.draw(generator, 0.03 / scale, 0.25 / scale)
    count = int(np.ceil((before + ahead) * SAMPLES_PER_METER)) + 1
    distances = np.arange(count) / SAMPLES_PER_METER
    curvature = _follow(PATHS[kind](generator, scale), distances + offset)
    softness = 0.10 if kind == "corners" else 0.16
    curvature = smooth(curvature, softness * scale * SAMPLES_PER_METER)
    curvature += (0.20 if kind == "wandering" else 0.02) / scale * meander(distances)
    headings = _integrate(curvature)
    headings += heading - np.interp(before, distances, headings)
    positions = _integrate(np.stack([np.sin(headings), np.cos(headings)], axis=-1))
    positions -= [np.interp(before, distances, axis) for axis in positions.T]
    values = np.concatenate([positions, headings[:, None], curvature[:, None]], axis=-1)
    return Path(Sampled(-before, SAMPLES_PER_METER, values))


def _integrate(
    values: Float[ndarray, "samples *channels"],
) -> Float[ndarray, "samples *channels"]:
    """Integral over arc length from the first sample (trapezoids)."""
    areas = (values[1:] + values[:-1]) / (2 * SAMPLES_PER_METER)
    return np.concatenate([np.zeros_like(values[:1]), np.cumsum(areas, axis=0)])


def _follow(
    pieces: Iterator[Piece], distances: Float[ndarray, " samples"]
) -> Float[ndarray, " samples"]:
    """Curvature at each arc length, taking as many pieces as it needs."""
    ends, curvatures = [0.0], []
    while ends[-1] <= distances[-1]:
        piece = next(pieces)
        ends.append(ends[-1] + piece.length)
        curvatures.append(piece.curvature)
    return np.array(curvatures)[np.searchsorted(ends, distances, side="right") - 1]


def _straight(generator: np.random.Generator, scale: float) -> Iterator[Piece]:
    return repeat(Piece(scale, 0.0))


def _arc(generator: np.random.Generator, scale: float) -> Iterator[Piece]:
    radius = scale * generator.uniform(0.8, 2.0) * generator.choice([-1, 1])
    return chain([Piece(2.5 * scale, 0.0)], repeat(Piece(scale, 1 / radius)))


def _s_curve(generator: np.random.Generator, scale: float) -> Iterator[Piece]:
    side = generator.choice([-1, 1])
    for sign in cycle((side, -side)):
        radius, angle = scale * generator.uniform(0.7, 1.3), generator.uniform(0.9, 2.2)
        yield Piece(radius * angle, sign / radius)
        yield Piece(scale * generator.uniform(0.1, 0.6), 0.0)


def _eight(generator: np.random.Generator, scale: float) -> Iterator[Piece]:
    """Two loops of three quarters of a circle, joined by straight lines that cross."""
    side, radius = generator.choice([-1, 1]), 0.75 * scale
    for sign in cycle((side, -side)):
        yield Piece(2 * radius, 0.0)
        yield Piece(1.5 * np.pi * radius, sign / radius)


def _corners(generator: np.random.Generator, scale: float) -> Iterator[Piece]:
    """Straight lines with turns on the spot, almost: a third of the usual radius."""
    while True:
        yield Piece(scale * generator.uniform(0.9, 1.8), 0.0)
        radius, angle = 0.30 * scale * generator.uniform(0.85, 1.25), generator.uniform(0.9, 2.7)
        yield Piece(radius * angle, generator.choice([-1, 1]) / radius)


PATHS: dict[str, Callable[[np.random.Generator, float], Iterator[Piece]]] = {
    "straight": _straight,
    "arc": _arc,
    "s-curve": _s_curve,
    "eight": _eight,
    "corners": _corners,
    "wandering": _straight,
}
"""Kinds of paths: what each draws as a sequence of pieces."""
