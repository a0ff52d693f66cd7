"""Changes that are known in stretches of time go over to nothing before and after, smoothly."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor


class _Knot(NamedTuple):
    """An end of a spline: value, and slope a frame."""

    frame: float
    value: Float[Tensor, "channels"]
    slope: Float[Tensor, "channels"]


def eased(
    values: Float[Tensor, "frames channels"], known: Sequence[tuple[int, int]], reach: float
) -> Float[Tensor, "frames channels"]:
    """Values as they are where they are known, and splines without a jump of velocity elsewhere.

    Each stretch goes over to zero within ``reach``; where two are nearer to each other than twice
    that, the end of the one goes over to the beginning of the other.

    Args:
        values: zero where they are not known.
        known: first and last frame of each stretch, in order of time.
        reach: frames.
    """
    result = values.clone()
    frames = torch.arange(len(values), dtype=values.dtype)
    for before, after in _gaps(values, known, reach):
        between = (frames > before.frame) & (frames < after.frame)
        result[between] = _spline(before, after, frames[between])
    return result


def _gaps(
    values: Float[Tensor, "frames channels"], known: Sequence[tuple[int, int]], reach: float
) -> list[tuple[_Knot, _Knot]]:
    """Where splines are needed: from which knot to which."""
    zero = torch.zeros_like(values[0])
    gaps: list[tuple[_Knot, _Knot]] = []
    end: _Knot | None = None
    for first, last in known:
        start = _Knot(first, values[first], values[min(first + 1, last)] - values[first])
        if end is not None and first - end.frame <= 2 * reach:
            gaps.append((end, start))
        else:
            if end is not None:
                gaps.append((end, _Knot(end.frame + reach, zero, zero)))
            gaps.append((_Knot(first - reach, zero, zero), start))
        end = _Knot(last, values[last], values[last] - values[max(last - 1, first)])
    if end is not None:
        gaps.append((end, _Knot(end.frame + reach, zero, zero)))
    return gaps


def _spline(
    before: _Knot, after: _Knot, frames: Float[Tensor, "frames"]
) -> Float[Tensor, "frames channels"]:
    """Cubic Hermite spline between two knots."""
    length = after.frame - before.frame
    share = ((frames - before.frame) / length)[:, None]
    rest = 1 - share
    return (
        rest**2 * (1 + 2 * share) * before.value
        + share**2 * (1 + 2 * rest) * after.value
        + rest**2 * share * length * before.slope
        - share**2 * rest * length * after.slope
    )
