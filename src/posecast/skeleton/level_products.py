"""Kinematics of many poses as few large operations, forwards and backwards.

Poses are worked on in chunks that fit the processor's cache, as planes: one row for each joint
and component, one column for each pose. Only the product of rotations needs a walk down the
tree level by level; all bones are turned at once. Intermediate planes live in buffers that all
chunks of a call share, because fresh memory costs more than the arithmetic.
"""

from __future__ import annotations

from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor
from torch.autograd.function import once_differentiable

from posecast.skeleton.planes import Scratch, add_product, cross, pieces, product, rotate
from posecast.skeleton.tree_plan import TreePlan


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
        scratch = Scratch(rotations)
        kept: list[Tensor] = []
        for piece in pieces(count, joints):
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
        scratch = Scratch(gradient)
        for number, piece in enumerate(pieces(count, joints)):
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


class WorldRotations(torch.autograd.Function):
    """Products of rotations (B, J, 4) down the tree, and their full gradient, up the tree.

    With G_j = G_p q_j for parent p and g the gradient of the G, from the leaves upwards:
    dL/dq_j = conj(G_p) g_j and g_p += g_j conj(q_j). Quaternions need not be unit.
    """

    @staticmethod
    def forward(
        ctx: Any, plan: TreePlan, rotations: Float[Tensor, "poses joints 4"]
    ) -> Float[Tensor, "poses joints 4"]:
        count, joints = rotations.shape[:2]
        world = torch.empty_like(rotations, memory_format=torch.contiguous_format)
        scratch = Scratch(rotations)
        for piece in pieces(count, joints):
            local = _ordered(plan, scratch, "local", rotations[piece])
            turned = scratch("turned", *local.shape)
            turned[:, : plan.roots] = local[:, : plan.roots]
            for number, level in enumerate(plan.levels):
                above = scratch.inner(f"above {number}", turned, level.rows)
                product(above, local[:, level.joints], out=turned[:, level.joints])
            whole = scratch.rows("whole", turned.flatten(0, 1), plan.own_rows)
            world[piece].flatten(1).copy_(whole.t())
        ctx.save_for_backward(rotations, world)
        ctx.plan = plan
        return world

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[None, Tensor]:
        plan: TreePlan = ctx.plan
        rotations, world = ctx.saved_tensors
        count, joints = rotations.shape[:2]
        result = torch.empty_like(rotations, memory_format=torch.contiguous_format)
        scratch = Scratch(rotations)
        for piece in pieces(count, joints):
            inverse = _ordered(plan, scratch, "inverse", rotations[piece])
            inverse[1:].neg_()
            turned = _ordered(plan, scratch, "turned", world[piece])
            pulled = _ordered(plan, scratch, "pulled", gradient[piece])
            for number, level in reversed(list(enumerate(plan.levels))):
                below = pulled[:, level.joints]
                lifted = scratch(f"lifted {number}", *below.shape)
                product(below, inverse[:, level.joints], out=lifted)
                pulled.flatten(0, 1).index_add_(0, level.rows, lifted.flatten(0, 1))
            local = scratch("local", *pulled.shape)
            local[:, : plan.roots] = pulled[:, : plan.roots]
            above = scratch.inner("above", turned, plan.above_rows)
            product(above, pulled[:, plan.roots :], out=local[:, plan.roots :], sign=-1.0)
            whole = scratch.rows("whole", local.flatten(0, 1), plan.own_rows)
            result[piece].flatten(1).copy_(whole.t())
        return None, result


def _ordered(
    plan: TreePlan, scratch: Scratch, name: str, rotations: Float[Tensor, "poses joints 4"]
) -> Float[Tensor, "4 joints poses"]:
    """Planes of quaternions in level order."""
    planes = scratch.planes(f"{name} as they come", rotations)
    return scratch.rows(name, planes, plan.order_rows).view(4, *rotations.shape[1::-1])


def _world_rotations(
    plan: TreePlan,
    scratch: Scratch,
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
    scratch: Scratch,
    world: Float[Tensor, "4 inner poses"],
    offsets: Float[Tensor, "bodies joints 3"],
    *,
    out: Float[Tensor, "joints 3 poses"],
) -> None:
    """Every joint's vector from its parent, turned into the world; a root's offset as it is."""
    bodies = scratch.planes("bodies", offsets).view(*out.shape[:2], offsets.shape[0])
    bodies = scratch.rows("bodies in order", bodies, plan.order)
    out[: plan.roots] = bodies[: plan.roots]
    above = scratch.inner("above", world, plan.hanging_above_rows)
    twice = scratch("twice", 3, *above.shape[1:])
    rotate(above, bodies[plan.roots :], twice=twice, out=out[plan.roots :])


def _sum_upwards(plan: TreePlan, values: Float[Tensor, "joints 3 poses"]) -> None:
    """Add to every joint's values those of all joints below it, in place."""
    for level in reversed(plan.levels):
        values[level.upper].index_add_(0, level.places, values[level.joints])


def _rotation_gradient(
    plan: TreePlan,
    scratch: Scratch,
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
    scratch: Scratch,
    world: Float[Tensor, "4 inner poses"],
    sums: Float[Tensor, "joints 3 poses"],
) -> Float[Tensor, "joints 3 poses"]:
    """Gradient of the offsets: the sums turned back into the frame of each joint's parent."""
    result = scratch("pulled", *sums.shape)
    result[: plan.roots] = sums[: plan.roots]
    above = scratch.inner("above", world, plan.hanging_above_rows)
    above[1:].neg_()
    twice = scratch("twice", 3, *above.shape[1:])
    rotate(above, sums[plan.roots :], twice=twice, out=result[plan.roots :])
    return scratch.rows("pulled in order", result, plan.places)
