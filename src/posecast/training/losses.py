"""Losses: one function a term, each the mean over batch and frames.

Every function is differentiable wherever it is evaluated, gimbal lock included, and none takes a
number out of its graph.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from posecast.geometry import quaternion
from posecast.geometry.euler import quaternion_to_euler
from posecast.representation.base import Content
from posecast.skeleton import Skeleton
from posecast.skeleton.kinematics import joint_positions, local_to_root
from posecast.training.comparison import Comparison

ASIN_MARGIN = 1e-6  # keeps the slope of asin finite at gimbal lock, as in QuaterNet's training


def euler_l1(
    predicted: Float[Tensor, "*batch joints 4"],
    target: Float[Tensor, "*batch joints 4"],
    *,
    order: str = "zyx",
) -> Float[Tensor, ""]:
    """Mean absolute difference of Euler angles, radians, the short way round the circle.

    Over all angles of all joints, the root's and those of motionless joints included. Does not
    change with the sign of a quaternion.

    Args:
        predicted: unit quaternions.
        target: unit quaternions; gradients do not flow into them.
        order: of the three intrinsic rotations.

    Source: Pavllo et al. 2018, section 3.4.
    """
    angles = quaternion_to_euler(predicted, order=order, margin=ASIN_MARGIN)
    true_angles = quaternion_to_euler(target.detach(), order=order, margin=ASIN_MARGIN)
    difference = torch.remainder(angles - true_angles + math.pi, 2 * math.pi) - math.pi
    return difference.abs().mean()


def quaternion_dot(
    predicted: Float[Tensor, "*batch joints 4"], target: Float[Tensor, "*batch joints 4"]
) -> Float[Tensor, ""]:
    """Mean of 1 - <p, q>: zero for equal quaternions, 2 for opposite ones.

    Depends on signs, as published: prediction and target must lie on one hemisphere.

    Source: Pavllo et al. 2019 (IJCV), the variant trained with teacher forcing only.
    """
    return (1 - (predicted * target).sum(-1)).mean()


def position(
    predicted: Float[Tensor, "*batch joints 4"],
    target: Float[Tensor, "*batch joints 4"],
    *,
    skeleton: Skeleton,
    offsets: Float[Tensor, "*#batch joints 3"],
) -> Float[Tensor, ""]:
    """Mean distance of joints, metres, after forward kinematics on one body held at the origin.

    Does not change with the sign of a quaternion, nor when both motions are turned together.

    Source: Pavllo et al. 2018, section 3.5, without the height and displacement of the root.
    """
    found = joint_positions(skeleton, predicted, offsets, None)
    true = joint_positions(skeleton, target, offsets, None)
    # The norm of an exact zero, which every root has, passes on a zero gradient.
    return torch.linalg.vector_norm(found - true, dim=-1).mean()


def root_l1(
    predicted: Float[Tensor, "*batch channels"], target: Float[Tensor, "*batch channels"]
) -> Float[Tensor, ""]:
    """Mean absolute difference of root channels, metres."""
    return (predicted - target).abs().mean()


def mean_distance(
    predicted: Float[Tensor, "*batch 3"], target: Float[Tensor, "*batch 3"]
) -> Float[Tensor, ""]:
    """Mean length of the difference of vectors, in their unit."""
    # The norm of an exact zero, which every root has, passes on a zero gradient.
    return torch.linalg.vector_norm(predicted - target, dim=-1).mean()


def bone_length_l1(
    predicted: Float[Tensor, "*batch joints 3"], target: Float[Tensor, "*batch joints 3"]
) -> Float[Tensor, ""]:
    """Mean absolute difference of the lengths of translations from the parent, metres."""
    lengths = [torch.linalg.vector_norm(values, dim=-1) for values in (predicted, target)]
    return (lengths[0] - lengths[1]).abs().mean()


def _euler(comparison: Comparison) -> Float[Tensor, ""]:
    return euler_l1(
        comparison.predicted_rotations, comparison.target_rotations, order=comparison.order
    )


def _features(comparison: Comparison) -> Float[Tensor, ""]:
    """Mean squared error of the standardized features, before they are projected to valid ones.

    Root channels included (Zhou et al. 2018; Andreou et al. 2022, section 5.1), and actions
    (Martinez et al. 2017).
    """
    difference = comparison.emitted - comparison.target
    if comparison.scale is not None:
        difference = difference / comparison.scale
    return difference.square().mean()


def _per_joint(comparison: Comparison) -> Float[Tensor, ""]:
    """Lengths of the joints' differences, summed over joints; of standardized features as above.

    The length of all numbers of a joint, not its square. Root channels and actions do not count.

    Source: Aksan et al. 2019, as their code has it (the text says mean squared error).
    """
    found, true = comparison.emitted, comparison.target
    if comparison.scale is not None:
        found, true = found / comparison.scale, true / comparison.scale
    split = comparison.codec.split
    differences = split(found).joints - split(true).joints
    # The norm of an exact zero passes on a zero gradient.
    return torch.linalg.vector_norm(differences, dim=-1).sum(-1).mean()


def _geodesic(comparison: Comparison) -> Float[Tensor, ""]:
    """Mean angle between local rotations, radians (Gui et al. 2018)."""
    return quaternion.angle(comparison.predicted_rotations, comparison.target_rotations).mean()


def _quaternion(comparison: Comparison) -> Float[Tensor, ""]:
    """Local rotations (Andreou et al. 2022, eq. 14; Pavllo et al. 2019)."""
    predicted, target = comparison.predicted_rotations, comparison.target_rotations
    return quaternion_dot(predicted, _on_side(comparison, predicted, target))


def _quaternion_root(comparison: Comparison) -> Float[Tensor, ""]:
    """Root-relative rotations: an error at a shoulder counts again at the elbow and the hand."""
    skeleton = comparison.codec.written
    predicted = local_to_root(skeleton, comparison.predicted_rotations)
    target = local_to_root(skeleton, comparison.target_rotations)
    return quaternion_dot(predicted, _on_side(comparison, predicted, target))


def _on_side(comparison: Comparison, predicted: Tensor, target: Tensor) -> Tensor:
    """The true rotations on the side of the predicted ones, where features carry no signs."""
    if "signs" in comparison.codec.representation.states:
        return target
    agree = (predicted.detach() * target).sum(-1, keepdim=True) >= 0
    return torch.where(agree, target, -target)


def _penalty(comparison: Comparison) -> Float[Tensor, ""]:
    return comparison.codec.representation.penalty(comparison.raw)


def _position(comparison: Comparison) -> Float[Tensor, ""]:
    """Positions from the root: as features state them, otherwise by forward kinematics.

    Source: Andreou et al. 2022, section 5.1; Pavllo et al. 2018, section 3.5.
    """
    return mean_distance(comparison.predicted_positions, comparison.target_positions)


def _position_fk(comparison: Comparison) -> Float[Tensor, ""]:
    """Positions by forward kinematics of the rotations on the true body, whatever else is stated.

    Source: Pavllo et al. 2018, section 3.5; "quaternions-FK" of Andreou et al. 2022.
    """
    return position(
        comparison.predicted_rotations,
        comparison.target_rotations,
        skeleton=comparison.codec.written,
        offsets=comparison.offsets[:, None],
    )


def _offset(comparison: Comparison) -> Float[Tensor, ""]:
    """Translations of joints from their parents (Andreou et al. 2022, section 5.1)."""
    return mean_distance(comparison.predicted_translations, comparison.target_translations)


def _bone_length(comparison: Comparison) -> Float[Tensor, ""]:
    return bone_length_l1(comparison.predicted_translations, comparison.target_translations)


def _velocity(comparison: Comparison) -> Float[Tensor, ""]:
    """Positions' differences from frame to frame, the last given frame to the first; metres."""
    steps = [
        torch.diff(positions, dim=1, prepend=comparison.last_positions)
        for positions in (comparison.predicted_positions, comparison.target_positions)
    ]
    return mean_distance(*steps)


