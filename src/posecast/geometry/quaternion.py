"""Unit quaternions (w, x, y, z), Hamilton product, active rotations."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from posecast.geometry import parts


def identity(*shape: int, like: Tensor) -> Float[Tensor, "*shape 4"]:
    """Identity rotations (1, 0, 0, 0) with the dtype and device of ``like``."""
    result = like.new_zeros(*shape, 4)
    result[..., 0].fill_(1)
    return result


def about_axis(
    axis: Float[Tensor, "*#batch 3"], angle: Float[Tensor, "*#batch"]
) -> Float[Tensor, "*batch 4"]:
    """Rotation by ``angle`` (radians) about ``axis``, counterclockwise seen from its tip.

    The axis need not have unit length; about an axis of zero length nothing turns.
    """
    unit = _unit_vector(axis)
    half = angle[..., None] / 2
    w, u = torch.cos(half), unit * torch.sin(half)
    w = torch.where((unit == 0).all(-1, keepdim=True), torch.ones_like(w), w)
    return torch.cat([w.expand(*u.shape[:-1], 1), u], dim=-1)


def between(
    start: Float[Tensor, "*#batch 3"], end: Float[Tensor, "*#batch 3"]
) -> Float[Tensor, "*batch 4"]:
    """Shortest rotation that turns the direction ``start`` into the direction ``end``.

    Lengths do not matter. Opposite directions: a half turn about some axis perpendicular to
    ``start``. A vector without direction (length zero): the identity.

    Source: q = (a . h, a x h), where a is the unit start and h halves the angle to the end b.
    With h along s = a + b, a . h is |s| / 2, which stays accurate when a and b nearly cancel.
    """
    a, b = torch.broadcast_tensors(_unit_vector(start), _unit_vector(end))
    total = a + b
    squared = (total * total).sum(-1, keepdim=True)
    opposite = squared < (8 * torch.finfo(a.dtype).eps) ** 2
    length = torch.sqrt(torch.where(opposite, torch.ones_like(squared), squared))
    w = torch.where(opposite, torch.zeros_like(length), length / 2)
    aside = torch.nn.functional.one_hot(a.detach().abs().argmin(-1), 3).to(a.dtype)
    perpendicular = _unit_vector(torch.linalg.cross(a, aside))
    halfway = torch.where(opposite, perpendicular, total / length)
    turn = normalize(torch.cat([w, torch.linalg.cross(a, halfway)], dim=-1))
    undefined = (a == 0).all(-1, keepdim=True) | (b == 0).all(-1, keepdim=True)
    return torch.where(undefined, identity(like=turn), turn)


def product(
    left: Float[Tensor, "*#batch 4"], right: Float[Tensor, "*#batch 4"]
) -> Float[Tensor, "*batch 4"]:
    """Hamilton product; as rotations, ``right`` is applied first. Batch axes broadcast."""
    w1, x1, y1, z1 = left.unbind(-1)
    w2, x2, y2, z2 = right.unbind(-1)
    return torch.stack(
        [
            w1 * w2 - x1 * x2 - y1 * y2 - z1 * z2,
            w1 * x2 + x1 * w2 + y1 * z2 - z1 * y2,
            w1 * y2 - x1 * z2 + y1 * w2 + z1 * x2,
            w1 * z2 + x1 * y2 - y1 * x2 + z1 * w2,
        ],
        dim=-1,
    )


def conjugate(rotation: Float[Tensor, "*batch 4"]) -> Float[Tensor, "*batch 4"]:
    """Conjugate; for unit quaternions the inverse rotation."""
    return torch.cat([rotation[..., :1], -rotation[..., 1:]], dim=-1)


def inverse(quaternion: Float[Tensor, "*batch 4"]) -> Float[Tensor, "*batch 4"]:
    """Multiplicative inverse of a quaternion of any length but zero (which gives no numbers)."""
    return conjugate(quaternion) / (quaternion * quaternion).sum(-1, keepdim=True)


def normalize(
    quaternion: Float[Tensor, "*batch 4"], eps: float = 1e-12
) -> Float[Tensor, "*batch 4"]:
    """Scale to unit length; a quaternion shorter than ``eps`` becomes the identity.

    For lengths whose squares are numbers of its dtype, in float32 up to 1e19; half precision is
    computed in float32.
    """
    if quaternion.dtype in (torch.float16, torch.bfloat16):
        return normalize(quaternion.float(), eps).to(quaternion.dtype)
    squared = (quaternion * quaternion).sum(-1, keepdim=True)
    vanishing = squared < eps * eps
    safe = torch.where(vanishing, torch.ones_like(squared), squared)
    unit = quaternion * torch.rsqrt(safe)
    return torch.where(vanishing, identity(like=unit), unit)


def rotate(
    rotation: Float[Tensor, "*#batch 4"], vector: Float[Tensor, "*#batch 3"]
) -> Float[Tensor, "*batch 3"]:
    """Rotate vectors by unit quaternions; batch axes broadcast.

    Args:
        rotation: unit quaternions (w, x, y, z). Not renormalized: see ``normalize``.
        vector: any unit of length; the result has the same.

    Source: Rodrigues' formula written with q = (w, u): v + 2w (u x v) + 2u x (u x v).
    """
    w, *u = rotation.unbind(-1)
    v = vector.unbind(-1)
    once = [2 * part for part in parts.cross(u, v)]
    twice = parts.cross(u, once)
    return torch.stack([a + w * b + c for a, b, c in zip(v, once, twice, strict=True)], dim=-1)


def exp(axis_angle: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 4"]:
    """Unit quaternion of a rotation vector (axis times angle in radians), of any length.

    At the zero vector it is the identity, with the gradient of its Taylor series.
    """
    squared = (axis_angle * axis_angle).sum(-1, keepdim=True)
    small = squared < torch.finfo(squared.dtype).eps ** 0.5
    angle = torch.sqrt(torch.where(small, torch.ones_like(squared), squared))
    series = 0.5 - squared / 48 + squared * squared / 3840
    scale = torch.where(small, series, torch.sin(angle / 2) / angle)
    w = torch.where(small, 1 - squared / 8 + squared * squared / 384, torch.cos(angle / 2))
    return torch.cat([w, axis_angle * scale], dim=-1)


def log(rotation: Float[Tensor, "*batch 4"]) -> Float[Tensor, "*batch 3"]:
    """Rotation vector (axis times angle in radians) of a unit quaternion, at most pi long.

    ``q`` and ``-q`` give the same vector, except at the half turn, where either of its two
    axes is right and the sign of the quaternion chooses. The gradient is finite everywhere on the
    sphere of unit quaternions; a zero quaternion is none, and gives no numbers.
    """
    upper = torch.where(rotation[..., :1] < 0, -rotation, rotation)
    w, u = upper[..., :1], upper[..., 1:]
    squared = (u * u).sum(-1, keepdim=True)
    small = squared < torch.finfo(squared.dtype).eps ** 0.5
    sine = torch.sqrt(torch.where(small, torch.ones_like(squared), squared))
    cosine = torch.where(small, w, torch.ones_like(w))
    tangent = squared / (cosine * cosine).clamp_min(torch.finfo(w.dtype).tiny)
    tangent = torch.where(small, tangent, torch.zeros_like(tangent))
    series = (2 - tangent * (2 / 3) + tangent * tangent * (2 / 5)) / cosine
    scale = torch.where(small, series, 2 * torch.atan2(sine, w) / sine)
    return u * scale


def power(
    rotation: Float[Tensor, "*#batch 4"], exponent: Float[Tensor, "*#batch"] | float
) -> Float[Tensor, "*batch 4"]:
    """Turn by a multiple of the rotation's angle (the short way round) about the same axis."""
    if isinstance(exponent, Tensor):
        exponent = exponent[..., None]
    return exp(log(rotation) * exponent)


