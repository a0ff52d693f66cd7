"""Performer: from body, manner, path and program to the joint rotations of every frame."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray
from torch import Tensor

from posecast.corpora.gait.body import SKELETON, Body
from posecast.corpora.gait.carriage import Carriage, Restlessness, carry
from posecast.corpora.gait.feet import Foot, move_foot
from posecast.corpora.gait.footfalls import Footfalls, plan_footfalls
from posecast.corpora.gait.manner import Manner
from posecast.corpora.gait.pace import Journey
from posecast.corpora.gait.rhythm import Rhythm, keep_rhythm
from posecast.geometry import quaternion
from posecast.geometry.euler import euler_to_quaternion
from posecast.skeleton.inverse_kinematics import two_bone

Rotations = dict[str, Float[Tensor, "times 4"]]
"""Rotations by joint name."""


@dataclass(frozen=True, eq=False)
class Performance:
    """A planned movement; it can be read at any time, so at any frame rate."""

    body: Body
    manner: Manner
    journey: Journey
    rhythm: Rhythm
    footfalls: Footfalls
    carriage: Carriage

    def feet(self, times: Float[ndarray, " times"]) -> tuple[Foot, Foot]:
        """The left and the right foot at some times."""
        return _feet(times, self.footfalls, self.body, self.manner)


class Frames(NamedTuple):
    """Poses at some times."""

    root_positions: Float[Tensor, "times 3"]
    rotations_local: Float[Tensor, "times joints 4"]


def perform(
    body: Body, manner: Manner, journey: Journey, generator: np.random.Generator
) -> Performance:
    """Plan a movement along a journey; the generator draws its irregularities."""
    restless = Restlessness.draw(generator)
    first, part = int(generator.integers(0, 2)), float(generator.uniform(0.0, 1.0))
    rhythm = keep_rhythm(journey, body, manner, first=first, part=part)
    footfalls = plan_footfalls(journey, rhythm, body, manner, generator)
    feet = _feet(journey.times, footfalls, body, manner)
    carriage = carry(journey, rhythm, feet, body, manner, restless)
    return Performance(body, manner, journey, rhythm, footfalls, carriage)


def _feet(
    times: Float[ndarray, " times"], footfalls: Footfalls, body: Body, manner: Manner
) -> tuple[Foot, Foot]:
    left = move_foot(times, footfalls, body, manner, left=True)
    return left, move_foot(times, footfalls, body, manner, left=False)


def pose(performance: Performance, times: Float[ndarray, " times"]) -> Frames:
    """Joint rotations at some times, seconds."""
    carriage, body = performance.carriage, performance.body
    root = torch.from_numpy(carriage.root(times))
    pelvis_angles = carriage.pelvis(times)
    pelvis, chest = _turned(pelvis_angles), _turned(carriage.chest(times))
    head = _turned(carriage.head(times))
    halfway = quaternion.slerp(pelvis, chest, torch.tensor(0.5, dtype=torch.float64))
    nodding = quaternion.slerp(chest, head, torch.tensor(0.45, dtype=torch.float64))
    rotations: Rotations = {
        "Hips": pelvis,
        "Spine": _relative(pelvis, halfway),
        "Chest": _relative(halfway, chest),
        "Neck": _relative(chest, nodding),
        "Head": _relative(nodding, head),
    }
    for side, foot in zip(("Left", "Right"), performance.feet(times), strict=True):
        rotations |= _leg(side, root, pelvis, pelvis_angles[:, 0], foot, body)
        rotations |= _arm(side, performance, times)
    stacked = torch.stack([rotations[name] for name in SKELETON.names], dim=1)
    return Frames(root, quaternion.unroll(stacked))


def _turned(angles: Float[ndarray, "times 3"]) -> Float[Tensor, "times 4"]:
    """World rotation of yaw, pitch and roll."""
    return euler_to_quaternion(torch.from_numpy(angles), "yxz")


def _relative(
    parent: Float[Tensor, "times 4"], child: Float[Tensor, "times 4"]
) -> Float[Tensor, "times 4"]:
    return quaternion.normalize(quaternion.product(quaternion.conjugate(parent), child))


def _about(axis: str, angle: Float[ndarray, " times"]) -> Float[Tensor, "times 4"]:
    """Turns about one axis of the frame."""
    direction = torch.zeros(3, dtype=torch.float64)
    direction["xyz".index(axis)] = 1
    return quaternion.about_axis(direction, torch.from_numpy(angle))


def _leg(
    side: str,
    root: Float[Tensor, "times 3"],
    pelvis: Float[Tensor, "times 4"],
    pelvis_yaw: Float[ndarray, " times"],
    foot: Foot,
    body: Body,
) -> Rotations:
    """Hip and knee that bring the ankle where the foot is; the knee points between both."""
    hip, knee, ankle = (
        body.offsets[SKELETON.index(side + joint)] for joint in ("UpLeg", "Leg", "Foot")
    )
    start = root + quaternion.rotate(pelvis, hip.expand_as(root))
    yaw = 0.5 * (pelvis_yaw + foot.yaw)
    bend = np.stack([np.sin(yaw), np.zeros_like(yaw), np.cos(yaw)], axis=-1)
    limb = two_bone(
        start,
        torch.from_numpy(foot.ankle),
        torch.from_numpy(bend),
        upper_offset=knee,
        lower_offset=ankle,
        rest_bend=torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64),
    )
    sole = _turned(np.stack([foot.yaw, -foot.pitch, np.zeros_like(yaw)], axis=-1))
    return {
        side + "UpLeg": _relative(pelvis, limb.upper),
        side + "Leg": _relative(limb.upper, limb.lower),
        side + "Foot": _relative(limb.lower, sole),
        side + "ToeBase": _about("x", -foot.bend),
    }


def _arm(side: str, performance: Performance, times: Float[ndarray, " times"]) -> Rotations:
    """Collar bone, shoulder, elbow and wrist; the right arm is the mirror image of the left."""
    carriage, manner, body = performance.carriage, performance.manner, performance.body
    index = 0 if side == "Left" else 1
    swing, elbow = carriage.arms(times)[:, index], carriage.elbows(times)[:, index]
    share = carriage.running(times)
    elbow = np.maximum(elbow, 0.08)
    aside = max(manner.arms_out, 0.15) + 0.25 * max(body.hips / body.shoulders - 1, 0.0)
    lowered = aside - np.pi / 2 + 0.10 * share
    inwards = 0.07 + share * (0.14 + 0.30 * np.tanh(swing))
    lift = quaternion.product(_about("x", -swing), _about("z", lowered))
    left = {
        "Shoulder": quaternion.product(
            _about("y", -0.14 * swing - 0.25 * max(manner.slouch, 0.0)),
            _about("z", np.full_like(times, -0.04)),
        ),
        "Arm": quaternion.product(lift, _about("x", inwards)),
        "ForeArm": _about("y", -elbow),
        "Hand": _about("z", -0.10 - 0.10 * np.tanh(swing)),
    }
    mirrored = torch.tensor([1.0, 1.0, -1.0, -1.0], dtype=torch.float64)
    return {
        side + joint: rotation if side == "Left" else rotation * mirrored
        for joint, rotation in left.items()
    }
