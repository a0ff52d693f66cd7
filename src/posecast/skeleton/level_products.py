"""Joint positions of many poses as few large operations, and their gradient from torques.

Poses are worked on in chunks that fit the processor's cache, as planes: one row for each joint
and component, one column for each pose. Only the product of rotations needs a walk down the
tree level by level; all bones are turned at once. Intermediate planes live in buffers that all
chunks of a call share, because fresh memory costs more than the arithmetic.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor
from torch.autograd.function import once_differentiable

from posecast.skeleton.planes import add_product, cross, product, rotate
from posecast.skeleton.tree_plan import TreePlan

CHUNK_ELEMENTS = 70_000
"""Poses times joints in a chunk: planes of one component then take 0.3 MB in float32."""


class JointPositions(torch.autograd.Function):
    """Positions from unit quaternions (B, J, 4), offsets (1 or B, J, 3), roots (B, 3) or none.

    Backward, for a gradient g of the positions: with S_j the sum of g over a joint and all
    below, the torque about a joint is tau_j = sum over the joints k below of bone_k x S_k, and

        dL/dq_j = 2 (0, R^T tau_j) q_j,  dL/doffset_j = R^T S_j,  dL/droot = sum of g,

    where R is the world rotation of the joint's parent. This is the gradient within the sphere
    of unit quaternions; its radial part, which a normalization upstream would remove, is zero.
    """

    @staticmethod
    def forward(
        ctx: Any,
        plan: TreePlan,
        rotations: Float[Tensor, "poses joints 4"],
        offsets: Float[Tensor, "bodies joints 3"],
        roots: Float[Tensor, "poses 3"] | None,
        differentiate: bool,
    ) -> Float[Tensor, "poses joints 3"]:
        count, joints = rotations.shape[:2]
        positions = rotations.new_empty(count, joints, 3)
        scratch = _Scratch(rotations)
        kept: list[Tensor] = []
        for piece in _pieces(count, joints):
            poses = piece.stop - piece.start
            turned, bones = (4, plan.inner.shape[0], poses), (joints, 3, poses)
            if differentiate:
                kept += (rotations.new_empty(turned), rotations.new_empty(bones))
                world, arms = kept[-2:]
            else:
                world, arms = scratch("world", *turned), scratch("arms", *bones)
            _world_rotations(plan, scratch, rotations[piece], out=world)
            own = offsets if offsets.shape[0] == 1 else offsets[piece]
            _bones(plan, scratch, world, own, out=arms)
            placed = scratch("placed", *bones).copy_(arms) if differentiate else arms
            if roots is not None:
                placed[: plan.roots].add_(roots[piece].t())
            for number, level in enumerate(plan.levels):
                above = scratch.rows(f"above {number}", placed[level.upper], level.places)
                placed[level.joints].add_(above)
            placed = scratch.rows("in order", placed, plan.places)
            positions[piece].flatten(1).copy_(placed.flatten(0, 1).t())
        ctx.save_for_backward(*kept)
        ctx.plan, ctx.offsets_shape = plan, offsets.shape
        return positions

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor | None, ...]:
        plan: TreePlan = ctx.plan
        kept: tuple[Tensor, ...] = ctx.saved_tensors
        _, for_rotations, for_offsets, for_roots, _ = ctx.needs_input_grad
        count, joints = gradient.shape[:2]
        rotations = gradient.new_empty(count, joints, 4) if for_rotations else None
        offsets = gradient.new_zeros(ctx.offsets_shape) if for_offsets else None
        scratch = _Scratch(gradient)
        for number, piece in enumerate(_pieces(count, joints)):
            world, arms = kept[2 * number : 2 * number + 2]
            sums = scratch.planes("gradient", gradient[piece]).view(joints, 3, -1)
            sums = scratch.rows("sums", sums, plan.order)
            _sum_upwards(plan, sums)
            if rotations is not None:
                turned = _rotation_gradient(plan, scratch, world, arms, sums)
                rotations[piece].flatten(1).copy_(turned.t())
            if offsets is not None:
                pulled = _offset_gradient(plan, scratch, world, sums)
                if offsets.shape[0] == 1:
                    offsets[0] += pulled.sum(-1)
                else:
                    offsets[piece].flatten(1).copy_(pulled.flatten(0, 1).t())
        roots = gradient.sum(1) if for_roots else None
        return None, rotations, offsets, roots, None


class _Scratch:
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


def _pieces(count: int, joints: int) -> Iterator[slice]:
    """Chunks of poses of about equal length, the longest first."""
    chunks = max(1, math.ceil(count * joints / CHUNK_ELEMENTS))
    length = max(1, math.ceil(count / chunks))
    for start in range(0, count, length):
        yield slice(start, min(start + length, count))


def _world_rotations(
    plan: TreePlan,
    scratch: _Scratch,
    rotations: Float[Tensor, "poses joints 4"],
    *,
    out: Float[Tensor, "4 inner poses"],
) -> None:
    """World rotations of the joints that have children: one product a level."""
    local = scratch.rows("local", scratch.planes("rotations", rotations), plan.inner_rows)
    local = local.view(out.shape)
    for number, (start, stop, above) in enumerate(plan.inner_levels):
        if above is None:
            out[:, start:stop] = local[:, start:stop]
            continue
        if isinstance(above, slice):
            parents = out[:, above]
        else:
            parents = scratch.inner(f"parents {number}", out, above)
        product(parents, local[:, start:stop], out=out[:, start:stop])


def _bones(
    plan: TreePlan,
    scratch: _Scratch,
    world: Float[Tensor, "4 inner poses"],
    offsets: Float[Tensor, "bodies joints 3"],
    *,
    out: Float[Tensor, "joints 3 poses"],
) -> None:
    """Every joint's vector from its parent, turned into the world; a root's offset as it is."""
    bodies = scratch.planes("bodies", offsets).view(*out.shape[:2], offsets.shape[0])
    bodies = scratch.rows("bodies in order", bodies, plan.order)
    out[: plan.roots] = bodies[: plan.roots]
    above = scratch.inner("above", world, plan.above_rows)
    twice = scratch("twice", 3, *above.shape[1:])
    rotate(above, bodies[plan.roots :], twice=twice, out=out[plan.roots :])


def _sum_upwards(plan: TreePlan, values: Float[Tensor, "joints 3 poses"]) -> None:
    """Add to every joint's values those of all joints below it, in place."""
    for level in reversed(plan.levels):
        values[level.upper].index_add_(0, level.places, values[level.joints])