def angle(
    first: Float[Tensor, "*#batch 4"], second: Float[Tensor, "*#batch 4"]
) -> Float[Tensor, "*batch"]:
    """Angle in radians, 0 to pi, between two rotations; the sign of a quaternion does not count.

    Its gradient is zero, not undefined, where both are equal. Accurate at small angles too,
    where an arc cosine of the dot product is not.
    """
    difference = product(conjugate(first), second)
    squared = (difference[..., 1:] * difference[..., 1:]).sum(-1)
    same = squared < torch.finfo(squared.dtype).tiny
    sine = torch.sqrt(torch.where(same, torch.ones_like(squared), squared))
    turned = 2 * torch.atan2(sine, difference[..., 0].abs())
    return torch.where(same, torch.zeros_like(turned), turned)


def slerp(
    start: Float[Tensor, "*#batch 4"],
    end: Float[Tensor, "*#batch 4"],
    fraction: Float[Tensor, "*#batch"] | float,
) -> Float[Tensor, "*batch 4"]:
    """Turn from ``start`` (fraction 0) to ``end`` (fraction 1) at constant speed, the short way.

    The result continues the sign of ``start``; at fraction 1 it may therefore be ``-end``.
    """
    return product(start, power(product(conjugate(start), end), fraction))


def unroll(rotations: Float[Tensor, "*shape 4"], dim: int = -3) -> Float[Tensor, "*shape 4"]:
    """Choose signs so that neighbors along ``dim`` lie in one hemisphere; the first stays as it is.

    Args:
        rotations: by default (..., frames, joints, 4), continued along the frames.
        dim: the axis of time; not the last one, which holds the components.

    Source: the antipodal correction of Pavllo et al. 2018, as a running product of signs.
    """
    return rotations * continuous_signs(rotations, dim=dim)


def continuous_signs(rotations: Float[Tensor, "*shape 4"], dim: int) -> Float[Tensor, "*signs 1"]:
    """The signs of ``unroll``, 1 or -1, without a gradient."""
    with torch.no_grad():
        first = torch.ones_like(rotations.narrow(dim, 0, min(1, rotations.shape[dim]))[..., :1])
        if rotations.shape[dim] < 2:
            return first
        earlier = rotations.narrow(dim, 0, rotations.shape[dim] - 1)
        later = rotations.narrow(dim, 1, rotations.shape[dim] - 1)
        agreement = (earlier * later).sum(-1, keepdim=True)
        flips = torch.where(agreement < 0, -torch.ones_like(agreement), torch.ones_like(agreement))
        return torch.cat([first, torch.cumprod(flips, dim=dim)], dim=dim)


def _unit_vector(vector: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 3"]:
    """Direction of a vector; zero where it has none."""
    largest = vector.detach().abs().amax(-1, keepdim=True)
    none = largest == 0
    scaled = vector / torch.where(none, torch.ones_like(largest), largest)
    squared = torch.where(none, torch.ones_like(largest), (scaled * scaled).sum(-1, keepdim=True))
    return scaled * torch.rsqrt(squared)
