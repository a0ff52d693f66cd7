"""Metrics of whole predictions against slow references and cases computed by hand."""

from __future__ import annotations

import math

import pytest
import torch

from posecast.errors import ConfigError
from posecast.evaluation import METRICS, Scene, build_protocol
from posecast.evaluation.motion_metrics import CMU_UNIT, joint_jitter
from posecast.geometry import quaternion
from posecast.motion import Motion
from posecast.skeleton import Skeleton

SKELETON = Skeleton(("hips", "arm", "hand"), (-1, 0, 1))
FPS = 30.0


def arm(angles):
    """A hand on an arm of half a meter that turns about z from +x, one angle a frame."""
    frames = len(angles)
    turns = torch.zeros(1, frames, 3, 3, dtype=torch.float64)
    turns[0, :, 1, 2] = torch.as_tensor(angles, dtype=torch.float64)
    offsets = torch.tensor([[[0.0, 0, 0], [0, 1, 0], [0.5, 0, 0]]], dtype=torch.float64)
    return Motion(quaternion.exp(turns), torch.zeros(1, frames, 3).double(), offsets)


def scene(prefix, replayed=None):
    return Scene(SKELETON, FPS, prefix, replayed)


def value(name, predicted, target, frames, prefix=None, replayed=None):
    known = arm([0.0] * 4) if prefix is None else prefix
    return METRICS[name].values(predicted, target, scene(known, replayed), [frames])[0, 0].item()


def test_distances_are_means_over_frames_and_all_joints():
    truth, guess = arm([0.0, 0.0, 0.0]), arm([0.0, 0.2, 0.4])
    chords = [0.0, 2 * 0.5 * math.sin(0.1), 2 * 0.5 * math.sin(0.2)]
    expected = sum(chords) / 3 / 3  # three frames, three joints
    assert value("euclidean_cm", guess, truth, 3) == pytest.approx(100 * expected)
    assert value("euclidean_cmu", guess, truth, 3) == pytest.approx(expected / 0.0564444, rel=1e-5)
    assert pytest.approx(0.0564444, rel=1e-5) == CMU_UNIT
    assert value("euclidean_cm", guess, truth, 1) == 0


def test_distances_are_measured_on_the_true_body_and_emitted_ones_where_joints_were_put():
    truth = arm([0.0, 0.0])
    bones = truth.offsets[:, None].repeat(1, 2, 1, 1)
    bones[:, :, 2, 0] += 0.03
    stretched = truth._replace(translations_local=bones)
    assert value("euclidean_cm", stretched, truth, 2) == 0
    assert value("emitted_cm", stretched, truth, 2) == pytest.approx(3 / 3)
    # One of two bones is 30 mm too long.
    assert value("bone_length_drift", stretched, truth, 2) == pytest.approx(15)
    assert value("bone_length_drift", truth, truth, 2) == 0


def test_bones_without_length_do_not_drift():
    truth = arm([0.0, 0.0])
    truth = truth._replace(offsets=truth.offsets.index_fill(1, torch.tensor([1]), 0.0))
    bones = truth.offsets[:, None].repeat(1, 2, 1, 1)
    bones[:, :, 1:] += 0.003
    # Of the two bones the arm's has no length; the hand's goes from (0.5, 0, 0) to 3 mm further.
    longer = math.sqrt(0.503**2 + 2 * 0.003**2) - 0.5
    found = value("bone_length_drift", truth._replace(translations_local=bones), truth, 2)
    assert found == pytest.approx(1000 * longer)


def test_where_the_root_faces_counts_and_where_it_is_does_not():
    truth = arm([0.0, 0.0])
    facing = truth.rotations_local.clone()
    facing[:, :, 0] = quaternion.exp(torch.tensor([0.0, 1.0, 0.0], dtype=torch.float64))
    assert value("euclidean_cm", truth._replace(rotations_local=facing), truth, 2) > 10
    assert (
        value("euclidean_cm", truth._replace(root_positions=truth.root_positions + 1), truth, 2)
        == 0
    )


def test_frames_of_the_prefix_enter_the_average_as_they_were_expected():
    truth, prefix = arm([0.0, 0.0]), arm([0.0, 0.0, 0.0, 0.0])
    replayed = arm([0.2, 0.2, 0.2])
    chord = 2 * 0.5 * math.sin(0.1) / 3
    found = value("euclidean_with_prefix_cm", truth, truth, 2, prefix, replayed)
    assert found == pytest.approx(100 * 3 * chord / 5)
    assert value("euclidean_cm", truth, truth, 2, prefix, replayed) == 0


def test_accelerations_are_second_differences_in_units_a_frame():
    radians = 0.1
    steady = arm([radians * frame for frame in range(12)])
    # On a circle of half a meter the second difference is 4 r sin^2(step / 2), for one joint of 3.
    expected = 100 * 4 * 0.5 * math.sin(radians / 2) ** 2 / 3
    still = arm([0.0] * 12)
    assert value("acceleration", steady, still, 12) == pytest.approx(expected)
    assert value("acceleration_true", still, steady, 12) == pytest.approx(expected)
    assert value("acceleration_error", still, steady, 12) == pytest.approx(expected)
    assert value("acceleration_error", steady, still, 12) == pytest.approx(expected)
    for name, predicted, true in (
        ("acceleration_cmu", steady, still),
        ("acceleration_true_cmu", still, steady),
        ("acceleration_error_cmu", steady, still),
    ):
        assert value(name, predicted, true, 12) == pytest.approx(expected / 5.64444, rel=1e-5)


