"""Local and root-relative motions of joints, as dual quaternions and as matrices, both ways.

From local to root-relative goes down the tree by the kinematics of ``skeleton.kinematics``, a whole
level at a time; back is one product for all joints at once.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from posecast.geometry import dual_quaternion, quaternion
from posecast.skeleton.dual_planes import local_motion, root_duals
from posecast.skeleton.kinematics import check_joints, forward_kinematics
from posecast.skeleton.skeleton import Skeleton
from posecast.skeleton.tree_plan import tree_plan


class LocalMotion(NamedTuple):
    """How joints are turned and where they are, from their parents.

    Args:
        rotations: unit quaternions (w, x, y, z).
        translations: meters, in the frame of the parent.
    """

    rotations: Float[Tensor, "*batch joints 4"]
    translations: Float[Tensor, "*batch joints 3"]


def local_to_root_dual(
    skeleton: Skeleton,
    rotations_local: Float[Tensor, "*batch joints 4"],
    translations_local: Float[Tensor, "*#batch joints 3"],
) -> Float[Tensor, "*batch joints 8"]:
    """Root-relative dual quaternions of joints: products of the local ones down the tree.

    A root's own rotation stays part of the chain ("current" in Andreou et al. 2022, section 4), its
    translation is its own: zero for the first root of a clip.

    The gradient of the dual part with respect to rotations is the one within the sphere of unit
    quaternions, that of the real part is complete; first derivatives only.

    Args:
        skeleton: whose joints.
        rotations_local: unit quaternions relative to the parent.
        translations_local: from the parent, meters; one body, or one for each batch entry or frame.

    Raises:
        SkeletonError: the number of joints is not that of the skeleton.

    Source: the dual part is 1/2 (0, t) r of the position t and the rotation r in the root's frame.
    """
    if _plain(rotations_local, translations_local):
        joints, batch = len(skeleton), rotations_local.shape[:-2]
        check_joints(skeleton, rotations_local.shape[-2])
        check_joints(skeleton, translations_local.shape[-2])
        bodies = translations_local
        if math.prod(bodies.shape[:-2]) > 1:
            bodies = bodies.expand(*batch, joints, 3)
        found = root_duals(
            tree_plan(skeleton, rotations_local.device),
            rotations_local.reshape(-1, joints, 4),
            bodies.reshape(-1, joints, 3),
        )
        return found.reshape(*batch, joints, 8)
    world = forward_kinematics(skeleton, rotations_local, translations_local, None)
    return dual_quaternion.from_rotation_translation(world.rotations, world.positions)


def root_to_local_dual(
    skeleton: Skeleton, dual_root: Float[Tensor, "*batch joints 8"]
) -> Float[Tensor, "*batch joints 8"]:
    """Local dual quaternions from unit root-relative ones: conj(parent) times one's own.

    Raises:
        SkeletonError: the number of joints is not that of the skeleton.
    """
    local = root_to_local_motion(skeleton, dual_root)
    return dual_quaternion.from_rotation_translation(local.rotations, local.translations)


def root_to_local_motion(
    skeleton: Skeleton, dual_root: Float[Tensor, "*batch joints 8"]
) -> LocalMotion:
    """Local rotations and translations from unit root-relative dual quaternions.

    All joints at once, without a walk down the tree.

    Raises:
        SkeletonError: the number of joints is not that of the skeleton.
    """
    check_joints(skeleton, dual_root.shape[-2])
    if _plain(dual_root):
        parents = torch.tensor(skeleton.parents, device=dual_root.device)
        poses = dual_root.reshape(-1, *dual_root.shape[-2:])
        turns, moves = local_motion(parents, poses)
        shape = dual_root.shape[:-1]
        return LocalMotion(turns.reshape(*shape, 4), moves.reshape(*shape, 3))
    # the parents' table rather than the plan: a compiler follows it, and fuses the gather
    parents = torch.tensor(skeleton.parents, device=dual_root.device)
    above = dual_root.index_select(-2, parents.clamp_min(0))
    # Below nothing: a root is seen from where it is, unturned.
    above = torch.where((parents < 0)[:, None], dual_quaternion.identity(like=dual_root), above)
    back = quaternion.conjugate(above[..., :4])
    bones = dual_quaternion.translation(dual_root) - dual_quaternion.translation(above)
    return LocalMotion(quaternion.product(back, dual_root[..., :4]), quaternion.rotate(back, bones))


def _plain(*tensors: Tensor) -> bool:
    """Whether nobody asks for a gradient and no compiler looks on: planes are faster then."""
    if torch.compiler.is_compiling():
        return False
    return not (torch.is_grad_enabled() and any(tensor.requires_grad for tensor in tensors))


def from_parents(
    skeleton: Skeleton,
    rotations_root: Float[Tensor, "*batch joints 4"],
    positions_root: Float[Tensor, "*batch joints 3"],
) -> Float[Tensor, "*batch joints 3"]:
    """Translations of joints from their parents in the frames of these; roots' as they are."""
    parents = torch.tensor(skeleton.parents, device=positions_root.device)
    above = parents.clamp_min(0)
    bones = positions_root - positions_root.index_select(-2, above)
    turned = quaternion.conjugate(rotations_root).index_select(-2, above)
    local = quaternion.rotate(turned, bones)
    return torch.where((parents < 0)[:, None], positions_root, local)


def local_to_root_matrix(
    skeleton: Skeleton, matrices_local: Float[Tensor, "*batch joints n n"]
) -> Float[Tensor, "*batch joints n n"]:
    """Root-relative matrices from those relative to the parent: products down the tree.

    Of rotations (3 x 3) or of rigid motions (4 x 4); a root's own stays part of the chain. A whole
    level of the tree is one batched product.

    Raises:
        SkeletonError: the number of joints is not that of the skeleton.
    """
    check_joints(skeleton, matrices_local.shape[-3])
    done: list[Tensor] = []
    place: dict[int, tuple[int, int]] = {}
    level = list(skeleton.roots)
    while level:
        own = matrices_local[..., level, :, :]
        if done:
            above = [place[skeleton.parents[joint]][1] for joint in level]
            own = done[-1][..., above, :, :] @ own
        place |= {joint: (len(done), index) for index, joint in enumerate(level)}
        done.append(own)
        level = [child for joint in level for child in skeleton.children[joint]]
    order = [joint for joint, _ in sorted(place.items(), key=lambda item: item[1])]
    back = sorted(range(len(order)), key=order.__getitem__)
    return torch.cat(done, dim=-3)[..., back, :, :]


def root_to_local_matrix(
    skeleton: Skeleton, matrices_root: Float[Tensor, "*batch joints n n"]
) -> Float[Tensor, "*batch joints n n"]:
    """Matrices relative to the parent from root-relative ones; all joints at once.

    Of rotations (3 x 3) or of rigid motions (4 x 4), whose inverse needs no division.

    Raises:
        SkeletonError: the number of joints is not that of the skeleton.
    """
    check_joints(skeleton, matrices_root.shape[-3])
    parents = torch.tensor(skeleton.parents, device=matrices_root.device)
    above = matrices_root.index_select(-3, parents.clamp_min(0))
    turned = above[..., :3, :3].mT
    if matrices_root.shape[-1] == 4:
        moved = -(turned @ above[..., :3, 3:])
        turned = torch.cat([torch.cat([turned, moved], dim=-1), above[..., 3:, :]], dim=-2)
    return torch.where((parents < 0)[:, None, None], matrices_root, turned @ matrices_root)
