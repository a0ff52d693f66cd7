"""Unit dual quaternions: a rotation and a translation in eight numbers that multiply.

The real part r = (w, x, y, z) comes first, then the dual part d = 1/2 (0, t) r, so that
r + eps d with eps^2 = 0 turns by r, then moves by t. ``q`` and ``-q``, all eight numbers of it,
are one motion.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from posecast.geometry import conversions, parts, quaternion


class DualNumber(NamedTuple):
    """A number with a part that squares to zero.

    Args:
        real: the part without eps.
        dual: the factor of eps.
    """

    real: Float[Tensor, "*batch"]
    dual: Float[Tensor, "*batch"]


def identity(*shape: int, like: Tensor) -> Float[Tensor, "*shape 8"]:
    """Motions that move nothing, with the dtype and device of ``like``."""
    result = like.new_zeros(*shape, 8)
    result[..., 0] = 1
    return result


def from_rotation_translation(
    rotation: Float[Tensor, "*#batch 4"], translation: Float[Tensor, "*#batch 3"]
) -> Float[Tensor, "*batch 8"]:
    """Turn by a unit quaternion, then move by a translation; batch axes broadcast."""
    shape = torch.broadcast_shapes(rotation.shape[:-1], translation.shape[:-1])
    rotation, moved = rotation.expand(*shape, 4), translation.expand(*shape, 3)
    w, u = rotation[..., :1], rotation[..., 1:]
    scalar = -(moved * u).sum(-1, keepdim=True)
    vector = w * moved + torch.linalg.cross(moved, u)
    return torch.cat([rotation, scalar / 2, vector / 2], dim=-1)


def rotation(dual: Float[Tensor, "*batch 8"]) -> Float[Tensor, "*batch 4"]:
    """The real part: a unit quaternion if the dual quaternion is unit."""
    return dual[..., :4]


def translation(dual: Float[Tensor, "*batch 8"]) -> Float[Tensor, "*batch 3"]:
    """Translation of unit dual quaternions, in the unit they were made with.

    The vector part of 2 d conj(r). Its scalar part, 2 <r, d>, is zero for unit ones and is
    dropped from others: normalize those first.
    """
    w, *u, scalar, a, b, c = dual.unbind(-1)
    turned = parts.cross(u, (a, b, c))
    moved = zip((a, b, c), u, turned, strict=True)
    return 2 * torch.stack([w * one - scalar * two + three for one, two, three in moved], dim=-1)


def product(
    left: Float[Tensor, "*#batch 8"], right: Float[Tensor, "*#batch 8"]
) -> Float[Tensor, "*batch 8"]:
    """(a + eps b)(c + eps d) = ac + eps (ad + bc); as motions, ``right`` is applied first."""
    a, b = left[..., :4], left[..., 4:]
    c, d = right[..., :4], right[..., 4:]
    dual = quaternion.product(a, d) + quaternion.product(b, c)
    return torch.cat([quaternion.product(a, c), dual], dim=-1)


def conjugate(dual: Float[Tensor, "*batch 8"]) -> Float[Tensor, "*batch 8"]:
    """Quaternion conjugate of both parts; the inverse of a unit dual quaternion."""
    return dual * dual.new_tensor([1.0, -1, -1, -1, 1, -1, -1, -1])


def dual_conjugate(dual: Float[Tensor, "*batch 8"]) -> Float[Tensor, "*batch 8"]:
    """The conjugate of dual numbers: r - eps d."""
    return dual * dual.new_tensor([1.0, 1, 1, 1, -1, -1, -1, -1])


def combined_conjugate(dual: Float[Tensor, "*batch 8"]) -> Float[Tensor, "*batch 8"]:
    """Both conjugates, conj(r) - eps conj(d): q p q' moves a point p, see ``transform``."""
    return dual * dual.new_tensor([1.0, -1, -1, -1, -1, 1, 1, 1])