def test_accelerations_with_the_prefix_are_of_what_was_expected_in_it_too():
    turn = 0.1
    still, prefix = arm([0.0] * 4), arm([0.0] * 4)
    replayed = arm([0.0, 0.0, turn])
    # Frames 0 0 t | 0 0 0 0: second differences t, -2t, t, 0, 0 of angles from rest.
    chord = 100 * 2 * 0.5 * math.sin(turn / 2) / 3
    vertical, across = 2 * 100 * 0.5 * (1 - math.cos(turn)) / 3, 2 * 100 * 0.5 * math.sin(turn) / 3
    twice = math.hypot(vertical, across)
    expected = (chord + twice + chord) / 5
    found = value("acceleration_with_prefix", still, still, 4, prefix, replayed)
    assert found == pytest.approx(expected)
    in_units = value("acceleration_with_prefix_cmu", still, still, 4, prefix, replayed)
    assert in_units == pytest.approx(expected / 5.64444, rel=1e-5)
    assert value("acceleration_true_with_prefix", still, still, 4, prefix, replayed) == 0
    error = value("acceleration_error_with_prefix", still, still, 4, prefix, replayed)
    assert error == pytest.approx(expected)
    assert value("acceleration", still, still, 4, prefix, replayed) == 0


def test_the_acceleration_error_is_of_all_windows_together():
    still, slow, fast = (arm([speed * frame for frame in range(12)]) for speed in (0.0, 0.1, 0.2))
    truth, swapped = Motion.join([slow, fast]), Motion.join([fast, slow])
    known = Motion.join([arm([0.0] * 4)] * 2)

    def values(name, predicted, target):
        return METRICS[name].values(predicted, target, scene(known), [12])[:, 0]

    # Each window is wrong, and all together are right: which move comes when is not asked.
    apart = values("acceleration_error", swapped, truth)
    assert apart.abs().min() > 0.05
    assert apart.mean().item() == pytest.approx(0, abs=1e-12)
    for predicted, target in ((truth, Motion.join([still, fast])), (still, truth)):
        predicted = Motion.join([predicted] * (2 // len(predicted.offsets)))
        found = values("acceleration_error", predicted, target).mean().item()
        one, other = (
            values(name, predicted, target).mean().item()
            for name in ("acceleration", "acceleration_true")
        )
        assert found == pytest.approx(abs(one - other))
        assert found > 0.05


@pytest.mark.parametrize(
    "name", ["acceleration", "acceleration_cmu", "acceleration_true", "acceleration_error"]
)
def test_an_acceleration_needs_three_frames_and_says_so(name):
    assert METRICS[name].least_frames == 3
    message = (
        rf"'{name}' needs horizons of 3 frames or more; the first, 66.6\d+ ms, has 2 at 30 fps"
    )
    with pytest.raises(ConfigError, match=message):
        value(name, arm([0.0] * 3), arm([0.0] * 3), 2)
    with pytest.raises(ConfigError, match="leave out the horizon or the metric"):
        build_protocol(
            "short-term", metrics=[name], prefix_ms=400, horizons_ms=[80, 400], stride=7
        ).frames(25.0)


@pytest.mark.parametrize(
    ("name", "least"), [("jitter", 3), ("jitter_true", 3), ("npss_with_prefix", 2), ("npss", 1)]
)
def test_a_prefix_that_is_too_short_for_a_metric_is_refused(name, least):
    assert METRICS[name].least_prefix == least
    if least > 1:
        with pytest.raises(ConfigError, match=f"a prefix of {least} frames or more; found"):
            value(name, arm([0.0] * 4), arm([0.0] * 4), 4, arm([0.0] * (least - 1)))
    assert value(name, arm([0.0] * 4), arm([0.0] * 4), 4, arm([0.0] * 3), arm([0.0] * 2)) == 0


def test_jitter_is_a_third_difference_and_counts_the_seam():
    still = arm([0.0] * 5)
    jumps = arm([math.pi] * 5)
    assert value("jitter", still, still, 5) == 0
    # The hand jumps by a meter once: third differences 1, 2, 1 in the first three frames.
    found = joint_jitter(jumps, scene(arm([0.0] * 4)))[0, :, 2] / FPS**3
    torch.testing.assert_close(found, torch.tensor([1.0, 2, 1, 0, 0], dtype=torch.float64))
    assert value("jitter", jumps, still, 5) == pytest.approx(FPS**3 * 4 / 5 / 3)
    assert value("jitter_true", still, jumps, 5) == pytest.approx(FPS**3 * 4 / 5 / 3)
    # Of a longer prefix only the last three frames: an earlier jump is over.
    assert value("jitter", still, still, 5, arm([math.pi, 0.0, 0.0, 0.0])) == 0
    assert value("jitter", still, still, 5, arm([0.0, math.pi, 0.0, 0.0])) > 0


def test_the_protocol_of_the_paper_has_its_numbers():
    protocol = build_protocol("cmu-acrnn")
    assert protocol.frames(30) == (10, (3, 12, 30, 300))
    assert protocol.sampling.stride == 7
    assert protocol.sampling.limit == 400
    long = build_protocol("h36m-long")
    assert long.frames(25) == (50, (2, 4, 8, 10, 15, 20, 25, 50, 75, 100))
    assert "mean-pose" in long.baselines
    assert any("lose to zero velocity from 0.8 s on" in note for note in long.notes)
    assert build_protocol("cross-skeleton").frames(30) == (10, (3, 12, 30))
