"""Between quaternions, axis-angle vectors, matrices and six numbers; the nearest rotation."""

from __future__ import annotations

from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor
from torch.autograd.function import once_differentiable

from posecast.geometry import quaternion


def axis_angle_to_quaternion(axis_angle: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 4"]:
    """Unit quaternion of a rotation vector: axis times angle in radians."""
    return quaternion.exp(axis_angle)


def quaternion_to_axis_angle(rotation: Float[Tensor, "*batch 4"]) -> Float[Tensor, "*batch 3"]:
    """Rotation vector, at most pi long, of a unit quaternion; see ``quaternion.log``."""
    return quaternion.log(rotation)


def quaternion_to_matrix(rotation: Float[Tensor, "*batch 4"]) -> Float[Tensor, "*batch 3 3"]:
    """Matrix that rotates column vectors like the unit quaternion does."""
    w, x, y, z = rotation.unbind(-1)
    entries = [
        *(1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)),
        *(2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)),
        *(2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)),
    ]
    return torch.stack(entries, dim=-1).unflatten(-1, (3, 3))


def matrix_to_quaternion(matrix: Float[Tensor, "*batch 3 3"]) -> Float[Tensor, "*batch 4"]:
    """Unit quaternion with w >= 0 of a rotation matrix.

    No entry of the matrix is divided by a small number, so value and gradient are accurate at
    every angle, the half turn included. The matrix must be a rotation: see ``nearest_rotation``.

    Source: the four rows of 4 q q^T are linear in the matrix; the one of the largest component
    is kept (Shepperd 1978) and normalized.
    """
    (r00, r01, r02), (r10, r11, r12), (r20, r21, r22) = (
        row.unbind(-1) for row in matrix.unbind(-2)
    )
    wx, wy, wz = r21 - r12, r02 - r20, r10 - r01
    xy, yz, zx = r01 + r10, r12 + r21, r20 + r02
    rows = torch.stack(
        [
            torch.stack([1 + r00 + r11 + r22, wx, wy, wz], dim=-1),
            torch.stack([wx, 1 + r00 - r11 - r22, xy, zx], dim=-1),
            torch.stack([wy, xy, 1 - r00 + r11 - r22, yz], dim=-1),
            torch.stack([wz, zx, yz, 1 - r00 - r11 + r22], dim=-1),
        ],
        dim=-2,
    )
    largest = torch.diagonal(rows, dim1=-2, dim2=-1).argmax(-1)
    chosen = torch.take_along_dim(rows, largest[..., None, None], dim=-2).squeeze(-2)
    unit = quaternion.normalize(chosen)
    return torch.where(unit[..., :1] < 0, -unit, unit)


def matrix_to_ortho6d(matrix: Float[Tensor, "*batch 3 3"]) -> Float[Tensor, "*batch 6"]:
    """First column of a rotation matrix, then its second (Zhou et al. 2019)."""
    return matrix[..., :2].transpose(-1, -2).flatten(-2)


def ortho6d_to_matrix(ortho6d: Float[Tensor, "*batch 6"]) -> Float[Tensor, "*batch 3 3"]:
    """Rotation whose first two columns are the given ones made orthonormal (Gram-Schmidt).

    Edges: a first column of zero length becomes the x axis; a second one that is parallel to
    the first is replaced by a direction perpendicular to it. Value and gradient are finite.

    Source: Zhou et al. 2019, "On the continuity of rotation representations", eq. 15.
    """
    first = _direction(ortho6d[..., :3], ortho6d.new_tensor([1.0, 0.0, 0.0]))
    second = ortho6d[..., 3:]
    rest = second - (first * second).sum(-1, keepdim=True) * first
    axis = torch.nn.functional.one_hot(first.detach().abs().argmin(-1), 3).to(first.dtype)
    aside = torch.linalg.cross(first, axis)
    aside = aside / torch.linalg.vector_norm(aside, dim=-1, keepdim=True)
    length = torch.linalg.vector_norm(second.detach(), dim=-1, keepdim=True)
    second = _direction(rest, aside, floor=8 * torch.finfo(rest.dtype).eps * length)
    return torch.stack([first, second, torch.linalg.cross(first, second)], dim=-1)


