"""Memories that relieve each other: when, how, and that a walk does not know north from south."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch
from tests.generation.conftest import OFFSETS

from posecast.errors import ConfigError
from posecast.generation import pace_by_hand, relay, walked_clip
from posecast.geometry import quaternion
from posecast.motion.path import Path
from posecast.motion.tracks import FACING, MOVEMENT, PHASE, turned_on_floor

BEND = torch.tensor([[0.0, 0.0], [0.0, 4.0], [4.0, 4.0]]).double()
QUARTER = math.pi / 2


def walk_along(make_walk, table, points, **options):
    path = Path.through(points, straight=True, spacing=0.02)
    return make_walk(pace_by_hand(path, table, speed=1.0), **options)


@pytest.mark.parametrize("renew", [relay.RENEW, None])
@pytest.mark.parametrize("angle", [QUARTER, -2.0, math.pi])
def test_a_walk_along_a_turned_path_is_the_walk_turned(make_walk, table, renew, angle):
    plain = walked_clip(walk_along(make_walk, table, BEND, renew=renew))
    other = walked_clip(walk_along(make_walk, table, turned_on_floor(BEND, angle), renew=renew))
    about = quaternion.about_axis(torch.tensor([0.0, 1.0, 0.0]), torch.tensor(angle)).double()
    root = quaternion.product(about.expand(plain.frames, 4), plain.rotations_local[:, 0])
    assert quaternion.angle(root, other.rotations_local[:, 0]).max() < 1e-4
    rest = quaternion.angle(plain.rotations_local[:, 1:], other.rotations_local[:, 1:])
    assert rest.max() < 1e-4
    floor = turned_on_floor(plain.root_positions[:, [0, 2]], angle)
    torch.testing.assert_close(floor, other.root_positions[:, [0, 2]], rtol=0, atol=1e-4)


def test_a_memory_is_relieved_where_a_step_begins(make_walk, table):
    walk = walk_along(make_walk, table, BEND)
    ages, begun = [], []
    for pose in walk:
        ages.append(max(memory.age for memory in walk._memories))
        if walk._memories[-1].age == 1:
            begun.append(float(pose.tracks[PHASE]))
    warm, whole = (relay.WARM + relay.FADE) * 30, relay.RENEW * 30
    cycle = 30 * math.tau / 6  # frames, at 6 radians a second
    assert len(begun) >= 3
    assert max(begun) < 6 / 30  # the phase has just gone round
    assert warm <= max(ages) <= whole + cycle + 1


def test_no_memory_is_relieved_if_none_is_to_be(make_walk, table):
    walk = walk_along(make_walk, table, BEND, renew=None)
    frames = sum(1 for _ in walk)
    assert [memory.age for memory in walk._memories] == [frames + 30]


def test_a_new_memory_is_seen_little_by_little(make_walk, table):
    walk = walk_along(make_walk, table, BEND)
    while len(walk._memories) < 2:
        next(walk)
    old, new = walk._memories
    tracks, codec = walk._tracks(walk.frame), walk.forecaster.codec

    def seen(*memories):
        return relay.expected(codec, memories, tracks, offsets=OFFSETS, fps=30.0)

    for seconds, share in ((0.0, 0), (relay.WARM, 0), (relay.WARM + relay.FADE / 2, 0.5), (1.1, 1)):
        both = seen(old, replace(new, age=round(30 * seconds)))
        positions = [each.root_positions for each in (seen(old), seen(new))]
        torch.testing.assert_close(both.root_positions, torch.lerp(*positions, share))
        ways = [
            quaternion.angle(both.rotations_local, each.rotations_local)
            for each in (seen(old), seen(new))
        ]
        whole = quaternion.angle(seen(old).rotations_local, seen(new).rotations_local)
        assert whole.max() > 0.01
        torch.testing.assert_close(ways[0] + ways[1], whole, rtol=1e-4, atol=1e-5)
        torch.testing.assert_close(ways[0], share * whole, rtol=1e-4, atol=1e-5)


def test_both_memories_step_as_each_would_alone(make_walk, table):
    walk = walk_along(make_walk, table, BEND)
    while len(walk._memories) < 2:
        next(walk)
    tracks, codec = walk._tracks(walk.frame), walk.forecaster.codec
    alone = [replace(memory) for memory in walk._memories]
    with torch.inference_mode():
        for memory in alone:
            relay.advance(walk.forecaster, codec, [memory], tracks)
        relay.advance(walk.forecaster, codec, walk._memories, tracks)
    for one, other in zip(alone, walk._memories, strict=True):
        assert one.age == other.age
        torch.testing.assert_close(one.expected, other.expected)
        torch.testing.assert_close(one.state, other.state)


def test_a_memory_begins_ahead_of_itself(make_walk, table):
    walk = walk_along(make_walk, table, turned_on_floor(BEND, QUARTER))
    tracks = walk._tracks(0)
    memory = relay.begin(walk.forecaster, walk._start, tracks)
    for name in (MOVEMENT, FACING):
        ahead = turned_on_floor(tracks[name], memory.turn)
        torch.testing.assert_close(ahead, torch.tensor([[[0.0, 1.0]]]).double())


@pytest.mark.parametrize("renew", [0.5, -1.0, math.nan])
def test_memories_have_time_to_warm_up(make_walk, table, renew):
    with pytest.raises(ConfigError, match="expected 1 s or more"):
        walk_along(make_walk, table, BEND, renew=renew)