def norm(dual: Float[Tensor, "*batch 8"]) -> DualNumber:
    """|r| + eps <r, d> / |r|; 1 + 0 eps for unit ones; the dual part is 0 where r is zero.

    Zero is a real part shorter than the smallest normal number of its dtype.
    """
    real, other = dual[..., :4], dual[..., 4:]
    length = torch.linalg.vector_norm(real, dim=-1)
    none = length < torch.finfo(dual.dtype).tiny
    direction = real / torch.where(none, torch.ones_like(length), length)[..., None]
    zero = torch.zeros_like(length)
    return DualNumber(
        torch.where(none, zero, length), torch.where(none, zero, (direction * other).sum(-1))
    )


def normalize(dual: Float[Tensor, "*batch 8"], eps: float = 1e-12) -> Float[Tensor, "*batch 8"]:
    """The unit dual quaternion nearest along the norm: both steps, always.

    Both parts are divided by |r|; then the dual part loses what it has along the real one. A real
    part shorter than ``eps``, or than the smallest normal number of its dtype, becomes the identity
    rotation; the vector of the dual part is then half the translation, as it is.

    Source: Andreou et al. 2022, eq. 13: d / |r| - r <r, d> / |r|^3.
    """
    real, other = dual[..., :4], dual[..., 4:]
    length = torch.linalg.vector_norm(real, dim=-1, keepdim=True)
    vanishing = length < max(eps, torch.finfo(dual.dtype).tiny)
    length = torch.where(vanishing, torch.ones_like(length), length)
    unit = real / length
    unit = torch.where(vanishing, quaternion.identity(like=unit), unit)
    divided = other / length
    return torch.cat([unit, divided - unit * (unit * divided).sum(-1, keepdim=True)], dim=-1)


def inverse(dual: Float[Tensor, "*batch 8"]) -> Float[Tensor, "*batch 8"]:
    """Multiplicative inverse of any whose real part is not zero (those give no numbers).

    Source: (r + eps d)^-1 = r^-1 - eps r^-1 d r^-1.
    """
    back = quaternion.inverse(dual[..., :4])
    other = quaternion.product(quaternion.product(back, dual[..., 4:]), back)
    return torch.cat([back, -other], dim=-1)


def transform(
    dual: Float[Tensor, "*#batch 8"], point: Float[Tensor, "*#batch 3"]
) -> Float[Tensor, "*batch 3"]:
    """Move points by unit dual quaternions: turned, then shifted; batch axes broadcast."""
    return quaternion.rotate(dual[..., :4], point) + translation(dual)


def exp(twist: Float[Tensor, "*batch 6"]) -> Float[Tensor, "*batch 8"]:
    """Unit dual quaternion of a twist: rotation vector w (radians), then v, of any size.

    The motion that a body makes in one unit of time if it turns with w and the point of it that is
    at the origin moves with v at first: a screw. exp(0, v) is the translation v.

    Source: the translation is v' = V v with V = 1 + (1 - cos a)/a^2 [w] + (a - sin a)/a^3 [w]^2,
    a = |w| (the exponential of SE(3)).
    """
    turn, shift = twist[..., :3], twist[..., 3:]
    first, second = _left_jacobian(turn)
    across = torch.linalg.cross(turn, shift)
    moved = shift + first * across + second * torch.linalg.cross(turn, across)
    return from_rotation_translation(quaternion.exp(turn), moved)


