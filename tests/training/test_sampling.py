"""Windows: every recording is seen, shares make up the batch, augmentation is exact."""

from __future__ import annotations

import math
from collections import Counter

import pytest
import torch

from posecast.errors import ConfigError
from posecast.motion import Clip, Motion
from posecast.motion.corpus import Corpus
from posecast.skeleton import Skeleton
from posecast.skeleton.kinematics import joint_positions
from posecast.training import augmentation
from posecast.training.sampling import SAMPLINGS, EveryRecording, RandomRecordings, Windows

LENGTH = 12


@pytest.fixture
def corpus(tiny):
    return tiny.tiny_corpus((40, 30, 55, 11, 12))


def make(corpus, **changes):
    return Windows(corpus, **{"length": LENGTH, "batch": 3, "seed": 1, **changes})


def world(motion: Motion, skeleton: Skeleton):
    return joint_positions(
        skeleton, motion.rotations_local, motion.offsets[:, None], motion.root_positions
    )


def test_there_are_two_ways_to_sample():
    assert set(SAMPLINGS) == {"every_recording", "random_recordings"}


@pytest.mark.parametrize("chunks", [1, 3])
@pytest.mark.parametrize("epoch", [0, 5])
def test_every_recording_that_is_long_enough_is_seen_equally_often(corpus, chunks, epoch):
    windows = make(corpus, sampling=EveryRecording(chunks))
    seen = Counter(window.clip for window in windows.windows(epoch))
    assert seen == {0: chunks, 1: chunks, 2: chunks, 4: chunks}
    assert windows.skipped == 1
    assert windows.steps == math.ceil(4 * chunks / 3)


@pytest.mark.parametrize("kind", SAMPLINGS)
def test_an_epoch_is_the_same_again_and_another_epoch_differs(kind, corpus):
    sampling = SAMPLINGS[kind]()
    first, again = (make(corpus, sampling=sampling) for _ in range(2))
    epochs = [first.windows(epoch) for epoch in range(4)]
    assert [again.windows(epoch) for epoch in (3, 1, 0)] == [epochs[3], epochs[1], epochs[0]]
    assert len({tuple(windows) for windows in epochs}) == 4
    assert make(corpus, sampling=sampling, seed=2).windows(0) != epochs[0]


@pytest.mark.parametrize("kind", SAMPLINGS)
def test_first_frames_are_uniform_over_all_that_fit(kind, corpus):
    windows = make(corpus, sampling=SAMPLINGS[kind]())
    starts = Counter(
        window.start
        for epoch in range(600)
        for window in windows.windows(epoch)
        if window.clip == 1
    )
    assert set(starts) == set(range(30 - LENGTH + 1))
    expected = starts.total() / len(starts)
    # Chi squared with 18 degrees of freedom stays below 42.3 in 999 of 1000 cases.
    assert sum((count - expected) ** 2 / expected for count in starts.values()) < 42.3


def test_windows_stay_within_what_is_not_skipped(corpus):
    windows = make(corpus, skip_start=5, skip_end=9, batch=100, sampling=RandomRecordings())
    assert windows.skipped == 2  # of 11 and 12 frames nothing is left for a window
    starts: dict[int, set[int]] = {}
    for epoch in range(60):
        for window in windows.windows(epoch):
            starts.setdefault(window.clip, set()).add(window.start)
    assert starts == {
        clip: set(range(5, frames - 9 - LENGTH + 1)) for clip, frames in ((0, 40), (1, 30), (2, 55))
    }


def test_nothing_left_but_what_is_skipped_is_refused(corpus):
    with pytest.raises(
        ConfigError, match=r"the longest of 5 has 5 beside the 50 .*: shorten .*, or skip fewer"
    ):
        make(corpus, skip_start=50)
    with pytest.raises(ConfigError, match="the longest of 5 has 0 beside the 100 that are skip"):
        make(corpus, skip_end=100)


def test_recordings_are_drawn_in_proportion_to_their_length_or_alike(corpus):
    for weight, share in (("length", 55 / 137), ("equal", 1 / 4)):
        windows = make(corpus, sampling=RandomRecordings(4000, weight=weight))
        assert windows.steps == 4000
        drawn = windows.windows(0)
        assert len(drawn) == 12_000
        found = sum(window.clip == 2 for window in drawn) / len(drawn)
        assert found == pytest.approx(share, abs=0.018)  # four standard deviations


def test_a_batch_holds_the_frames_of_its_windows(corpus):
    windows = make(corpus)
    batch = windows.share(2, 0)
    assert batch.windows == 3
    assert batch.weight == 1
    for place, window in enumerate(windows.windows(2)[:3]):
        clip = corpus.clips[window.clip]
        piece = clip.rotations_local[window.start : window.start + LENGTH]
        assert torch.equal(batch.motion.rotations_local[place], piece)
        assert torch.equal(batch.motion.offsets[place], clip.offsets)
    assert windows.share(2, 1).windows == 1  # what is left of four recordings


