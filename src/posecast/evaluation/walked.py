"""A clip of somebody on two feet, and what its scores are taken of."""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from posecast.evaluation.spectra import in_body_frame
from posecast.motion import Clip, Feet, Gait, analyse_gait, find_feet, leg_length
from posecast.skeleton.kinematics import joint_positions


class Walked(NamedTuple):
    """A clip and what its scores are taken of.

    Args:
        clip: as it is.
        positions: of its joints in the world, metres, float64.
        feet: its feet.
        leg: length of its legs, metres.
        gait: what ``analyse_gait`` finds in it.
    """

    clip: Clip
    positions: Float[Tensor, "frames joints 3"]
    feet: Feet
    leg: float
    gait: Gait

    @classmethod
    def of(cls, clip: Clip) -> Walked:
        """Analyse a clip.

        Raises:
            DataError, SkeletonError: see ``analyse_gait``.
        """
        positions = world_positions(clip)
        feet = find_feet(clip.skeleton, clip.offsets, positions[:: max(1, clip.frames // 64)])
        leg = leg_length(clip.skeleton, clip.offsets, feet)
        return cls(clip, positions, feet, leg, analyse_gait(clip, feet=feet))

    @property
    def root(self) -> Float[Tensor, "frames 2"]:
        """(x, z) of the first root, metres."""
        return self.positions[:, self.clip.skeleton.roots[0]][:, [0, 2]]

    @property
    def toes(self) -> Float[Tensor, "frames 2 3"]:
        """Left and right, in the world."""
        return self.positions[:, list(self.feet.toes)]

    @property
    def ankles(self) -> Float[Tensor, "frames 2 3"]:
        """Left and right, in the world."""
        return self.positions[:, list(self.feet.ankles)]

    @property
    def features(self) -> Float[Tensor, "frames features"]:
        """Joints relative to the root, left, up and ahead of where the body faces, leg lengths."""
        root = self.clip.skeleton.roots[0]
        return in_body_frame(self.positions, self.gait.facing, root=root).flatten(1) / self.leg

    @property
    def lean(self) -> float:
        """Degrees between upright and the way from between the hips to the mean of all joints
        above: those that hang below no hip, roots left out."""
        skeleton, hips = self.clip.skeleton, self.feet.hips
        legs = {j for j in range(len(skeleton)) if {j, *skeleton.ancestors(j)} & set(hips)}
        upper = [j for j in range(len(skeleton)) if j not in {*legs, *skeleton.roots}]
        if not upper:
            return math.nan
        way = self.positions[:, upper].mean(1) - self.positions[:, list(hips)].mean(1)
        return float(torch.rad2deg(torch.atan2(way[:, [0, 2]].norm(dim=-1), way[:, 1])).mean())

    @property
    def jitter(self) -> float:
        """Length of the third difference of joint positions over dt^3, m/s^3, mean."""
        if self.clip.frames < 4:
            return math.nan
        return float(self.positions.diff(n=3, dim=0).norm(dim=-1).mean()) * self.clip.fps**3

    @property
    def bone_drift(self) -> float:
        """Most that the way from a joint to its parent differs from that at rest, mm."""
        bones = [j for j, parent in enumerate(self.clip.skeleton.parents) if parent >= 0]
        parents = [self.clip.skeleton.parents[j] for j in bones]
        found = (self.positions[:, bones] - self.positions[:, parents]).norm(dim=-1)
        rest = self.clip.offsets[bones].double().norm(dim=-1)
        return 1000 * float((found - rest).abs().max())


def world_positions(clip: Clip) -> Float[Tensor, "frames joints 3"]:
    """Joints of a clip, whose bones stretch if they do, metres, float64."""
    moved = clip.translations_local
    return joint_positions(
        clip.skeleton,
        clip.rotations_local.double(),
        (clip.offsets if moved is None else moved).double(),
        clip.root_positions.double(),
    )
