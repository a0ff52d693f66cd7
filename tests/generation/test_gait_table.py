"""What a corpus walks like: speeds, step rates, accelerations, the pose in which a step begins."""

from __future__ import annotations

import pytest
import torch
from tests.generation.conftest import OFFSETS, SKELETON

from posecast.errors import ConfigError
from posecast.generation import GaitTable, measure_gait
from posecast.geometry import quaternion
from posecast.motion import Clip
from posecast.motion.tracks import (
    LATERAL,
    LONGITUDINAL,
    MOVEMENT,
    PHASE,
    SPEED,
    STEP_RATE,
    WALKING,
)
from posecast.representation import Codec, Controls, Quaternion

FRAMES, FPS, RADIUS = 240, 30.0, 4.0
CODEC = Codec(SKELETON, Quaternion(), root="path_lateral", controls=Controls())


def circling(speed: float, *, gain: float = 0.0, style: str = "", walking: bool = True) -> Clip:
    """Round a circle to the left, with 6 rad/s of phase and more by the speed, knees bent a little
    where the right foot touches down."""
    time = torch.arange(FRAMES).double() / FPS
    speeds = speed + gain * time
    bearing = (speed * time + gain * time.square() / 2) / RADIUS
    phase = 7 * time
    bend = 0.3 * phase.cos()
    rotations = quaternion.identity(FRAMES, len(SKELETON), like=bend)
    rotations[:, 0] = torch.stack(
        [(bearing / 2).cos(), 0 * time, (bearing / 2).sin(), 0 * time], -1
    )
    rotations[:, 1, 0], rotations[:, 1, 1] = (bend / 2).cos(), (bend / 2).sin()
    return Clip(
        SKELETON,
        OFFSETS.double(),
        FPS,
        torch.tensor([0.0, 0.9, 0.0]).double().expand(FRAMES, 3),
        rotations,
        labels={"style": style},
        tracks={
            PHASE: phase,
            SPEED: speeds,
            STEP_RATE: 6 + speeds,
            MOVEMENT: torch.stack([bearing.sin(), bearing.cos()], dim=-1),
            WALKING: torch.full((FRAMES,), walking),
            LONGITUDINAL: torch.full((FRAMES,), 0.02).double(),
            LATERAL: torch.full((FRAMES,), -0.03).double(),
        },
    )


def test_speeds_step_rates_and_accelerations_are_those_of_the_walks():
    table = measure_gait([circling(1.0, gain=0.1)], CODEC)
    assert table.speeds.shape == (1, 9)
    assert table.speeds[0, [0, -1]].tolist() == pytest.approx([1.0, 1.8], abs=0.03)
    assert (table.speeds.diff() > 0).all()
    rates = table.step_rates[0, 1:-1].tolist()
    assert rates == pytest.approx((6 + table.speeds[0, 1:-1]).tolist(), abs=0.02)
    assert table.sideways.item() == pytest.approx(1.78**2 / RADIUS, rel=0.02)
    assert table.gathering.item() == pytest.approx(0.1, rel=1e-3)


def test_a_step_begins_in_the_mean_pose_of_right_touch_downs_heading_ahead():
    table = measure_gait([circling(1.0)], CODEC)
    joints, root, _ = CODEC.split(table.poses[0])
    ahead = torch.tensor([1.0, 0, 0, 0]).double()
    torch.testing.assert_close(joints[0], ahead, atol=1e-6, rtol=0)
    bent = quaternion.angle(joints[1], ahead).item()
    assert bent == pytest.approx(0.3, abs=0.01)
    assert root.tolist() == pytest.approx([0.02, 0.9, -0.03])


def test_every_style_has_a_row_of_its_own_and_other_clips_none():
    clips = [circling(1.0, style="calm"), circling(2.0, style="wild"), circling(9.0, style="odd")]
    table = measure_gait(clips, CODEC, ("wild", "calm"))
    assert table.speeds[:, 4].tolist() == pytest.approx([2.0, 1.0])
    again = GaitTable.of(table.tensors())
    assert torch.equal(again.poses, table.poses)
    everyone = measure_gait(clips, CODEC)
    assert everyone.speeds[0, -1].item() == pytest.approx(9.0)


def test_who_never_walks_has_no_gait():
    with pytest.raises(ConfigError, match="no clip of the corpus walks"):
        measure_gait([circling(1.0, walking=False)], CODEC)
    with pytest.raises(ConfigError, match="no clip of style 'wild' walks"):
        measure_gait([circling(1.0, style="calm")], CODEC, ("calm", "wild"))
