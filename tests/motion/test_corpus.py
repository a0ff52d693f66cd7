"""Splits, windows that are counted and not listed, and batches gathered from them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from posecast.errors import ConfigError, SkeletonError
from posecast.motion import Clip, Corpus, Window, Windows
from posecast.skeleton import Skeleton

MakeClip = Callable[..., Clip]


@pytest.fixture
def corpus(make_clip: MakeClip) -> Corpus:
    clips = [
        make_clip(
            frames=frames,
            name=f"clip {index}",
            labels={"style": "slow" if index % 2 else "fast"} if index else {},
            tracks={"phase": torch.arange(frames)},
        )
        for index, frames in enumerate([30, 9, 41, 10, 25])
    ]
    return Corpus("made", clips, {"train": (0, 1, 2, 3), "test": (4,), "validation": ()})


def test_windows_are_listed_in_order_of_clip_and_time(corpus: Corpus) -> None:
    windows = corpus.windows("train", 10, stride=4)
    expected = [
        Window(clip, start)
        for clip in (0, 1, 2, 3)
        for start in range(0, corpus.clips[clip].frames - 10 + 1, 4)
    ]
    assert len(expected) == 6 + 0 + 8 + 1
    assert list(windows) == expected
    assert [windows[place] for place in range(len(windows))] == expected
    assert windows[-1] == expected[-1]
    assert windows[3:7] == expected[3:7]


@given(
    frames=st.lists(st.integers(0, 60), max_size=8),
    length=st.integers(1, 20),
    stride=st.integers(1, 7),
)
def test_indexing_agrees_with_iterating(frames: list[int], length: int, stride: int) -> None:
    windows = Windows(tuple(range(len(frames))), tuple(frames), length, stride)
    assert [windows[place] for place in range(len(windows))] == list(windows)
    with pytest.raises(IndexError):
        windows[len(windows)]


def test_counting_windows_does_not_list_them() -> None:
    windows = Windows(tuple(range(1000)), (10**9,) * 1000, 50)
    assert len(windows) == 1000 * (10**9 - 49)
    assert windows[10**11] == Window(100, 10**11 - 100 * (10**9 - 49))


def test_a_window_needs_a_frame_and_a_stride() -> None:
    for length, stride in [(0, 1), (1, 0)]:
        with pytest.raises(ConfigError, match="at least 1"):
            Windows((), (), length, stride)


def test_an_empty_split_has_no_windows(corpus: Corpus) -> None:
    assert len(corpus.windows("validation", 10)) == 0
    assert corpus.split("validation") == ()


def test_an_unknown_split_is_refused_with_those_there_are(corpus: Corpus) -> None:
    for ask in (lambda: corpus.split("dev"), lambda: corpus.windows("dev", 10)):
        with pytest.raises(ConfigError, match="'dev'; it has train, test, validation"):
            ask()


def test_labels_choose_clips(corpus: Corpus) -> None:
    assert corpus.indices("train", {"style": "slow"}) == (1, 3)
    assert corpus.indices("train", {"style": ["slow", "fast"]}) == (1, 2, 3)
    assert [clip.name for clip in corpus.split("train", {"style": "fast"})] == ["clip 2"]
    assert {window.clip for window in corpus.windows("train", 10, labels={"style": "fast"})} == {2}
    assert corpus.indices("train", {"style": "none"}) == ()


def test_gathering_copies_windows_in_order_as_float32(corpus: Corpus) -> None:
    windows = [Window(2, 7), Window(0, 0), Window(2, 31)]
    motion = corpus.gather(windows, 10)
    assert {part.dtype for part in motion[:3]} == {torch.float32}
    assert motion.rotations_local.shape == (3, 10, 7, 4)
    for place, (index, start) in enumerate(windows):
        piece = corpus.clips[index].cut(start, start + 10).to(torch.float32)
        assert torch.equal(motion.rotations_local[place], piece.rotations_local)
        assert torch.equal(motion.root_positions[place], piece.root_positions)
        assert torch.equal(motion.offsets[place], piece.offsets)


def test_changing_a_batch_does_not_change_the_corpus(corpus: Corpus) -> None:
    before = corpus.clips[0].rotations_local.clone()
    corpus.gather([Window(0, 0)], 30).rotations_local.zero_()
    assert torch.equal(corpus.clips[0].rotations_local, before)


def test_tracks_are_gathered_with_their_own_type(corpus: Corpus) -> None:
    track = corpus.gather_track([Window(2, 7), Window(0, 0)], 10, "phase")
    assert torch.equal(track, torch.stack([torch.arange(7, 17), torch.arange(10)]))
    with pytest.raises(ConfigError, match="no track 'contacts'; it has phase"):
        corpus.gather_track([Window(0, 0)], 10, "contacts")


@pytest.mark.parametrize("window", [Window(0, 21), Window(0, -1), Window(-1, 0), Window(5, 0)])
def test_a_window_outside_the_corpus_is_refused(corpus: Corpus, window: Window) -> None:
    with pytest.raises(ConfigError, match="window"):
        corpus.gather([window], 10)


def test_a_batch_of_nothing_is_refused(corpus: Corpus) -> None:
    for ask in (lambda: corpus.gather([], 10), lambda: corpus.gather_track([], 10, "phase")):
        with pytest.raises(ConfigError, match="at least one window"):
            ask()


def test_bodies_may_differ_but_topologies_may_not(make_clip: MakeClip) -> None:
    first, second = make_clip(name="one"), make_clip(name="two")
    assert not torch.equal(first.offsets, second.offsets)
    assert len(Corpus("mixed", (first, second), {}).clips) == 2
    renamed = replace(first.skeleton, names=("Pelvis", *first.skeleton.names[1:]))
    moved = replace(first.skeleton, parents=(-1, 0, 1, 0, 3, 0, 0))
    small = Skeleton(("Hips",), (-1,))
    others = {"'Pelvis'": renamed, "'Head' hangs": moved, "1 joints against 7": small}
    assert len(others) == 3
    for message, skeleton in others.items():
        with pytest.raises(SkeletonError, match=f"'other' and 'one' .*{message}"):
            Corpus("mixed", (first, make_clip(skeleton, name="other")), {})


def test_clips_of_different_rates_are_refused(make_clip: MakeClip) -> None:
    with pytest.raises(ConfigError, match="give fps"):
        Corpus("mixed", (make_clip(fps=30.0), make_clip(fps=60.0)), {})


def test_a_split_must_name_clips_that_are_there(make_clip: MakeClip) -> None:
    with pytest.raises(ConfigError, match="split 'test' names clip 1"):
        Corpus("short", (make_clip(),), {"test": (0, 1)})


def test_a_corpus_needs_clips() -> None:
    with pytest.raises(ConfigError, match="no clips"):
        Corpus("empty", (), {})
