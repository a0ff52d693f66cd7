"""What must hold for every generated pose: possible bodies, planted feet, smooth joints."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch
from torch import Tensor

from posecast.corpora.gait.body import CAST, SKELETON
from posecast.corpora.gait.manner import STYLES
from posecast.corpora.gait.repertoire import REPERTOIRE
from posecast.corpora.synthetic import make_clip, synthetic
from posecast.geometry import quaternion
from posecast.motion import Clip, Corpus
from posecast.skeleton.kinematics import World, forward_kinematics

SIDES = ("Left", "Right")


@pytest.fixture(scope="module")
def corpus() -> Corpus:
    return synthetic()


@pytest.fixture(scope="module")
def clips(corpus: Corpus) -> list[Clip]:
    """Two performances of everything, by every body and in every style."""
    chosen = list(corpus.clips[:24])
    assert {clip.labels["body"] for clip in chosen} == {body.name for body in CAST}
    assert {clip.labels["style"] for clip in chosen} == set(STYLES)
    assert {clip.labels["gait"] for clip in chosen} == {"walk", "jog", "run", "mixed"}
    assert {clip.labels["action"] for clip in chosen} == {act.action for act in REPERTOIRE}
    return chosen


def of_gait(clips: list[Clip], *gaits: str) -> list[Clip]:
    chosen = [clip for clip in clips if clip.labels["gait"] in gaits]
    assert len(chosen) >= 2
    return chosen


def world(clip: Clip) -> World:
    return forward_kinematics(
        clip.skeleton, clip.rotations_local, clip.offsets, clip.root_positions
    )


def joints(clip: Clip, joint: str) -> Tensor:
    """World positions of the left and the right one of a pair: (frames, 2, 3)."""
    return world(clip).positions[:, [SKELETON.index(side + joint) for side in SIDES]]


def hinge(clip: Clip, joint: str) -> Tensor:
    """Degrees that the left and the right joint turn about +x: (frames, 2)."""
    pair = clip.rotations_local[:, [SKELETON.index(side + joint) for side in SIDES]]
    turned = torch.rad2deg(2 * torch.atan2(pair[..., 1], pair[..., 0]))
    return (turned + 180) % 360 - 180


# Bodies


def test_bodies_differ_in_proportions_not_only_in_size():
    limbs = [(body.leg / body.height, body.offsets.norm(dim=-1).sum()) for body in CAST]
    assert len(limbs) == 8
    legs = [leg for leg, _ in limbs]
    assert max(legs) / min(legs) > 1.1
    assert CAST[0].height < 1.25
    assert CAST[-1].height > 1.9


def test_the_rest_pose_is_a_t_pose_facing_z():
    for body in CAST:
        rest = replace(make_clip(0, seconds=0.02), offsets=body.offsets)
        still = quaternion.identity(1, len(SKELETON), like=rest.rotations_local)
        positions = world(replace(rest, rotations_local=still)).positions[0]
        at = dict(zip(SKELETON.names, positions - rest.root_positions[0], strict=True))
        assert at["LeftHand"][0] > 0.3 * body.height
        assert at["LeftToeBase"][2] > at["LeftFoot"][2]
        torch.testing.assert_close(at["LeftHand"][1], at["LeftArm"][1])
        sole = body.ankle_height - at["LeftFoot"][1]
        assert 0.86 * body.height < at["Head"][1] + sole < body.height
        for joint in range(len(SKELETON)):
            twin = SKELETON.mirror_permutation[joint]
            mirrored = body.offsets[twin] * torch.tensor([-1.0, 1.0, 1.0])
            torch.testing.assert_close(body.offsets[joint], mirrored.double())


# Feet


def test_planted_toes_do_not_move(clips):
    for clip in clips:
        contacts = clip.tracks["contacts"]
        staying = contacts[1:] & contacts[:-1]
        speed = joints(clip, "ToeBase").diff(dim=0).norm(dim=-1) * clip.fps
        assert staying.sum() > 50
        assert speed[staying].max() < 1e-3


def test_nothing_sinks_into_the_floor(clips):
    for clip in clips:
        body = next(body for body in CAST if body.name == clip.labels["body"])
        pose = world(clip)
        points = [pose.positions]
        for side in SIDES:
            foot, toes = SKELETON.index(side + "Foot"), SKELETON.index(side + "ToeBase")
            heel = clip.offsets.new_tensor([0, -body.ankle_height, -body.heel_behind])
            tip = clip.offsets.new_tensor([0, 0, body.toe_ahead])
            for joint, point, thickness in ((foot, heel, 0.0), (toes, tip, body.ball_height)):
                at = pose.positions[:, joint] + quaternion.rotate(
                    pose.rotations[:, joint], point.expand(clip.frames, 3)
                )
                points.append((at - at.new_tensor([0, thickness, 0]))[:, None])
        assert torch.cat(points, dim=1)[..., 1].min() > -1e-3
        planted = clip.tracks["contacts"]
        height = joints(clip, "ToeBase")[..., 1]
        torch.testing.assert_close(
            height[planted], torch.full_like(height[planted], body.ball_height)
        )


def test_walkers_never_leave_the_floor_and_runners_do(clips):
    for clip in of_gait(clips, "walk"):
        assert clip.tracks["contacts"].any(dim=-1).all()
    for clip in of_gait(clips, "run"):
        airborne = (~clip.tracks["contacts"].any(dim=-1)).double().mean()
        assert 0.15 < airborne < 0.5


def test_feet_lift_clear_and_keep_apart(clips):
    for clip in clips:
        assert joints(clip, "Foot")[..., 1].max() > 0.07 * clip.offsets.norm(dim=-1).max()
        left, right = joints(clip, "Foot").unbind(dim=1)
        assert (left - right).norm(dim=-1).min() > 0.06


# Joints


def test_rotations_are_finite_unit_and_continuous_in_sign(clips):
    for clip in clips:
        rotations = clip.rotations_local
        assert rotations.dtype == torch.float64
        assert torch.isfinite(rotations).all()
        assert (rotations.norm(dim=-1) - 1).abs().max() < 1e-9
        assert ((rotations[1:] * rotations[:-1]).sum(dim=-1) > 0).all()
        assert clip.translations_local is None


def test_knees_and_elbows_are_hinges_that_bend_one_way(clips):
    for clip in clips:
        knees = hinge(clip, "Leg")
        assert knees.min() > 5, "legs never lock, let alone bend backwards"
        assert knees.max() < 125
        legs = clip.rotations_local[:, [SKELETON.index(side + "Leg") for side in SIDES]]
        assert legs[..., 2:].abs().max() < 1e-6
        elbows = clip.rotations_local[:, [SKELETON.index(side + "ForeArm") for side in SIDES]]
        assert elbows[..., [1, 3]].abs().max() < 1e-12
        bent = 2 * torch.rad2deg(torch.asin(elbows[..., 2]))
        assert bent[:, 0].max() < -4
        assert bent[:, 1].min() > 4
        assert bent.abs().max() < 130


def test_hips_knees_and_ankles_keep_to_what_a_person_can_do(clips):
    for clip in of_gait(clips, "walk"):
        if clip.labels["style"] == "sneaking":
            continue
        thigh = -hinge(clip, "UpLeg")
        assert 15 < thigh.max() < 60
        assert -40 < thigh.min() < 5
        ankle = -hinge(clip, "Foot")
        assert ankle.max() < 40
        assert ankle.min() > -50


@pytest.mark.parametrize(
    ("gaits", "turn", "jolt"), [(("walk",), 16.0, 14.0), (("jog", "run", "mixed"), 24.0, 17.0)]
)
def test_no_joint_jumps(clips, gaits, turn, jolt):
    """Degrees a frame at 50 Hz; a walking knee reaches 8 on average people, a running one 15."""
    for clip in of_gait(clips, *gaits):
        rotations = clip.rotations_local
        steps = torch.rad2deg(quaternion.angle(rotations[1:], rotations[:-1]))
        assert steps.max() < turn
        assert steps.diff(dim=0).abs().max() < jolt
        upper = [SKELETON.index(name) for name in ("Hips", "Spine", "Chest", "Neck", "Head")]
        assert steps[:, upper].max() < 4


def test_hands_stay_outside_of_trunk_and_thighs(clips):
    for clip in clips:
        at = world(clip).positions
        for side in SIDES:
            hand = at[:, SKELETON.index(side + "Hand")]
            for start, end in (("Hips", "Chest"), (side + "UpLeg", side + "Leg")):
                first, last = at[:, SKELETON.index(start)], at[:, SKELETON.index(end)]
                line = last - first
                along = ((hand - first) * line).sum(-1) / (line * line).sum(-1)
                nearest = first + along.clamp(0, 1)[:, None] * line
                assert (hand - nearest).norm(dim=-1).min() > 0.07


def test_the_head_is_steadier_than_the_pelvis(clips):
    for clip in of_gait(clips, "walk"):
        turned = world(clip).rotations
        hips, head = SKELETON.index("Hips"), SKELETON.index("Head")
        rate = torch.rad2deg(quaternion.angle(turned[1:], turned[:-1])) * clip.fps
        assert rate[:, head].median() < rate[:, hips].median()


def test_left_and_right_are_mirror_images_on_average(corpus):
    means = []
    for clip in corpus.clips:
        angles = [hinge(clip, joint) for joint in ("UpLeg", "Leg", "Foot", "Arm")]
        means.append(torch.stack([angle.mean(dim=0) for angle in angles]))
    difference = torch.stack(means).diff(dim=-1)
    assert difference.shape == (72, 4, 1)
    assert difference.mean(dim=0).abs().max() < 1.5
    legs = torch.stack(
        [joints(clip, "Foot").diff(dim=0).norm(dim=-1).sum(0) for clip in corpus.clips]
    )
    assert abs(float((legs[:, 0] / legs[:, 1]).log().mean())) < 0.02
