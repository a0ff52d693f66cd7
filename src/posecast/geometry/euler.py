"""Euler angles of all twelve orders, both ways, and the legacy triple of the H3.6M protocol."""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from posecast.errors import ConfigError
from posecast.geometry.quaternion import product

ORDERS: tuple[str, ...] = (
    *("xyz", "xzy", "yxz", "yzx", "zxy", "zyx"),
    *("xyx", "xzx", "yxy", "yzy", "zxz", "zyz"),
)
"""Six orders of three different axes (Tait-Bryan), then six that return to the first (proper)."""


class _Axes(NamedTuple):
    """Positions in (w, x, y, z) of an order's axes, and the handedness of its first two."""

    first: int
    second: int
    other: int
    handedness: int
    proper: bool


def _axes(order: str) -> _Axes:
    """Look up an order by name.

    Raises:
        ConfigError: it is none of ``ORDERS``.
    """
    if order not in ORDERS:
        raise ConfigError(f"Euler order {order!r} is unknown; expected one of {', '.join(ORDERS)}")
    first, second = "xyz".index(order[0]), "xyz".index(order[1])
    return _Axes(
        first=first + 1,
        second=second + 1,
        other=3 - first - second + 1,
        handedness=1 if second == (first + 1) % 3 else -1,
        proper=order[0] == order[2],
    )


def euler_to_quaternion(
    angles: Float[Tensor, "*batch 3"], order: str = "zyx"
) -> Float[Tensor, "*batch 4"]:
    """Compose three turns about the axes of a frame that turns along (intrinsic).

    Args:
        angles: radians, in the sequence of ``order``: for "zyx" the angle about z comes first,
            and the rotation is Rz Ry Rx.
        order: one of ``ORDERS``.

    Raises:
        ConfigError: the order is unknown.
    """
    _axes(order)
    cosines, sines = torch.cos(angles / 2), torch.sin(angles / 2)
    zero = torch.zeros_like(cosines[..., 0])
    turns = []
    for place, axis in enumerate(order):
        parts = [cosines[..., place], zero, zero, zero]
        parts["wxyz".index(axis)] = sines[..., place]
        turns.append(torch.stack(parts, dim=-1))
    return product(product(turns[0], turns[1]), turns[2])


def quaternion_to_euler(
    rotation: Float[Tensor, "*batch 4"], order: str = "zyx", margin: float = 0.0
) -> Float[Tensor, "*batch 3"]:
    """Angles of the intrinsic rotations whose composition is ``rotation``.

    The outer angles lie in [-pi, pi], the middle one in [-pi/2, pi/2] for three different axes
    and in [0, pi] for proper orders. At gimbal lock, where only the sum or the difference of
    the outer angles is defined, the last angle is zero. Composing the angles gives the rotation
    back to the last digit, at gimbal lock and as close to it as one likes.

    Args:
        rotation: unit quaternions; ``q`` and ``-q`` give the same angles.
        order: one of ``ORDERS``; the angles come in its own sequence.
        margin: how far the sine (proper orders: cosine) of the middle angle stays away from
            +-1. Inside that cap the middle angle is that of the rim and nothing has a gradient
            with respect to what is undefined at its center, which bounds the gradient by
            ``sqrt(2 / margin)``. A loss wants about 1e-6; evaluation wants 0, where the gradient
            is merely finite.

    Raises:
        ConfigError: the order is unknown.

    Source: with e_i(a) e_j(b) e_i(c) = (cos b/2 cos s, cos b/2 sin s, sin b/2 cos d,
    +-sin b/2 sin d) along 1, i, j, i x j, where s = (a + c)/2 and d = (a - c)/2. Three different
    axes reduce to this form by a quarter turn about the middle axis. Compare Bernardes and
    Viollet 2022, "Quaternion to Euler angles conversion: a direct, general and computationally
    efficient method".
    """
    axes = _axes(order)
    w, i = rotation[..., 0], rotation[..., axes.first]
    j, k = rotation[..., axes.second], axes.handedness * rotation[..., axes.other]
    if not axes.proper:
        w, i, j, k = ((w - j), (i - k), (j + w), (k + i))
        w, i, j, k = (part * math.sqrt(0.5) for part in (w, i, j, k))
    half_sum = _half_angle(i, w, margin)
    half_difference = _half_angle(k, j, margin)
    locked = torch.finfo(w.dtype).eps ** 2
    sum_free, difference_free = w * w + i * i < locked, j * j + k * k < locked
    half_sum, half_difference = (
        torch.where(sum_free, half_difference, half_sum),
        torch.where(difference_free, half_sum, half_difference),
    )
    middle = 2 * torch.atan2(_radius(j, k, margin), _radius(w, i, margin))
    first, last = half_sum + half_difference, half_sum - half_difference
    if not axes.proper:
        middle = middle - math.pi / 2
        last = -axes.handedness * last
    return torch.stack([_wrap(first), middle, _wrap(last)], dim=-1)


