"""Predictors without a network."""

from __future__ import annotations

import math

import pytest
import torch

from posecast.errors import ConfigError
from posecast.geometry import quaternion
from posecast.geometry.euler import euler_to_quaternion, quaternion_to_euler
from posecast.model import MeanPose, RunningAverage, ZeroVelocity
from posecast.motion import Clip, Motion
from posecast.skeleton import Skeleton


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


def _clip(rotations: torch.Tensor) -> Clip:
    """A clip of two joints from their local rotations."""
    frames = len(rotations)
    return Clip(
        Skeleton(("hips", "spine"), (-1, 0)),
        torch.zeros(2, 3).double(),
        25.0,
        torch.zeros(frames, 3).double(),
        rotations,
    )


def _turns(*angles: float) -> torch.Tensor:
    """Joints turned about x, one pose an angle, with signs that alternate."""
    turns = torch.zeros(len(angles), 2, 3).double()
    turns[..., 0] = torch.tensor(angles).double()[:, None]
    signs = torch.tensor([(-1.0) ** place for place in range(len(angles))]).double()
    return signs[:, None, None] * quaternion.exp(turns)


def test_the_mean_pose_of_two_clips_is_the_rotation_between_them():
    mean = MeanPose.of([_clip(_turns(0.2)), _clip(_turns(-0.6))]).rotations_local
    assert quaternion.angle(mean, _turns(-0.2)[0]).max() < 1e-7


def test_every_frame_of_a_mean_pose_weighs_the_same():
    parts = [_turns(0.1, 0.3, 0.2, -0.4), _turns(0.9)]
    mean = MeanPose.of([_clip(part) for part in parts]).rotations_local
    together = MeanPose.of([_clip(torch.cat(parts))]).rotations_local
    torch.testing.assert_close(mean, together)
    once = MeanPose.of(_clip(MeanPose.of([_clip(part)]).rotations_local[None]) for part in parts)
    assert quaternion.angle(mean, once.rotations_local).min() > 0.1


def test_a_mean_pose_is_the_first_eigenvector_of_the_mean_of_quaternion_products(generator):
    rotations = quaternion.exp(torch.randn(50, 2, 3, dtype=torch.float64, generator=generator))
    mean = MeanPose.of([_clip(rotations[:20]), _clip(rotations[20:])]).rotations_local
    products = torch.einsum("tji,tjk->jik", rotations, rotations)
    first = torch.linalg.eigh(products).eigenvectors[..., -1]
    assert quaternion.angle(mean, first).max() < 1e-7


def test_a_mean_pose_rests_where_the_root_was_last(motion, generator):
    mean = MeanPose(quaternion.exp(torch.randn(5, 3, dtype=torch.float64, generator=generator)))
    found = mean.predict(motion, 3)
    for step in range(3):
        assert torch.equal(found.rotations_local[:, step], mean.rotations_local.expand(2, -1, -1))
        assert torch.equal(found.root_positions[:, step], motion.root_positions[:, -1])


def test_a_mean_pose_of_nothing_is_refused():
    with pytest.raises(ConfigError, match="needs at least one clip"):
        MeanPose.of([])


@pytest.mark.parametrize(
    "baseline",
    [
        ZeroVelocity(),
        RunningAverage(1),
        RunningAverage(2),
        MeanPose(_turns(0.3)[0, :1].expand(5, 4)),
    ],
    ids=repr,
)
def test_a_replay_is_what_was_expected_after_each_frame(baseline, motion):
    replayed = baseline.replay(motion)
    assert replayed.root_positions.shape == (2, 11, 3)
    for read in range(2, 12):  # after the first frame alone, two cannot be averaged
        after = baseline.predict(motion.cut(0, read), 1)
        found = replayed.cut(read - 1, read)
        assert quaternion.angle(found.rotations_local, after.rotations_local).max() < 1e-7
        torch.testing.assert_close(found.root_positions, after.root_positions)


def test_a_running_average_replays_with_as_many_frames_as_there_are(motion):
    replayed = RunningAverage(4).replay(motion)
    for read in (1, 2, 3, 4):
        after = RunningAverage(read).predict(motion.cut(0, read), 1)
        found = replayed.cut(read - 1, read)
        assert quaternion.angle(found.rotations_local, after.rotations_local).max() < 1e-7
