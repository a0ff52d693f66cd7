"""The cast: one skeleton, several bodies from child to tall adult, differing in proportions."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import torch
from jaxtyping import Float
from torch import Tensor

from posecast.skeleton import Skeleton

_TRUNK = (("Hips", ""), ("Spine", "Hips"), ("Chest", "Spine"), ("Neck", "Chest"), ("Head", "Neck"))
_ARM = (("Shoulder", "Chest"), ("Arm", "Shoulder"), ("ForeArm", "Arm"), ("Hand", "ForeArm"))
_LEG = (("UpLeg", "Hips"), ("Leg", "UpLeg"), ("Foot", "Leg"), ("ToeBase", "Foot"))


def _skeleton() -> Skeleton:
    """Trunk, left arm, right arm, left leg, right leg."""
    bones = list(_TRUNK)
    for limb in (_ARM, _LEG):
        for side in ("Left", "Right"):
            sided = {name for name, _ in limb}
            for name, parent in limb:
                bones.append((side + name, side + parent if parent in sided else parent))
    names = tuple(name for name, _ in bones)
    parents = tuple(names.index(parent) if parent else -1 for _, parent in bones)
    return Skeleton(names, parents)


SKELETON = _skeleton()
"""21 joints; with all rotations zero it stands in a T-pose, facing +z, palms down."""


@dataclass(frozen=True)
class Body:
    """Proportions of one person; 1.0 is the average adult of that height.

    Bone lengths of the average adult are shares of standing height from Winter, Biomechanics and
    Motor Control of Human Movement, figure 4.1, with the joints of the trunk put in between.

    Args:
        name: what the body is like, for labels.
        height: standing height, metres.
        legs, arms, shoulders, hips, head, feet: length or width of a part against the average.
    """

    name: str
    height: float
    legs: float = 1.0
    arms: float = 1.0
    shoulders: float = 1.0
    hips: float = 1.0
    head: float = 1.0
    feet: float = 1.0

    @property
    def thigh(self) -> float:
        """Hip to knee, metres."""
        return 0.245 * self.height * self.legs

    @property
    def shank(self) -> float:
        """Knee to ankle, metres."""
        return 0.246 * self.height * self.legs

    @property
    def leg(self) -> float:
        """Hip to ankle with a straight knee, metres."""
        return self.thigh + self.shank

    @property
    def ankle_height(self) -> float:
        """Ankle above the floor when the foot is flat, metres."""
        return 0.041 * self.height

    @property
    def ball_height(self) -> float:
        """Joint of the toes above the floor: the radius on which the ball of the foot rolls."""
        return 0.012 * self.height

    @property
    def ball_ahead(self) -> float:
        """Joint of the toes ahead of the ankle, metres."""
        return 0.080 * self.height * self.feet

    @property
    def heel_behind(self) -> float:
        """End of the heel behind the ankle, metres."""
        return 0.030 * self.height * self.feet

    @property
    def toe_ahead(self) -> float:
        """Tip of the toes ahead of their joint, metres."""
        return 0.038 * self.height * self.feet

    @property
    def hip_drop(self) -> float:
        """Hip joints below the root, metres."""
        return 0.025 * self.height

    @property
    def hip_half_width(self) -> float:
        """Hip joint beside the middle, metres."""
        return 0.052 * self.height * self.hips

    @property
    def size(self) -> float:
        """Leg length against that of an average adult of 1.75 m."""
        return self.leg / (0.491 * 1.75)

    @cached_property
    def offsets(self) -> Float[Tensor, "joints 3"]:
        """Translation of each joint from its parent in the T-pose, metres, float64."""
        tall = self.height
        trunk = tall * (1 - 0.466 * self.legs - 0.17 * self.head) / (1 - 0.466 - 0.17)
        bones: dict[str, tuple[float, float, float]] = {
            "Spine": (0, 0.060 * trunk, -0.006 * tall),
            "Chest": (0, 0.105 * trunk, -0.004 * tall),
            "Neck": (0, 0.130 * trunk, -0.004 * tall),
            "Head": (0, 0.088 * tall * self.head, 0.014 * tall),
        }
        for name, sign in (("Left", 1), ("Right", -1)):
            bones[f"{name}Shoulder"] = (sign * 0.02 * tall, 0.105 * trunk, 0.004 * tall)
            bones[f"{name}Arm"] = (sign * 0.088 * tall * self.shoulders, 0.004 * trunk, 0)
            bones[f"{name}ForeArm"] = (sign * 0.172 * tall * self.arms, 0, 0)
            bones[f"{name}Hand"] = (sign * 0.150 * tall * self.arms, 0, 0)
            bones[f"{name}UpLeg"] = (sign * self.hip_half_width, -self.hip_drop, 0)
            bones[f"{name}Leg"] = (0, -self.thigh, 0)
            bones[f"{name}Foot"] = (0, -self.shank, 0)
            bones[f"{name}ToeBase"] = (0, self.ball_height - self.ankle_height, self.ball_ahead)
        rows = [bones.get(name, (0, 0, 0)) for name in SKELETON.names]
        return torch.tensor(rows, dtype=torch.float64)


CAST = (
    Body("child", 1.18, legs=0.93, arms=0.95, shoulders=0.92, hips=0.96, head=1.22, feet=1.04),
    Body("youth", 1.50, legs=1.03, arms=1.02, shoulders=0.92, hips=0.92, head=1.05, feet=1.05),
    Body("petite", 1.57, legs=0.99, arms=0.96, shoulders=0.93, hips=1.10, feet=0.96),
    Body("stocky", 1.66, legs=0.94, arms=0.97, shoulders=1.12, hips=1.12),
    Body("average", 1.71),
    Body("broad", 1.80, legs=0.97, arms=1.03, shoulders=1.14, hips=1.02, feet=1.03),
    Body("long-legged", 1.78, legs=1.06, arms=1.02, shoulders=0.97, hips=0.95, head=0.96),
    Body("tall", 1.96, legs=1.03, arms=1.04, shoulders=1.03, head=0.94, feet=1.02),
)
"""The people who perform, shortest first; a subject is one of them."""
