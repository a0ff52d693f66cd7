"""Kinematics of many poses as few large operations, forwards and backwards.

Poses are worked on in chunks that fit the processor's cache, as planes: one row for each joint
and component, one column for each pose. Only the product of rotations needs a walk down the
tree level by level; all bones are turned at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import Any, NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor
from torch.autograd.function import once_differentiable

from posecast.skeleton.planes import Quaternions, from_planes, pieces, product, to_planes
from posecast.skeleton.tree_plan import TreePlan
from posecast.skeleton.work_spaces import PlacingSpace, PullingSpace, Walk


class Placement(torch.autograd.Function):
    """Positions from unit quaternions (B, J, 4), offsets (1 or B, J, 3), roots (B, 3) or none.

    World rotations, where they are asked for, come from the same walk down the tree.

    Backward, for a gradient g of the positions: with S_j the sum of g over a joint and all
    below, the torque about a joint is tau_j = sum over the joints k below of bone_k x S_k, and

        dL/dq_j = 2 (0, R^T tau_j) q_j,  dL/doffset_j = R^T S_j,  dL/droot = sum of g,

    where R is the world rotation of the joint's parent. This is the gradient within the sphere
    of unit quaternions; its radial part, which a normalization upstream would remove, is zero.
    A gradient of the world rotations adds that of ``WorldRotations``, which is complete.
    """

    @staticmethod
    def forward(
        ctx: Any,
        plan: TreePlan,
        rotations: Float[Tensor, "poses joints 4"],
        offsets: Float[Tensor, "bodies joints 3"],
        roots: Float[Tensor, "poses 3"] | None,
        with_rotations: bool,
        differentiate: bool,
    ) -> tuple[Float[Tensor, "poses joints 3"], Float[Tensor, "poses joints 4"] | None]:
        count, joints = rotations.shape[:2]
        positions = rotations.new_empty(count, joints, 3)
        world = rotations.new_empty(count, joints, 4) if with_rotations else None
        levels = (*plan.levels, plan.ends) if with_rotations else plan.levels
        space_for = cache(lambda poses: PlacingSpace(plan, levels, rotations, poses))
        kept: list[Tensor] = []
        for piece in pieces(count, joints):
            space = space_for(piece.stop - piece.start)
            space.turn(rotations[piece], offsets if offsets.shape[0] == 1 else offsets[piece])
            if differentiate:
                kept += (space.walk.world[: plan.turned].clone(), space.bones.clone())
            if world is not None:
                world[piece] = _in_order_of_skeleton(space.walk.world, plan)
            positions[piece] = space.place(None if roots is None else roots[piece])
        pulls = with_rotations and ctx.needs_input_grad[1]
        ctx.save_for_backward(*((rotations, world) if pulls else (None, None)), *kept)
        ctx.plan, ctx.offsets_shape = plan, offsets.shape
        ctx.set_materialize_grads(False)
        return positions, world

    @staticmethod
    @once_differentiable
    def backward(
        ctx: Any, of_positions: Tensor | None, of_rotations: Tensor | None
    ) -> tuple[Tensor | None, ...]:
        local, world, *kept = ctx.saved_tensors
        rotations, offsets, roots = None, None, None
        if of_positions is not None:
            rotations, offsets, roots = _pull_positions(
                ctx.plan, of_positions, kept, ctx.offsets_shape, ctx.needs_input_grad[1:4]
            )
        if of_rotations is not None and ctx.needs_input_grad[1]:
            pulled = _pull_rotations(ctx.plan, of_rotations, local, world)
            rotations = pulled if rotations is None else rotations.add_(pulled)
        return None, rotations, offsets, roots, None, None


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
        space_for = cache(lambda poses: Walk(plan, (*plan.levels, plan.ends), rotations, poses))
        for piece in pieces(count, joints):
            space = space_for(piece.stop - piece.start)
            world[piece] = _in_order_of_skeleton(space.down(to_planes(rotations[piece])), plan)
        ctx.save_for_backward(rotations, world)
        ctx.plan = plan
        return world

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[None, Tensor]:
        return None, _pull_rotations(ctx.plan, gradient, *ctx.saved_tensors)


def _in_order_of_skeleton(
    planes: Float[Tensor, "joints 4 poses"], plan: TreePlan
) -> Float[Tensor, "poses joints 4"]:
    """Rotations that are in the order of work, as the skeleton has them."""
    return from_planes(planes.index_select(0, plan.places))


class _Pulled(NamedTuple):
    """Gradients of what positions are made from; ``None`` where nobody asked."""

    rotations: Tensor | None
    offsets: Tensor | None
    roots: Tensor | None


def _pull_positions(
    plan: TreePlan,
    gradient: Float[Tensor, "poses joints 3"],
    kept: Sequence[Tensor],
    offsets_shape: torch.Size,
    wanted: tuple[bool, bool, bool],
) -> _Pulled:
    """Gradients of rotations, offsets and roots from that of the positions; see ``Placement``.

    Args:
        plan: of the skeleton.
        gradient: of the positions.
        kept: for each chunk the world rotations of its turned joints and its bones.
        offsets_shape: one body or one for each pose.
        wanted: which of the three to compute.
    """
    count, joints = gradient.shape[:2]
    rotations = gradient.new_empty(count, joints, 4) if wanted[0] else None
    offsets = gradient.new_zeros(offsets_shape) if wanted[1] else None
    space_for = cache(lambda poses: PullingSpace(plan, gradient, poses))
    for number, piece in enumerate(pieces(count, joints)):
        space = space_for(piece.stop - piece.start)
        space.sum(gradient[piece], world=kept[2 * number])
        if rotations is not None:
            rotations[piece] = space.rotation_gradient(bones=kept[2 * number + 1])
        if offsets is not None:
            pulled = space.offset_gradient()
            if offsets.shape[0] == 1:
                offsets[0] += pulled.sum(-1)
            else:
                offsets[piece] = from_planes(pulled)
    return _Pulled(rotations, offsets, gradient.sum(1) if wanted[2] else None)


def _pull_rotations(
    plan: TreePlan,
    gradient: Float[Tensor, "poses joints 4"],
    rotations: Float[Tensor, "poses joints 4"],
    world: Float[Tensor, "poses joints 4"],
) -> Float[Tensor, "poses joints 4"]:
    """Gradient of local rotations from that of world rotations; see ``WorldRotations``."""
    result = torch.empty_like(rotations, memory_format=torch.contiguous_format)
    for piece in pieces(*rotations.shape[:2]):
        inverse, turned, pulled = (
            to_planes(planes[piece]).index_select(0, plan.order)
            for planes in (rotations, world, gradient)
        )
        inverse[:, 1:].neg_()
        lifted = torch.empty_like(pulled)
        for level in (plan.ends, *reversed(plan.levels)):
            below, back, above = (
                Quaternions(planes[level.joints]) for planes in (pulled, inverse, lifted)
            )
            product(below, back, out=above)
            for run in level.runs:
                pulled[run.parents] += lifted[run.joints]
        local = pulled.clone()
        product(
            Quaternions(turned.index_select(0, plan.parents)),
            Quaternions(pulled[plan.roots :]),
            out=Quaternions(local[plan.roots :]),
            sign=-1.0,
        )
        result[piece] = _in_order_of_skeleton(local, plan)
    return result
