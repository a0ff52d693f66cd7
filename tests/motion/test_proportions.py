"""The same motion on another body: what turns, what scales, and where the feet come down."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from torch import Tensor
from torch.testing import assert_close

from posecast.corpora.gait.body import CAST
from posecast.corpora.synthetic import make_clip as make_walk
from posecast.errors import ConfigError, SkeletonError
from posecast.io.bvh import read_bvh, write_bvh
from posecast.motion import Clip, body_parts, reproportion, scale_body
from posecast.motion.proportions import leg_ratio
from posecast.skeleton import Skeleton, joint_positions, named_skeleton, skeleton_names

MakeClip = Callable[..., Clip]

SMALL = Skeleton(
    ("Hips", "LeftHip", "LeftKnee", "LeftAnkle", "RightHip", "RightKnee", "RightAnkle", "Spine"),
    (-1, 0, 1, 2, 0, 4, 5, 0),
)
TURNED = Skeleton(("Pelvis", "LeftKnee", "RightKnee", "Camera"), (-1, 0, 0, -1))


def world(clip: Clip) -> Tensor:
    return joint_positions(clip.skeleton, clip.rotations_local, clip.offsets, clip.root_positions)


def lowest(clip: Clip) -> Tensor:
    """Height of the lowest joint in each frame, metres."""
    return world(clip)[..., 1].amin(-1)


def small_body(thigh: float, shin: float, *, drop: float = 0.1, down: int = 1) -> Tensor:
    """Offsets of SMALL whose legs point along an axis: 1 is down to the floor, 0 is sideways."""
    rows = torch.zeros(8, 3, dtype=torch.float64)
    rows[:, down] = torch.tensor([0, -drop, -thigh, -shin, -drop, -thigh, -shin, 0.6]).double()
    rows[1, 2], rows[4, 2] = 0.1, -0.1
    return rows


def test_another_body_turns_its_joints_as_before(
    make_clip: MakeClip, generator: torch.Generator
) -> None:
    clip = make_clip(SMALL)
    offsets = torch.randn(8, 3, generator=generator, dtype=torch.float64)
    other = reproportion(clip, offsets, body="other")
    assert other.rotations_local is clip.rotations_local
    assert torch.equal(other.offsets, offsets)
    assert (other.name, other.fps, other.labels["body"]) == (clip.name, clip.fps, "other")
    ratio = leg_ratio(SMALL, clip.offsets, offsets)
    roots = clip.root_positions + clip.offsets[0]
    assert_close(world(other)[:, 0], ratio * roots)
    origin = torch.zeros_like(clip.root_positions)
    by_hand = joint_positions(SMALL, clip.rotations_local, offsets, origin)
    assert_close(world(other) - world(other)[:, :1], by_hand - by_hand[:, :1])


def test_legs_are_as_long_as_they_reach_down_in_a_rest_pose_that_stands() -> None:
    before, after = small_body(0.4, 0.5), small_body(0.3, 0.35)
    assert_close(leg_ratio(SMALL, before, after).item(), 0.75 / 1.0)
    # The width of the hips is no height, and hands that hang lower are no feet.
    wide = after.clone()
    wide[1, 2], wide[7, 1] = 0.5, -3.0
    assert_close(leg_ratio(SMALL, before, wide).item(), 0.75 / 1.0)


def test_legs_are_as_long_as_their_bones_in_a_rest_pose_that_does_not_stand() -> None:
    lying, shorter = small_body(0.4, 0.5, down=0), small_body(0.3, 0.3, down=0)
    assert_close(leg_ratio(SMALL, lying, shorter).item(), 0.6 / 0.9)
    assert_close(leg_ratio(SMALL, lying, small_body(0.3, 0.3)).item(), 0.6 / 0.9)
    assert_close(leg_ratio(SMALL, small_body(0.3, 0.3), lying).item(), 0.9 / 0.6)
    # Hips a little below the root, as in Bandai's files, do not make a leg that lies stand.
    lying[[1, 4], 1], shorter[[1, 4], 1] = -0.06, -0.03
    assert_close(leg_ratio(SMALL, lying, shorter).item(), 0.6 / 0.9)


def test_joints_without_telling_names_are_measured_by_the_lowest_of_them() -> None:
    nameless = Skeleton(tuple("abcdefgh"), SMALL.parents)
    before, after = small_body(0.4, 0.5), small_body(0.3, 0.35)
    assert_close(leg_ratio(nameless, before, after).item(), 0.75 / 1.0)
    assert leg_ratio(nameless, before, small_body(0.3, 0.35, down=0)) == 1


def test_where_legs_cannot_be_compared_places_are_kept(make_clip: MakeClip) -> None:
    legless = Skeleton(("Hips", "Spine", "Head"), (-1, 0, 1))
    up = torch.tensor([[0, 0, 0], [0, 0.3, 0], [0, 0.4, 0]], dtype=torch.float64)
    clip = make_clip(legless, offsets=up)
    assert torch.equal(reproportion(clip, 2 * up, body="x").root_positions, clip.root_positions)
    nothing, something = small_body(0, 0, drop=0), small_body(0.4, 0.5)
    assert leg_ratio(SMALL, nothing, something) == 1
    assert leg_ratio(SMALL, something, nothing) == 1


def test_what_hangs_from_another_root_is_no_leg(make_clip: MakeClip) -> None:
    offsets = torch.tensor([[0, 0.2, 0], [0.1, -1, 0], [-0.1, -1, 0], [0, -9, 0]]).double()
    clip = make_clip(TURNED, offsets=offsets)
    longer = offsets.clone()
    longer[1:3, 1] = -1.5
    longer[0, 1], longer[3, 1] = 0.3, -5
    other = reproportion(clip, longer, body="long")
    assert_close(world(other)[:, 0], 1.5 * world(clip)[:, 0])


def test_on_its_old_body_a_clip_is_what_it_was(
    make_clip: MakeClip, generator: torch.Generator
) -> None:
    tracks = {"path": torch.randn(40, 2, generator=generator, dtype=torch.float64)}
    clip = make_clip(SMALL, offsets=small_body(0.4, 0.5), tracks=tracks)
    there = reproportion(clip, small_body(0.31, 0.37), body="b")
    assert not torch.allclose(there.root_positions, clip.root_positions)
    back = reproportion(there, clip.offsets, body="a")
    assert_close(world(back), world(clip), atol=1e-13, rtol=0)
    assert_close(back.tracks["path"], clip.tracks["path"], atol=1e-13, rtol=0)
    same = reproportion(clip, clip.offsets, body="a")
    assert torch.equal(same.root_positions, clip.root_positions)


def test_a_piece_of_a_clip_gets_the_body_that_the_whole_gets(make_clip: MakeClip) -> None:
    clip, body = make_clip(SMALL), small_body(0.2, 0.3)
    piece = reproportion(clip.cut(7, 19), body, body="b")
    assert torch.equal(world(piece), world(reproportion(clip, body, body="b"))[7:19])


def test_places_on_the_floor_and_speeds_scale_and_other_tracks_do_not(make_clip: MakeClip) -> None:
    frames = torch.arange(40, dtype=torch.float64)
    tracks = {
        "path": torch.stack([frames, -frames], dim=-1),
        "speed": frames,
        "phase": frames,
        "facing": torch.stack([frames.sin(), frames.cos()], dim=-1),
        "contacts": torch.stack([frames > 3, frames > 5], dim=-1),
    }
    clip = make_clip(SMALL, offsets=small_body(0.4, 0.5), tracks=tracks, labels={"action": "walk"})
    half = reproportion(clip, 0.5 * clip.offsets, body="half")
    assert_close(half.root_positions, 0.5 * clip.root_positions)
    assert dict(half.labels) == {"action": "walk", "body": "half"}
    for track in ("path", "speed"):
        assert_close(half.tracks[track], 0.5 * tracks[track])
    for track in ("phase", "facing", "contacts"):
        assert half.tracks[track] is tracks[track]


def test_giving_a_body_changes_neither_clip_nor_body(make_clip: MakeClip) -> None:
    clip, body = make_clip(SMALL), small_body(0.2, 0.3)
    kept = [clip.offsets.clone(), clip.root_positions.clone(), body.clone()]
    reproportion(clip, body, body="b")
    scale_body(SMALL, body, {"legs": 2.0})
    assert all(map(torch.equal, kept, (clip.offsets, clip.root_positions, body)))


def test_a_body_that_does_not_fit_is_refused(make_clip: MakeClip) -> None:
    clip = make_clip(SMALL)
    with pytest.raises(SkeletonError, match=r"'b' .* offsets \(7, 3\), expected \(8, 3\)"):
        reproportion(clip, torch.zeros(7, 3), body="b")
    broken = small_body(0.2, 0.3)
    broken[2, 1] = math.nan
    with pytest.raises(SkeletonError, match="'LeftKnee' is not finite"):
        reproportion(clip, broken, body="b")
    moving = torch.zeros(40, 8, 3, dtype=torch.float64)
    with pytest.raises(SkeletonError, match="moving='mean'"):
        reproportion(replace(clip, translations_local=moving), small_body(1, 1), body="b")


def test_a_file_of_the_new_body_does_not_state_the_ends_of_the_old_one(tmp_path: Path) -> None:
    walk = replace(make_walk(0, fps=30.0, seconds=0.5), tracks={})
    write_bvh(walk, tmp_path / "a.bvh")
    lines = (tmp_path / "a.bvh").read_text().split("\n")
    ends = [at + 2 for at, line in enumerate(lines) if "End Site" in line]
    assert len(ends) == 5
    for at in ends:
        lines[at] = "OFFSET 7.654321 0.0 0.0"
    (tmp_path / "a.bvh").write_text("\n".join(lines))
    clip = read_bvh(tmp_path / "a.bvh")
    other = reproportion(clip, 2 * clip.offsets, body="double")
    write_bvh(other, tmp_path / "b.bvh")
    assert "7.654321" not in (tmp_path / "b.bvh").read_text()
    assert_close(world(read_bvh(tmp_path / "b.bvh", unit=0.01)), world(other), atol=1e-6, rtol=0)
    write_bvh(replace(other, source=clip.source), tmp_path / "c.bvh")
    assert "7.654321" in (tmp_path / "c.bvh").read_text(), "why the source is not kept"


@pytest.mark.parametrize("index", [0, 1, 2, 4, 11])
def test_feet_of_made_walks_stay_near_the_floor_on_every_body(index: int) -> None:
    clip = make_walk(index, fps=25.0, seconds=4.0)
    before = lowest(clip)
    for body in CAST:
        other = reproportion(clip, body.offsets, body=body.name)
        # Feet are not scaled as legs are, so an ankle that is high up costs a few centimetres.
        assert (lowest(other) - before).abs().max() < 0.035, body.name


@pytest.mark.data
def test_feet_of_dancers_stay_near_the_floor_on_every_body(data_root: Path) -> None:
    clip = read_bvh(data_root / "cmu-salsa" / "61" / "61_01.bvh", unit=0.01, up="y")
    before = lowest(clip)
    bodies = ({"all": 0.7, "head": 1.3}, {"all": 1.3}, {"legs": 0.75}, {"legs": 1.2, "arms": 0.8})
    for factors in bodies:
        body = scale_body(clip.skeleton, clip.offsets, factors)
        ratio = leg_ratio(clip.skeleton, clip.offsets, body)
        assert abs(ratio - 1) > 0.1
        after = lowest(reproportion(clip, body, body="made"))
        assert (after - ratio * before).abs().max() < 0.03, factors


def test_parts_of_a_body_scale_together_and_keep_their_directions() -> None:
    walk = make_walk(0, fps=10.0, seconds=0.1)
    skeleton, offsets = walk.skeleton, walk.offsets
    factors = {"all": 0.5, "arms": 3.0, "LeftHand": 2.0, "legs": 0.8}
    scaled = scale_body(skeleton, offsets, factors)
    expected = dict.fromkeys(skeleton.names, 0.5)
    for side in ("Left", "Right"):
        expected |= {side + name: 0.5 * 3 for name in ("ForeArm", "Hand")}
        expected |= {side + name: 0.5 * 0.8 for name in ("Leg", "Foot")}
    expected["LeftHand"] *= 2
    scale = torch.tensor([expected[name] for name in skeleton.names]).double()
    assert_close(scaled, offsets * scale[:, None])


def test_scaling_a_body_leaves_its_roots_where_they_stand() -> None:
    offsets = torch.ones(4, 3, dtype=torch.float64)
    scaled = scale_body(TURNED, offsets, {"all": 2.0})
    assert scaled[:, 0].tolist() == [1, 2, 2, 1]


@pytest.mark.parametrize(
    ("factors", "message"),
    [
        ({"lgs": 2.0}, "'lgs'; did you mean 'legs'"),
        ({"hands": 2.0}, "'hands'"),
        ({"Hips": 2.0}, "no joint below a root is called 'Hips'"),
        ({"legs": 0.0}, "factor of 'legs' is 0.0; expected a positive number"),
        ({"legs": math.inf}, "expected a positive number"),
    ],
)
def test_factors_that_make_no_sense_are_refused(factors: dict[str, float], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        scale_body(SMALL, small_body(0.4, 0.5), factors)


LEG_NAMES = {
    "h36m-32": {"RightLeg", "RightFoot", "LeftLeg", "LeftFoot"},
    "h36m-21": {"RightLeg", "RightFoot", "LeftLeg", "LeftFoot"},
    "cmu-31": {"RightLeg", "RightFoot", "LeftLeg", "LeftFoot"},
    "smpl-15": {"l_knee", "r_knee"},
    "smpl-22": {"l_knee", "r_knee", "l_ankle", "r_ankle"},
    "smpl-24": {"l_knee", "r_knee", "l_ankle", "r_ankle"},
}


@pytest.mark.parametrize("name", skeleton_names())
def test_limbs_of_every_named_skeleton_are_found(name: str) -> None:
    skeleton = named_skeleton(name).skeleton
    parts = body_parts(skeleton)
    found = [joint for joints in parts.values() for joint in joints]
    assert len(found) == len(set(found)), "no joint is in two parts"
    assert {skeleton.names[joint] for joint in parts["legs"]} == LEG_NAMES[name]
    others = set(range(len(skeleton))) - set(skeleton.roots)
    assert set(found) == others, "and each is in one"
    assert all(parts[part] for part in ("shoulders", "arms", "trunk", "head"))


@pytest.mark.parametrize(
    ("knees", "elbows"),
    [
        (("LeftLeg", "RightLeg"), ("LeftForeArm", "RightForeArm")),
        (("lShin", "rShin"), ("lForeArm", "rForeArm")),
        (("ltibia", "rtibia"), ("lradius", "rradius")),
        (("LowerLeg_L", "LowerLeg_R"), ("LowerArm_L", "LowerArm_R")),
        (("calf_l", "calf_r"), ("lowerarm_l", "lowerarm_r")),
        (("mixamorig:LeftLeg", "mixamorig:RightLeg"), ("L_Elbow", "R_Elbow")),
    ],
)
def test_knees_and_elbows_go_by_many_names(knees: tuple[str, str], elbows: tuple[str, str]) -> None:
    names = ("Hips", "LeftUpLeg", knees[0], "LeftFoot", "LeftToe", "RightUpLeg", knees[1])
    names += ("RightFoot", "RightToe", "Spine", "LeftUpperArm", elbows[0], "LeftWrist")
    names += ("RightUpperArm", elbows[1], "RightWrist", "Neck")
    parents = (-1, 0, 1, 2, 3, 0, 5, 6, 7, 0, 9, 10, 11, 9, 13, 14, 9)
    parts = body_parts(Skeleton(names, parents))
    assert parts == {
        "hips": (1, 5),
        "legs": (2, 3, 6, 7),
        "feet": (4, 8),
        "shoulders": (10, 13),
        "arms": (11, 12, 14, 15),
        "hands": (),
        "trunk": (9,),
        "head": (16,),
    }


def test_a_skeleton_without_limbs_has_no_parts() -> None:
    assert set(body_parts(Skeleton(("a", "b", "legacy"), (-1, 0, 1))).values()) == {()}
