"""Predictors without a network."""

from __future__ import annotations

import math

import pytest
import torch

from posecast.errors import ConfigError
from posecast.geometry import quaternion
from posecast.geometry.euler import euler_to_quaternion, quaternion_to_euler
from posecast.model import RunningAverage, ZeroVelocity
from posecast.motion import Motion


def test_zero_velocity_repeats_the_last_frame(motion):
    found = ZeroVelocity().predict(motion, 5)
    assert found.rotations_local.shape == (2, 5, 5, 4)
    for step in range(5):
        assert torch.equal(found.rotations_local[:, step], motion.rotations_local[:, -1])
        assert torch.equal(found.root_positions[:, step], motion.root_positions[:, -1])
    assert found.offsets is motion.offsets


@pytest.mark.parametrize("frames", [2, 4])
@pytest.mark.parametrize("order", ["zyx", "xyz"])
def test_a_running_average_is_the_mean_of_euler_vectors(frames, order, motion):
    found = RunningAverage(frames, order).predict(motion, 3)
    angles = quaternion_to_euler(motion.rotations_local[:, -frames:], order)
    wanted = euler_to_quaternion(sum(angles.unbind(1)) / frames, order)
    for step in range(3):
        assert quaternion.angle(found.rotations_local[:, step], wanted).max() < 1e-7
        assert torch.equal(found.root_positions[:, step], motion.root_positions[:, -1])


def test_a_running_average_is_of_numbers_not_of_rotations():
    # 179 and -179 degrees about z: the numbers average to 0, the rotations to 180.
    angles = torch.tensor([[math.pi - 0.02, 0, 0], [0.02 - math.pi, 0, 0]]).double()
    rotations = euler_to_quaternion(angles, "zyx")[None, :, None]
    motion = Motion(rotations, torch.zeros(1, 2, 3).double(), torch.zeros(1, 1, 3).double())
    found = RunningAverage(2).predict(motion, 1).rotations_local
    assert quaternion.angle(found, quaternion.identity(like=rotations)).max() < 1e-7


def test_a_running_average_over_one_frame_is_zero_velocity(motion):
    one, zero = RunningAverage(1).predict(motion, 2), ZeroVelocity().predict(motion, 2)
    assert quaternion.angle(one.rotations_local, zero.rotations_local).max() < 1e-7


def test_a_prefix_that_is_too_short_is_refused(motion):
    short = Motion(motion.rotations_local[:, :3], motion.root_positions[:, :3], motion.offsets)
    with pytest.raises(ConfigError, match="average over 4 frames; the prefix has only 3"):
        RunningAverage(4).predict(short, 2)
