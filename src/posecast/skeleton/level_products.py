"""Kinematics of many poses as few large operations, forwards and backwards.

Poses are worked on in chunks that fit the processor's cache, as planes: one row for each joint
and component, one column for each pose. Only the product of rotations needs a walk down the
tree level by level; all bones are turned at once.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor
from torch.autograd.function import once_differentiable

from posecast.skeleton.planes import Quaternions, from_planes, pieces, product, to_planes
from posecast.skeleton.tree_plan import TreePlan
from posecast.skeleton.work_spaces import PlacingSpace, PullingSpace, Walk


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
        space_for = cache(lambda poses: PlacingSpace(plan, rotations, poses))
        kept: list[Tensor] = []
        for piece in pieces(count, joints):
            space = space_for(piece.stop - piece.start)
            space.turn(rotations[piece], offsets if offsets.shape[0] == 1 else offsets[piece])
            if differentiate:
                kept += (space.walk.world.clone(), space.bones.clone())
            positions[piece] = space.place(None if roots is None else roots[piece])
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
        space_for = cache(lambda poses: Walk(plan, (*plan.levels, plan.ends), rotations, poses))
        for piece in pieces(count, joints):
            space = space_for(piece.stop - piece.start)
            turned = space.down(to_planes(rotations[piece]))
            world[piece] = from_planes(turned.index_select(0, plan.places))
        ctx.save_for_backward(rotations, world)
        ctx.plan = plan
        return world

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[None, Tensor]:
        plan: TreePlan = ctx.plan
        rotations, world = ctx.saved_tensors
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
            result[piece] = from_planes(local.index_select(0, plan.places))
        return None, result
