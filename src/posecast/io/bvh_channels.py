"""Angles of BVH channels to quaternions, and back so that a file can be written twice alike.

Angles go back as whole numbers of micro-degrees (held in float64, exactly): what a file with six
decimals holds. Every choice (branch, winding, gimbal lock) is made on these whole numbers, so
reading what was written and choosing again gives the same digits.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float
from numpy.typing import NDArray
from torch import Tensor

from posecast.geometry import quaternion
from posecast.geometry.euler import ORDERS, quaternion_to_euler
from posecast.io.bvh_document import AXES

MICRO = 1_000_000
_HALF_TURN = 180 * MICRO
_TURN = 360 * MICRO
_LOCK = 30
"""Micro-degrees around gimbal lock in which the middle angle is written as the lock itself.

Nearer than this, double precision does not give the outer angles back to half a micro-degree."""
_NEGLIGIBLE = 10
"""Micro-degrees about an axis without a channel that count as none."""


def channels_to_quaternion(
    degrees: Float[np.ndarray, "frames joints turns"], axes: str
) -> Float[Tensor, "frames joints 4"]:
    """The product of elementary rotations in the order of the channels (intrinsic).

    Args:
        degrees: any number of channels, any winding.
        axes: one letter a channel; repeats are allowed.
    """
    if np.abs(degrees).max(initial=0) > 3600:
        degrees = np.fmod(degrees, 360)  # exact, while a large argument of sin is not
    half = torch.from_numpy(np.ascontiguousarray(np.moveaxis(degrees, -1, 0))) * (np.pi / 360)
    cosines, sines = torch.cos(half), torch.sin(half)
    if len(axes) == 3 and len(set(axes)) == 3:
        return _three_turns(cosines, sines, axes)
    result = quaternion.identity(*half.shape[1:], like=half)
    for axis, cosine, sine in zip(axes, cosines, sines, strict=True):
        turn = torch.zeros_like(result)
        turn[..., 0], turn[..., 1 + AXES.index(axis)] = cosine, sine
        result = quaternion.product(result, turn)
    return result


def _three_turns(
    cosines: Float[Tensor, "3 frames joints"], sines: Float[Tensor, "3 frames joints"], axes: str
) -> Float[Tensor, "frames joints 4"]:
    """Product of three turns about different axes, multiplied out: four times less work."""
    i, j, k = (AXES.index(axis) for axis in axes)
    hand = 1 if (j - i) % 3 == 1 else -1
    (ci, cj, ck), (si, sj, sk) = cosines, sines
    cc, cs, sc, ss = cj * ck, cj * sk, sj * ck, hand * (sj * sk)
    result = cosines.new_empty(*ci.shape, 4)
    result[..., 0] = ci * cc - si * ss
    result[..., 1 + i] = si * cc + ci * ss
    result[..., 1 + j] = ci * sc - hand * (si * cs)
    result[..., 1 + k] = ci * cs + hand * (si * sc)
    return result


def complete_axes(axes: str) -> str | None:
    """An order of three turns that begins with ``axes``; ``None`` if there is none."""
    if len(axes) == 3:
        return axes if axes in ORDERS else None
    if len(set(axes)) < len(axes):
        return None
    return axes + "".join(axis for axis in AXES if axis not in axes)


class Angles(NamedTuple):
    """Angles of one or several joints with the same channels.

    Args:
        micro: whole micro-degrees, one for each letter of the order.
        expressible: for each joint, whether the angles asked for express all its rotations.
    """

    micro: Float[np.ndarray, "frames joints turns"]
    expressible: tuple[bool, ...]


def quaternion_to_channels(
    rotations: Float[Tensor, "frames joints 4"], order: str, turns: int, near: NDArray[np.float64]
) -> Angles:
    """Angles that are continuous in time and start as near as can be to given ones.

    Args:
        rotations: unit quaternions.
        order: three axes, an Euler order.
        turns: how many of the three have channels; the others must come out as zero.
        near: (joints, turns) degrees that the first frame should be near to.
    """
    radians = quaternion_to_euler(rotations, order).numpy()
    exact = np.degrees(radians) * MICRO
    proper = order[0] == order[2]
    principal = np.rint(exact)
    anchor = np.zeros((rotations.shape[1], 3))
    anchor[:, :turns] = np.rint(np.where(np.abs(near) < 1e9, near, np.fmod(near, 360)) * MICRO)
    _settle_lock(principal, exact, order, anchor if turns == 3 else None)
    other = principal + _HALF_TURN
    other[..., 1] = -principal[..., 1] + (0 if proper else _HALF_TURN)
    if turns == 3:
        take_other = _continuous_branch(principal, other, anchor)
    else:
        take_other = np.abs(_wrap(principal[..., 2])) > _HALF_TURN // 2
    chosen = np.where(take_other[..., None], other, principal)
    idle = np.abs(_wrap(chosen[..., turns:])) <= _NEGLIGIBLE
    chosen = _unwind(chosen[..., :turns], anchor[:, :turns])
    return Angles(chosen, tuple(idle.all(axis=(0, 2)).tolist()))


def _settle_lock(
    angles: Float[np.ndarray, "frames joints 3"],
    exact: Float[np.ndarray, "frames joints 3"],
    order: str,
    anchor: Float[np.ndarray, "joints 3"] | None,
) -> None:
    """At gimbal lock hold the last angle and give the first what is defined: sum or difference.

    Changes ``angles`` in place. Before the first frame that is not locked, the last angle is that
    of ``anchor``; it is zero where the last axis has no channel.
    """
    proper = order[0] == order[2]
    middle = angles[..., 1]
    upper, lower = (_HALF_TURN, 0) if proper else (_HALF_TURN // 2, -_HALF_TURN // 2)
    at_upper, at_lower = middle >= upper - _LOCK, middle <= lower + _LOCK
    locked = at_upper | at_lower
    if not locked.any():
        return
    hand = 1 if (AXES.index(order[1]) - AXES.index(order[0])) % 3 == 1 else -1
    # Proper orders keep first + last at 0 and first - last at 180 degrees; three different axes
    # keep first + hand * last at 90 and first - hand * last at -90 degrees.
    sign = np.where(at_upper, -1, 1) if proper else np.where(at_upper, hand, -hand)
    kept = np.rint(exact[..., 0] + sign * exact[..., 2])
    frames = np.arange(len(angles))[:, None]
    free = np.maximum.accumulate(np.where(locked, -1, frames), axis=0)
    before = np.take_along_axis(angles[..., 2], np.maximum(free, 0), axis=0)
    start = 0 if anchor is None else anchor[:, 2]
    last = np.where(free >= 0, before, start) if anchor is not None else np.zeros_like(before)
    angles[..., 2] = np.where(locked, last, angles[..., 2])
    angles[..., 0] = np.where(locked, kept - sign * last, angles[..., 0])
    angles[..., 1] = np.where(at_upper, upper, np.where(at_lower, lower, middle))


def _continuous_branch(
    principal: Float[np.ndarray, "frames joints 3"],
    other: Float[np.ndarray, "frames joints 3"],
    anchor: Float[np.ndarray, "joints 3"],
) -> NDArray[np.bool_]:
    """Where to take the second of the two triples that every rotation has.

    The triples of two neighbouring frames are as far apart if both are of the first kind as if
    both are of the second, so a frame only says whether the kind changes there.
    """

    def apart(
        a: Float[np.ndarray, "*frames joints 3"], b: Float[np.ndarray, "*frames joints 3"]
    ) -> NDArray[np.float64]:
        return np.abs(_wrap(a - b)).sum(axis=-1)

    changes = np.empty(principal.shape[:2], dtype=np.bool_)
    changes[0] = apart(other[0], anchor) < apart(principal[0], anchor)
    changes[1:] = apart(other[1:], principal[:-1]) < apart(principal[1:], principal[:-1])
    return np.logical_xor.accumulate(changes, axis=0)


def _unwind(
    angles: Float[np.ndarray, "frames joints turns"], anchor: Float[np.ndarray, "joints turns"]
) -> Float[np.ndarray, "frames joints turns"]:
    """Add whole turns so that no step is longer than half a turn, starting next to ``anchor``."""
    steps = np.empty_like(angles)
    steps[0] = anchor + _wrap(angles[0] - anchor)
    steps[1:] = _wrap(angles[1:] - angles[:-1])
    return np.cumsum(steps, axis=0)


def _wrap(micro: Float[np.ndarray, "*shape"]) -> Float[np.ndarray, "*shape"]:
    """Whole micro-degrees brought into [-180, 180) degrees by whole turns; exact below 1e15."""
    turns = (micro + _HALF_TURN) / _TURN
    np.floor(turns, out=turns)
    turns *= _TURN
    return np.subtract(micro, turns, out=turns)
