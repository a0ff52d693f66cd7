"""The corpus as a whole, and whether the tracks of its clips tell the truth."""

from __future__ import annotations

import math
from collections import Counter
from itertools import pairwise

import numpy as np
import pytest
import torch
from torch import Tensor

from posecast.corpora.gait.body import CAST, SKELETON
from posecast.corpora.gait.manner import STYLES
from posecast.corpora.gait.repertoire import REPERTOIRE, reserved_style
from posecast.corpora.synthetic import make_clip, split_of, synthetic
from posecast.errors import ConfigError
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


def world(clip: Clip) -> World:
    return forward_kinematics(
        clip.skeleton, clip.rotations_local, clip.offsets, clip.root_positions
    )


def joints(clip: Clip, joint: str) -> Tensor:
    """World positions of the left and the right one of a pair: (frames, 2, 3)."""
    return world(clip).positions[:, [SKELETON.index(side + joint) for side in SIDES]]


def onsets(clip: Clip) -> list[tuple[int, int]]:
    """(frame, side) where a foot comes into contact; side 0 is the left one."""
    contacts = clip.tracks["contacts"]
    starts = contacts[1:] & ~contacts[:-1]
    return [(int(frame) + 1, int(side)) for frame, side in starts.nonzero()]


# The corpus as a whole


def test_the_default_corpus_shows_everything_in_every_split(corpus):
    assert len(corpus.clips) == 72
    assert [len(corpus.splits[name]) for name in ("train", "validation", "test")] == [48, 12, 12]
    assert sorted(sum(corpus.splits.values(), ())) == list(range(72))
    for name in corpus.splits:
        found = Counter(clip.labels["action"] for clip in corpus.split(name))
        assert set(found) == {act.action for act in REPERTOIRE}
    training = corpus.split("train")
    assert min(Counter(clip.labels["body"] for clip in training).values()) >= 3
    assert min(Counter(clip.labels["style"] for clip in training).values()) >= 3
    assert {clip.labels["body"] for clip in training} == {body.name for body in CAST}
    assert {clip.labels["style"] for clip in training} == set(STYLES)
    assert {clip.labels["path"] for clip in training} >= {"straight", "arc", "eight", "corners"}
    assert all(6 <= clip.duration <= 12 for clip in corpus.clips)


def test_some_pairs_of_body_and_style_are_for_testing_only(corpus):
    reserved = {
        (body.name, reserved_style(subject))
        for subject, body in enumerate(CAST)
        if reserved_style(subject) is not None
    }
    assert len(reserved) == 6

    def shown(split: str) -> set[tuple[str, str]]:
        return {(clip.labels["body"], clip.labels["style"]) for clip in corpus.split(split)}

    assert not reserved & (shown("train") | shown("validation"))
    assert len(reserved & shown("test")) >= 3
    assert len(shown("test") - reserved) >= 3


def test_small_corpora_have_all_splits():
    splits = Counter(split_of(index) for index in range(6))
    assert splits == {"train": 4, "validation": 1, "test": 1}


def test_a_run_repeats_to_the_byte_and_more_clips_change_none_before(corpus):
    again = synthetic(clips=7)
    assert len(again.clips) == 7
    for clip, twin in zip(corpus.clips, again.clips, strict=False):
        assert clip.name == twin.name
        assert torch.equal(clip.root_positions, twin.root_positions)
        assert torch.equal(clip.rotations_local, twin.rotations_local)
        assert clip.tracks.keys() == twin.tracks.keys()
        assert all(torch.equal(clip.tracks[track], twin.tracks[track]) for track in clip.tracks)


def test_another_seed_gives_another_corpus(corpus):
    other = make_clip(0, seed=1, seconds=corpus.clips[0].duration)
    assert other.frames == corpus.clips[0].frames
    assert (other.root_positions - corpus.clips[0].root_positions).abs().max() > 0.1


