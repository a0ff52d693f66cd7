"""Joint positions of many poses as few large operations, and their gradient from torques.

Poses are worked on in chunks that fit the processor's cache, as planes: one row for each joint
and component, one column for each pose. Only the product of rotations needs a walk down the
tree level by level; all bones are turned at once.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor
from torch.autograd.function import once_differentiable

from posecast.skeleton.tree_plan import TreePlan

CHUNK_ELEMENTS = 100_000
"""Poses times joints in a chunk: planes of one component then take 0.4 MB in float32."""


class _Chunk(NamedTuple):
    """What the backward of one chunk reads.

    Args:
        rotations: world rotations of the inner joints, (4, K, poses).
        bones: vectors from each parent to the joint in the world, (J, 3, poses); for roots
            their offsets.
    """

    rotations: Tensor
    bones: Tensor


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
        chunk: int,
        differentiate: bool,
    ) -> Float[Tensor, "poses joints 3"]:
        count, joints = rotations.shape[:2]
        positions = rotations.new_empty(count, joints, 3)
        chunks: list[Tensor] = []
        for start in range(0, count, chunk):
            piece = slice(start, start + chunk)
            turned = _world_rotations(plan, rotations[piece])
            bones = _bones(plan, turned, _offset_planes(offsets, piece))
            if differentiate:
                chunks += _Chunk(turned, bones)
            placed = bones.clone() if differentiate else bones
            if roots is not None:
                placed[plan.roots] += roots[piece].t()
            for level in plan.levels:
                placed.index_add_(0, level.joints, placed.index_select(0, level.parents))
            positions[piece].flatten(1).copy_(placed.flatten(0, 1).t())
        ctx.save_for_backward(*chunks)
        ctx.plan, ctx.chunk, ctx.shared = plan, chunk, offsets.shape[0] != count
        ctx.offsets_shape = offsets.shape
        return positions

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor | None, ...]:
        plan, saved = ctx.plan, ctx.saved_tensors
        _, for_rotations, for_offsets, for_roots, _, _ = ctx.needs_input_grad
        count, joints = gradient.shape[:2]
        rotations = gradient.new_empty(count, joints, 4) if for_rotations else None
        offsets = gradient.new_zeros(ctx.offsets_shape) if for_offsets else None
        for number, start in enumerate(range(0, count, ctx.chunk)):
            piece = slice(start, start + ctx.chunk)
            chunk = _Chunk(*saved[2 * number : 2 * number + 2])
            sums = _planes(gradient[piece]).unflatten(0, (joints, 3))
            _sum_upwards(plan, sums)
            if rotations is not None:
                turned = _rotation_gradient(plan, chunk, sums)
                rotations[piece].flatten(1).copy_(turned.t())
            if offsets is not None:
                pulled = _offset_gradient(plan, chunk, sums)
                if ctx.shared:
                    offsets += pulled.sum(-1)
                else:
                    offsets[piece].flatten(1).copy_(pulled.flatten(0, 1).t())
        roots = gradient.sum(1) if for_roots else None
        return None, rotations, offsets, roots, None, None


def _planes(poses: Float[Tensor, "poses joints parts"]) -> Float[Tensor, "rows poses"]:
    """One row for each joint and component. A single 2-D transpose is the cheapest way there."""
    return poses.flatten(1).t().contiguous()


def _offset_planes(
    offsets: Float[Tensor, "bodies joints 3"], piece: slice
) -> Float[Tensor, "joints 3 poses"]:
    """Offsets of one chunk; a single column where all poses share one body."""
    own = offsets if offsets.shape[0] == 1 else offsets[piece]
    return _planes(own).unflatten(0, offsets.shape[1:])


def _world_rotations(
    plan: TreePlan, rotations: Float[Tensor, "poses joints 4"]
) -> Float[Tensor, "4 inner poses"]:
    """World rotations of the joints that have children: one product a level."""
    local = _planes(rotations).index_select(0, plan.inner_rows)
    world = torch.empty_like(local)
    inner = plan.inner.shape[0]
    local3, world3 = local.view(4, inner, -1), world.view(4, inner, -1)
    for start, stop, above in plan.inner_levels:
        if above is None:
            world3[:, start:stop] = local3[:, start:stop]
            continue
        if isinstance(above, slice):
            parents = world3[:, above]
        else:
            parents = world.index_select(0, above).view(4, stop - start, -1)
        _product(parents, local3[:, start:stop], out=world3[:, start:stop])
    return world3


def _bones(
    plan: TreePlan,
    rotations: Float[Tensor, "4 inner poses"],
    offsets: Float[Tensor, "joints 3 columns"],
) -> Float[Tensor, "joints 3 poses"]:
    """Every joint's vector from its parent, turned into the world; a root's offset as it is."""
    poses = rotations.shape[-1]
    result = rotations.new_empty(offsets.shape[0], 3, poses)
    result[plan.roots] = offsets.index_select(0, plan.roots).expand(-1, -1, poses)
    if plan.levels:
        above = _rows(rotations, plan.hanging_above_rows)
        result[plan.hanging] = _rotate(above, offsets.index_select(0, plan.hanging))
    return result


def _sum_upwards(plan: TreePlan, values: Float[Tensor, "joints parts poses"]) -> None:
    """Add to every joint's values those of all joints below it, in place."""
    for level in reversed(plan.levels):
        values.index_add_(0, level.parents, values.index_select(0, level.joints))


