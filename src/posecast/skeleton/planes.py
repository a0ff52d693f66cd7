"""Quaternion arithmetic on planes: one contiguous row of poses for each joint and component.

The same formulas as ``geometry.quaternion``, in place and for the layout that the functions of
``level_products`` use: quaternions (4, n, poses), vectors (n, 3, poses). No gradients here.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import torch
from torch import Tensor

CHUNK_ELEMENTS = 70_000
"""Poses times joints in a chunk: planes of one component then take 0.3 MB in float32."""


class Scratch:
    """Named buffers of one call, made at first use and used again by every later chunk."""

    def __init__(self, like: Tensor) -> None:
        self.like = like
        self.buffers: dict[str, Tensor] = {}

    def __call__(self, name: str, *shape: int) -> Tensor:
        """An uninitialized tensor; it overwrites what the name stood for before."""
        size = math.prod(shape)
        buffer = self.buffers.get(name)
        if buffer is None or buffer.shape[0] < size:
            buffer = self.buffers[name] = self.like.new_empty(size)
        return buffer[:size].view(shape)

    def planes(self, name: str, poses: Tensor) -> Tensor:
        """A row for each joint and component of (poses, J, parts): one 2-D transpose."""
        flat = poses.flatten(1)
        return self(name, flat.shape[1], flat.shape[0]).copy_(flat.t())

    def rows(self, name: str, table: Tensor, rows: Tensor) -> Tensor:
        """Whole rows of a table, in the order asked for: faster than indexing a middle axis."""
        result = self(name, rows.shape[0], *table.shape[1:])
        return torch.index_select(table, 0, rows, out=result)

    def inner(self, name: str, rotations: Tensor, rows: Tensor) -> Tensor:
        """Planes (4, n, poses) of some inner joints from those of all, (4, K, poses)."""
        chosen = self.rows(name, rotations.flatten(0, 1), rows)
        return chosen.view(4, rows.shape[0] // 4, rotations.shape[-1])


def pieces(count: int, joints: int) -> Iterator[slice]:
    """Chunks of poses of about equal length, the longest first."""
    chunks = max(1, math.ceil(count * joints / CHUNK_ELEMENTS))
    length = max(1, math.ceil(count / chunks))
    for start in range(0, count, length):
        yield slice(start, min(start + length, count))


def product(left: Tensor, right: Tensor, *, out: Tensor, sign: float = 1.0) -> None:
    """Hamilton product of quaternions into ``out``; ``sign=-1.0`` conjugates the left one."""
    torch.mul(left[0], right, out=out)
    add_product(left[1:], right, out=out, sign=sign)


def add_product(vector: Tensor, right: Tensor, *, out: Tensor, sign: float = 1.0) -> None:
    """Add ``sign`` times the product of (0, ``vector``) and ``right`` to ``out``.

    Args:
        vector: (3, n, poses), unlike vectors elsewhere: the last three planes of quaternions.
        right: quaternions (4, n, poses).
        out: quaternions (4, n, poses).
        sign: 1 or -1.
    """
    x, y, z = vector.unbind(0)
    rw, rx, ry, rz = right.unbind(0)
    ow, ox, oy, oz = out.unbind(0)
    out[1:].addcmul_(vector, rw, value=sign)
    ow.addcmul_(x, rx, value=-sign).addcmul_(y, ry, value=-sign).addcmul_(z, rz, value=-sign)
    ox.addcmul_(y, rz, value=sign).addcmul_(z, ry, value=-sign)
    oy.addcmul_(z, rx, value=sign).addcmul_(x, rz, value=-sign)
    oz.addcmul_(x, ry, value=sign).addcmul_(y, rx, value=-sign)


def cross(left: Tensor, right: Tensor, *, out: Tensor) -> None:
    """Cross product of vectors into ``out``."""
    a, b, c = left.unbind(1), right.unbind(1), out.unbind(1)
    for k, i, j in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        torch.mul(a[i], b[j], out=c[k]).addcmul_(a[j], b[i], value=-1)


def rotate(rotation: Tensor, vector: Tensor, *, twice: Tensor, out: Tensor) -> None:
    """Rotate vectors by unit quaternions into ``out``: v + w t + u x t with t = 2 u x v.

    Args:
        rotation: quaternions (4, n, poses).
        vector: (n, 3, poses), or (n, 3, 1) where all poses share them.
        twice: a buffer (3, n, poses) for t.
        out: (n, 3, poses).
    """
    w, u, t = rotation[0], rotation[1:].unbind(0), twice.unbind(0)
    v, doubled, result = vector.unbind(1), (2 * vector).unbind(1), out.unbind(1)
    for k, i, j in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        torch.mul(u[i], doubled[j], out=t[k]).addcmul_(u[j], doubled[i], value=-1)
    for k, i, j in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        torch.addcmul(v[k], w, t[k], out=result[k])
        result[k].addcmul_(u[i], t[j]).addcmul_(u[j], t[i], value=-1)
