"""Giving a path a pace: speed, step rate and facing along it, and times of arrival."""

from __future__ import annotations

import math
from collections.abc import Mapping

import torch
from jaxtyping import Float
from torch import Tensor

from posecast.errors import ConfigError, DataError
from posecast.generation.course import TIME, Course, timed
from posecast.generation.gait_table import GaitTable
from posecast.motion.path import Path
from posecast.motion.tracks import FACING, SPEED, STEP_RATE, turned_on_floor

CALM = 0.7
"""Share of the largest usual acceleration that a pace made by hand asks for."""


def pace_by_hand(
    path: Path,
    table: GaitTable,
    *,
    speed: float | None = None,
    style: int = 0,
    facing: float | None = None,
    slow_in_curves: bool = True,
) -> Course:
    """A pace without a network: a wanted speed, slower in curves as far as the body asks for it.

    A track ``speed`` or ``facing`` that the path has already stays.

    Args:
        path: any.
        table: how the walker walks: what curves and changes of speed it takes.
        speed: m/s on straight stretches; ``None``: the middle of those the walker knows.
        style: row of the table.
        facing: where the body faces, radians from the path's direction towards the left hand;
            ``None``: along it.
        slow_in_curves: keep the acceleration towards the inside of curves, and along the path, to
            what is usual.

    Raises:
        ConfigError: a speed that is not positive, or a speed or facing beside the path's own.
    """
    for name, asked, own in ((SPEED, speed, path.scalars), (FACING, facing, path.directions)):
        if asked is not None and name in own:
            raise ConfigError(f"the path says its {name} itself; leave {name} out here or there")
    wanted = table.speeds[style].median().item() if speed is None else speed
    if not 0 < wanted < math.inf:
        raise ConfigError(f"speed is {wanted}: expected a positive number of metres a second")
    fast = path.scalars.get(SPEED, torch.full_like(path.distances, wanted))
    if slow_in_curves:
        sideways = CALM * float(table.sideways[style])
        allowed = (sideways / path.curvatures.abs().clamp_min(1e-9)).sqrt()
        slowest = float(table.speeds[style, 0])
        fast = torch.minimum(fast, allowed.clamp_min(min(slowest, float(fast.min()))))
        fast = gathered(fast, path, most=CALM * float(table.gathering[style]))
    path = path.with_scalar(SPEED, fast)
    path = path.with_scalar(STEP_RATE, table.step_rate(fast, style))
    if FACING not in path.directions:
        path = path.with_direction(FACING, turned_on_floor(path.tangents, facing or 0.0))
    return timed(path)


def gathered(
    speed: Float[Tensor, " points"], path: Path, *, most: float
) -> Float[Tensor, " points"]:
    """The highest speeds below those given that need no larger acceleration along the path.

    Args:
        speed: m/s.
        path: whose points they are at; around a closed one three times, so that the seam is
            as any place.
        most: m/s^2, positive.
    """
    laps = 3 if path.closed else 1
    squares = speed.square().repeat(laps).tolist()
    gain = 2 * most * path.spacing
    for order in (range(1, len(squares)), range(len(squares) - 2, -1, -1)):
        step = 1 if order.step > 0 else -1
        for place in order:
            squares[place] = min(squares[place], squares[place - step] + gain)
    middle = squares[len(speed) : 2 * len(speed)] if path.closed else squares
    return speed.new_tensor(middle).sqrt()


