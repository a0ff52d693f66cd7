"""Feet that slide are held where they stand, and nothing else of a clip changes."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import pytest
import torch
from torch import Tensor
from torch.testing import assert_close

from posecast.corpora.synthetic import synthetic
from posecast.errors import ConfigError, SkeletonError
from posecast.geometry import quaternion
from posecast.motion import Clip, Feet, drop_joints, find_feet, mirror, pin_feet, turn
from posecast.skeleton import Skeleton
from posecast.skeleton.kinematics import World, forward_kinematics

FPS = 100.0


@cache
def walks() -> list[Clip]:
    """Seven seconds each, on several bodies; planted feet do not slide at all."""
    clips = synthetic(fps=FPS, clips=24, seconds=7.0).clips
    chosen = [clip for clip in clips if clip.labels["action"] in ("walk", "turn", "jog")]
    assert len(chosen) >= 8
    return chosen


def faster(clip: Clip, share: float = 0.05) -> Clip:
    """The root goes farther than its feet do, which slide."""
    scale = clip.root_positions.new_tensor((1 + share, 1.0, 1 + share))
    return replace(clip, root_positions=clip.root_positions * scale)


def world(clip: Clip) -> World:
    moved = clip.translations_local
    return forward_kinematics(
        clip.skeleton,
        clip.rotations_local,
        clip.offsets if moved is None else moved,
        clip.root_positions,
    )


def places(clip: Clip, joints: tuple[int, int]) -> Tensor:
    return world(clip).positions[:, list(joints)]


def feet_of(clip: Clip) -> Feet:
    return find_feet(clip.skeleton, clip.offsets)


def slides(clip: Clip, contacts: Tensor) -> Tensor:
    """Metres on the floor between two frames in both of which a foot stands."""
    steps = places(clip, feet_of(clip).toes)[..., [0, 2]].diff(dim=0).norm(dim=-1)
    return steps[contacts[1:] & contacts[:-1]]


def inner(contacts: Tensor, margin: int = 5) -> Tensor:
    """Contacts without the frames in which they begin and end, which are a matter of judgement, and
    without those that the ends of a clip cut short."""
    kept = contacts.clone()
    kept[:15] = kept[-15:] = False
    for shift in range(1, margin + 1):
        kept[shift:] &= contacts[:-shift]
        kept[:-shift] &= contacts[shift:]
    return kept


def legs_of(clip: Clip) -> list[int]:
    return sorted({joint for pair in feet_of(clip) for joint in pair})


def test_feet_of_a_root_that_is_too_fast_no_longer_slide() -> None:
    for clip in walks():
        sliding, contacts = faster(clip), inner(clip.tracks["contacts"])
        pinned, report = pin_feet(sliding)
        assert not report.short
        assert report.moved == report.contacts > 5
        assert slides(sliding, contacts).sum() > 0.1
        assert slides(pinned, contacts).sum() < 1e-3
        assert 0.1 < report.mean_cm < report.largest_cm < 6
        assert 1 < report.largest_deg < 25


def test_a_toe_stays_where_it_was_in_one_frame_of_its_contact() -> None:
    for clip in walks()[:4]:
        sliding = faster(clip)
        toes = feet_of(clip).toes
        before, after = places(sliding, toes), places(pin_feet(sliding).clip, toes)
        way = (after - before).norm(dim=-1)
        moved = (way > 1e-9).any(0)
        assert moved.all()
        for foot in (0, 1):
            changes = (inner(clip.tracks["contacts"])[:, foot]).long().diff()
            for first, last in zip(
                (changes == 1).nonzero(), (changes == -1).nonzero(), strict=False
            ):
                if first < last:
                    assert way[int(first) - 5 : int(last) + 5, foot].min() < 1e-6


def test_heights_stay() -> None:
    for clip in walks()[:4]:
        sliding, toes = faster(clip), feet_of(clip).toes
        before, after = places(sliding, toes), places(pin_feet(sliding).clip, toes)
        assert_close(after[..., 1], before[..., 1], atol=1e-9, rtol=0)


def test_root_trunk_arms_and_bones_stay() -> None:
    for clip in walks()[:4]:
        sliding = faster(clip)
        pinned, report = pin_feet(sliding)
        others = [joint for joint in range(len(clip.skeleton)) if joint not in legs_of(clip)]
        assert len(others) > 10
        assert torch.equal(pinned.rotations_local[:, others], sliding.rotations_local[:, others])
        assert pinned.root_positions is sliding.root_positions
        assert pinned.offsets is sliding.offsets
        assert (pinned.name, pinned.labels, pinned.source) == (
            sliding.name,
            sliding.labels,
            sliding.source,
        )
        assert pinned.tracks is sliding.tracks
        for each in (sliding, pinned):
            positions = world(each).positions
            for joint, parent in enumerate(clip.skeleton.parents[1:], start=1):
                bone = (positions[:, joint] - positions[:, parent]).norm(dim=-1)
                expected = clip.offsets[joint].norm().expand_as(bone)
                assert_close(bone, expected, atol=1e-9, rtol=0)
        turned = quaternion.angle(sliding.rotations_local, pinned.rotations_local)
        assert math.degrees(float(turned.max())) == pytest.approx(report.largest_deg)


def test_feet_keep_their_rotation_in_the_world_and_knees_their_plane() -> None:
    for clip in walks()[:4]:
        sliding, feet = faster(clip), feet_of(clip)
        pinned = pin_feet(sliding).clip
        before, after = world(sliding), world(pinned)
        for toe in feet.toes:
            apart = quaternion.angle(before.rotations[:, toe], after.rotations[:, toe])
            assert apart.max() < 1e-7
        tilted = quaternion.angle(
            before.rotations[:, list(feet.ankles)], after.rotations[:, list(feet.ankles)]
        )
        assert (tilted < 1e-7).double().mean() > 0.9
        planes = [_knee_planes(each, feet) for each in (before, after)]
        bent = (planes[0].norm(dim=-1) > 0.1) & (planes[1].norm(dim=-1) > 0.1)
        assert bent.double().mean() > 0.5
        cosine = torch.nn.functional.cosine_similarity(planes[0], planes[1], dim=-1)
        assert cosine[bent].min() > 0.97


def _knee_planes(placed: World, feet: Feet) -> Tensor:
    """Normals of the planes of both legs, as long as the sine of the bend."""
    hip, knee, ankle = (
        placed.positions[:, list(joints)] for joints in (feet.hips, feet.knees, feet.ankles)
    )
    thigh = torch.nn.functional.normalize(knee - hip, dim=-1)
    return torch.linalg.cross(thigh, torch.nn.functional.normalize(ankle - knee, dim=-1))


@pytest.mark.parametrize("dtype", [torch.float64, torch.float32])
@pytest.mark.parametrize("share", [0.05, 0.2])
def test_pinning_what_is_pinned_changes_nothing(dtype: torch.dtype, share: float) -> None:
    """No number at all; also where legs are too short, and far from the origin."""
    for clip in walks()[: 2 if share > 0.1 else None]:
        away = replace(clip, root_positions=clip.root_positions + 10.0 * torch.eye(3)[2])
        once = pin_feet(faster(away, share).to(dtype))
        assert once.report.moved > 3
        twice = pin_feet(once.clip)
        assert twice.report.moved == 0
        assert torch.equal(twice.clip.rotations_local, once.clip.rotations_local)
        assert once.clip.rotations_local.dtype == dtype


def test_velocities_do_not_jump() -> None:
    """What is added to a toe accelerates it as a spline over the easing does, at any frame rate.

    A jump of velocity would be as large as the slide times the frame rate: several times as much.
    """
    ease = 0.1
    for clip in walks():
        sliding, toes = faster(clip), feet_of(clip).toes
        pinned, report = pin_feet(sliding, ease=ease)
        added = places(pinned, toes) - places(sliding, toes)
        acceleration = (added[2:] - 2 * added[1:-1] + added[:-2]).norm(dim=-1) * FPS**2
        assert acceleration.max() < 10 * (report.largest_cm / 100) / ease**2


def test_feet_that_do_not_slide_are_left_alone() -> None:
    for clip in walks()[:4]:
        pinned, report = pin_feet(clip)
        assert report.contacts > 5
        assert (report.moved, report.largest_deg) == (0, 0.0)
        assert pinned is clip


def test_a_clip_without_contacts_is_returned_as_it_is() -> None:
    clip = faster(walks()[0]).cut(0, 4)
    pinned, report = pin_feet(clip)
    assert pinned is clip
    assert report.contacts == 0
    assert "0 of 0 contacts" in report.text()


def test_where_a_leg_is_too_short_the_contact_ends_and_is_reported() -> None:
    found = 0
    for clip in walks():
        sliding = faster(clip, 0.4)
        pinned, report = pin_feet(sliding)
        toes = places(pinned, feet_of(clip).toes)[..., [0, 2]]
        for short in report.short:
            foot = toes[short.stand.frames, short.stand.foot]
            apart = torch.cdist(foot, foot)
            # It stands at one place for at least 0.1 s or is left as it was; the rest is away.
            assert 100 * float(apart.max()) > short.left_cm - 1e-6 > 0
            assert 100 * float(apart.max(dim=1).values.min()) < short.left_cm + 1e-6
            found += 1
        if report.short:
            assert f"in {len(report.short)} of them a leg is too short" in report.text()
        _check_stretch(sliding, pinned)
    assert found > 10


def _check_stretch(before: Clip, after: Clip) -> None:
    """No leg is stretched farther than 99.5 % of its length, or than it was."""
    stretch = []
    for clip in (before, after):
        feet = feet_of(clip)
        hip, knee, ankle = (places(clip, joints) for joints in (feet.hips, feet.knees, feet.ankles))
        length = (knee - hip).norm(dim=-1) + (ankle - knee).norm(dim=-1)
        stretch.append((ankle - hip).norm(dim=-1) / length)
    assert (stretch[1] <= stretch[0].clamp(min=0.995) + 1e-7).all()


def test_where_a_leg_is_almost_too_short_the_heel_rises_about_the_toe() -> None:
    risen = 0
    for clip in walks():
        sliding, feet = faster(clip, 0.15), feet_of(clip)
        pinned = pin_feet(sliding).clip
        before, after = world(sliding), world(pinned)
        contacts = inner(clip.tracks["contacts"])
        for foot, (ankle, toe) in enumerate(zip(feet.ankles, feet.toes, strict=True)):
            tilt = quaternion.angle(before.rotations[:, ankle], after.rotations[:, ankle])
            turned = (tilt > 1e-3) & contacts[:, foot]
            heights = [each.positions[turned][:, [ankle, toe], 1] for each in (before, after)]
            rise = heights[1][:, 0] - heights[0][:, 0]
            assert (rise > 0).all()
            assert_close(heights[1][:, 1], heights[0][:, 1], atol=1e-9, rtol=0)
            risen += len(rise)
    assert risen > 200


def test_a_toe_below_the_floor_is_lifted_to_it() -> None:
    clip = next(clip for clip in walks() if clip.labels["action"] == "walk")
    times = torch.arange(clip.frames, dtype=torch.float64) / FPS
    sink = 0.08 * torch.exp(-0.5 * ((times - 3.5) / 0.2) ** 2)
    positions = clip.root_positions.clone()
    positions[:, 1] -= sink
    sunken, toes = replace(clip, root_positions=positions), feet_of(clip).toes
    assert places(sunken, toes)[..., 1].min() < -0.02
    assert places(pin_feet(sunken).clip, toes)[..., 1].min() > -1.1e-4
    floor = positions - positions.new_tensor((0.0, 1.0, 0.0))
    lower = replace(clip, root_positions=floor)
    assert places(pin_feet(faster(lower)).clip, toes)[..., 1].max() < 0.0


def test_turned_and_mirrored_clips_are_pinned_alike() -> None:
    clip = faster(walks()[1])
    pinned = pin_feet(clip).clip
    for change in (lambda each: turn(each, 1.1), mirror):
        one, other = pin_feet(change(clip)).clip, change(pinned)
        apart = quaternion.angle(one.rotations_local, other.rotations_local)
        assert apart.max() < 1e-6


def _with_zero_bones(clip: Clip) -> Clip:
    """As in ASF skeletons: before hips, knees and ankles a joint at the same place."""
    names, parents, sources = [], [], []
    places_of: dict[int, int] = {}
    split = {*feet_of(clip).hips, *feet_of(clip).knees, *feet_of(clip).ankles}
    for joint, (name, parent) in enumerate(
        zip(clip.skeleton.names, clip.skeleton.parents, strict=True)
    ):
        above = places_of.get(parent, -1)
        if joint in split:
            names.append(f"{name}Begin")
            parents.append(above)
            sources.append((joint, False))
            above = len(names) - 1
        places_of[joint] = len(names)
        names.append(name)
        parents.append(above)
        sources.append((joint, True))
    rotations = torch.stack(
        [
            clip.rotations_local[:, joint]
            if own
            else quaternion.identity(clip.frames, like=clip.offsets)
            for joint, own in sources
        ],
        dim=1,
    )
    offsets = torch.stack(
        [
            clip.offsets[joint] if (joint not in split or not own) else torch.zeros(3).double()
            for joint, own in sources
        ]
    )
    return replace(
        clip,
        skeleton=Skeleton(tuple(names), tuple(parents)),
        rotations_local=rotations,
        offsets=offsets,
        tracks={},
    )


def test_joints_without_length_between_the_bones_make_no_difference() -> None:
    clip = faster(walks()[2])
    longer = _with_zero_bones(clip)
    assert len(longer.skeleton) == len(clip.skeleton) + 6
    toes = places(pin_feet(longer).clip, feet_of(longer).toes)
    assert_close(toes, places(pin_feet(clip).clip, feet_of(clip).toes), atol=1e-9, rtol=0)


def test_feet_without_toes_are_pinned_at_the_ankle() -> None:
    clip = walks()[2]
    toes = [clip.skeleton.names[joint] for joint in feet_of(clip).toes]
    footless = drop_joints(clip, toes)
    assert feet_of(footless).toes == feet_of(footless).ankles
    sliding = faster(footless)
    pinned, report = pin_feet(sliding)
    assert report.moved > 3
    before, after = (
        places(each, feet_of(each).ankles).diff(dim=0)[..., [0, 2]].norm(dim=-1)
        for each in (sliding, pinned)
    )
    assert (before < 1e-6).sum() == 0
    assert (after < 1e-6).sum() > 50
    assert torch.equal(pin_feet(pinned).clip.rotations_local, pinned.rotations_local)


def test_bones_that_move_are_kept_as_they_move() -> None:
    clip = faster(walks()[0])
    times = torch.arange(clip.frames, dtype=torch.float64) / FPS
    stretch = 1 + 0.01 * torch.sin(3 * times)
    moving = replace(clip, translations_local=stretch[:, None, None] * clip.offsets)
    pinned, report = pin_feet(moving)
    assert pinned.translations_local is moving.translations_local
    assert report.moved > 3
    assert slides(pinned, inner(clip.tracks["contacts"])).sum() < 1e-3


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"near": 0.0}, "near is 0.0"),
        ({"near": math.nan}, "near is nan"),
        ({"ease": 0.0}, "ease is 0.0"),
        ({"ease": math.inf}, "ease is inf"),
    ],
)
def test_numbers_that_make_no_sense_are_refused(changes: dict[str, float], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        pin_feet(walks()[0], **changes)


def test_bodies_that_cannot_be_pinned_are_refused() -> None:
    clip = walks()[0]
    knees = [clip.skeleton.names[joint] for joint in feet_of(clip).knees]
    with pytest.raises(SkeletonError, match="has no thigh or no shin"):
        pin_feet(drop_joints(clip, knees))
    names = tuple(f"joint {joint}" for joint in range(3))
    stick = Clip(
        skeleton=Skeleton(names, (-1, 0, 1)),
        offsets=torch.ones(3, 3),
        fps=30.0,
        root_positions=torch.zeros(9, 3),
        rotations_local=quaternion.identity(9, 3, like=torch.ones(1)),
    )
    with pytest.raises(SkeletonError, match="no feet found"):
        pin_feet(stick)
