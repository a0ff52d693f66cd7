"""Motion matching: moments that are found again, courses that are followed, refusals."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import islice

import pytest
import torch

from posecast.corpora.synthetic import make_clip
from posecast.errors import ConfigError, SkeletonError
from posecast.generation import Course, MatchedWalk, MotionMatcher, Weights, timed, walked_clip
from posecast.generation.match_features import Features
from posecast.geometry import quaternion
from posecast.motion import Clip, turn, with_gait
from posecast.motion.path import Path
from posecast.motion.tracks import FACING, MOVEMENT, PATH, PHASE, SPEED, STEP_RATE
from posecast.skeleton import Skeleton
from posecast.skeleton.kinematics import joint_positions

FPS = 30
WALKS = (0, 1, 4, 6, 9, 11, 12, 16)
"""Clips of the synthetic corpus that walk, some of them around corners and along curves."""


@pytest.fixture(scope="module")
def clips() -> list[Clip]:
    return [with_gait(make_clip(index, fps=FPS, seconds=5)) for index in WALKS]


@pytest.fixture(scope="module")
def matcher(clips) -> MotionMatcher:
    return MotionMatcher(clips)


def course(waypoints: list[list[float]], *, speed: float = 1.1, straight: bool = False) -> Course:
    """Through way points at one speed, facing ahead."""
    path = Path.through(torch.tensor(waypoints).double(), straight=straight)
    path = path.with_scalar(SPEED, speed).with_scalar(STEP_RATE, 6.0)
    return timed(path.with_direction(FACING, path.tangents))


def astray(clip: Clip) -> torch.Tensor:
    """Metres from the root to where the course is in each frame."""
    return (clip.root_positions[:, [0, 2]] - clip.tracks[PATH]).norm(dim=-1)


def positions(clip: Clip) -> torch.Tensor:
    return joint_positions(clip.skeleton, clip.rotations_local, clip.offsets, clip.root_positions)


AHEAD = [[0.0, 0.0], [3.0, 8.0]]
LEFT = [[0.0, 0.0], [0.0, 4.0], [1.0, 6.0], [3.0, 7.0], [7.0, 7.0]]
RIGHT = [[-x, z] for x, z in LEFT]


@pytest.mark.parametrize("way", [AHEAD, LEFT, RIGHT], ids=["straight", "left", "right"])
def test_it_is_where_the_course_is_and_when(matcher, way):
    asked = course(way)
    clip = walked_clip(MatchedWalk(matcher, asked))
    assert clip.frames == math.floor(asked.duration * FPS) + 1
    aside = asked.path.distance_to(clip.root_positions[:, [0, 2]])
    assert aside.mean() < 0.06
    assert aside.max() < 0.15
    assert astray(clip).mean() < 0.12
    assert astray(clip).max() < 0.25


@pytest.mark.parametrize("way", [LEFT, RIGHT], ids=["left", "right"])
def test_without_a_pull_the_search_alone_follows_a_course(matcher, way):
    asked = course(way)
    clip = walked_clip(MatchedWalk(matcher, asked, pull=None))
    assert asked.path.distance_to(clip.root_positions[:, [0, 2]]).max() < 0.3
    assert astray(clip).max() < 0.6


def test_feet_slide_little_and_the_body_stands_on_them(matcher):
    clip = walked_clip(MatchedWalk(matcher, course(LEFT)))
    toes = positions(clip)[:, list(matcher.feet.toes)]
    speed = toes[..., [0, 2]].diff(dim=0).norm(dim=-1) * FPS
    lower = toes[1:, :, 1].argmin(dim=-1, keepdim=True)
    assert speed.gather(1, lower).mean() < 0.25
    assert toes[..., 1].min() > -0.03
    assert (toes[..., 1].amin(dim=-1) < 0.08).all()


def test_moments_are_found_again_wherever_they_are_and_whichever_way_they_face(clips, matcher):
    moved = [
        replace(
            clip,
            root_positions=clip.root_positions + torch.tensor([3.0, 0.0, -5.0]),
            tracks={**clip.tracks, PATH: clip.tracks[PATH] + torch.tensor([3.0, -5.0])},
        )
        for clip in clips
    ]
    elsewhere = MotionMatcher(
        [turn(clip, 0.5 + number) for number, clip in enumerate(moved)], mirrored=False
    )
    same = elsewhere.moments
    for found, expected in zip(elsewhere.features(same), matcher.features(same), strict=True):
        torch.testing.assert_close(found, expected)
    for moment in same[::97].tolist():
        query = Features(*(each[0] for each in elsewhere.features(torch.tensor([moment]))))
        assert matcher.match(query) == moment


def test_who_walks_sees_the_way_ahead_and_the_left_foot_to_the_left(clips):
    straight = MotionMatcher(clips[:1], mirrored=False)
    seen = straight.features(straight.moments)
    speed = clips[0].tracks[SPEED].mean()
    assert seen.path[..., 1].mean(0).tolist() == pytest.approx(
        [float(speed * steps / FPS) for steps in straight.ahead], rel=0.05
    )
    assert seen.path[..., 0].abs().max() < 0.1
    assert (seen.facing[..., 1] > 0.99).all()
    assert seen.feet[:, 0, 0].mean() > 0.03
    assert seen.feet[:, 1, 0].mean() < -0.03
    assert seen.root_velocity[:, 2].mean() == pytest.approx(float(speed), rel=0.05)
    assert seen.feet_velocity[..., 2].max() > 1.5 * speed


def test_a_walk_asks_for_the_course_ahead_and_for_its_own_feet(matcher):
    walk = MatchedWalk(matcher, course(AHEAD, speed=1.2))
    query, own = walk._query(), matcher.features(torch.tensor([walk.playing]))
    expected = torch.tensor([[0.0, 1.2 * steps / FPS] for steps in matcher.ahead]).double()
    torch.testing.assert_close(query.path, expected, rtol=0, atol=1e-6)
    torch.testing.assert_close(query.facing, torch.tensor([0.0, 1.0]).double().expand(3, 2))
    for name in ("feet", "feet_velocity", "root_velocity"):
        torch.testing.assert_close(getattr(query, name), getattr(own, name)[0])


def test_a_mirrored_corpus_holds_every_moment_twice(clips, matcher):
    plain = MotionMatcher(clips, mirrored=False)
    assert len(matcher.moments) == 2 * len(plain.moments)
    first = plain.features(plain.moments)
    second = matcher.features(matcher.moments[len(plain.moments) :])
    reflect = torch.tensor([-1.0, 1.0]).double()
    torch.testing.assert_close(second.path, first.path * reflect)
    torch.testing.assert_close(second.facing, first.facing * reflect)
    torch.testing.assert_close(second.root_velocity[:, 0], -first.root_velocity[:, 0])


def test_weights_say_what_counts(clips, matcher):
    moments = matcher.moments[[100, 711]]
    way, body = (Features(*(each[n] for each in matcher.features(moments))) for n in (0, 1))
    mixed = Features(way.path, way.facing, *body[2:])
    blind = MotionMatcher(clips, weights=Weights(feet=0, feet_velocity=0, root_velocity=0))
    lost = MotionMatcher(clips, weights=Weights(path=0, facing=0))
    assert [blind.match(mixed), lost.match(mixed)] == moments.tolist()


def walked(walk: MatchedWalk) -> tuple[torch.Tensor, list[int]]:
    """Places of all joints, and the frames of the database that played."""
    poses, frames = [], []
    for pose in walk:
        poses.append(pose)
        frames.append(walk.playing)
    rotations, roots = (torch.stack([pose[part] for pose in poses]) for part in (0, 1))
    return joint_positions(walk.skeleton, rotations, walk.offsets, roots), frames


def switches(frames: list[int]) -> list[int]:
    """Where another frame plays than the next one."""
    return [n for n in range(1, len(frames)) if frames[n] != frames[n - 1] + 1]


def test_nothing_jumps_where_another_clip_begins_to_play(matcher):
    """Nothing changes its velocity more than feet that strike and swing do anyway."""
    places, frames = walked(MatchedWalk(matcher, course(LEFT)))
    change = places.diff(n=2, dim=0).norm(dim=-1).mean(dim=-1)
    at = torch.tensor(switches(frames)[:-1])
    assert len(at) > 10
    # Velocities change at the frame before the switch, and at that of the switch.
    assert change[at - 2].mean() < 1.2 * change.mean()
    assert change[at - 1].mean() < 1.2 * change.mean()
    places, frames = walked(MatchedWalk(matcher, course(LEFT), half_life=1e-3))
    abrupt = places.diff(n=2, dim=0).norm(dim=-1).mean(dim=-1)
    assert abrupt[torch.tensor(switches(frames)[:-1]) - 1].mean() > 2 * change.mean()


def test_without_searches_clips_play_to_their_ends(matcher):
    straight = course([[0.0, 0.0], [0.0, 20.0]])
    walk = MatchedWalk(matcher, straight, search_every=100.0)
    _, frames = walked(walk)
    at = switches(frames)
    assert len(at) >= 3
    assert all(matcher.frames.ends[frames[n - 1] + 1] for n in at)
    assert astray(walked_clip(MatchedWalk(matcher, straight, search_every=100.0))).max() < 1.0


def test_who_is_off_is_pulled_back_in_the_time_given(matcher):
    asked = course(AHEAD)
    first, moved, turned = (
        MatchedWalk(matcher, asked, search_every=100.0, pull=0.5) for _ in range(3)
    )
    moved._place = moved._place + torch.tensor([0.2, 0.1]).double()
    turned._turn = turned._turn + 0.3
    poses = [list(islice(walk, 16)) for walk in (first, moved, turned)]
    apart = [
        float((b.root_position - a.root_position).norm()) for a, b, _ in zip(*poses, strict=True)
    ]
    assert apart[0] == pytest.approx(math.hypot(0.2, 0.1))
    assert apart[15] == pytest.approx(apart[0] / math.e)
    angle = [
        float(quaternion.angle(a.rotations_local[0], b.rotations_local[0]))
        for a, _, b in zip(*poses, strict=True)
    ]
    assert angle[0] == pytest.approx(0.3)
    assert angle[15] == pytest.approx(0.3 / math.e)


def test_of_moments_as_much_alike_the_one_that_plays_goes_on(clips):
    twice = MotionMatcher([clips[0], clips[0]], mirrored=False)
    first, second = twice.moments[[5, 5 + len(twice.moments) // 2]].tolist()
    query = Features(*(each[0] for each in twice.features(torch.tensor([second]))))
    assert twice.match(query) == first
    assert twice.match(query, playing=second) == second


def test_two_walks_are_the_same(matcher):
    first, second = (walked_clip(MatchedWalk(matcher, course(LEFT))) for _ in range(2))
    assert torch.equal(first.rotations_local, second.rotations_local)
    assert torch.equal(first.root_positions, second.root_positions)


def test_poses_say_where_the_course_is(matcher):
    asked = course(LEFT)
    pose = list(islice(MatchedWalk(matcher, asked), 50))[-1]
    place = asked.path.at(asked.distance(torch.tensor(pose.time).double()))
    torch.testing.assert_close(pose.tracks[PATH], place.position)
    torch.testing.assert_close(pose.tracks[MOVEMENT], place.tangent)
    assert float(pose.tracks[SPEED]) == pytest.approx(1.1)
    assert 0 <= float(pose.tracks[PHASE]) < 2 * math.pi


def test_a_walk_may_go_on_beyond_the_end(matcher):
    asked = course(AHEAD)
    clip = walked_clip(MatchedWalk(matcher, asked, lead=1.0))
    assert clip.frames == math.floor((asked.duration + 1) * FPS) + 1
    assert astray(clip).max() < 0.25


def test_only_clips_of_the_style_are_played(clips):
    styles = [clip.labels["style"] for clip in clips]
    chosen = [clip for clip in clips if clip.labels["style"] == styles[0]]
    assert 0 < len(chosen) < len(clips)
    found = MotionMatcher(clips, style=styles[0], mirrored=False)
    torch.testing.assert_close(
        found.frames.root_positions[: chosen[0].frames], chosen[0].root_positions
    )
    assert len(found.frames.ends) == sum(clip.frames for clip in chosen)
    with pytest.raises(ConfigError, match="no clip is of style 'prowd'"):
        MotionMatcher(clips, style="prowd")


def test_every_clip_walks_on_the_body_asked_for(clips):
    body = clips[3].offsets
    walk = MatchedWalk(MotionMatcher(clips, offsets=body), course(AHEAD))
    clip = walked_clip(walk, 1.0)
    torch.testing.assert_close(clip.offsets, body)
    length = clip.root_positions[:, 1].mean() / clips[3].root_positions[:, 1].mean()
    assert float(length) == pytest.approx(1, abs=0.03)


def test_clips_that_cannot_be_matched_are_refused(clips):
    with pytest.raises(ConfigError, match="no clips to match"):
        MotionMatcher([])
    short = [clip.cut(0, 20) for clip in clips]
    with pytest.raises(ConfigError, match=r"no clip is long enough .* 20 frames, expected 32"):
        MotionMatcher(short)
    assert len(MotionMatcher([*short, clips[0].cut(0, 32)], mirrored=False).moments) == 1
    with pytest.raises(
        ConfigError, match="has no track path and no facing; analyse its gait first"
    ):
        MotionMatcher([replace(clips[0], tracks={PHASE: clips[0].tracks[PHASE]})])
    with pytest.raises(ConfigError, match="15 frames per second"):
        MotionMatcher([clips[0], replace(clips[1], fps=15.0)])


def test_clips_of_another_skeleton_are_refused(clips):
    names = ("pelvis", *clips[1].skeleton.names[1:])
    other = replace(clips[1], skeleton=Skeleton(names, clips[1].skeleton.parents))
    with pytest.raises(SkeletonError, match="expected the same skeleton in all"):
        MotionMatcher([clips[0], other])


@pytest.mark.parametrize("name", ["search_every", "half_life", "pull"])
def test_times_are_positive(matcher, name):
    with pytest.raises(ConfigError, match=f"{name} is 0"):
        MatchedWalk(matcher, course(AHEAD), **{name: 0.0})


def test_rotations_are_unit(matcher):
    clip = walked_clip(MatchedWalk(matcher, course(LEFT)))
    norms = clip.rotations_local.norm(dim=-1)
    torch.testing.assert_close(norms, torch.ones_like(norms))
    turned = quaternion.angle(clip.rotations_local[1:], clip.rotations_local[:-1])
    assert turned.max() < 0.6