def arriving(
    course: Course, table: GaitTable, at: Mapping[float, float], *, style: int = 0
) -> Course:
    """The same course, each of some places reached at its time.

    Between two of them the pace is stretched evenly at first and last, smoothly on the way
    (monotone cubic in time), so that slow stretches stay slower than fast ones. Step rates follow
    the new speeds.

    Args:
        course: as it is without times.
        table: how fast the walker can be, and its step rates.
        at: arc length of a place, metres: seconds after the start.
        style: row of the table.

    Raises:
        DataError: times that do not ascend with the places, a place off the path, or one that
            cannot be reached in time by a walker of the table.
    """
    path = course.path
    places = torch.tensor(sorted(at), dtype=torch.float64)
    times = torch.tensor([at[place] for place in sorted(at)], dtype=torch.float64)
    _check_times(path, places, times)
    before, after = course.arrival(places), times
    keep = places > 0
    if not keep.any():
        return course
    knots = torch.cat([before.new_zeros(1), before[keep]])
    values = torch.cat([after.new_zeros(1), after[keep]])
    own = path.scalars[TIME]
    stretched, slope = _monotone(knots, values, own)
    speed = path.scalars[SPEED] / slope
    _check_speeds(course, speed, table, style)
    path = path.with_scalar(SPEED, speed).with_scalar(STEP_RATE, table.step_rate(speed, style))
    return Course(path.with_scalar(TIME, stretched))


def _check_times(path: Path, places: Tensor, times: Tensor) -> None:
    """Refuse what no walk can do."""
    for place, time in zip(places.tolist(), times.tolist(), strict=True):
        if not -1e-9 <= place <= path.length + 1e-6:
            raise DataError(
                "arrival",
                f"at {place:g} m, but the path is {path.length:.4g} m long; name a place on it",
            )
        if not 0 <= time < math.inf or (place <= 0 and time > 0):
            raise DataError(
                "arrival",
                f"{time:g} s at {place:g} m; expected seconds after the start, which is at 0 s",
            )
    ascending = (times.diff() > 0).all() and (places.diff() > 0).all()
    if not bool(ascending) or bool(((places > 0) & (times <= 0)).any()):
        raise DataError(
            "arrival",
            f"times {', '.join(f'{time:g}' for time in times.tolist())} s at "
            f"{', '.join(f'{place:.4g}' for place in places.tolist())} m do not ascend; later "
            "places are reached later",
        )


def _check_speeds(course: Course, speed: Tensor, table: GaitTable, style: int) -> None:
    """Refuse a pace that is faster than the walker has ever been."""
    fastest = 1.1 * float(table.speeds[style, -1])
    worst = int(speed.argmax())
    if float(speed[worst]) > fastest:
        place = float(course.path.distances[worst])
        raise DataError(
            "arrival",
            f"{float(speed[worst]):.3g} m/s would be needed {place:.3g} m along the path; this "
            f"walker knows up to {fastest / 1.1:.3g} m/s: give later times, or a shorter path",
        )


def _monotone(
    knots: Float[Tensor, " knots"], values: Float[Tensor, " knots"], at: Float[Tensor, " places"]
) -> tuple[Float[Tensor, " places"], Float[Tensor, " places"]]:
    """A curve through ascending values that never falls, and its slope; straight beyond the ends.

    Source: Fritsch and Butland 1984 (harmonic means as slopes), cubic Hermite between knots.
    """
    width, rise = knots.diff(), values.diff()
    slopes = rise / width
    inner = 2 * slopes[1:] * slopes[:-1] / (slopes[1:] + slopes[:-1])
    tangents = torch.cat([slopes[:1], inner, slopes[-1:]])
    after = torch.searchsorted(knots, at.contiguous()).clamp(1, len(knots) - 1)
    before = after - 1
    t = ((at - knots[before]) / width[before]).clamp(0, 1)
    h, left, right = width[before], tangents[before], tangents[after]
    low, high = values[before], values[after]
    found = (
        low * (1 + 2 * t) * (1 - t) ** 2
        + high * t**2 * (3 - 2 * t)
        + h * (left * t * (1 - t) ** 2 - right * t**2 * (1 - t))
    )
    slope = (
        6 * t * (1 - t) * (high - low) / h
        + left * (1 - 4 * t + 3 * t**2)
        + right * (3 * t**2 - 2 * t)
    )
    beyond = (at - knots[-1]).clamp_min(0)
    return found + beyond * tangents[-1], slope
