"""Transforms keep what they promise to keep, checked in the world by forward kinematics."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest
import torch
from scipy.spatial.transform import Rotation, Slerp
from torch.testing import assert_close

from posecast.errors import ConfigError, SkeletonError
from posecast.geometry import quaternion
from posecast.motion import Clip, mirror, resample, turn, unroll
from posecast.skeleton import Skeleton
from posecast.skeleton.kinematics import joint_positions

MakeClip = Callable[..., Clip]
FOREST = Skeleton(("Pelvis", "LeftKnee", "RightKnee", "Camera", "Lens"), (-1, 0, 0, -1, 3))


def world(clip: Clip) -> torch.Tensor:
    offsets = clip.offsets if clip.translations_local is None else clip.translations_local
    return joint_positions(clip.skeleton, clip.rotations_local, offsets, clip.root_positions)


def with_tracks(make_clip: MakeClip, frames: int = 40) -> Clip:
    frame = torch.arange(frames)
    return make_clip(
        frames=frames,
        tracks={
            "phase": torch.remainder(frame * 0.3, 2 * math.pi).double(),
            "contacts": torch.stack([frame % 2 == 0, frame % 3 == 0], dim=1),
            "speed": torch.linspace(0, 1, frames, dtype=torch.float64),
            "step": frame,
        },
        translations_local=torch.randn(frames, 7, 3, dtype=torch.float64),
    )


def test_a_whole_ratio_keeps_every_frame_in_one_of_the_copies(make_clip: MakeClip) -> None:
    clip = with_tracks(make_clip, frames=43)
    copies = resample(clip, 30)
    assert [copy.labels["phase"] for copy in copies] == ["0", "1", "2", "3"]
    assert [copy.frames for copy in copies] == [11, 11, 11, 10]
    assert {copy.fps for copy in copies} == {30.0}
    for phase, copy in enumerate(copies):
        assert torch.equal(copy.rotations_local, clip.rotations_local[phase::4])
        assert torch.equal(copy.root_positions, clip.root_positions[phase::4])
        assert copy.translations_local is not None
        assert clip.translations_local is not None
        assert torch.equal(copy.translations_local, clip.translations_local[phase::4])
        assert set(copy.tracks) == {"phase", "contacts", "speed", "step"}
        assert torch.equal(copy.tracks["step"], torch.arange(43)[phase::4])


def test_the_first_phase_alone_can_be_had(make_clip: MakeClip) -> None:
    (copy,) = resample(make_clip(frames=41), 60, phases="first")
    assert copy.frames == 21
    assert copy.labels["phase"] == "0"


def test_a_rate_rounded_in_the_file_is_still_a_whole_ratio(make_clip: MakeClip) -> None:
    copies = resample(make_clip(fps=1 / 0.008333), 30)
    assert len(copies) == 4
    assert copies[0].fps == 30.0


def test_a_clip_shorter_than_the_ratio_has_no_empty_copies(make_clip: MakeClip) -> None:
    copies = resample(make_clip(frames=2), 30)
    assert [copy.frames for copy in copies] == [1, 1]


def test_the_same_rate_changes_nothing(make_clip: MakeClip) -> None:
    clip = make_clip(fps=30.0)
    (same,) = resample(clip, 30)
    assert torch.equal(same.rotations_local, clip.rotations_local)
    assert dict(same.labels) == {}


@pytest.mark.parametrize(("source", "target"), [(60.0, 25.0), (25.0, 60.0), (59.0, 30.0)])
def test_an_odd_ratio_is_slerped_as_by_scipy(
    make_clip: MakeClip, generator: torch.Generator, source: float, target: float
) -> None:
    clip = make_clip(fps=source, frames=50)
    flips = torch.where(torch.rand(50, 7, 1, generator=generator) < 0.5, -1.0, 1.0)
    (slow,) = resample(
        Clip(
            clip.skeleton,
            clip.offsets,
            clip.fps,
            clip.root_positions,
            clip.rotations_local * flips.double(),
        ),
        target,
    )
    times = torch.arange(slow.frames, dtype=torch.float64) / target
    assert slow.fps == target
    assert times[-1] <= 49 / source < times[-1] + 1 / target
    for joint in range(7):
        truth = Slerp(
            [frame / source for frame in range(50)],
            Rotation.from_quat(clip.rotations_local[:, joint].numpy(), scalar_first=True),
        )(times.numpy()).as_quat(scalar_first=True)
        gap = quaternion.angle(slow.rotations_local[:, joint], torch.from_numpy(truth.copy()))
        assert gap.max() < 1e-7
    agreement = (slow.rotations_local[1:] * slow.rotations_local[:-1]).sum(-1)
    assert agreement.min() > 0, "signs are continuous in time"


def test_an_odd_ratio_interpolates_positions_and_tracks(make_clip: MakeClip) -> None:
    frames = torch.arange(61, dtype=torch.float64)
    phase = torch.remainder(0.5 * frames, 2 * math.pi)
    clip = make_clip(
        fps=60.0,
        frames=61,
        root_positions=frames[:, None].expand(61, 3) / 60,
        tracks={
            "phase": phase,
            "counted": 0.5 * frames,
            "contacts": (frames[:, None] % 10 < 5).expand(61, 2),
        },
    )
    (slow,) = resample(clip, 25)
    seconds = torch.arange(26, dtype=torch.float64) / 25
    assert_close(slow.root_positions, seconds[:, None].expand(26, 3))
    assert_close(slow.tracks["phase"], torch.remainder(30 * seconds, 2 * math.pi))
    assert_close(slow.tracks["counted"], 30 * seconds)
    nearest = (seconds * 60).round().long()
    assert torch.equal(slow.tracks["contacts"], clip.tracks["contacts"][nearest])


def test_a_single_frame_can_be_resampled(make_clip: MakeClip) -> None:
    (one,) = resample(make_clip(frames=1, fps=60.0), 25)
    assert one.frames == 1


@pytest.mark.parametrize("fps", [0.0, -30.0, math.nan, math.inf])
def test_an_impossible_rate_is_refused(make_clip: MakeClip, fps: float) -> None:
    with pytest.raises(ConfigError, match="expected a positive number"):
        resample(make_clip(), fps)


@pytest.mark.parametrize("moving", [False, True])
def test_a_mirrored_clip_is_the_reflection_of_the_world(make_clip: MakeClip, moving: bool) -> None:
    clip = with_tracks(make_clip) if moving else make_clip()
    twins = list(clip.skeleton.mirror_permutation)
    assert twins == [0, 3, 4, 1, 2, 5, 6]
    reflected = world(clip)[:, twins] * torch.tensor([-1.0, 1.0, 1.0], dtype=torch.float64)
    assert_close(world(mirror(clip)), reflected, atol=1e-12, rtol=0)


def test_a_forest_is_mirrored_and_turned_as_one(make_clip: MakeClip) -> None:
    clip = make_clip(FOREST)
    assert len(clip.skeleton.roots) == 2
    twins = list(FOREST.mirror_permutation)
    reflected = world(clip)[:, twins] * torch.tensor([-1.0, 1.0, 1.0], dtype=torch.float64)
    assert_close(world(mirror(clip)), reflected, atol=1e-12, rtol=0)


def test_mirroring_twice_gives_the_clip_back(make_clip: MakeClip) -> None:
    clip = with_tracks(make_clip)
    once = mirror(clip)
    assert once.labels["mirrored"] == "yes"
    twice = mirror(once)
    assert torch.equal(twice.rotations_local, clip.rotations_local)
    assert torch.equal(twice.offsets, clip.offsets)
    assert dict(twice.labels) == {}
    assert_close(twice.tracks["phase"], clip.tracks["phase"])


def test_mirroring_swaps_contacts_and_shifts_the_phase_by_half_a_cycle(
    make_clip: MakeClip,
) -> None:
    clip = with_tracks(make_clip)
    mirrored = mirror(clip).tracks
    assert torch.equal(mirrored["contacts"], clip.tracks["contacts"][:, [1, 0]])
    shift = torch.remainder(mirrored["phase"] - clip.tracks["phase"], 2 * math.pi)
    assert_close(shift, torch.full_like(shift, math.pi))
    assert mirrored["phase"].min() >= 0
    assert mirrored["phase"].max() < 2 * math.pi
    assert torch.equal(mirrored["speed"], clip.tracks["speed"])


def test_twins_on_different_branches_are_refused(make_clip: MakeClip) -> None:
    crooked = Skeleton(("Hips", "Spine", "LeftHand", "RightHand"), (-1, 0, 0, 1))
    with pytest.raises(SkeletonError, match="'LeftHand' and 'RightHand'"):
        mirror(make_clip(crooked))


@pytest.mark.parametrize("angle", [0.4, -2.0, math.pi, 7.0])
@pytest.mark.parametrize("skeleton", [None, FOREST])
def test_turning_a_clip_turns_the_world_about_the_vertical(
    make_clip: MakeClip, angle: float, skeleton: Skeleton | None
) -> None:
    clip = make_clip(FOREST) if skeleton else with_tracks(make_clip)
    turned = Rotation.from_euler("y", angle).apply(world(clip).reshape(-1, 3).numpy())
    expected = torch.from_numpy(turned).reshape(world(clip).shape)
    assert_close(world(turn(clip, angle)), expected, atol=1e-11, rtol=0)


def test_a_quarter_turn_takes_forward_to_the_left(make_clip: MakeClip) -> None:
    forward = torch.tensor([[0.0, 0.0, 1.0]], dtype=torch.float64)
    clip = turn(make_clip(frames=1, root_positions=forward), math.pi / 2)
    left = torch.tensor([[1.0, 0.0, 0.0]], dtype=torch.float64)
    assert_close(clip.root_positions, left, atol=1e-15, rtol=0)


def test_what_lies_on_the_floor_is_mirrored_turned_and_interpolated(make_clip: MakeClip) -> None:
    heading = torch.linspace(0, 9, 31, dtype=torch.float64)
    facing = torch.stack([heading.sin(), heading.cos()], dim=-1)
    place = torch.randn(31, 2, dtype=torch.float64)
    floor = torch.stack([place[:, 0], torch.zeros(31, dtype=torch.float64), place[:, 1]], dim=-1)
    clip = make_clip(
        frames=31, fps=60.0, root_positions=floor, tracks={"facing": facing, "path": place}
    )
    turned, mirrored = turn(clip, 0.7), mirror(clip)
    assert_close(turned.tracks["path"], turned.root_positions[:, [0, 2]])
    assert_close(mirrored.tracks["path"], mirrored.root_positions[:, [0, 2]])
    ahead = torch.stack([(heading + 0.7).sin(), (heading + 0.7).cos()], dim=-1)
    assert_close(turned.tracks["facing"], ahead)
    assert_close(mirrored.tracks["facing"], facing * torch.tensor([-1.0, 1.0]).double())
    (slow,) = resample(clip, 25)
    assert slow.frames == 13
    assert_close(slow.tracks["facing"].norm(dim=-1), torch.ones(13, dtype=torch.float64))
    between = torch.arange(13, dtype=torch.float64) / 25 * 60 * 0.3
    assert_close(
        torch.atan2(slow.tracks["facing"][:, 0], slow.tracks["facing"][:, 1]).cos(),
        between.cos(),
        atol=3e-3,
        rtol=0,
    )


def test_unrolled_quaternions_are_the_same_rotations_with_continuous_signs(
    make_clip: MakeClip, generator: torch.Generator
) -> None:
    clip = make_clip()
    flips = torch.where(torch.rand(40, 7, 1, generator=generator) < 0.5, -1.0, 1.0).double()
    flips[0] = 1
    assert (flips < 0).any()
    broken = make_clip(rotations_local=clip.rotations_local * flips)
    assert_close(unroll(broken).rotations_local, clip.rotations_local)


def test_no_transform_changes_the_clip_it_is_given(make_clip: MakeClip) -> None:
    clip = with_tracks(make_clip)
    before = {track: values.clone() for track, values in clip.tracks.items()}
    rotations, offsets = clip.rotations_local.clone(), clip.offsets.clone()
    for transform in (
        mirror,
        unroll,
        lambda given: turn(given, 1.0),
        lambda given: resample(given, 25),
    ):
        transform(clip)
    assert torch.equal(clip.rotations_local, rotations)
    assert torch.equal(clip.offsets, offsets)
    assert all(torch.equal(clip.tracks[track], before[track]) for track in before)