def _rotation_gradient(
    plan: TreePlan, chunk: _Chunk, sums: Float[Tensor, "joints 3 poses"]
) -> Float[Tensor, "rows poses"]:
    """Gradient of the local rotations as rows of all joints; zero for joints without children."""
    inner, poses = chunk.rotations.shape[1:]
    result = sums.new_zeros(4 * inner + 1, poses)  # the last row stays zero: see spread_rows
    if inner == 0:
        return result.index_select(0, plan.spread_rows)
    arms = _cross(chunk.bones.index_select(0, plan.hanging), sums.index_select(0, plan.hanging))
    torques = torch.zeros_like(sums).index_add_(0, plan.hanging_parents, arms)
    _sum_upwards(plan, torques)
    torques = torques.index_select(0, plan.inner).mul_(2).transpose(0, 1)
    # 2 (0, R^T tau) q = conj(R) (2 (0, tau) R q), and R q is the joint's own world rotation
    spun = torch.zeros_like(chunk.rotations)
    _add_product(torques, chunk.rotations, out=spun)
    first = plan.inner_levels[0].stop
    local = result[:-1].view(4, inner, poses)
    local[:, :first] = spun[:, :first]
    if first < inner:
        above = _rows(chunk.rotations, plan.inner_above_rows)
        _product(above, spun[:, first:], out=local[:, first:], sign=-1.0)
    return result.index_select(0, plan.spread_rows)


def _offset_gradient(
    plan: TreePlan, chunk: _Chunk, sums: Float[Tensor, "joints 3 poses"]
) -> Float[Tensor, "joints 3 poses"]:
    """Gradient of the offsets: the sums turned back into the frame of each joint's parent."""
    result = sums.clone()
    if plan.levels:
        above = _rows(chunk.rotations, plan.hanging_above_rows)
        above[1:].neg_()
        result[plan.hanging] = _rotate(above, sums.index_select(0, plan.hanging))
    return result


def _rows(
    rotations: Float[Tensor, "4 inner poses"], rows: Tensor
) -> Float[Tensor, "4 chosen poses"]:
    """Planes of chosen inner joints, copied as whole rows: faster than indexing the middle axis."""
    return rotations.flatten(0, 1).index_select(0, rows).unflatten(0, (4, -1))


def _product(left: Tensor, right: Tensor, *, out: Tensor, sign: float = 1.0) -> None:
    """Hamilton product of planes (4, n, poses) into ``out``; ``sign=-1.0`` conjugates the left."""
    torch.mul(left[0], right, out=out)
    _add_product(left[1:], right, out=out, sign=sign)


def _add_product(vector: Tensor, right: Tensor, *, out: Tensor, sign: float = 1.0) -> None:
    """Add the product of (0, ``vector``) with planes of quaternions to ``out``."""
    x, y, z = vector.unbind(0)
    rw, rx, ry, rz = right.unbind(0)
    ow, ox, oy, oz = out.unbind(0)
    out[1:].addcmul_(vector, rw, value=sign)
    ow.addcmul_(x, rx, value=-sign).addcmul_(y, ry, value=-sign).addcmul_(z, rz, value=-sign)
    ox.addcmul_(y, rz, value=sign).addcmul_(z, ry, value=-sign)
    oy.addcmul_(z, rx, value=sign).addcmul_(x, rz, value=-sign)
    oz.addcmul_(x, ry, value=sign).addcmul_(y, rx, value=-sign)


def _cross(left: Tensor, right: Tensor) -> Tensor:
    """Cross product of planes (n, 3, poses)."""
    result = torch.empty_like(left)
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        torch.mul(left[:, i], right[:, j], out=result[:, k])
        result[:, k].addcmul_(left[:, j], right[:, i], value=-1)
    return result


def _rotate(rotations: Tensor, vectors: Tensor) -> Tensor:
    """Rotate planes (n, 3, poses or 1) by planes (4, n, poses): v + w t + u x t, t = 2 u x v."""
    w, u = rotations[0], rotations[1:]
    doubled = 2 * vectors
    t = []
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        t.append((u[i] * doubled[:, j]).addcmul_(u[j], doubled[:, i], value=-1))
    result = rotations.new_empty(vectors.shape[0], 3, rotations.shape[-1])
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        torch.addcmul(vectors[:, k], w, t[k], out=result[:, k])
        result[:, k].addcmul_(u[i], t[j]).addcmul_(u[j], t[i], value=-1)
    return result
