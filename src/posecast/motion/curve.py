"""Curves on the floor through way points: straight lines, or the cubic spline of chord length."""

from __future__ import annotations

import math
from os import PathLike
from typing import NamedTuple

import torch
from jaxtyping import Float, Int
from torch import Tensor

from posecast.errors import DataError
from posecast.motion.path_checks import check_finite, check_size, check_waypoints

SAMPLES = 16
"""Samples of a smooth curve from one point of a path to the next: their chords add up to the arc
length less a millionth, or a smaller part of it, at any radius above 13 times the spacing."""

_ROUNDS = 60
"""Of the iteration for a spline's bends, each of which at least halves the error."""


class Curve(NamedTuple):
    """A polyline so fine that it is the curve.

    Args:
        samples: (x, z), metres; of a closed curve the last is the first again.
        distances: arc length of each sample, metres.
        knots: which samples are way points.
    """

    samples: Float[Tensor, "samples 2"]
    distances: Float[Tensor, " samples"]
    knots: Int[Tensor, " knots"]

    @property
    def length(self) -> float:
        """Metres."""
        return float(self.distances[-1])

    def read(self, distances: Float[Tensor, " places"]) -> Float[Tensor, "places 2"]:
        """Positions at some arc lengths; beyond the end straight on in the last direction."""
        last = len(self.samples) - 2
        before = torch.searchsorted(self.distances, distances, right=True).sub(1).clamp(0, last)
        start, step = self.distances[before], self.distances[before + 1] - self.distances[before]
        # Samples share an arc length where a recording stands still.
        fraction = (distances - start) / torch.where(step > 0, step, 1)
        return self.samples[before] + fraction[:, None] * (
            self.samples[before + 1] - self.samples[before]
        )


class Laid(NamedTuple):
    """Equal segments laid along a curve: see ``Path``."""

    points: Float[Tensor, "points 2"]
    spacing: float
    marks: Float[Tensor, " marks"]


def lay(curve: Curve, *, spacing: float, closed: bool) -> Laid:
    """As many equal segments as fit a curve, ``spacing`` long or a little shorter."""
    steps = max(math.ceil(curve.length / spacing - 1e-9), 3 if closed else 1)
    spacing = curve.length / steps
    order = torch.arange(steps + (not closed), device=curve.samples.device)
    return Laid(curve.read(order.double() * spacing), spacing, curve.distances[curve.knots])


def draw_curve(
    where: str | PathLike[str],
    waypoints: Float[Tensor, "waypoints 2"],
    *,
    closed: bool,
    straight: bool,
    spacing: float,
    direction: Float[Tensor, "2"] | None = None,
) -> Curve:
    """Draw the curve of a path through way points: see ``Path.through``.

    Args:
        where: what errors name.
        direction: unit vector in which a smooth curve begins; ``None``: as it likes.

    Raises:
        DataError: way points through which no curve can be drawn.
    """
    waypoints = waypoints.detach().double()
    check_waypoints(where, waypoints, closed=closed)
    lines = straight_curve(waypoints, closed=closed)
    check_size(where, lines.length, spacing)
    if straight:
        return lines
    return smooth_curve(waypoints, closed=closed, spacing=spacing, direction=direction)


def draw_track(
    where: str | PathLike[str],
    positions: Float[Tensor, "frames 2"],
    *,
    closed: bool,
    spacing: float,
) -> Curve:
    """Draw the curve of a path along a recorded track: see ``Path.along``.

    Args:
        where: what errors name.

    Raises:
        DataError: a track that never moves, or is nowhere.
    """
    check_finite(where, positions, kind="position")
    curve = straight_curve(positions.detach().double(), closed=closed)
    check_size(where, curve.length, spacing)
    if not curve.length > 0:
        raise DataError(where, "never moves, expected a track that leads somewhere")
    return curve


def lead_on(
    points: Float[Tensor, "points 2"],
    waypoints: Float[Tensor, "waypoints 2"],
    *,
    spacing: float,
    straight: bool,
) -> Laid:
    """The points that come after the last one of a path, and arc lengths from there to the new way
    points: see ``Path.extend``."""
    way = points[-1] - points[-2]
    curve = draw_curve(
        "path",
        torch.cat([points[-1:], waypoints.to(points)]),
        closed=False,
        straight=straight,
        spacing=spacing,
        direction=torch.nn.functional.normalize(way, dim=0),
    )
    count = math.ceil(curve.length / spacing - 1e-9)
    order = torch.arange(1, count + 1, device=points.device)
    marks = curve.distances[curve.knots[1:]]
    return Laid(curve.read(order.to(points) * spacing), spacing, marks)


