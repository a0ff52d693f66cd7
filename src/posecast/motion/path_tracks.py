"""Making a track of a path, one value a point, from values given at some of its arc lengths."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from posecast.errors import DataError
from posecast.motion.path_checks import check_track
from posecast.motion.places import bearing, heading, wrapped


def spread_numbers(
    name: str,
    values: Float[Tensor, " values"],
    distances: Float[Tensor, " points"],
    *,
    at: Float[Tensor, " places"] | None,
    period: float | None,
    turning: bool = False,
) -> Float[Tensor, " points"]:
    """A track of numbers: linear between the arc lengths at which they are given.

    Args:
        name: of the track, for errors.
        values: one for all points, one a point, or one for each arc length ``at``.
        distances: arc lengths of the points, metres.
        at: arc lengths of the values, not falling; the outer values are held beyond them.
        period: length of a closed path, around which the values go on; ``None``: open.
        turning: the values are angles, which go from one to the next the shorter way round.

    Raises:
        DataError: see ``Path.with_scalar``.
    """
    if at is None and len(values) == 1:
        values = values.expand(len(distances))
    at = distances if at is None else at.to(distances)
    check_track(name, values, expected=len(at))
    _check_arc_lengths(name, at, longest=period or float(distances[-1]))
    if period is not None:  # One lap before and one after: all points have neighbours.
        laps = at.new_tensor([-period, 0.0, period])
        at, values = (laps[:, None] + at).flatten(), values.repeat(3)
    if turning:
        turns = wrapped(values.diff()).cumsum(0)
        values = torch.cat([values[:1], values[:1] + turns])
    if len(values) == 1:
        return values.expand(len(distances)).clone()
    after = torch.searchsorted(at, distances, right=True).clamp(1, len(at) - 1)
    start, step = at[after - 1], at[after] - at[after - 1]
    # Where somebody stands still there are several values at an arc length: the last one counts.
    fraction = ((distances - start) / torch.where(step > 0, step, 1)).clamp(0, 1)
    return values[after - 1] + fraction * (values[after] - values[after - 1])


def spread_directions(
    name: str,
    vectors: Float[Tensor, "values 2"],
    distances: Float[Tensor, " points"],
    *,
    at: Float[Tensor, " places"] | None,
    period: float | None,
) -> Float[Tensor, "points 2"]:
    """A track of unit vectors (x, z), which turn evenly, the shorter way round; see above.

    Args:
        vectors: of any length but 0; the rest as above.

    Raises:
        DataError: see ``Path.with_direction``.
    """
    zero = (vectors == 0).all(dim=-1)
    if zero.any():
        raise DataError(
            f"track {name!r} of a path",
            f"value {int(zero.nonzero()[0, 0])} is (0, 0), expected a vector that points somewhere",
        )
    angles = spread_numbers(name, bearing(vectors), distances, at=at, period=period, turning=True)
    return heading(angles)


def held(track: Float[Tensor, "points *axes"], steps: int) -> Float[Tensor, "longer *axes"]:
    """A track on so many points more: its last value."""
    return torch.cat([track, track[-1:].expand(steps, *track.shape[1:])])


def _check_arc_lengths(name: str, at: Float[Tensor, " places"], *, longest: float) -> None:
    """Refuse arc lengths of values that fall, or that lie off the path."""
    off = ~((at >= 0) & (at <= longest * (1 + 1e-9)))
    if off.any():
        first = int(off.nonzero()[0, 0])
        raise DataError(
            f"track {name!r} of a path",
            f"value {first} is at {float(at[first]):g} m, expected 0 to {longest:g} m, the length "
            "of the path",
        )
    falls = at.diff() < 0
    if falls.any():
        first = int(falls.nonzero()[0, 0])
        raise DataError(
            f"track {name!r} of a path",
            f"value {first + 1} is at {float(at[first + 1]):g} m, before value {first} at "
            f"{float(at[first]):g} m; sort them by arc length",
        )
