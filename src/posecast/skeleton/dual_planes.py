"""Dual quaternions of many poses as planes: what ``dual_kinematics`` does where nobody derives."""

from __future__ import annotations

from functools import cache

import torch
from jaxtyping import Float
from torch import Tensor

from posecast.skeleton.planes import (
    Quaternions,
    Vectors,
    add_product,
    cross,
    from_planes,
    pieces,
    product,
    rotate,
    to_planes,
)
from posecast.skeleton.tree_plan import TreePlan
from posecast.skeleton.work_spaces import PlacingSpace


def root_duals(
    plan: TreePlan,
    rotations: Float[Tensor, "poses joints 4"],
    offsets: Float[Tensor, "bodies joints 3"],
) -> Float[Tensor, "poses joints 8"]:
    """Root-relative dual quaternions: rotations and positions of one walk, written side by side."""
    count, joints = rotations.shape[:2]
    result = rotations.new_empty(count, joints, 8)
    levels = (*plan.levels, plan.ends)
    space_for = cache(lambda poses: PlacingSpace(plan, levels, rotations, poses))
    for piece in pieces(count, joints):
        poses = piece.stop - piece.start
        space = space_for(poses)
        space.turn(rotations[piece], offsets if offsets.shape[0] == 1 else offsets[piece])
        record = rotations.new_zeros(joints, 8, poses)
        record[:, :4] = space.walk.world.index_select(0, plan.places)
        turned, dual = Quaternions(record[:, :4]), Quaternions(record[:, 4:])
        add_product(Vectors(space.places(None)), turned, out=dual, scale=0.5)
        result[piece] = from_planes(record)
    return result


def local_motion(
    parents: Tensor, dual_root: Float[Tensor, "poses joints 8"]
) -> tuple[Float[Tensor, "poses joints 4"], Float[Tensor, "poses joints 3"]]:
    """Local rotations and translations, all joints of a chunk at once.

    Args:
        parents: of each joint; -1: a root, which is left as it is.
        dual_root: unit.
    """
    count, joints = dual_root.shape[:2]
    turns = dual_root.new_empty(count, joints, 4)
    moves = dual_root.new_empty(count, joints, 3)
    roots = (parents < 0).nonzero()[:, 0]
    above_of = parents.clamp_min(0)
    for piece in pieces(count, joints):
        planes = to_planes(dual_root[piece])
        own, dual = Quaternions(planes[:, :4]), Quaternions(planes[:, 4:])
        places = torch.empty_like(planes[:, :3])
        cross(own.vector, dual.vector, out=Vectors(places))
        places.addcmul_(own.scalar, dual.vector.all).addcmul_(
            dual.scalar, own.vector.all, value=-1
        ).mul_(2)
        above = Quaternions(own.all.index_select(0, above_of))
        local = Quaternions(torch.empty_like(above.all))
        product(above, own, out=local, sign=-1.0)
        bones = places - places.index_select(0, above_of)
        above.vector.all.neg_()
        moved = Vectors(torch.empty_like(bones))
        rotate(above, Vectors(bones), twice=Vectors(torch.empty_like(bones)), out=moved)
        local.all[roots], moved.all[roots] = own.all[roots], places[roots]
        turns[piece], moves[piece] = from_planes(local.all), from_planes(moved.all)
    return turns, moves