def polyline(samples: Float[Tensor, "samples 2"], knots: Int[Tensor, " knots"]) -> Curve:
    """The curve along some samples."""
    steps = (samples[1:] - samples[:-1]).norm(dim=-1)
    return Curve(samples, torch.cat([steps.new_zeros(1), steps.cumsum(0)]), knots)


def straight_curve(waypoints: Float[Tensor, "waypoints 2"], *, closed: bool) -> Curve:
    """Way points joined by straight lines."""
    samples = torch.cat([waypoints, waypoints[:1]]) if closed else waypoints
    return polyline(samples, torch.arange(len(waypoints), device=samples.device))


def smooth_curve(
    waypoints: Float[Tensor, "waypoints 2"],
    *,
    closed: bool,
    spacing: float,
    direction: Float[Tensor, "2"] | None = None,
) -> Curve:
    """Way points joined by the cubic spline whose parameter is the length of the chords.

    Position, tangent and curvature are continuous, at the seam of a closed curve too. The ends of
    an open one are free: not curved.

    Args:
        waypoints: (x, z), metres; neighbours must differ.
        closed: whether the last is joined to the first.
        spacing: of the points that are wanted, metres; the curve is sampled more finely.
        direction: unit vector in which the curve begins; ``None``: the end is free.

    Source: Floater & Surazhsky 2006: with this parameter, and not with a uniform or centripetal
    one, the spline comes as near to the curve behind unevenly spaced points as to that behind even
    ones, with the fourth power of their distance.
    """
    knots = torch.cat([waypoints, waypoints[:1]]) if closed else waypoints
    chords = knots[1:] - knots[:-1]
    spans = chords.norm(dim=-1)
    bends = _bends(chords / spans[:, None], spans, closed=closed, direction=direction)
    counts = (spans * (SAMPLES / spacing)).ceil().clamp(min=SAMPLES).long()
    firsts = torch.cat([counts.new_zeros(1), counts.cumsum(0)])
    piece = torch.arange(len(counts), device=counts.device).repeat_interleave(counts)
    steps = torch.arange(len(piece), device=counts.device) - firsts[piece]
    after = (steps / counts[piece].to(spans))[:, None]
    before = 1 - after
    bent = (before**3 - before) * bends[piece] + (after**3 - after) * bends[piece + 1]
    samples = before * knots[piece] + after * knots[piece + 1]
    samples = samples + spans[piece, None] ** 2 / 6 * bent
    return polyline(torch.cat([samples, knots[-1:]]), firsts[: len(waypoints)])


def _bends(
    slopes: Float[Tensor, "spans 2"],
    spans: Float[Tensor, " spans"],
    *,
    closed: bool,
    direction: Float[Tensor, "2"] | None,
) -> Float[Tensor, "knots 2"]:
    """Second derivatives of the spline at its knots.

    A knot's own bend weighs twice as much in its equation as those of both neighbours together, so
    Jacobi's iteration halves the error each round, however uneven the spans are.
    """
    if closed:
        before, after, turns = spans.roll(1), spans, slopes - slopes.roll(1, 0)
    else:
        if direction is not None:  # As if a span of no length came before, with that slope.
            slopes = torch.cat([direction[None], slopes])
            spans = torch.cat([spans.new_zeros(1), spans])
        before, after, turns = spans[:-1], spans[1:], slopes[1:] - slopes[:-1]
    own = 2 * (before + after)[:, None]
    before, after = before[:, None], after[:, None]
    bends = torch.zeros_like(turns)
    for _ in range(_ROUNDS):
        left, right = bends.roll(1, 0), bends.roll(-1, 0)
        if not closed:  # What comes around is beyond an end, where nothing bends.
            left, right = torch.cat([0 * left[:1], left[1:]]), torch.cat([right[:-1], 0 * left[:1]])
        bends = (6 * turns - before * left - after * right) / own
    if closed:
        return torch.cat([bends, bends[:1]])
    end = bends.new_zeros(1, 2)
    return torch.cat([bends, end]) if direction is not None else torch.cat([end, bends, end])