def quaternion_to_ortho6d(rotation: Float[Tensor, "*batch 4"]) -> Float[Tensor, "*batch 6"]:
    """First two columns of the rotation matrix, one after the other."""
    return matrix_to_ortho6d(quaternion_to_matrix(rotation))


def ortho6d_to_quaternion(ortho6d: Float[Tensor, "*batch 6"]) -> Float[Tensor, "*batch 4"]:
    """Unit quaternion with w >= 0 of two columns; edges as in ``ortho6d_to_matrix``."""
    return matrix_to_quaternion(ortho6d_to_matrix(ortho6d))


def nearest_rotation(matrix: Float[Tensor, "*batch 3 3"]) -> Float[Tensor, "*batch 3 3"]:
    """The rotation (determinant +1) closest to a matrix in the sum of squared differences.

    Where several are equally close (rank below two, or a reflection with two equal smallest
    singular values) one of them is returned; the undefined part of the gradient is zero there.
    At a rotation, where a plain SVD has no gradient, this one has. First derivatives only. A matrix
    with a number that is not finite gives no numbers; half precision is computed in float32.

    Source: U diag(1, 1, det UV^T) V^T with M = U S V^T (Kabsch 1976).
    """
    if matrix.dtype in (torch.float16, torch.bfloat16):
        return nearest_rotation(matrix.float()).to(matrix.dtype)
    # The decomposition refuses all matrices if one of them is not finite.
    finite = matrix.isfinite().all(-1, keepdim=True).all(-2, keepdim=True)
    still = torch.eye(3, dtype=matrix.dtype, device=matrix.device)
    found = _NearestRotation.apply(torch.where(finite, matrix, still))
    return torch.where(finite, found, torch.nan)


class _NearestRotation(torch.autograd.Function):
    """SVD projection whose backward divides by sums of singular values, not by differences."""

    @staticmethod
    def forward(ctx: Any, matrix: Tensor) -> Tensor:
        left, singular, right = torch.linalg.svd(matrix)
        # det is +-1 up to rounding, and that sign goes to the smallest singular direction
        sign = torch.where(torch.linalg.det(left @ right) < 0, -1.0, 1.0).to(matrix.dtype)
        signs = torch.stack([torch.ones_like(sign), torch.ones_like(sign), sign], dim=-1)
        right = signs[..., :, None] * right
        ctx.save_for_backward(left, singular * signs, right)
        return left @ right

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> Tensor:
        left, singular, right = ctx.saved_tensors
        inner = left.mT @ gradient @ right.mT
        sums = singular[..., :, None] + singular[..., None, :]
        noise = 8 * torch.finfo(sums.dtype).eps * singular[..., :1, None]
        defined = sums > noise
        skew = (inner - inner.mT) / torch.where(defined, sums, torch.ones_like(sums))
        return left @ torch.where(defined, skew, torch.zeros_like(skew)) @ right


def _direction(
    vector: Float[Tensor, "*batch 3"],
    otherwise: Float[Tensor, "*#batch 3"],
    floor: Float[Tensor, "*#batch 1"] | float = 0.0,
) -> Float[Tensor, "*batch 3"]:
    """Unit vector, or ``otherwise`` where the length does not exceed ``floor``."""
    squared = (vector * vector).sum(-1, keepdim=True)
    tiny = torch.finfo(vector.dtype).tiny
    none = squared <= (torch.as_tensor(floor, dtype=vector.dtype) ** 2).clamp_min(tiny)
    unit = vector * torch.rsqrt(torch.where(none, torch.ones_like(squared), squared))
    return torch.where(none, otherwise, unit)
