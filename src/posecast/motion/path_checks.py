"""Whether a path can be drawn through way points, and whether a drawn one can be walked."""

from __future__ import annotations

import math
from collections.abc import Sequence
from os import PathLike

import torch
from jaxtyping import Float
from torch import Tensor

from posecast.errors import ConfigError, DataError

SAME_PLACE = 1e-6
"""Metres: way points nearer than this are one."""

_MOST_POINTS = 1_000_000
"""Points of a path: at the spacing of an adult's, 11 km."""


def check_waypoints(
    where: str | PathLike[str],
    waypoints: Float[Tensor, "waypoints 2"],
    *,
    closed: bool = False,
    lines: Sequence[int | None] | None = None,
) -> None:
    """Refuse way points through which no curve can be drawn.

    Args:
        where: what the error names: a file, or a path.
        waypoints: (x, z), metres.
        closed: whether the last is to be joined to the first.
        lines: line in the file of each, where that is known.

    Raises:
        DataError: too few of them, one that is not finite, or two in a row that are equal; names
            the way point, counted from 1.
    """
    count, least = len(waypoints), 3 if closed else 2
    if count < least:
        kind = "closed path" if closed else "path"
        raise DataError(
            where,
            f"{count} way point{'s' * (count != 1)}, expected at least {least} for a {kind}; add "
            "where it leads",
        )
    check_finite(where, waypoints, kind="way point", lines=lines)
    steps = (waypoints.roll(-1, 0) - waypoints).norm(dim=-1)
    same = (steps if closed else steps[:-1]) < SAME_PLACE
    if same.any():
        first = int(same.nonzero()[0, 0])
        second = (first + 1) % count
        remedy = (
            "a closed path comes back to its first way point by itself: leave out the last"
            if second == 0
            else "leave out one of them"
        )
        raise DataError(
            where,
            f"way points {first + 1} and {second + 1} of {count} are both at "
            f"{_place(waypoints[first])}, expected neighbours to differ; {remedy}",
            line=None if lines is None else lines[max(first, second)],
        )


def check_finite(
    where: str | PathLike[str],
    positions: Float[Tensor, "positions 2"],
    *,
    kind: str,
    lines: Sequence[int | None] | None = None,
) -> None:
    """Refuse positions on the floor that are none.

    Args:
        kind: what a position is called, such as "way point"; for the rest see ``check_waypoints``.

    Raises:
        DataError: names the first position that is not finite, counted from 1.
    """
    wrong = ~torch.isfinite(positions).all(dim=-1)
    if wrong.any():
        first = int(wrong.nonzero()[0, 0])
        raise DataError(
            where,
            f"{kind} {first + 1} of {len(positions)} is {_place(positions[first])}, expected "
            "finite numbers; mend it or leave it out",
            line=None if lines is None else lines[first],
        )


def check_size(where: str | PathLike[str], length: float, spacing: float) -> None:
    """Refuse a path of too many points before they are made.

    Args:
        where: what the error names.
        length, spacing: of the path and of its points, metres.

    Raises:
        ConfigError: ``spacing`` is not a positive number.
        DataError: more points than anybody walks in hours.
    """
    if not 0 < spacing < math.inf:
        raise ConfigError(f"spacing is {spacing}: expected a positive number of metres")
    if length / spacing > _MOST_POINTS:
        raise DataError(
            where,
            f"{length:.3g} m long, which is {length / spacing:.2g} points {spacing:.3g} m apart, "
            f"expected at most {_MOST_POINTS:.2g}; is the unit right? If so, space them wider",
        )


def check_track(name: str, values: Tensor, *, expected: int) -> None:
    """Refuse a track of a path that is not one finite value a point, or a place.

    Args:
        name: of the track.
        values: the first axis is that of the points.
        expected: how many points or places there are.

    Raises:
        DataError: names the track, and the first value that is not finite, counted from 0.
    """
    where = f"track {name!r} of a path"
    if len(values) != expected:
        raise DataError(
            where,
            f"{len(values)} values for {expected} places; give one for each point, or at=, the arc "
            "length of each value",
        )
    wrong = ~torch.isfinite(values).reshape(expected, -1).all(dim=-1)
    if wrong.any():
        first = int(wrong.nonzero()[0, 0])
        raise DataError(where, f"value {first} is not finite; mend it or leave it out")


def _place(position: Float[Tensor, "2"]) -> str:
    x, z = position.tolist()
    return f"(x, z) = ({x:g}, {z:g})"