def log(dual: Float[Tensor, "*batch 8"]) -> Float[Tensor, "*batch 6"]:
    """Twist of a unit dual quaternion, its rotation vector at most pi long: see ``exp``.

    ``q`` and ``-q`` give the same, except at the half turn, where the sign chooses the axis. Value
    and gradient are finite for all unit ones; normalize others, a zero real part gives no numbers.

    Source: v = V^-1 t with V^-1 = 1 - 1/2 [w] + (1/a^2)(1 - (a/2) cot(a/2)) [w]^2.
    """
    turn, moved = quaternion.log(dual[..., :4]), translation(dual)
    squared = (turn * turn).sum(-1, keepdim=True)
    small = squared < torch.finfo(squared.dtype).eps ** 0.25
    angle = torch.sqrt(torch.where(small, torch.ones_like(squared), squared))
    half = angle / 2
    series = 1 / 12 + squared / 720 + squared * squared / 30240
    factor = torch.where(small, series, (1 - half * torch.cos(half) / torch.sin(half)) / angle**2)
    across = torch.linalg.cross(turn, moved)
    shift = moved - across / 2 + factor * torch.linalg.cross(turn, across)
    return torch.cat([turn, shift], dim=-1)


def power(
    dual: Float[Tensor, "*#batch 8"], exponent: Float[Tensor, "*#batch"] | float
) -> Float[Tensor, "*batch 8"]:
    """A multiple of the screw motion, the short way round, about the same axis."""
    if isinstance(exponent, Tensor):
        exponent = exponent[..., None]
    return exp(log(dual) * exponent)


def interpolate(
    start: Float[Tensor, "*#batch 8"],
    end: Float[Tensor, "*#batch 8"],
    fraction: Float[Tensor, "*#batch"] | float,
) -> Float[Tensor, "*batch 8"]:
    """From ``start`` (fraction 0) to ``end`` (1) along one screw at constant speed, the short way.

    The result continues the sign of ``start``; at fraction 1 it may therefore be ``-end``.

    Source: screw linear interpolation, start (start^-1 end)^fraction (Kavan et al. 2008).
    """
    return product(start, power(product(conjugate(start), end), fraction))


def unroll(duals: Float[Tensor, "*shape 8"], dim: int = -3) -> Float[Tensor, "*shape 8"]:
    """Choose signs so that the real parts of neighbors along ``dim`` lie in one hemisphere.

    All eight numbers change sign together; the first stays as it is.

    Args:
        duals: by default (..., frames, joints, 8), continued along the frames.
        dim: the axis of time; not the last one.
    """
    signs = quaternion.continuous_signs(duals[..., :4], dim=dim)
    return duals * signs


def to_matrix(dual: Float[Tensor, "*batch 8"]) -> Float[Tensor, "*batch 4 4"]:
    """Matrix that moves homogeneous column vectors like the unit dual quaternion does."""
    turn = conversions.quaternion_to_matrix(dual[..., :4])
    upper = torch.cat([turn, translation(dual)[..., None]], dim=-1)
    last = upper.new_tensor([0.0, 0, 0, 1]).expand(*upper.shape[:-2], 1, 4)
    return torch.cat([upper, last], dim=-2)


def from_matrix(matrix: Float[Tensor, "*batch 4 4"]) -> Float[Tensor, "*batch 8"]:
    """Unit dual quaternion, w >= 0, of a rigid motion; its last row is not read."""
    turn = conversions.matrix_to_quaternion(matrix[..., :3, :3])
    return from_rotation_translation(turn, matrix[..., :3, 3])


def _left_jacobian(
    turn: Float[Tensor, "*batch 3"],
) -> tuple[Float[Tensor, "*batch 1"], Float[Tensor, "*batch 1"]]:
    """(1 - cos a) / a^2 and (a - sin a) / a^3 of a rotation vector of length a."""
    squared = (turn * turn).sum(-1, keepdim=True)
    small = squared < torch.finfo(squared.dtype).eps ** 0.25
    angle = torch.sqrt(torch.where(small, torch.ones_like(squared), squared))
    half = torch.sin(angle / 2) / angle
    first = torch.where(small, 0.5 - squared / 24 + squared * squared / 720, 2 * half * half)
    series = 1 / 6 - squared / 120 + squared * squared / 5040
    second = torch.where(small, series, (angle - torch.sin(angle)) / angle**3)
    return first, second
