"""The path of a clip: hips sway about it, and it still turns where they turned."""

import math
from dataclasses import replace

import pytest
import torch

from posecast.corpora import build_corpus
from posecast.corpora.synthetic import make_clip
from posecast.errors import ConfigError, DataError
from posecast.motion import Clip, path_of, turn
from posecast.skeleton import Skeleton

FPS = 60.0


def clip_of(places):
    """A clip of one joint at some places of the floor."""
    frames = len(places)
    rotations = torch.tensor([1.0, 0, 0, 0], dtype=torch.float64).expand(frames, 1, 4)
    height = torch.ones(frames, dtype=torch.float64)
    return Clip(
        skeleton=Skeleton(("Hips",), (-1,)),
        offsets=torch.zeros(1, 3, dtype=torch.float64),
        fps=FPS,
        root_positions=torch.stack([places[:, 0], height, places[:, 1]], dim=-1),
        rotations_local=rotations,
        name="made",
    )


def swaying(speed, steps_a_second, *, seconds=10.0):
    """Straight ahead along +z, with 3 cm of sway and 4 cm of surge."""
    time = torch.arange(int(seconds * FPS), dtype=torch.float64) / FPS
    step = 2 * math.pi * steps_a_second * time
    sway, surge = 0.03 * (step / 2).sin(), 0.04 * step.cos()
    return clip_of(torch.stack([sway, speed * time + surge], dim=-1))


def test_hips_that_sway_at_1_8_steps_a_second_leave_8_per_cent_in_the_path():
    clip = swaying(1.3, 1.8)
    path = path_of(clip)
    inside = path.at(path.marks[120:-120])  # the ends, where little is known, aside
    assert 0.07 * 0.03 < float(inside.position[:, 0].abs().max()) < 0.082 * 0.03
    speed = path.marks[120:-120].diff() * FPS
    torch.testing.assert_close(speed, torch.full_like(speed, 1.3), rtol=1e-2, atol=0)


def test_without_a_low_pass_the_path_goes_where_the_root_went():
    clip = swaying(1.3, 1.8)
    path = path_of(clip, low_pass=0)
    places = clip.root_positions[:, [0, 2]]
    assert float(path.distance_to(places).max()) < 1e-3
    torch.testing.assert_close(path.marks[1:], places.diff(dim=0).norm(dim=-1).cumsum(0))


def test_a_bend_keeps_its_radius_within_one_per_cent():
    angle = 1.3 / 1.5 * torch.arange(600, dtype=torch.float64) / FPS
    path = path_of(clip_of(1.5 * torch.stack([angle.cos(), angle.sin()], dim=-1)))
    middle = path.points[len(path.points) // 4 : -len(path.points) // 4]
    torch.testing.assert_close(
        middle.norm(dim=-1), torch.full((len(middle),), 1.5).double(), rtol=1e-2, atol=0
    )


def test_the_path_of_a_turned_clip_is_the_path_turned():
    clip = make_clip(1, fps=30.0)
    path, turned = path_of(clip), path_of(turn(clip, 0.8))
    sine, cosine = math.sin(0.8), math.cos(0.8)
    matrix = torch.tensor([[cosine, -sine], [sine, cosine]], dtype=torch.float64)
    torch.testing.assert_close(turned.points, path.points @ matrix, rtol=0, atol=1e-6)
    torch.testing.assert_close(turned.marks, path.marks, rtol=0, atol=1e-6)


def test_the_path_of_a_generated_clip_is_nearer_to_the_one_it_followed_than_its_hips_are():
    corpus = build_corpus("synthetic", fps=30.0, clips=24)
    assert len(corpus.clips) == 24
    for clip in corpus.clips:
        path = path_of(clip)
        followed = clip.tracks["path"].double()
        assert float(path.distance_to(followed).mean()) < 0.022
        assert float(path.distance_to(followed).mean()) < float(
            (clip.root_positions[:, [0, 2]] - followed).norm(dim=-1).mean()
        )
        assert len(path.marks) == clip.frames
        assert path.marks[-1] == pytest.approx(path.length)


def test_a_track_of_the_clip_becomes_one_of_its_path():
    clip = make_clip(0, fps=30.0, seconds=6.0)
    path = path_of(clip)
    path = path.with_scalar("speed", clip.tracks["speed"], at=path.marks)
    path = path.with_direction("facing", clip.tracks["facing"], at=path.marks)
    frame = 90
    there = path.marks[frame]
    assert float(path.scalar("speed", there)) == pytest.approx(
        float(clip.tracks["speed"][frame]), abs=0.02
    )
    torch.testing.assert_close(
        path.direction("facing", there), clip.tracks["facing"][frame].double(), rtol=0, atol=0.02
    )


def test_a_root_with_an_offset_of_its_own_is_where_both_together_are():
    clip = swaying(1.3, 1.8)
    aside = replace(clip, offsets=torch.tensor([[2.0, 5.0, -1.0]], dtype=torch.float64))
    torch.testing.assert_close(
        path_of(aside).points, path_of(clip).points + torch.tensor([2.0, -1.0])
    )
    moved = replace(aside, translations_local=torch.zeros(clip.frames, 1, 3).double())
    torch.testing.assert_close(path_of(moved).points, path_of(clip).points)


def test_a_clip_that_goes_nowhere_is_refused():
    still = clip_of(torch.zeros(50, 2, dtype=torch.float64))
    with pytest.raises(DataError) as caught:
        path_of(still)
    assert str(caught.value) == (
        "made: root 'Hips' stands still, expected one that goes somewhere; if it is above one that "
        "does, fold it away with drop_joints"
    )
    places = torch.zeros(50, 2, dtype=torch.float64)
    places[7] = float("nan")
    with pytest.raises(DataError, match="made: root position 8 of 50 is"):
        path_of(clip_of(places))
    with pytest.raises(ConfigError, match="low_pass is -1: expected 0 seconds or more"):
        path_of(still, low_pass=-1)


@pytest.mark.data
def test_people_who_walk_straight_leave_straight_paths(data_root):
    """Sway turns the way of the hips to and fro by some 25 degrees a metre."""
    corpus = build_corpus("bandai-locomotion", root=data_root / "bandai-locomotion")
    clips = [clip for clip in corpus.clips if clip.labels["content"] == "walk"][::9]
    assert len(clips) == 15

    def waggling(path):
        turns = path.curvatures * path.spacing
        return math.degrees(float(turns.abs().sum() - turns.sum().abs())) / path.length

    steady = torch.tensor([waggling(path_of(clip)) for clip in clips])
    swaying = torch.tensor([waggling(path_of(clip, low_pass=0)) for clip in clips])
    assert float(swaying.median()) > 15
    assert float(steady.median()) < 3
    assert bool((steady < 0.5 * swaying).all())
