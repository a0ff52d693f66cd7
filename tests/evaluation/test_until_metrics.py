"""Metrics of Aksan et al. 2019, against cases worked out by hand and by SciPy."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from posecast.errors import ConfigError
from posecast.evaluation import METRICS, build_protocol, keypoint_curve
from posecast.evaluation.metric import Scene
from posecast.evaluation.until_metrics import (
    THRESHOLDS,
    correct_keypoints,
    left_thigh,
    thresholds_until,
)
from posecast.geometry import quaternion
from posecast.model import ZeroVelocity
from posecast.motion.clip import Motion
from posecast.skeleton import Skeleton
from posecast.skeleton.catalog import named_skeleton

LEG = Skeleton(("pelvis", "l_hip", "l_knee", "l_ankle"), (-1, 0, 1, 2))
OFFSETS = torch.tensor([[0.0, 0, 0], [0.1, 0, 0], [0, -0.4, 0], [0, -0.4, 0]]).double()
FRAMES = 24


def bent(angle: torch.Tensor | float, joint: int = 1, frames: int = FRAMES) -> Motion:
    """One motion in which a joint is turned about x by an angle, the same or one a frame."""
    turn = torch.zeros(1, frames, 4, 3, dtype=torch.float64)
    turn[0, :, joint, 0] = torch.as_tensor(angle, dtype=torch.float64)
    return Motion(quaternion.exp(turn), torch.zeros(1, frames, 3).double(), OFFSETS[None])


def value(name: str, predicted: Motion, target: Motion, frame: int, **counting: object) -> float:
    scene = Scene(LEG, 60.0, target.cut(0, 1), None, **counting)
    return METRICS[name].values(predicted, target, scene, [frame]).item()


def test_angles_are_summed_and_averaged_until_the_frame_at_the_end():
    straight, grows = bent(0.0), bent(torch.arange(1, FRAMES + 1) / 100)
    # Hip, knee and ankle are all turned by what the hip is, 0.01 more every frame.
    assert value("joint_angle_sum", grows, straight, 4) == pytest.approx(0.01 + 0.02 + 0.03 + 0.04)
    assert value("joint_angle_mean", grows, straight, 4) == pytest.approx(0.025)
    assert value("joint_angle", grows, straight, 4) == pytest.approx(0.04)
    # With the pelvis, which counts nothing, the mean is over four joints.
    some = value("joint_angle_sum", grows, straight, 4, counted=(0, 1, 2, 3))
    assert some == pytest.approx(0.1 * 3 / 4)


def test_positions_are_in_thighs_of_the_true_body():
    straight, turned = bent(0.0), bent(0.2, joint=1)
    chord = 2 * np.sin(0.1)  # of a circle with radius 1: the knee is a thigh away
    found = value("position_thighs_sum", turned, straight, 3)
    assert found == pytest.approx(3 * (0 + chord + 2 * chord) / 3)
    assert value("position_thighs_mean", turned, straight, 3) == pytest.approx(chord)
    knee = value("position_thighs_mean", turned, straight, 3, counted=(2,))
    assert knee == pytest.approx(chord)
    # In units of the hip's offset, a quarter of the thigh, everything is four times as far.
    assert value("position_thighs_mean", turned, straight, 3, thigh=1) == pytest.approx(4 * chord)


def test_euler_angles_are_those_of_the_inverse():
    generator = torch.Generator().manual_seed(0)
    turns = torch.randn(2, 1, FRAMES, 4, 3, generator=generator, dtype=torch.float64)
    motions = [
        Motion(quaternion.exp(turn), torch.zeros(1, FRAMES, 3).double(), OFFSETS[None])
        for turn in turns
    ]
    angles = [
        Rotation.from_rotvec(-turn[0, :, 1:].reshape(-1, 3).numpy()).as_euler("ZYX").reshape(-1, 9)
        for turn in turns
    ]
    wanted = np.linalg.norm(angles[0] - angles[1], axis=1)[:7].sum()
    assert value("euler_inverse_sum", *motions, 7) == pytest.approx(wanted)
    assert value("euler_inverse_mean", *motions, 7) == pytest.approx(wanted / 7)


def test_shares_of_correct_joints_include_the_threshold_itself():
    distances = torch.tensor([[[0.0, 0.05, 0.25, 0.3]]])
    shares = correct_keypoints(distances, [0.01, 0.05, 0.3])
    assert shares.tolist() == [[[0.25, 0.5, 1.0]]]


@pytest.mark.parametrize(
    ("frames", "count"), [(1, 6), (5, 6), (6, 7), (11, 7), (12, 8), (17, 8), (18, 9), (60, 9)]
)
def test_fewer_thresholds_count_soon(frames, count):
    assert thresholds_until(frames) == THRESHOLDS[:count]
    assert len(THRESHOLDS) == 9


def test_the_area_of_a_case_by_hand():
    # Three joints: the hip is right, the knee off by one chord and the ankle by two, in thighs.
    chord = 0.06
    turned = bent(2 * np.arcsin(chord / 2))
    straight = bent(0.0)
    # Within 0.05 only the hip; within 0.1 the knee too; within 0.15 all.
    limits = [0.001, 0.005, 0.01, 0.02, 0.05, 0.1, 0.15]
    shares = [1 / 3] * 5 + [2 / 3, 1.0]
    pairs = zip(limits, limits[1:], shares, shares[1:], strict=False)
    area = sum((b - a) * (left + right) / 2 for a, b, left, right in pairs)
    assert value("pck_auc", turned, straight, 6) == pytest.approx(area / 0.149)
    # Right in half of the frames, until 18: shares are averaged before the area is taken.
    half = bent(torch.tensor([2 * np.arcsin(chord / 2)] * 9 + [0.0] * 15))
    limits += [0.2, 0.3]
    shares = [(share + 1) / 2 for share in (*shares, 1.0, 1.0)]
    pairs = zip(limits, limits[1:], shares, shares[1:], strict=False)
    area = sum((b - a) * (left + right) / 2 for a, b, left, right in pairs)
    assert value("pck_auc", half, straight, 18) == pytest.approx(area / 0.299)


def test_the_thresholds_are_the_published_ones():
    assert THRESHOLDS == (0.001, 0.005, 0.01, 0.02, 0.05, 0.1, 0.15, 0.2, 0.3)


@pytest.mark.parametrize(("frames", "area"), [(10, 0.07885 / 0.149), (20, 0.20135 / 0.299)])
def test_every_threshold_has_its_part_in_the_area(frames, area):
    # The knee is once between each two thresholds in ten frames: the share grows by a tenth at
    # every one of them. By hand: 0.004 * 0.15 + 0.005 * 0.25 + 0.01 * 0.35 + 0.03 * 0.45
    # + 0.05 * (0.55 + 0.65), and 0.05 * 0.75 + 0.1 * 0.85 for the last two thresholds.
    chords = torch.tensor([0.0005, 0.003, 0.007, 0.015, 0.03, 0.07, 0.12, 0.18, 0.25, 0.4])
    turned = bent(2 * torch.arcsin(chords.double() / 2).repeat(2), frames=20)
    found = value("pck_auc", turned, bent(0.0, frames=20), frames, counted=(2,))
    assert found == pytest.approx(area)


def test_all_joints_right_or_wrong_is_one_or_zero():
    assert value("pck_auc", bent(0.0), bent(0.0), 24) == pytest.approx(1)
    assert value("pck_auc", bent(3.0), bent(0.0), 24, counted=(2, 3)) == 0


@pytest.mark.parametrize(
    ("names", "knee"),
    [
        (named_skeleton("smpl-22").skeleton.names, "l_knee"),
        (named_skeleton("h36m-32").skeleton.names, "LeftLeg"),
        (named_skeleton("cmu-31").skeleton.names, "LeftLeg"),
        (("root", "lhipjoint", "lfemur", "ltibia"), "ltibia"),
        (("hip", "lThigh", "lShin", "rShin"), "lShin"),
        (("Hips", "UpperLeg_L", "LowerLeg_L"), "LowerLeg_L"),
    ],
)
def test_the_left_knee_is_found_by_its_name(names, knee):
    skeleton = Skeleton(tuple(names), (-1, *range(len(names) - 1)))
    assert names[left_thigh(skeleton)] == knee


def test_a_body_without_a_knee_says_what_to_do():
    with pytest.raises(ConfigError, match="no joint is called like one among hips, tail"):
        left_thigh(Skeleton(("hips", "tail"), (-1, 0)))


def test_the_curve_is_the_share_of_joints_within_each_threshold(make_h36m):
    corpus = make_h36m(("walking", "eating"))
    protocol = build_protocol(
        "short-term",
        stride=40,
        metrics=["pck_auc"],
        horizons_ms=[80, 400],
        joints=["Head", "Spine"],
    )
    curve = keypoint_curve(ZeroVelocity(), protocol, corpus, horizon_ms=400)
    assert [threshold for threshold, _ in curve] == list(THRESHOLDS)
    shares = [share for _, share in curve]
    assert shares == sorted(shares)
    assert 0 < shares[-1] <= 1
    # The area under it, over all thresholds up to 10 frames' last, is the metric.
    limits = thresholds_until(10)
    area = np.trapezoid(shares[: len(limits)], limits) / (limits[-1] - limits[0])
    every = protocol.score(ZeroVelocity(), corpus)
    assert every.value("pck_auc", 400) == pytest.approx(area)
    with pytest.raises(ConfigError, match="160 ms is no horizon of protocol 'short-term'"):
        keypoint_curve(ZeroVelocity(), protocol, corpus, horizon_ms=160)
