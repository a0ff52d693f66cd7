"""Baselines: predictors without a network, the rows every table starts with."""

from __future__ import annotations

from dataclasses import dataclass

from posecast.errors import ConfigError
from posecast.geometry.euler import euler_to_quaternion, quaternion_to_euler
from posecast.motion import Motion


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
