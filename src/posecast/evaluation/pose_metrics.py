"""Metrics of poses: how far predicted ones are from true ones, frame by frame."""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from posecast.evaluation.metric import FrameMetric, Scene
from posecast.geometry import quaternion
from posecast.geometry.euler import quaternion_to_euler
from posecast.motion.clip import Motion
from posecast.skeleton.kinematics import joint_positions, local_to_root

# Angles that move less than this in a window (standard deviation, radians) do not count.
MOTIONLESS = 1e-4


def euler_vectors(
    rotations_local: Float[Tensor, "*batch joints 4"],
) -> Float[Tensor, "*batch angles"]:
    """Intrinsic z-y-x angles (radians) of all joints but the first, as one vector a frame."""
    angles = quaternion_to_euler(rotations_local[..., 1:, :], order="zyx")
    return angles.flatten(-2)


def moving_angles(target: Float[Tensor, "batch frames angles"]) -> Bool[Tensor, "batch 1 angles"]:
    """Angles that move in the window's own target frames: standard deviation above 1e-4 radians.

    It depends on how many frames are predicted. The filter looks at the truth only: looking at
    the prediction would excuse a predictor from every angle that it holds still.

    Source: Martinez et al., CVPR 2017, code of the training-time evaluation.
    """
    return target.std(dim=1, correction=0, keepdim=True) > MOTIONLESS


def euler(predicted: Motion, target: Motion, scene: Scene) -> Float[Tensor, "batch frames"]:
    """L2 norm of the difference of Euler vectors, radians; not wrapped; moving angles only.

    The error of the Human3.6M literature: the root's rotation never counts, an angle predicted
    just across +-pi costs up to 2 pi, and there is no division by the number of angles.

    Source: Jain et al., CVPR 2016; Martinez et al., CVPR 2017.
    """
    truth = euler_vectors(target.rotations_local)
    difference = euler_vectors(predicted.rotations_local) - truth
    return _norm(difference * moving_angles(truth))


def euler_wrapped(predicted: Motion, target: Motion, scene: Scene) -> Float[Tensor, "batch frames"]:
    """As ``euler``, but each difference is taken modulo 2 pi, within +-pi."""
    truth = euler_vectors(target.rotations_local)
    difference = euler_vectors(predicted.rotations_local) - truth
    wrapped = torch.remainder(difference + torch.pi, 2 * torch.pi) - torch.pi
    return _norm(wrapped * moving_angles(truth))


def euler_all(predicted: Motion, target: Motion, scene: Scene) -> Float[Tensor, "batch frames"]:
    """As ``euler``, over all angles but the root's, moving or not.

    Source: Pavllo et al., BMVC 2018, code: 93 angles of the 31 joints below the root.
    """
    difference = euler_vectors(predicted.rotations_local) - euler_vectors(target.rotations_local)
    return _norm(difference)


def joint_angle(predicted: Motion, target: Motion, scene: Scene) -> Float[Tensor, "batch frames"]:
    """Angle between root-relative rotations, radians, mean over the joints that count.

    The root's rotation is set to the identity in both. An error at a shoulder counts again at
    the elbow and the hand.

    Source: Aksan et al., ICCV 2019, Table 2 (which prints the sum over frames).
    """
    angles = quaternion.angle(
        local_to_root(scene.skeleton, _without_root(predicted)),
        local_to_root(scene.skeleton, _without_root(target)),
    )
    return scene.mean_of_joints(angles)


def position(predicted: Motion, target: Motion, scene: Scene) -> Float[Tensor, "batch frames"]:
    """Distance between joint positions, metres, mean over the joints that count.

    Forward kinematics with the root at the origin, its rotation set to the identity, and the
    offsets of the target for both. Body pose only: where the body is and faces does not count.

    Source: Aksan et al., ICCV 2019, Table 2, in metres instead of thigh lengths.
    """
    return scene.mean_of_joints(joint_distances(predicted, target, scene))


def joint_distances(
    predicted: Motion, target: Motion, scene: Scene
) -> Float[Tensor, "batch frames joints"]:
    """Distance of each joint, metres, as for ``position``; the first joint's is zero."""
    return _norm(
        _positions(predicted, target.offsets, scene) - _positions(target, target.offsets, scene)
    )


def velocity(predicted: Motion, target: Motion, scene: Scene) -> Float[Tensor, "batch frames"]:
    """Length of the difference of joint velocities, metres per second, mean below the root.

    Velocities are first differences of the positions of ``position``; that of the first predicted
    frame starts from the last true frame.

    Source: Pavllo et al., IJCV 2019, its long-term results, there per frame instead of per second.
    """
    last = Motion(
        scene.prefix.rotations_local[:, -1:], scene.prefix.root_positions[:, -1:], target.offsets
    )
    before = _positions(last, target.offsets, scene)
    moved = [
        torch.diff(_positions(motion, target.offsets, scene), dim=1, prepend=before)
        for motion in (predicted, target)
    ]
    return scene.fps * _norm(moved[0] - moved[1])[..., 1:].mean(-1)


POSE_METRICS: tuple[FrameMetric, ...] = (
    FrameMetric("euler", "Euler-angle error, moving angles, not wrapped", "rad", euler),
    FrameMetric(
        "euler_wrapped", "Euler-angle error, moving angles, modulo 2 pi", "rad", euler_wrapped
    ),
    FrameMetric("euler_all", "Euler-angle error, all angles, not wrapped", "rad", euler_all),
    FrameMetric(
        "joint_angle",
        "Angle of root-relative rotations, mean",
        "rad",
        joint_angle,
        asks=frozenset({"counted"}),
    ),
    FrameMetric(
        "position",
        "Joint position error, mean",
        "m",
        position,
        digits=4,
        asks=frozenset({"counted"}),
    ),
    FrameMetric("velocity", "Joint velocity error, mean", "m/s", velocity),
)


def _norm(values: Float[Tensor, "*batch channels"]) -> Float[Tensor, "*batch"]:
    """Euclidean norm over the last axis."""
    return torch.linalg.vector_norm(values, dim=-1)


def _without_root(motion: Motion) -> Float[Tensor, "batch frames joints 4"]:
    """Local rotations with the first joint's set to the identity."""
    rotations = motion.rotations_local
    root = quaternion.identity(*rotations.shape[:2], 1, like=rotations)
    return torch.cat([root, rotations[..., 1:, :]], dim=-2)


def _positions(
    motion: Motion, offsets: Float[Tensor, "batch joints 3"], scene: Scene
) -> Float[Tensor, "batch frames joints 3"]:
    """Joint positions relative to the first joint, its rotation set to the identity, metres."""
    positions = joint_positions(scene.skeleton, _without_root(motion), offsets[:, None], None)
    return positions - positions[..., :1, :]
