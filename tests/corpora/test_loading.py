"""Files are read once, wherever that is done, and errors come out as they are."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest
import torch

from posecast.corpora.h36m import _read
from posecast.corpora.loading import Loaded, find, load, prepare
from posecast.errors import DataError
from posecast.motion import Clip, unroll

NAMES = [f"S1/{action}_1.txt" for action in ("eating", "waiting", "walking")]
READ = partial(_read, fps=25.0, trajectory="increments")


@pytest.fixture
def files(write_h36m) -> list[Path]:  # type: ignore[no-untyped-def]
    root = write_h36m(NAMES)
    return [root / name for name in NAMES]


def names(loaded: Loaded) -> list[str]:
    return [f"{clip.labels['file']}:{clip.labels['phase']}" for clip in loaded.clips]


EXPECTED = [f"{name}:{phase}" for name in NAMES for phase in (0, 1)]


def test_clips_come_in_the_order_of_the_files_in_float32(files: list[Path]) -> None:
    loaded = load(files, READ, cache=False)
    assert names(loaded) == EXPECTED
    assert {clip.rotations_local.dtype for clip in loaded.clips} == {torch.float32}
    assert names(load(files[::-1], READ, cache=False))[0] == "S1/walking_1.txt:0"


def test_the_second_time_nothing_is_parsed(files: list[Path], tmp_path: Path) -> None:
    seen: list[tuple[int, int]] = []

    def progress(done: int, total: int) -> None:
        seen.append((done, total))

    first = load(files, READ, cache=tmp_path / "cache", progress=progress)
    assert seen == [(1, 3), (2, 3), (3, 3)]
    second = load(files, READ, cache=tmp_path / "cache", progress=progress)
    assert len(seen) == 3
    assert names(first) == names(second) == EXPECTED
    plain = load(files, READ, cache=False)
    for one, two, three in zip(first.clips, second.clips, plain.clips, strict=True):
        assert torch.equal(one.rotations_local, two.rotations_local)
        assert torch.equal(one.rotations_local, three.rotations_local)


def test_a_changed_file_and_other_options_are_parsed_again(
    files: list[Path], tmp_path: Path
) -> None:
    cache = tmp_path / "cache"
    before = load(files, READ, cache=cache).clips[0].frames
    content = files[0].read_text()
    files[0].write_text("\n".join(content.splitlines()[:30]) + "\n")
    assert (before, load(files, READ, cache=cache).clips[0].frames) == (30, 15)
    other = partial(_read, fps=50.0, trajectory="increments")
    assert len(load(files, other, cache=cache).clips) == 3


def test_several_processes_read_the_same(files: list[Path], tmp_path: Path) -> None:
    seen: list[tuple[int, int]] = []
    here = load(files * 4, READ, cache=False)

    def progress(done: int, total: int) -> None:
        seen.append((done, total))

    spread = load(files * 4, READ, cache=tmp_path / "cache", workers=2, progress=progress)
    assert seen == [(8, 12), (12, 12)]
    assert len(here.clips) == 24
    for one, two in zip(here.clips, spread.clips, strict=True):
        assert one.labels == two.labels
        assert torch.equal(one.rotations_local, two.rotations_local)
    assert len(list((tmp_path / "cache").iterdir())) == 1


@pytest.mark.parametrize("workers", [0, 1])
def test_a_damaged_file_is_named_and_leaves_nothing_behind(
    files: list[Path], tmp_path: Path, workers: int
) -> None:
    files[1].write_text("1,2,3\n")
    with pytest.raises(DataError, match=r"waiting_1\.txt, line 1: 3 columns") as caught:
        load(files, READ, cache=tmp_path / "cache", workers=workers)
    assert caught.value.line == 1
    assert list((tmp_path / "cache").iterdir()) == []


def test_clips_read_elsewhere_and_kept_in_memory_need_no_file(files: list[Path]) -> None:
    loaded = load(files, READ, cache=False, workers=1)
    assert names(loaded) == EXPECTED
    assert all(clip.rotations_local.isfinite().all() for clip in loaded.clips)


def test_the_user_cache_is_the_default_and_may_be_closed(
    files: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    assert load(files, READ).notes == ()
    assert len(list((tmp_path / "cache" / "posecast").iterdir())) == 1
    (tmp_path / "file").write_text("in the way")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    loaded = load(files, READ)
    assert names(loaded) == EXPECTED
    assert "are not kept" in loaded.notes[0]
    with pytest.raises(DataError, match="cannot keep parsed clips"):
        load(files, READ, cache=tmp_path / "file")


def test_signs_are_continuous_before_frames_are_left_out(walk: Callable[..., Clip]) -> None:
    clip = walk(fps=60.0)
    flips = torch.ones(clip.frames, 1, 1, dtype=torch.float64)
    flips[31:] = -1
    broken = replace(clip, rotations_local=clip.rotations_local * flips, labels={"style": "x"})
    copies = prepare(broken, 30.0, file="a.bvh")
    assert [dict(copy.labels) for copy in copies] == [
        {"style": "x", "file": "a.bvh", "phase": "0"},
        {"style": "x", "file": "a.bvh", "phase": "1"},
    ]
    for phase, copy in enumerate(copies):
        assert torch.equal(copy.rotations_local, unroll(clip).rotations_local[phase::2])


def test_files_are_found_at_any_depth_in_the_order_of_their_paths(tmp_path: Path) -> None:
    for name in ("b/2.BVH", "a/x/3.bvh", "1.bvh", "a/4.txt", "a/x/bvh"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("")
    (tmp_path / "folder.bvh").mkdir()
    assert list(find(tmp_path, r".*\.bvh")) == ["1.bvh", "a/x/3.bvh", "b/2.BVH"]