@pytest.mark.parametrize("step", [0, 1])
@pytest.mark.parametrize("ranks", [1, 2, 3, 5])
def test_shares_make_up_the_batch_whatever_the_number_of_processes(corpus, ranks, step):
    windows = make(corpus, turn=True, mirror=True)
    whole = windows.share(0, step).motion.rotations_local
    shares = [windows.share(0, step, rank=rank, ranks=ranks) for rank in range(ranks)]
    counted = [share for share in shares if share.weight > 0]
    found = torch.cat([share.motion.rotations_local for share in counted])
    assert found.shape == whole.shape
    assert all(any(torch.equal(one, other) for other in found) for one in whole)
    # The mean over processes of weighted means is the mean over the batch.
    means = [share.weight * share.motion.rotations_local.mean() for share in shares]
    torch.testing.assert_close(torch.stack(means).mean(), whole.mean())
    assert sum(share.weight for share in shares) == pytest.approx(ranks)


def test_turns_are_uniform_over_two_turns_either_way(corpus, monkeypatch):
    found = []

    def turn(motion, angles, skeleton):
        found.append(angles)
        return motion

    monkeypatch.setattr(augmentation, "turn", turn)
    windows = make(corpus, batch=4, turn=True)
    for epoch in range(400):
        windows.share(epoch, 0)
    turns = torch.cat(found) / (2 * math.pi)
    assert len(turns) > 1000
    assert turns.abs().max() < 1
    quarters = torch.histc(turns, bins=4, min=-1, max=1) / len(turns)
    torch.testing.assert_close(quarters, torch.full_like(quarters, 0.25), atol=0.05, rtol=0)


def test_turned_windows_cover_both_signs_of_the_root(corpus):
    plain, turned = (make(corpus, batch=4, turn=turn) for turn in (False, True))
    dots = []
    for epoch in range(100):
        before, after = (x.share(epoch, 0).motion.rotations_local for x in (plain, turned))
        assert torch.equal(before[:, :, 1:], after[:, :, 1:])
        dots.append((before[:, 0, 0] * after[:, 0, 0]).sum(-1))
    found = torch.cat(dots)  # the cosine of half the angle, for an angle in (-2 pi, 2 pi)
    assert len(found) == 400
    assert (found < -0.5).float().mean() == pytest.approx(1 / 3, abs=0.1)
    assert (found > 0.5).float().mean() == pytest.approx(1 / 3, abs=0.1)


def forest(generator):
    """Two windows on a skeleton with two roots and a left and a right arm."""
    skeleton = Skeleton(("hips", "LeftArm", "RightArm", "prop"), (-1, 0, 0, -1))
    rotations = torch.randn(2, 5, 4, 4, dtype=torch.float64, generator=generator)
    return skeleton, Motion(
        rotations / rotations.norm(dim=-1, keepdim=True),
        torch.randn(2, 5, 3, dtype=torch.float64, generator=generator),
        torch.randn(2, 4, 3, dtype=torch.float64, generator=generator),
    )


def test_turning_turns_the_whole_world_about_the_vertical(generator):
    skeleton, motion = forest(generator)
    angles = torch.tensor([math.pi / 2, -0.3], dtype=torch.float64)
    x, y, z = world(motion, skeleton).unbind(-1)
    cosine, sine = angles.cos()[:, None, None], angles.sin()[:, None, None]
    expected = torch.stack((cosine * x + sine * z, y, cosine * z - sine * x), dim=-1)
    found = world(augmentation.turn(motion, angles, skeleton), skeleton)
    torch.testing.assert_close(found, expected)


def test_mirroring_reflects_the_world_and_exchanges_left_and_right(generator):
    skeleton, motion = forest(generator)
    chosen = torch.tensor([True, False])
    mirrored = augmentation.mirror(motion, chosen, skeleton)
    reflect = torch.tensor([-1.0, 1, 1], dtype=torch.float64)
    before, after = world(motion, skeleton), world(mirrored, skeleton)
    torch.testing.assert_close(after[0], before[0][:, [0, 2, 1, 3]] * reflect)
    torch.testing.assert_close(after[1], before[1])
    for again, first in zip(augmentation.mirror(mirrored, chosen, skeleton), motion, strict=True):
        torch.testing.assert_close(again, first)


def test_about_half_of_the_windows_are_mirrored(corpus):
    plain, mirrored = (make(corpus, batch=4, mirror=mirror) for mirror in (False, True))
    changed = [
        (plain.share(epoch, 0).motion[1] != mirrored.share(epoch, 0).motion[1]).flatten(1).any(1)
        for epoch in range(100)
    ]
    assert torch.cat(changed).float().mean() == pytest.approx(0.5, abs=0.1)


def test_windows_longer_than_every_recording_are_refused(corpus):
    with pytest.raises(ConfigError, match="longest of 5 has 55: shorten prefix"):
        make(corpus, length=56)


def test_mirroring_needs_a_left_and_a_right(tiny):
    clip = tiny.swinging_clip(0, 20)
    single = Clip(
        Skeleton(("hips",), (-1,)),
        clip.offsets[:1],
        25.0,
        clip.root_positions,
        clip.rotations_local[:, :1],
    )
    with pytest.raises(ConfigError, match="set mirror to false"):
        make(Corpus("one", [single], {"train": (0,)}), mirror=True)


@pytest.mark.parametrize(
    "wrong", [lambda: EveryRecording(0), lambda: RandomRecordings(steps_per_epoch=0)]
)
def test_an_empty_epoch_is_refused(wrong):
    with pytest.raises(ConfigError, match="expected >= 1"):
        wrong()