def _root(comparison: Comparison) -> Float[Tensor, ""]:
    split = comparison.codec.split
    return root_l1(split(comparison.predicted).root, split(comparison.target).root)


def _displacement(comparison: Comparison) -> Float[Tensor, ""]:
    """Distance between places on the floor, seen from the path; the height is left out, metres.

    Source: the longitudinal offset in Pavllo et al. 2018, section 3.4; 2020, section 3.7.
    """
    split = comparison.codec.split
    apart = split(comparison.predicted).root - split(comparison.target).root
    floor = torch.cat([apart[..., :1], apart[..., 2:]], dim=-1)
    return torch.linalg.vector_norm(floor, dim=-1).mean()


def _action(comparison: Comparison) -> Float[Tensor, ""]:
    """Mean squared error of the numbers that stand for actions."""
    split = comparison.codec.split
    difference = split(comparison.emitted).action - split(comparison.target).action
    return difference.square().mean()


class Term(NamedTuple):
    """A loss, and what features must state for it to mean anything.

    Args:
        measure: a comparison to its value.
        needs: what ``Representation.states`` must hold.
    """

    measure: Callable[[Comparison], Tensor]
    needs: frozenset[Content] = frozenset()

    def __call__(self, comparison: Comparison) -> Float[Tensor, ""]:
        """The value of the loss."""
        return self.measure(comparison)


_ROTATIONS: frozenset[Content] = frozenset({"rotations"})
_TRANSLATIONS: frozenset[Content] = frozenset({"translations"})

LOSSES: dict[str, Term] = {
    "features": Term(_features),
    "per_joint": Term(_per_joint),
    "geodesic": Term(_geodesic, _ROTATIONS),
    "euler": Term(_euler, _ROTATIONS),
    "quaternion": Term(_quaternion, _ROTATIONS),
    "quaternion_root": Term(_quaternion_root, _ROTATIONS),
    "penalty": Term(_penalty, frozenset({"constraint"})),
    "position": Term(_position),
    "position_fk": Term(_position_fk, _ROTATIONS),
    "offset": Term(_offset, _TRANSLATIONS),
    "bone_length": Term(_bone_length, _TRANSLATIONS),
    "velocity": Term(_velocity),
    "root": Term(_root),
    "displacement": Term(_displacement),
    "action": Term(_action),
}
