"""Arithmetic on planes: for each joint and component one contiguous row of poses.

The same formulas as ``geometry.quaternion``, in place and for the layout that the functions of
``level_products`` use: quaternions (n, 4, poses), vectors (n, 3, poses). No gradients here.
Views of a buffer are made once, with the buffer: making one takes as long as a product of a
thousand numbers.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import torch
from torch import Tensor

CHUNK_ELEMENTS = 66_000
"""Poses times joints in a chunk: 2100 poses of 31 joints, near the best of 400 to 3200 measured.

Fewer poses pay more for each call; of more, what one step reads and writes leaves the cache.
"""


class Vectors:
    """Vectors (n, 3, poses) and the views of them that the formulas need."""

    def __init__(self, planes: Tensor, parts: tuple[Tensor, ...] | None = None) -> None:
        self.all = planes
        self.parts = parts or planes.unbind(1)


class Quaternions:
    """Quaternions (n, 4, poses), components (w, x, y, z), and views of them."""

    def __init__(self, planes: Tensor) -> None:
        self.all = planes
        self.parts = planes.unbind(1)
        self.scalar = planes[:, :1]
        self.vector = Vectors(planes[:, 1:], self.parts[1:])


def pieces(count: int, joints: int) -> Iterator[slice]:
    """Chunks of poses of about equal length, the longest first."""
    chunks = max(1, math.ceil(count * joints / CHUNK_ELEMENTS))
    length = max(1, math.ceil(count / chunks))
    for start in range(0, count, length):
        yield slice(start, min(start + length, count))


def transposed(table: Tensor) -> Tensor:
    """A contiguous copy of the transpose of a matrix; no empty ones.

    Shuffling the channels of a single pixel is a transpose, and in float32 on a CPU it is two
    to three times as fast as copying ``table.t()``: it moves blocks through vector registers.
    """
    rows, columns = table.shape
    size = table.numel()
    pixel = table.contiguous().as_strided((1, size, 1, 1), (size, 1, size, size))
    return torch.channel_shuffle(pixel, rows).view(columns, rows)


def to_planes(poses: Tensor) -> Tensor:
    """(joints, parts, poses) from (poses, joints, parts)."""
    return transposed(poses.flatten(1)).view(*poses.shape[1:], poses.shape[0])


def from_planes(planes: Tensor) -> Tensor:
    """(poses, joints, parts) from (joints, parts, poses)."""
    return transposed(planes.flatten(0, 1)).view(planes.shape[2], *planes.shape[:2])


def product(left: Quaternions, right: Quaternions, *, out: Quaternions, sign: float = 1.0) -> None:
    """Hamilton product of quaternions into ``out``; ``sign=-1.0`` conjugates the left one."""
    torch.mul(left.scalar, right.all, out=out.all)
    add_product(left.vector, right, out=out, scale=sign)


def add_product(left: Vectors, right: Quaternions, *, out: Quaternions, scale: float) -> None:
    """Add ``scale`` times the product of (0, ``left``) and ``right`` to ``out``."""
    x, y, z = left.parts
    _, rx, ry, rz = right.parts
    ow, ox, oy, oz = out.parts
    out.vector.all.addcmul_(left.all, right.scalar, value=scale)
    ow.addcmul_(x, rx, value=-scale).addcmul_(y, ry, value=-scale).addcmul_(z, rz, value=-scale)
    ox.addcmul_(y, rz, value=scale).addcmul_(z, ry, value=-scale)
    oy.addcmul_(z, rx, value=scale).addcmul_(x, rz, value=-scale)
    oz.addcmul_(x, ry, value=scale).addcmul_(y, rx, value=-scale)


def cross(left: Vectors, right: Vectors, *, out: Vectors) -> None:
    """Cross product of vectors into ``out``."""
    a, b, c = left.parts, right.parts, out.parts
    for k, i, j in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        torch.mul(a[i], b[j], out=c[k]).addcmul_(a[j], b[i], value=-1)


def rotate(rotation: Quaternions, vector: Vectors, *, twice: Vectors, out: Vectors) -> None:
    """Rotate vectors by unit quaternions into ``out``: v + w t + u x t with t = 2 u x v.

    Args:
        rotation: n quaternions.
        vector: n vectors, (n, 3, 1) where all poses share them.
        twice: a buffer for t.
        out: n vectors.
    """
    cross(rotation.vector, Vectors(2 * vector.all), out=twice)
    torch.addcmul(vector.all, rotation.scalar, twice.all, out=out.all)
    u, t, result = rotation.vector.parts, twice.parts, out.parts
    for k, i, j in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        result[k].addcmul_(u[i], t[j]).addcmul_(u[j], t[i], value=-1)
