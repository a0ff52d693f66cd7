"""A folder of BVH files, split by YAML or by rule, is a corpus without a line of code."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from posecast.corpora import build_corpus
from posecast.corpora.folder import file_splits
from posecast.corpora.splitting import match_globs, tenths
from posecast.errors import ConfigError, DataError, SkeletonError
from posecast.motion import Clip, Corpus, drop_joints

Write = Callable[..., Path]


def build(root: Path, **options: object) -> Corpus:
    return build_corpus("folder", root=root, cache=False, **options)  # type: ignore[arg-type]


def files_of(corpus: Corpus, split: str) -> list[str]:
    return [clip.labels["file"] for clip in corpus.split(split)]


def test_the_last_tenths_of_the_paths_are_for_test_and_validation(write_walks: Write) -> None:
    names = [f"{letter}/{number}.bvh" for letter in "ba" for number in (1, 2)]
    corpus = build(write_walks(names, seconds=0.2))
    assert files_of(corpus, "train") == ["a/1.bvh", "a/2.bvh"]
    assert files_of(corpus, "validation") == ["b/1.bvh"]
    assert files_of(corpus, "test") == ["b/2.bvh"]
    assert corpus.fps == 60
    assert corpus.clips[0].labels["folder"] == "a"
    assert corpus.name == "walks"


@given(st.integers(0, 300))
def test_tenths_give_every_name_one_split_in_order(count: int) -> None:
    names = [str(number) for number in range(count)]
    chosen = tenths(names)
    assert list(chosen) == names
    order = ["train", "validation", "test"]
    assert [*chosen.values()] == sorted(chosen.values(), key=order.index)
    sizes = [list(chosen.values()).count(split) for split in order]
    if count >= 3:
        assert sizes[1] == sizes[2] == max(1, round(count / 10 + 1e-9))
    else:
        assert sizes == [min(count, 1), 0, max(0, count - 1)]


def test_mirrored_copies_stay_with_their_originals() -> None:
    names = sorted([f"{n:02d}.bvh" for n in range(10)] + [f"{n:02d}_mirror.bvh" for n in range(10)])
    chosen = file_splits(names)
    assert len(chosen) == 20
    assert all(chosen[f"{n:02d}.bvh"] == chosen[f"{n:02d}_mirror.bvh"] for n in range(10))
    assert list(chosen.values()).count("test") == 2


def test_a_yaml_file_in_the_folder_says_what_is_for_what(write_walks: Write) -> None:
    root = write_walks(["s1/a.bvh", "s1/b.bvh", "s2/a.bvh", "s3/a.bvh"], seconds=0.2)
    (root / "splits.yaml").write_text("train: ['s1/*']\ntest: s2/a.bvh\n")
    corpus = build(root)
    assert files_of(corpus, "train") == ["s1/a.bvh", "s1/b.bvh"]
    assert files_of(corpus, "test") == ["s2/a.bvh"]
    assert files_of(corpus, "validation") == []
    assert len(corpus.clips) == 3
    assert "1 of 4 files are not named" in " ".join(corpus.notes)
    other = build(root, splits={"train": ["s3/*"], "test": ["s1/a.bvh"]})
    assert files_of(other, "train") == ["s3/a.bvh"]


@pytest.mark.parametrize(
    ("globs", "message"),
    [
        ({"trian": "*"}, "did you mean 'train'"),
        ({"train": "nowhere/*"}, "'nowhere/\\*' matches none of 2 files, such as a.bvh"),
        ({"train": "*", "test": "b.bvh"}, "b.bvh is in train and, by 'b.bvh', in test"),
        ({"train": 3}, "expected a pattern or a list"),
        ({"train": []}, "names no file"),
    ],
)
def test_patterns_that_cannot_be_meant_are_refused(globs: dict, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        match_globs(["a.bvh", "b.bvh"], globs, "splits")


def test_files_of_another_skeleton_are_named(write_walks: Write, walk: Callable[..., Clip]) -> None:
    root = write_walks(["a.bvh", "b.bvh"], seconds=0.2)

    def without_head(clip: Clip) -> Clip:
        return drop_joints(clip, ["Head"])

    write_walks(["c.bvh", "d.bvh"], root=root, seconds=0.2, change=without_head)
    with pytest.raises(SkeletonError, match=r"c\.bvh, d\.bvh: not the skeleton of a\.bvh"):
        build(root)


def test_different_rates_need_one_to_be_given(write_walks: Write) -> None:
    root = write_walks(["a.bvh"], seconds=0.2)
    write_walks(["b.bvh"], root=root, fps=25.0, seconds=0.2)
    with pytest.raises(ConfigError, match=r"b\.bvh has 25 frames per second.*give fps"):
        build(root)
    corpus = build(root, fps=30.0, splits={"train": "*"})
    assert corpus.fps == 30
    assert [clip.frames for clip in corpus.clips] == [6, 6, 5]


def test_the_unit_can_be_given(write_walks: Write) -> None:
    root = write_walks(["a.bvh"], seconds=0.2)
    small = build(root, unit=0.001, up="y").clips[0].offsets
    assert abs(float(build(root).clips[0].offsets.abs().sum() / small.abs().sum()) - 10) < 1e-4


def test_a_broken_file_is_named(write_walks: Write) -> None:
    root = write_walks(["a.bvh", "b.bvh"], seconds=0.2)
    (root / "b.bvh").write_bytes((root / "b.bvh").read_bytes()[:-200])
    with pytest.raises(DataError, match=r"b\.bvh"):
        build(root)