def _rotation_gradient(
    plan: TreePlan,
    scratch: _Scratch,
    world: Float[Tensor, "4 inner poses"],
    arms: Float[Tensor, "joints 3 poses"],
    sums: Float[Tensor, "joints 3 poses"],
) -> Float[Tensor, "rows poses"]:
    """Gradient of the local rotations as rows of all joints; zero for joints without children."""
    inner, poses = world.shape[1:]
    moments = scratch("moments", arms.shape[0] - plan.roots, 3, poses)
    cross(arms[plan.roots :], sums[plan.roots :], out=moments)
    torques = scratch("torques", *sums.shape).zero_().index_add_(0, plan.above, moments)
    _sum_upwards(plan, torques)
    torques = scratch.rows("inner torques", torques, plan.inner).mul_(2)
    # 2 (0, R^T tau) q = conj(R) (2 (0, tau) R q), and R q is the joint's own world rotation
    spun = scratch("spun", *world.shape).zero_()
    add_product(torques.transpose(0, 1), world, out=spun)
    result = scratch("result", 4 * inner + 1, poses)
    result[-1] = 0  # what joints without children read: see spread_rows
    local = result[:-1].view(world.shape)
    turned_roots = inner - plan.inner_above_rows.shape[0] // 4
    local[:, :turned_roots] = spun[:, :turned_roots]
    above = scratch.inner("above", world, plan.inner_above_rows)
    product(above, spun[:, turned_roots:], out=local[:, turned_roots:], sign=-1.0)
    return scratch.rows("spread", result, plan.spread_rows)


def _offset_gradient(
    plan: TreePlan,
    scratch: _Scratch,
    world: Float[Tensor, "4 inner poses"],
    sums: Float[Tensor, "joints 3 poses"],
) -> Float[Tensor, "joints 3 poses"]:
    """Gradient of the offsets: the sums turned back into the frame of each joint's parent."""
    result = scratch("pulled", *sums.shape)
    result[: plan.roots] = sums[: plan.roots]
    above = scratch.inner("above", world, plan.above_rows)
    above[1:].neg_()
    twice = scratch("twice", 3, *above.shape[1:])
    rotate(above, sums[plan.roots :], twice=twice, out=result[plan.roots :])
    return scratch.rows("pulled in order", result, plan.places)
