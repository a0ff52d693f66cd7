"""Walking: where the root is, streams against clips, paths that grow, refusals."""

from __future__ import annotations

import math
from itertools import islice

import pytest
import torch
from tests.generation.conftest import OFFSETS, SKELETON

from posecast.errors import ConfigError
from posecast.generation import Walk, arriving, pace_by_hand, walked_clip
from posecast.generation.walk import RUN_UP
from posecast.geometry import quaternion
from posecast.motion.tracks import MOVEMENT, PATH, PHASE, SPEED, left_of
from posecast.representation import Codec, Quaternion


def test_a_walk_has_a_frame_for_every_moment_of_its_course(make_walk):
    walk = make_walk()
    clip = walked_clip(walk)
    assert clip.frames == math.floor(walk.course.duration * 30) + 1
    assert clip.fps == 30
    assert clip.skeleton == SKELETON
    torch.testing.assert_close(clip.offsets, OFFSETS.double())
    norms = clip.rotations_local.norm(dim=-1)
    torch.testing.assert_close(norms, torch.ones_like(norms))


def test_the_root_is_where_the_course_is_but_for_what_the_network_says(make_walk):
    walk = make_walk(renew=None)
    codec = walk.forecaster.codec
    for frame in range(60):
        said = codec.split(walk._memories[0].expected[0, -1].double()).root
        pose = next(walk)
        time = torch.tensor([frame / 30]).double()
        place = walk.course.path.at(walk.course.distance(time))
        torch.testing.assert_close(pose.tracks[PATH], place.position[0])
        torch.testing.assert_close(pose.tracks[MOVEMENT], place.tangent[0])
        floor = place.position[0] + said[0] * place.tangent[0] + said[2] * left_of(place.tangent[0])
        torch.testing.assert_close(pose.root_position[[0, 2]], floor)
        torch.testing.assert_close(pose.root_position[1], said[1])
        assert pose.time == pytest.approx(frame / 30)


def test_the_phase_grows_by_the_step_rate(make_walk, bend, table):
    walk = make_walk(pace_by_hand(bend, table, speed=1.0, slow_in_curves=False))
    phases = [float(pose.tracks[PHASE]) for pose in islice(walk, 30)]
    start = 6.0 * RUN_UP
    expected = [math.remainder(start + 6.0 * frame / 30, math.tau) for frame in range(30)]
    found = [math.remainder(phase, math.tau) for phase in phases]
    assert found == pytest.approx(expected, abs=1e-9)


def test_a_stream_and_a_clip_are_the_same_walk(make_walk):
    clip, stream = walked_clip(make_walk(), 2.0), list(islice(make_walk(), 60))
    assert clip.frames == 60
    streamed = torch.stack([pose.rotations_local for pose in stream])
    assert quaternion.angle(clip.rotations_local, streamed).max() < 1e-6
    roots = torch.stack([pose.root_position for pose in stream])
    torch.testing.assert_close(clip.root_positions, roots, rtol=0, atol=0)


def test_others_may_step_in_the_network_s_place(make_walk, forecaster):
    calls = []

    class Counting:
        feedback = "valid"
        initial_state = forecaster.initial_state

        def __call__(self, features, state, controls=None, *, last=None, generator=None):
            calls.append(features.shape[1])
            return forecaster(features, state, controls, last=last, generator=generator)

    own, others = walked_clip(make_walk(), 1.0), walked_clip(make_walk(stepper=Counting()), 1.0)
    assert torch.equal(own.rotations_local, others.rotations_local)
    # The run-up, the frames, and one that was predicted but not shown.
    assert calls == [1] * (30 + 30 + 1)


def test_what_was_walked_does_not_change_when_the_path_goes_on(make_walk, bend, table):
    def paced(path):
        return pace_by_hand(path, table, speed=1.0, slow_in_curves=False)

    longer = bend.extend(torch.tensor([[8.0, 4.0]]).double(), straight=True)
    short, whole = make_walk(paced(bend)), make_walk(paced(longer))
    first = list(islice(short, 90))
    short.extend(paced(longer))
    rest = list(short)
    every = list(whole)
    assert len(first) + len(rest) == len(every)
    for found, expected in zip([*first, *rest], every, strict=True):
        torch.testing.assert_close(found.root_position, expected.root_position)


def test_a_path_cannot_be_moved_from_under_the_walker(make_walk, circle, table):
    walk = make_walk()
    next(walk)
    with pytest.raises(ConfigError, match="away from the walker; extend the path ahead of it only"):
        walk.extend(pace_by_hand(circle, table))


def test_times_of_arrival_are_kept_to_the_frame(make_walk, bend, table):
    course = arriving(pace_by_hand(bend, table, speed=1.0), table, {4.0: 5.0, 8.0: 10.0})
    clip = walked_clip(make_walk(course))
    places = torch.tensor([4.0, 8.0]).double()
    expected = course.path.at(places).position
    torch.testing.assert_close(clip.tracks[PATH][[150, 300]], expected)


def test_a_closed_path_is_walked_for_as_long_as_asked(make_walk, circle, table):
    walk = make_walk(pace_by_hand(circle, table, speed=2.0))
    with pytest.raises(ConfigError, match="no end; say how many seconds"):
        walked_clip(walk)
    assert walked_clip(walk, 9.0).frames == 270


def test_a_walk_may_go_on_beyond_the_end(make_walk):
    walk = make_walk(lead=1.0)
    clip = walked_clip(walk)
    assert clip.frames == math.floor((walk.course.duration + 1) * 30) + 1
    far = clip.tracks[PATH][-1] - torch.tensor([4.0, 4.0]).double()
    speed = clip.tracks[SPEED][-1]
    assert far[0] == pytest.approx(float(speed), abs=0.05)
    assert far[1] == pytest.approx(0, abs=0.02)


def test_styles_walk_differently(make_walk):
    calm, wild = (walked_clip(make_walk(style=style), 1.0) for style in (0, 1))
    assert quaternion.angle(calm.rotations_local, wild.rotations_local).max() > 1e-3
    with pytest.raises(ConfigError, match="style 2: this walker has 2"):
        make_walk(style=2)


def test_a_walk_does_not_change_with_the_global_seed_or_the_mode(make_walk):
    torch.manual_seed(1)
    first = walked_clip(make_walk(), 1.0)
    torch.manual_seed(2)
    second = walked_clip(make_walk(), 1.0)
    assert torch.equal(first.rotations_local, second.rotations_local)


def test_a_network_that_follows_no_path_does_not_walk(make_walk, forecaster, table):
    walk = make_walk()
    forecaster.codec = Codec(SKELETON, Quaternion())
    with pytest.raises(ConfigError, match="does not walk along paths"):
        Walk(forecaster, walk.course, table, OFFSETS, fps=30.0)
