"""Unit quaternions (w, x, y, z), Hamilton product, active rotations."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor


def identity(*shape: int, like: Tensor) -> Float[Tensor, "*shape 4"]:
    """Identity rotations (1, 0, 0, 0) with the dtype and device of ``like``."""
    result = like.new_zeros(*shape, 4)
    result[..., 0] = 1
    return result


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
    return rotation * rotation.new_tensor([1.0, -1.0, -1.0, -1.0])


def normalize(
    quaternion: Float[Tensor, "*batch 4"], eps: float = 1e-12
) -> Float[Tensor, "*batch 4"]:
    """Scale to unit length; a quaternion of zero length becomes the identity."""
    squared = (quaternion * quaternion).sum(-1, keepdim=True)
    vanishing = squared < eps * eps
    safe = torch.where(vanishing, torch.ones_like(squared), squared)
    unit = quaternion * torch.rsqrt(safe)
    one = torch.zeros_like(quaternion)
    one[..., 0] = 1
    return torch.where(vanishing, one, unit)


def rotate(
    rotation: Float[Tensor, "*#batch 4"], vector: Float[Tensor, "*#batch 3"]
) -> Float[Tensor, "*batch 3"]:
    """Rotate vectors by unit quaternions; batch axes broadcast.

    Args:
        rotation: unit quaternions (w, x, y, z). Not renormalized: see ``normalize``.
        vector: any unit of length; the result has the same.

    Source: Rodrigues' formula written with q = (w, u): v + 2w (u x v) + 2u x (u x v).
    """
    w = rotation[..., :1]
    u, v = torch.broadcast_tensors(rotation[..., 1:], vector)
    t = 2 * torch.linalg.cross(u, v)
    return v + w * t + torch.linalg.cross(u, t)
