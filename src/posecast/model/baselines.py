"""Baselines: predictors without a network, the rows every table starts with."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from posecast.errors import ConfigError
from posecast.geometry import conversions
from posecast.geometry.euler import euler_to_quaternion, quaternion_to_euler
from posecast.motion import Clip, Motion


@dataclass(frozen=True)
class ZeroVelocity:
    """Repeats the last pose (Martinez et al. 2017)."""

    def predict(self, prefix: Motion, horizon: int) -> Motion:
        """The last frame of each prefix, ``horizon`` times."""
        return Motion(
            prefix.rotations_local[:, -1:].expand(-1, horizon, -1, -1),
            prefix.root_positions[:, -1:].expand(-1, horizon, -1),
            prefix.offsets,
        )

    def replay(self, prefix: Motion) -> Motion:
        """For each frame but the first the one before it."""
        return prefix.cut(0, -1)


@dataclass(frozen=True)
class RunningAverage:
    """Repeats the mean of the last poses, taken of their Euler angles (Martinez et al. 2017).

    The mean is that of the numbers: angles on either side of half a turn average to about zero.
    Published tables do so, and it is why this is not a mean of rotations. The root stays where it
    was last.

    Args:
        frames: how many poses are averaged.
        order: of the Euler angles, intrinsic.
    """

    frames: int = 2
    order: str = "zyx"

    def predict(self, prefix: Motion, horizon: int) -> Motion:
        """The mean pose of each prefix, ``horizon`` times.

        Raises:
            ConfigError: the prefix is shorter than what is averaged.
        """
        found = prefix.rotations_local.shape[1]
        if found < self.frames:
            raise ConfigError(
                f"running average over {self.frames} frames; the prefix has only {found}"
            )
        angles = quaternion_to_euler(prefix.rotations_local[:, -self.frames :], self.order)
        mean = euler_to_quaternion(angles.mean(dim=1, keepdim=True), self.order)
        return Motion(
            mean.expand(-1, horizon, -1, -1),
            prefix.root_positions[:, -1:].expand(-1, horizon, -1),
            prefix.offsets,
        )

    def replay(self, prefix: Motion) -> Motion:
        """For each frame but the first the mean of those before it, as many as there are."""
        count = prefix.root_positions.shape[1]
        parts = []
        for frame in range(1, count):
            fewer = RunningAverage(min(self.frames, frame), self.order)
            parts.append(fewer.predict(prefix.cut(0, frame), 1))
        return Motion.join_frames(parts)


@dataclass(frozen=True, eq=False)
class MeanPose:
    """Always the mean pose of some clips; the root stays where it was last.

    Args:
        rotations_local: unit quaternions, one a joint.
    """

    rotations_local: Float[Tensor, "joints 4"]

    @classmethod
    def of(cls, clips: Iterable[Clip]) -> MeanPose:
        """The mean of each joint's local rotation over all frames of some clips, alike in weight.

        It has the least sum of squared distances of matrices: the rotation nearest to their mean,
        which for unit quaternions is the first eigenvector of the sum of q q^T. Where the body
        faces is averaged with the rest.

        Source: Moakher 2002, "Means and averaging in the group of rotations".

        Raises:
            ConfigError: no clips.
        """
        sums = [
            conversions.quaternion_to_matrix(clip.rotations_local.double()).sum(0) for clip in clips
        ]
        if not sums:
            raise ConfigError("a mean pose needs at least one clip; found none")
        mean = conversions.nearest_rotation(torch.stack(sums).sum(0))
        return cls(conversions.matrix_to_quaternion(mean))

    def predict(self, prefix: Motion, horizon: int) -> Motion:
        """The mean pose, ``horizon`` times."""
        batch = len(prefix.root_positions)
        rotations = self.rotations_local.to(prefix.rotations_local)
        return Motion(
            rotations.expand(batch, horizon, -1, -1),
            prefix.root_positions[:, -1:].expand(-1, horizon, -1),
            prefix.offsets,
        )

    def replay(self, prefix: Motion) -> Motion:
        """The mean pose for each frame but the first, the root where it was before."""
        return self.predict(prefix, prefix.root_positions.shape[1] - 1)._replace(
            root_positions=prefix.root_positions[:, :-1]
        )
