"""Angles of BVH channels to quaternions, and back so that a file can be written twice alike.

Angles go back as whole numbers of micro-degrees (held in float64, exactly): what a file with six
decimals holds. Every choice (branch, winding, gimbal lock) is made on these whole numbers, so
reading what was written and choosing again gives the same digits.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float
from numpy.typing import NDArray
from torch import Tensor

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
    degrees: Float[np.ndarray, "frames channels"],
    groups: Mapping[str, Sequence[Sequence[int]]],
    joints: Sequence[Sequence[int]],
) -> Float[Tensor, "frames joints 4"]:
    """The products of elementary rotations in the order of the channels (intrinsic).

    Args:
        degrees: rows of a file, any winding; columns that are no angles are not looked at.
        groups: by axes, one letter a channel (repeats are allowed), the columns of those
            channels: for each letter one column a joint.
        joints: for each group the joints that its columns belong to.

    A few hundred frames at a time: what a step reads is then still in the cache.
    """
    result = np.empty((len(degrees), sum(map(len, joints)), 4))
    todo = [
        (axes, [_slice(letter) for letter in columns], _slice(members))
        for (axes, columns), members in zip(groups.items(), joints, strict=True)
    ]
    for start in range(0, len(degrees), _CHUNK):
        rows = degrees[start : start + _CHUNK]
        if np.abs(rows).max(initial=0) > 3600:
            rows = np.fmod(rows, 360)  # exact, while a large argument of sin is not
        for axes, columns, members in todo:
            turns = [_cos_sin(rows[:, column] * (np.pi / 360)) for column in columns]
            if len(axes) == 3 and len(set(axes)) == 3:
                product = _three_turns(turns, axes)
            else:
                shape = (len(rows), result[:1, members].shape[1])
                product = _any_turns(turns, axes, shape)
            for part in range(4):
                result[start : start + _CHUNK, members, part] = product[part]
    return torch.from_numpy(result)


_CHUNK = 256

Plane = NDArray[np.float64]

_ALONE = 1024
"""Numbers that PyTorch and MKL work on with one thread. On a machine that runs other programs, two
threads wait for each other many times longer than this work takes."""


def _cos_sin(angles: Plane) -> tuple[Plane, Plane]:
    """Cosines and sines by PyTorch's kernels, which are faster than NumPy's."""
    results = np.empty((2, *angles.shape))
    cosines, sines = torch.from_numpy(results).flatten(1)
    flat = torch.from_numpy(angles).flatten()
    for start in range(0, len(flat), _ALONE):
        piece = slice(start, start + _ALONE)
        torch.cos(flat[piece], out=cosines[piece])
        torch.sin(flat[piece], out=sines[piece])
    return results[0], results[1]


def _slice(places: Sequence[int]) -> slice | list[int]:
    """Evenly spaced places as a slice, which needs no copy."""
    steps = set(np.diff(places).tolist()) or {1}
    if len(steps) == 1 and len(places) and (step := steps.pop()) > 0:
        return slice(places[0], places[-1] + 1, step)
    return list(places)


def _three_turns(turns: Sequence[tuple[Plane, Plane]], axes: str) -> list[Plane]:
    """Product of three turns about different axes, multiplied out: four times less work."""
    i, j, k = (AXES.index(axis) for axis in axes)
    (ci, si), (cj, sj), (ck, sk) = turns
    cc, cs, sc, ss = cj * ck, cj * sk, sj * ck, sj * sk
    parts: list[Plane] = [cc] * 4
    if (j - i) % 3 == 1:
        parts[0], parts[1 + i] = ci * cc - si * ss, si * cc + ci * ss
        parts[1 + j], parts[1 + k] = ci * sc - si * cs, ci * cs + si * sc
    else:
        parts[0], parts[1 + i] = ci * cc + si * ss, si * cc - ci * ss
        parts[1 + j], parts[1 + k] = ci * sc + si * cs, ci * cs - si * sc
    return parts


def _any_turns(
    turns: Sequence[tuple[Plane, Plane]], axes: str, shape: tuple[int, int]
) -> list[Plane]:
    """Product of any number of turns about any axes, one after the other."""
    parts = [np.ones(shape), np.zeros(shape), np.zeros(shape), np.zeros(shape)]
    for axis, (cosine, sine) in zip(axes, turns, strict=True):
        i = AXES.index(axis)
        a, b, c = 1 + i, 1 + (i + 1) % 3, 1 + (i + 2) % 3
        parts[0], parts[a], parts[b], parts[c] = (
            parts[0] * cosine - parts[a] * sine,
            parts[a] * cosine + parts[0] * sine,
            parts[b] * cosine + parts[c] * sine,
            parts[c] * cosine - parts[b] * sine,
        )
    return parts


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