@pytest.mark.parametrize("fps", [25, 100.0, 120.0])
@pytest.mark.parametrize("index", [0, 3, 5, 8])
def test_every_frame_rate_samples_the_same_movement(fps, index):
    slow, fast = (make_clip(index, fps=rate, seconds=6) for rate in (5, fps))
    ratio = int(fps // 5)
    assert (slow.frames, fast.frames) == (30, 30 * ratio)
    torch.testing.assert_close(fast.root_positions[::ratio], slow.root_positions)
    angles = quaternion.angle(fast.rotations_local[::ratio], slow.rotations_local)
    assert angles.max() < 1e-6
    for track, values in slow.tracks.items():
        torch.testing.assert_close(fast.tracks[track][::ratio], values)


@pytest.mark.parametrize(
    ("options", "found"),
    [
        ({"fps": 0}, "0 frames per second"),
        ({"seconds": -1.0}, "clips of -1.0 seconds"),
        ({"seconds": 0.001}, "at least one frame"),
        ({"seed": -3}, "seed -3"),
        ({"clips": 5}, "5 clips; at least 6"),
    ],
)
def test_impossible_requests_are_refused(options, found):
    with pytest.raises(ConfigError, match=found):
        synthetic(**options)


@pytest.mark.parametrize("seconds", [0.02, 1, 3])
def test_clips_may_be_short(seconds):
    for index in range(len(REPERTOIRE)):
        clip = make_clip(index, seconds=seconds)
        assert clip.frames == round(50 * seconds)
        assert torch.isfinite(clip.rotations_local).all()


# Tracks


def test_contacts_alternate_and_phase_counts_them(clips):
    for clip in clips:
        phase, starts = clip.tracks["phase"], onsets(clip)
        assert len(starts) >= 6
        assert all(a != b for (_, a), (_, b) in pairwise(starts))
        assert (phase.diff() >= 0).all()
        slope = phase.diff().max()
        for frame, side in starts:
            touchdown = math.pi if side == 0 else 0.0
            since = (float(phase[frame]) - touchdown) % (2 * math.pi)
            assert since < 0.65 + slope, "the foot is flat soon after it touches down"
        total = float(phase[starts[-1][0]] - phase[starts[0][0]])
        assert round(total / math.pi) == len(starts) - 1


def detected_phase(clip: Clip) -> np.ndarray:
    """Switches of contact by the speeds of the ankles, as protocols.md e.2 words it; 30 Hz."""
    speeds = joints(clip, "Foot").diff(dim=0).norm(dim=-1).numpy() / 0.0564444
    left = speeds[0, 0] < speeds[0, 1]
    switches, values, frame = [0], [math.pi if left else 0.0], 3
    while frame < len(speeds):
        now, other = speeds[frame, 0 if left else 1], speeds[frame, 1 if left else 0]
        if now > other + 0.1:
            left = not left
            switches.append(frame)
            values.append(values[-1] + math.pi)
            frame += 3
        frame += 1
    return np.interp(np.arange(clip.frames), switches, values)


@pytest.mark.parametrize("index", [0, 2, 4, 5, 7, 9, 10])
def test_phase_agrees_with_what_ankle_speeds_say(index):
    clip = make_clip(index, fps=30.0)
    middle = slice(30, clip.frames - 30)
    difference = clip.tracks["phase"].numpy()[middle] - detected_phase(clip)[middle]
    rest = np.angle(np.exp(1j * difference))
    assert np.abs(rest.mean()) < 0.5
    assert np.abs(rest).max() < 1.2


def test_speed_path_and_facing_describe_the_hips(clips):
    for clip in clips:
        floor = clip.root_positions[:, [0, 2]]
        assert (floor - clip.tracks["path"]).norm(dim=-1).max() < 0.08
        along = clip.tracks["path"].diff(dim=0).norm(dim=-1) * clip.fps
        torch.testing.assert_close(along, clip.tracks["speed"][:-1], rtol=0, atol=0.12)
        facing = clip.tracks["facing"]
        torch.testing.assert_close(facing.norm(dim=-1), torch.ones(clip.frames).double())
        ahead = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64).expand(clip.frames, 3)
        hips = quaternion.rotate(clip.rotations_local[:, 0], ahead)[:, [0, 2]]
        assert torch.cosine_similarity(hips, facing, dim=-1).min() > math.cos(math.radians(20))


def test_gaits_have_human_speeds_and_step_rates(clips):
    """Speed over the square root of gravity times leg length: walking below 0.7, running above."""
    for clip in clips:
        body = next(body for body in CAST if body.name == clip.labels["body"])
        unit = math.sqrt(9.81 * body.leg)
        froude = float(clip.tracks["speed"].median()) / unit
        frames = [frame for frame, _ in onsets(clip)]
        rate = float(np.median(60 * clip.fps / np.diff(frames))) * math.sqrt(body.size)
        if clip.labels["action"] in ("walk", "turn"):
            assert 0.2 < froude < 0.6
            assert 80 < rate < 140
        elif clip.labels["gait"] == "jog":
            assert 0.6 < froude < 1.0
            assert 145 < rate < 185
        elif clip.labels["gait"] == "run":
            assert 0.9 < froude < 1.5
            assert 155 < rate < 205


def test_who_stands_stands_still(corpus):
    starting = [clip for clip in corpus.clips if clip.labels["action"] == "start-stop"]
    assert len(starting) == 6
    for clip in starting:
        standing = clip.tracks["speed"] == 0
        assert standing[0]
        assert standing[-1]
        assert 0.1 < standing.double().mean() < 0.7
        assert clip.tracks["contacts"][0].all()
        assert clip.tracks["contacts"][-1].all()
        final = clip.root_positions[-10:]
        assert (final.diff(dim=0).norm(dim=-1) * clip.fps).max() < 0.05


def test_corners_are_taken_slowly_and_with_the_head_first(corpus):
    cornering = [clip for clip in corpus.clips if clip.labels["path"] == "corners"]
    assert len(cornering) >= 4
    slowing, leading = [], []
    for clip in cornering:
        facing = torch.atan2(*clip.tracks["facing"].unbind(-1))
        rate = torch.atan2(facing.diff().sin(), facing.diff().cos()) * clip.fps
        turning, speed = rate.abs() > 0.5 * rate.abs().max(), clip.tracks["speed"][1:]
        assert rate.abs().max() > 0.6
        slowing.append(float(speed[turning].mean() / speed.max()))
        turned = world(clip).rotations[1:]
        hips, head = turned[:, SKELETON.index("Hips")], turned[:, SKELETON.index("Head")]
        ahead = quaternion.product(quaternion.conjugate(hips), head)
        yaw = 2 * torch.atan2(ahead[:, 2], ahead[:, 0])
        leading.append(float((yaw * rate.sign())[turning].mean()))
    assert np.mean(slowing) < 0.85
    assert np.mean(leading) > math.radians(5)
