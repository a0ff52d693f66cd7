"""Freeze detection: what stops, what runs on and what runs away is told apart, second by second."""

from __future__ import annotations

import math

import pytest
import torch

from posecast.errors import ConfigError
from posecast.evaluation import FreezeDetector
from posecast.geometry import quaternion
from posecast.motion import Clip, Motion
from posecast.skeleton import Skeleton

SKELETON = Skeleton(("hips", "arm", "hand"), (-1, 0, 1))
OFFSETS = torch.tensor([[0.0, 0, 0], [0, 1, 0], [0.5, 0, 0]], dtype=torch.float64)


def waving(frames: int, hertz: float, reach: float = 0.5, fps: float = 30.0) -> Clip:
    """A hand on an arm of half a meter that swings about z."""
    clock = torch.arange(frames, dtype=torch.float64) / fps
    turns = torch.zeros(frames, 3, 3, dtype=torch.float64)
    turns[:, 1, 2] = reach * torch.sin(2 * math.pi * hertz * clock)
    return Clip(SKELETON, OFFSETS, fps, torch.zeros(frames, 3).double(), quaternion.exp(turns))


@pytest.fixture
def detector() -> FreezeDetector:
    """Knows waving once to twice a second, 180 windows of a second."""
    return FreezeDetector.of([waving(901, 1 + place / 5) for place in range(6)])


def test_the_training_set_is_cut_into_windows_of_a_second(detector):
    assert detector.window == 30
    assert len(detector.speeds) == 6 * 30
    assert bool((detector.speeds.diff() >= 0).all())
    assert detector.spectrum.shape == (16,)
    assert float(detector.spectrum.sum()) == pytest.approx(1)
    # The hand covers 4 x 0.25 m a wave, on an arc that chords cut short a little; the arm rests.
    one = FreezeDetector.of([waving(901, 1)])
    assert one.median == pytest.approx(4 * 0.25 / 2, rel=0.02)


def test_what_moves_as_in_training_is_neither_frozen_nor_blown(detector):
    found = detector.examine([waving(3001, 1.5).motion()])
    assert found.speed.shape == (1, 100)
    assert found.frozen_share.item() == found.blown_share.item() == 0
    assert found.speed_ratio.median().item() == pytest.approx(1, abs=0.1)
    assert found.spectral_distance.max() < 0.5


def test_a_motion_that_stops_is_frozen_from_then_on(detector):
    moving = waving(301, 1.5).motion()
    rest = moving.cut(300).rotations_local.expand(-1, 600, -1, -1)
    still = Motion(rest, torch.zeros(1, 600, 3).double(), OFFSETS[None])
    found = detector.examine([moving, still])
    assert found.frozen[0].tolist() == [False] * 10 + [True] * 20
    assert found.frozen_share.item() == pytest.approx(2 / 3)
    # All power must be shifted from 0 Hz to where the training set has it on average.
    hertz = torch.arange(16) * 1.0
    away = float((detector.spectrum * hertz).sum())
    assert found.spectral_distance[0, -1].item() == pytest.approx(away)
    assert 1 < away < 2.5


def test_a_trembling_pose_is_frozen_by_speed_and_far_by_spectrum(detector):
    found = detector.examine([waving(301, 12, reach=0.002).motion()])
    assert found.frozen_share.item() == 1
    assert found.spectral_distance.min() > 9


def test_a_pose_that_trembles_as_fast_as_a_hand_waves_is_frozen(detector):
    found = detector.examine([waving(301, 12, reach=0.08).motion()])
    assert 0.5 < found.speed_ratio.median() < 2
    assert found.speed.min() > detector.slowest
    assert found.frozen_share.item() == 1
    assert found.blown_share.item() == 0
    # Half as far again as the farthest window of the training set is allowed.
    assert detector.strangest == pytest.approx(1.5 * detector.farthest)
    assert detector.farthest < 1


def test_a_motion_that_runs_away_or_is_no_number_is_blown(detector):
    wild = waving(301, 10).motion()
    assert detector.examine([wild]).blown_share.item() == 1
    broken = waving(301, 1.5).motion()
    rotations = broken.rotations_local.clone()
    rotations[:, 150:] = torch.nan
    found = detector.examine([broken._replace(rotations_local=rotations)])
    # The frame where one window ends and the next begins belongs to both.
    assert found.blown[0].tolist() == [False] * 4 + [True] * 6
    assert not found.frozen.any()
    assert not torch.isnan(found.spectral_distance).any()
    assert bool(torch.isinf(found.spectral_distance[0, 4:]).all())


def test_stretched_bones_are_looked_at_as_they_were_put(detector):
    moving = waving(301, 1.5).motion()
    bones = moving.bones.repeat(1, 301, 1, 1)
    bones[:, :, 2, 0] += torch.arange(301) ** 2 / 1000
    assert detector.examine([moving._replace(translations_local=bones)]).blown[0, -1]


@pytest.mark.parametrize("length", [1, 7, 30, 31, 100])
def test_how_a_rollout_is_chunked_does_not_matter(detector, length):
    whole = Motion.join([waving(200, 1.5).motion(), waving(200, 0.01).motion()])
    pieces = [whole.cut(first, first + length) for first in range(0, 200, length)]
    expected, found = detector.examine([whole]), detector.examine(iter(pieces))
    assert expected.speed.shape == (2, 6)
    for one, other in zip(expected, found, strict=True):
        torch.testing.assert_close(one, other)


def test_the_training_set_itself_raises_few_alarms():
    clips = [waving(901, 0.5 + place / 40) for place in range(60)]
    detector = FreezeDetector.of(clips)
    shares = [detector.examine([clip.motion()]) for clip in clips]
    frozen = torch.stack([found.frozen_share for found in shares]).mean()
    assert 0 < frozen <= 0.0051
    assert not any(found.blown.any() for found in shares)


def test_a_training_set_that_often_rests_still_tells_what_is_frozen():
    clips = [waving(901, 1.5), waving(901, 1.4), waving(901, 1.5, reach=0.0)]
    detector = FreezeDetector.of(clips)
    assert detector.speeds[0] == 0
    still = waving(301, 1.5, reach=0.001).motion()
    assert detector.examine([still]).frozen_share.item() == 1


def test_a_training_set_that_mostly_rests_is_refused():
    with pytest.raises(ConfigError, match="clips that do not move in half of their windows"):
        FreezeDetector.of([waving(901, 1.5), waving(901, 1.5, reach=0.0)])


def test_clips_that_fit_no_window_or_each_other_are_refused(detector):
    with pytest.raises(ConfigError, match="no clip is as long as a window of 1 s"):
        FreezeDetector.of([waving(30, 1)])
    with pytest.raises(ConfigError, match="no clip is as long"):
        FreezeDetector.of([])
    with pytest.raises(ConfigError, match="clips at 30 and 25 frames per second"):
        FreezeDetector.of([waving(301, 1), waving(301, 1, fps=25.0)])
    with pytest.raises(ConfigError, match="expected two frames or more"):
        FreezeDetector.of([waving(301, 1)], window_s=0.03)
    with pytest.raises(ConfigError, match="fewer than 31 frames"):
        detector.examine([waving(30, 1).motion()])


def test_a_quarter_of_an_hour_is_a_value_a_second(detector):
    found = detector.examine([waving(30_001, 1.5).motion()])
    assert found.speed.shape == (1, 1000)
    assert found.frozen_share.item() == found.blown_share.item() == 0