def _radius(
    a: Float[Tensor, "*batch"], b: Float[Tensor, "*batch"], margin: float
) -> Float[Tensor, "*batch"]:
    """Length of (a, b), at least that of the cap's rim; constant inside the cap."""
    floor = max(margin / 2, torch.finfo(a.dtype).tiny)
    return torch.sqrt((a * a + b * b).clamp_min(floor))


def _half_angle(
    sine: Float[Tensor, "*batch"], cosine: Float[Tensor, "*batch"], margin: float
) -> Float[Tensor, "*batch"]:
    """atan2, with its value but without its exploding gradient inside the cap."""
    floor = max(margin / 2, torch.finfo(sine.dtype).eps ** 2)
    inside = sine * sine + cosine * cosine < floor
    free = torch.atan2(
        torch.where(inside, torch.zeros_like(sine), sine),
        torch.where(inside, torch.ones_like(cosine), cosine),
    )
    return torch.where(inside, torch.atan2(sine.detach(), cosine.detach()), free)


def _wrap(angle: Float[Tensor, "*batch"]) -> Float[Tensor, "*batch"]:
    """Bring an angle into [-pi, pi] by whole turns."""
    return angle - 2 * math.pi * torch.round(angle.detach() / (2 * math.pi))


_LEGACY_EPS = 1.1920928955078125e-07
"""Machine epsilon of float32, which the original adds to the angle before dividing by it."""


def h36m_euler(axis_angle: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3"]:
    """The Euler triple in which the H3.6M protocol measures, from a file's rotation vectors.

    Files of that release follow a row-vector convention; ``axis_angle`` is as in the file. The
    triple (E1, E2, E3) equals the angles about x, y, z of the intrinsic z-y-x decomposition of
    the **inverse** rotation: reversed, those of ``quaternion_to_euler(exp(-axis_angle), "zyx")``,
    up to the epsilon that the original adds to the angle (differences of about 1e-7, more close to
    gimbal lock). For evaluation: it has no gradient at the zero vector and at gimbal lock.

    Source: evaluation of Martinez et al. 2017, "On human motion prediction using recurrent
    neural networks": R = I + sin|r| K + (1 - cos|r|) K^2 with K the cross-product matrix of
    r / (|r| + eps), then E2 = -asin R02, E1 = atan2(R12, R22), E3 = atan2(R01, R00). Where R02
    is exactly +-1 the original reads E1 = atan2(R01, R02), E3 = 0, kept here as it is.
    """
    angle = torch.linalg.vector_norm(axis_angle, dim=-1)
    x, y, z = (axis_angle / (angle[..., None] + _LEGACY_EPS)).unbind(-1)
    sine, versine = torch.sin(angle), 1 - torch.cos(angle)
    r00 = 1 - versine * (y * y + z * z)
    r01 = versine * x * y - sine * z
    r02 = versine * x * z + sine * y
    r12 = versine * y * z - sine * x
    r22 = 1 - versine * (x * x + y * y)
    locked = r02.abs() == 1
    e1 = torch.where(locked, torch.atan2(r01, r02), torch.atan2(r12, r22))
    e2 = -torch.asin(r02.clamp(-1, 1))
    e3 = torch.where(locked, torch.zeros_like(r01), torch.atan2(r01, r00))
    return torch.stack([e1, e2, e3], dim=-1)
