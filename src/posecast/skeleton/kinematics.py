"""Forward kinematics and local <-> root-relative rotations, a whole tree level at a time.

Inside ``torch.compile`` and ``torch.export`` the same results come from a plain loop over joints,
which the compiler unrolls and fuses; there all gradients are complete and of any order.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from posecast.errors import SkeletonError
from posecast.geometry import quaternion
from posecast.skeleton.level_products import Placement, WorldRotations
from posecast.skeleton.skeleton import Skeleton
from posecast.skeleton.tree_plan import tree_plan


class World(NamedTuple):
    """Where every joint is and how it is turned, in the frame of the floor.

    Args:
        positions: meters (the unit of the offsets).
        rotations: unit quaternions (w, x, y, z).
    """

    positions: Float[Tensor, "*batch joints 3"]
    rotations: Float[Tensor, "*batch joints 4"]


def forward_kinematics(
    skeleton: Skeleton,
    rotations_local: Float[Tensor, "*batch joints 4"],
    offsets: Float[Tensor, "*#batch joints 3"],
    root_positions: Float[Tensor, "*batch 3"] | None = None,
) -> World:
    """World positions and rotations of all joints.

    Gradients are those of ``joint_positions`` and ``local_to_root``; both results belong to one
    step back, so change neither in place before it. Ask for the positions alone where the rotations
    are not needed.

    Args:
        skeleton: a forest; every root is at ``root_positions`` plus its own offset.
        rotations_local: unit quaternions relative to the parent; for a root, to the world.
        offsets: translation of each joint from its parent in the parent's frame, meters: one
            body, one for each batch entry, or one for each frame, as the batch axes say.
        root_positions: meters; ``None``: at the origin.

    Raises:
        SkeletonError: the number of joints is not that of the skeleton.
    """
    check_joints(skeleton, rotations_local.shape[-2])
    check_joints(skeleton, offsets.shape[-2])
    if torch.compiler.is_compiling():
        return _world_by_joint(skeleton, rotations_local, offsets, root_positions)
    positions, rotations = _place(
        skeleton, rotations_local, offsets, root_positions, with_rotations=True
    )
    assert rotations is not None
    return World(positions, rotations)


def joint_positions(
    skeleton: Skeleton,
    rotations_local: Float[Tensor, "*batch joints 4"],
    offsets: Float[Tensor, "*#batch joints 3"],
    root_positions: Float[Tensor, "*batch 3"] | None = None,
) -> Float[Tensor, "*batch joints 3"]:
    """World positions of all joints, fast: for losses, metrics and drawing.

    Arguments and errors as for ``forward_kinematics``. Any number of poses; they are worked on
    in chunks that stay in the cache.

    The gradient with respect to rotations is the one within the sphere of unit quaternions: it
    has no part along the quaternion, so rotations must come from something that normalizes.
    Offsets and root positions have their full gradient. First derivatives only.
    """
    check_joints(skeleton, rotations_local.shape[-2])
    check_joints(skeleton, offsets.shape[-2])
    if torch.compiler.is_compiling():
        return _world_by_joint(skeleton, rotations_local, offsets, root_positions).positions
    return _place(skeleton, rotations_local, offsets, root_positions, with_rotations=False)[0]


def _place(
    skeleton: Skeleton,
    rotations_local: Float[Tensor, "*batch joints 4"],
    offsets: Float[Tensor, "*#batch joints 3"],
    root_positions: Float[Tensor, "*batch 3"] | None,
    *,
    with_rotations: bool,
) -> tuple[Float[Tensor, "*batch joints 3"], Float[Tensor, "*batch joints 4"] | None]:
    """Positions and, if asked for, rotations of any number of poses."""
    joints, batch = len(skeleton), rotations_local.shape[:-2]
    poses = math.prod(batch)
    if math.prod(offsets.shape[:-2]) == 1:
        bodies = offsets.reshape(1, joints, 3)
    else:
        bodies = offsets.expand(*batch, joints, 3).reshape(poses, joints, 3)
    roots = None if root_positions is None else root_positions.reshape(poses, 3)
    inputs = (rotations_local.reshape(poses, joints, 4), bodies, roots)
    positions, rotations = Placement.apply(
        tree_plan(skeleton, rotations_local.device),
        *inputs,
        with_rotations,
        torch.is_grad_enabled() and any(x is not None and x.requires_grad for x in inputs),
    )
    return (
        positions.reshape(*batch, joints, 3),
        None if rotations is None else rotations.reshape(*batch, joints, 4),
    )


def local_to_root(
    skeleton: Skeleton, rotations_local: Float[Tensor, "*batch joints 4"]
) -> Float[Tensor, "*batch joints 4"]:
    """Root-relative rotations from those relative to the parent: products down the tree.

    A root's own rotation stays part of the chain, so with the root's rotation in the world
    these are world rotations ("current" in Andreou et al. 2022). The gradient is complete, also
    for quaternions that are not unit; first derivatives only.

    Raises:
        SkeletonError: the number of joints is not that of the skeleton.
    """
    check_joints(skeleton, rotations_local.shape[-2])
    if torch.compiler.is_compiling():
        return torch.stack(_rotations_by_joint(skeleton, rotations_local), dim=-2)
    poses = rotations_local.reshape(-1, *rotations_local.shape[-2:])
    world = WorldRotations.apply(tree_plan(skeleton, rotations_local.device), poses)
    return world.reshape(rotations_local.shape)


def root_to_local(
    skeleton: Skeleton, rotations_root: Float[Tensor, "*batch joints 4"]
) -> Float[Tensor, "*batch joints 4"]:
    """Rotations relative to the parent from root-relative ones; all joints at once.

    Raises:
        SkeletonError: the number of joints is not that of the skeleton.
    """
    check_joints(skeleton, rotations_root.shape[-2])
    plan = tree_plan(skeleton, rotations_root.device)
    ordered = rotations_root.index_select(-2, plan.order)
    above = quaternion.conjugate(ordered.index_select(-2, plan.parents))
    local = quaternion.product(above, ordered[..., plan.roots :, :])
    whole = torch.cat([ordered[..., : plan.roots, :], local], dim=-2)
    return whole.index_select(-2, plan.places)


def _rotations_by_joint(
    skeleton: Skeleton, rotations_local: Float[Tensor, "*batch joints 4"]
) -> list[Tensor]:
    """World rotation of each joint, from operations that a compiler sees through."""
    turned: list[Tensor] = []
    for joint, parent in enumerate(skeleton.parents):
        own = rotations_local[..., joint, :]
        turned.append(own if parent == -1 else quaternion.product(turned[parent], own))
    return turned


def _world_by_joint(
    skeleton: Skeleton,
    rotations_local: Float[Tensor, "*batch joints 4"],
    offsets: Float[Tensor, "*#batch joints 3"],
    root_positions: Float[Tensor, "*batch 3"] | None,
) -> World:
    """World positions and rotations, from operations that a compiler sees through."""
    turned = _rotations_by_joint(skeleton, rotations_local)
    bodies = offsets.expand(*rotations_local.shape[:-1], 3)
    placed: list[Tensor] = []
    for joint, parent in enumerate(skeleton.parents):
        bone = bodies[..., joint, :]
        if parent >= 0:
            placed.append(placed[parent] + quaternion.rotate(turned[parent], bone))
        else:
            placed.append(bone if root_positions is None else bone + root_positions)
    return World(torch.stack(placed, dim=-2), torch.stack(turned, dim=-2))


def check_joints(skeleton: Skeleton, found: int) -> None:
    """Refuse a joint axis that is not the skeleton's, before an index goes astray."""
    if found != len(skeleton):
        raise SkeletonError(
            f"{found} joints along the joint axis, but the skeleton has {len(skeleton)}; "
            "select the same joints from both"
        )
