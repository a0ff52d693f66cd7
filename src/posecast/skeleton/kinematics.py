"""Forward kinematics and local <-> root-relative rotations, a whole tree level at a time."""

from __future__ import annotations

from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from posecast.geometry import quaternion
from posecast.skeleton.skeleton import Skeleton


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
    """World positions and rotations of all joints."""
    rotations = local_to_root(skeleton, rotations_local)
    parents = list(skeleton.parents)
    identity = quaternion.identity(*rotations.shape[:-2], 1, like=rotations)
    above = torch.cat([rotations, identity], dim=-2)[..., parents, :]
    bones = quaternion.rotate(above, offsets)
    chain = bones.new_zeros(len(skeleton), len(skeleton))
    for joint in range(len(skeleton)):
        chain[joint, [joint, *skeleton.ancestors(joint)]] = 1
    positions = chain @ bones
    if root_positions is not None:
        positions = positions + root_positions[..., None, :]
    return World(positions, rotations)


def joint_positions(
    skeleton: Skeleton,
    rotations_local: Float[Tensor, "*batch joints 4"],
    offsets: Float[Tensor, "*#batch joints 3"],
    root_positions: Float[Tensor, "*batch 3"] | None = None,
) -> Float[Tensor, "*batch joints 3"]:
    """World positions of all joints."""
    return forward_kinematics(skeleton, rotations_local, offsets, root_positions).positions


def local_to_root(
    skeleton: Skeleton, rotations_local: Float[Tensor, "*batch joints 4"]
) -> Float[Tensor, "*batch joints 4"]:
    """Rotations relative to the frame in which the root turns: products down the tree."""
    joints = list(rotations_local.unbind(-2))
    for level in skeleton.levels[1:]:
        above = torch.stack([joints[skeleton.parents[joint]] for joint in level], dim=-2)
        turned = quaternion.product(above, rotations_local[..., list(level), :])
        for joint, rotation in zip(level, turned.unbind(-2), strict=True):
            joints[joint] = rotation
    return torch.stack(joints, dim=-2)


def root_to_local(
    skeleton: Skeleton, rotations_root: Float[Tensor, "*batch joints 4"]
) -> Float[Tensor, "*batch joints 4"]:
    """Rotations relative to the parent, from root-relative ones; all joints at once."""
    identity = quaternion.identity(*rotations_root.shape[:-2], 1, like=rotations_root)
    above = torch.cat([rotations_root, identity], dim=-2)[..., list(skeleton.parents), :]
    return quaternion.product(quaternion.conjugate(above), rotations_root)
