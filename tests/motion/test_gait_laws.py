"""What turning, mirroring, scaling and cutting a clip do to its gait, and what has no gait."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Literal

import pytest
import torch
from torch import Tensor
from torch.testing import assert_close

from posecast.corpora.synthetic import make_clip as make_walk
from posecast.errors import ConfigError, DataError, SkeletonError
from posecast.geometry import quaternion
from posecast.motion import (
    Clip,
    Gait,
    analyse_gait,
    drop_joints,
    mirror,
    reproportion,
    resample,
    tracks,
    turn,
    with_gait,
)

CLIPS = (0, 1, 3, 6, 9)
"""A walk, a turn, a start and stop, a run and others."""


@pytest.fixture(params=CLIPS)
def clip(request: pytest.FixtureRequest) -> Clip:
    return make_walk(request.param, fps=30.0, seconds=7)


def same_gait(found: Gait, expected: dict[str, Tensor], atol: float = 1e-9) -> None:
    """All of it, phases up to whole turns."""
    assert set(expected) == set(Gait._fields)
    for name, values in expected.items():
        if name == "phase":
            gap = torch.remainder(found.phase - values + math.pi, 2 * math.pi) - math.pi
            assert gap.abs().max() < atol
        else:
            assert_close(getattr(found, name), values, atol=atol, rtol=0)


@pytest.mark.parametrize("angle", [0.4, math.pi, -2.5])
def test_turning_turns_what_lies_on_the_floor_and_nothing_else(clip: Clip, angle: float) -> None:
    same_gait(analyse_gait(turn(clip, angle)), dict(turn(with_gait(clip), angle).tracks))


def test_turning_keeps_all_numbers(clip: Clip) -> None:
    found, turned = analyse_gait(clip), analyse_gait(turn(clip, 1.1))
    for name in set(Gait._fields) - {"path", "movement", "facing"}:
        assert_close(getattr(found, name), getattr(turned, name), atol=1e-9, rtol=0)
    assert (found.movement - turned.movement).norm(dim=-1).min() > 0.5


def test_mirroring_exchanges_sides_in_the_tracks_as_in_the_motion(clip: Clip) -> None:
    same_gait(analyse_gait(mirror(clip)), dict(mirror(with_gait(clip)).tracks))


def test_mirroring_a_gait_is_what_it_says(clip: Clip) -> None:
    found, mirrored = analyse_gait(clip), analyse_gait(mirror(clip))
    assert torch.equal(mirrored.contacts, found.contacts[:, [1, 0]])
    assert_close(mirrored.lateral, -found.lateral)
    assert_close(mirrored.longitudinal, found.longitudinal)
    assert_close((mirrored.phase - found.phase).cos(), -torch.ones_like(found.phase))
    assert found.lateral.abs().max() > 0.005


@pytest.mark.parametrize("factor", [0.5, 1.7])
def test_scaling_the_body_scales_lengths_and_keeps_the_rest(clip: Clip, factor: float) -> None:
    bigger = reproportion(with_gait(clip), factor * clip.offsets, body="scaled")
    assert_close(bigger.root_positions, factor * clip.root_positions)
    found, expected = analyse_gait(bigger), dict(bigger.tracks)
    same_gait(found, expected)
    assert torch.equal(found.contacts, analyse_gait(clip).contacts)
    assert set(Gait._fields) > tracks.LENGTHS


@pytest.mark.parametrize("fps", [60.0, 120.0])
def test_another_frame_rate_shows_the_same_gait(fps: float) -> None:
    for index in CLIPS:
        fast = make_walk(index, fps=fps, seconds=7)
        slow, *_ = resample(with_gait(fast), 30)
        found = analyse_gait(slow)
        both = found.walking & slow.tracks["walking"]
        assert (found.walking == slow.tracks["walking"]).double().mean() > 0.97
        gap = torch.remainder(found.phase - slow.tracks["phase"] + math.pi, 2 * math.pi) - math.pi
        assert gap[both].abs().max() < 0.12
        assert (found.contacts == slow.tracks["contacts"]).double().mean() > 0.97
        assert (found.path - slow.tracks["path"]).norm(dim=-1).max() < 0.01
        assert (found.speed - slow.tracks["speed"]).abs().max() < 0.05


@pytest.mark.parametrize("start", [17, 40])
def test_a_later_start_shows_the_same_gait_away_from_the_ends(clip: Clip, start: int) -> None:
    whole, part = with_gait(clip).cut(start, clip.frames), analyse_gait(clip.cut(start, 210))
    inner = slice(45, None)
    assert torch.equal(part.contacts[8:], whole.tracks["contacts"][8:])
    gap = (part.phase - whole.tracks["phase"])[inner]
    assert (1 - gap.cos())[part.walking[inner]].abs().max() < 1e-9
    assert (part.path - whole.tracks["path"])[inner].norm(dim=-1).max() < 0.005
    assert_close(part.height, whole.tracks["height"])


def test_an_odd_ratio_of_frame_rates_keeps_directions_of_unit_length(clip: Clip) -> None:
    (slow,) = resample(with_gait(clip), 25)
    assert slow.tracks["walking"].dtype == torch.bool
    for track in ("movement", "facing"):
        length = slow.tracks[track].norm(dim=-1)
        assert_close(length, torch.ones_like(length))


def test_the_root_is_put_together_from_path_and_offsets(clip: Clip) -> None:
    found = analyse_gait(clip)
    left = torch.stack([found.movement[:, 1], -found.movement[:, 0]], dim=-1)
    root = found.path + found.longitudinal[:, None] * found.movement
    root = root + found.lateral[:, None] * left
    assert_close(root, clip.root_positions[:, [0, 2]], atol=1e-12, rtol=0)
    for unit in (found.movement, found.facing):
        assert_close(unit.norm(dim=-1), torch.ones(clip.frames, dtype=torch.float64))


def test_feet_take_turns_and_the_phase_never_goes_back(clip: Clip) -> None:
    found = analyse_gait(clip)
    assert found.phase.diff().min() >= 0
    assert found.phase[0] >= 0
    starts = (found.contacts[1:] & ~found.contacts[:-1]).nonzero()[:, 1]
    assert len(starts) > 5
    assert (starts.diff() != 0).all()


def test_before_the_first_and_after_the_last_change_the_phase_goes_on() -> None:
    clip = make_walk(0, fps=30.0, seconds=7)
    found = analyse_gait(clip)
    assert found.walking.all()
    rate = found.phase.diff() * 30
    assert rate[:3].min() > 0.8 * rate.median()
    assert rate[-3:].min() > 0.8 * rate.median()


def test_tracks_are_called_as_other_modules_know_them() -> None:
    names = [tracks.CONTACTS, tracks.PHASE, tracks.WALKING, tracks.STEP_RATE, tracks.PATH]
    names += [tracks.DISTANCE, tracks.SPEED, tracks.MOVEMENT, tracks.LONGITUDINAL]
    names += [tracks.LATERAL, tracks.HEIGHT, tracks.FACING]
    assert tuple(names) == Gait._fields


def test_tracks_have_the_precision_of_the_clip_and_others_stay() -> None:
    clip = make_walk(0, fps=30.0, seconds=3).to(torch.float32)
    clip = replace(clip, tracks={"mood": torch.zeros(clip.frames)})
    found = with_gait(clip).tracks
    assert set(found) == {*Gait._fields, "mood"}
    assert {values.dtype for values in found.values()} == {torch.float32, torch.bool}
    other = analyse_gait(clip)._replace(height=torch.full((clip.frames,), 2.0))
    assert_close(with_gait(clip, other).tracks["height"], torch.full((clip.frames,), 2.0))


# Where there is no gait


@pytest.mark.parametrize("frames", [1, 2, 5, 60])
def test_who_stands_still_has_no_gait_but_a_place(frames: int) -> None:
    walk = make_walk(0, fps=30.0, seconds=3)
    clip = replace(
        walk,
        root_positions=walk.root_positions[:1].expand(frames, 3),
        rotations_local=walk.rotations_local[:1].expand(frames, -1, -1),
        tracks={},
    )
    found = analyse_gait(clip)
    assert all(torch.isfinite(values).all() for values in found)
    assert not found.walking.any()
    assert found.contacts.all()
    for still in (found.step_rate, found.speed, found.distance, found.lateral):
        assert_close(still, torch.zeros(frames, dtype=torch.float64))
    assert_close(found.movement, found.facing)


def test_a_raised_foot_that_keeps_still_stands_on_nothing_but_uneven_ground() -> None:
    walk = make_walk(0, fps=30.0, seconds=3)
    rotations = walk.rotations_local[:1].expand(walk.frames, -1, -1).clone()
    axis = torch.tensor([1.0, 0.0, 0.0], dtype=torch.float64)
    bent = (torch.arange(walk.frames) > 45).double() * 1.2
    thigh = walk.skeleton.index("LeftUpLeg")
    rotations[:, thigh] = quaternion.product(
        quaternion.about_axis(axis, -bent), rotations[:, thigh]
    )
    still = walk.root_positions[:1].expand(walk.frames, 3)
    clip = replace(walk, rotations_local=rotations, root_positions=still)
    level, uneven = analyse_gait(clip).contacts, analyse_gait(clip, near=math.inf).contacts
    assert level[:40].all()
    assert level[:, 1].all()
    assert not level[50:, 0].any()
    assert uneven[50:].all()


def test_movement_is_held_while_standing() -> None:
    clip = make_walk(3, fps=30.0, seconds=7)
    assert clip.labels["action"] == "start-stop"
    found = analyse_gait(clip)
    resting = (found.speed < 0.05).nonzero().flatten()
    assert len(resting) > 30
    held = found.movement[resting]
    changes = (held[1:] - held[:-1])[resting.diff() == 1].norm(dim=-1)
    assert changes.max() < 1e-12


@pytest.mark.parametrize("facing", ["body", "root"])
def test_a_somersault_does_not_turn_the_facing(facing: Literal["body", "root"]) -> None:
    clip = make_walk(0, fps=30.0, seconds=4)
    pitch = torch.linspace(0, 2 * math.pi, clip.frames, dtype=torch.float64)
    axis = torch.tensor([1.0, 0.0, 0.0], dtype=torch.float64)
    still = clip.rotations_local[:1].expand(clip.frames, -1, -1).clone()
    still[:, 0] = quaternion.about_axis(axis, pitch)
    tumbling = analyse_gait(replace(clip, rotations_local=still), facing=facing).facing
    assert tumbling[:, 1].min() > 0.95, "shoulders are not quite square to the hips"


def test_who_twists_faces_between_hips_and_shoulders() -> None:
    clip = make_walk(0, fps=30.0, seconds=2)
    rotations = quaternion.identity(clip.frames, len(clip.skeleton), like=clip.rotations_local)
    up = torch.tensor([0.0, 1.0, 0.0], dtype=torch.float64)
    rotations[:, clip.skeleton.index("Spine")] = quaternion.about_axis(
        up, torch.tensor(0.8).double()
    )
    facing = analyse_gait(replace(clip, rotations_local=rotations)).facing
    expected = torch.tensor([[math.sin(0.4), math.cos(0.4)]], dtype=torch.float64)
    assert_close(facing, expected.expand(clip.frames, 2))


def test_lying_on_the_side_keeps_the_facing_from_before_to_after() -> None:
    clip = make_walk(0, fps=30.0, seconds=4)
    rotations = clip.rotations_local[:1].expand(clip.frames, -1, -1).clone()
    axis = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64)
    roll = torch.zeros(clip.frames, dtype=torch.float64)
    roll[50:70] = math.pi / 2
    rotations[:, 1:] = quaternion.identity(clip.frames, len(clip.skeleton) - 1, like=rotations)
    rotations[:, 0] = quaternion.about_axis(axis, roll)
    facing = analyse_gait(replace(clip, rotations_local=rotations)).facing
    assert_close(facing, torch.tensor([[0.0, 1.0]]).double().expand(clip.frames, 2))


def test_bones_that_move_are_followed() -> None:
    clip = make_walk(0, fps=30.0, seconds=4)
    pruned = drop_joints(clip, ["LeftLeg", "RightLeg"])
    assert pruned.translations_local is not None
    found, whole = analyse_gait(pruned), analyse_gait(clip)
    assert torch.equal(found.walking, whole.walking)
    assert (found.contacts == whole.contacts).double().mean() > 0.97


@pytest.mark.parametrize(
    ("error", "change", "options", "message"),
    [
        (ConfigError, {}, {"near": 0.0}, r"near is 0\.0; expected a positive number"),
        (ConfigError, {}, {"near": math.nan}, "near is nan"),
        (DataError, {"root_positions": "nan"}, {}, "root_positions has a value .* in row 4"),
        (SkeletonError, {"offsets": "zero"}, {}, r"have length 0\.0 m; expected a leg"),
    ],
)
def test_what_cannot_be_analysed_is_refused(
    error: type[Exception], change: dict[str, str], options: dict[str, object], message: str
) -> None:
    clip = make_walk(0, fps=30.0, seconds=1)
    broken: dict[str, Tensor] = {}
    if "root_positions" in change:
        broken["root_positions"] = clip.root_positions.clone()
        broken["root_positions"][4, 1] = math.nan
    if "offsets" in change:
        broken["offsets"] = 0 * clip.offsets
    analyse: Callable[..., Gait] = analyse_gait
    with pytest.raises(error, match=message):
        analyse(replace(clip, **broken), **options)  # type: ignore[arg-type]
