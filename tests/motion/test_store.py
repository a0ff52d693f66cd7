"""Packed clips come back as they were; damage is noticed; writers do not disturb each other."""

from __future__ import annotations

import json
import multiprocessing
import os
import pickle
import shutil
import zlib
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
import torch

from posecast.errors import DataError
from posecast.motion import Clip, Store, pack
from posecast.motion.cache import cached, default_folder, fingerprint
from posecast.skeleton import Skeleton

MakeClip = Callable[..., Clip]
CHAIN = Skeleton(("Wurzel", "Hüfte"), (-1, 0))


@pytest.fixture
def clips(make_clip: MakeClip) -> list[Clip]:
    return [
        make_clip(name="erste", labels={"style": "slow"}),
        make_clip(
            CHAIN,
            frames=7,
            fps=59.94,
            translations_local=torch.randn(7, 2, 3, dtype=torch.float64),
            tracks={
                "phase": torch.linspace(0, 1, 7, dtype=torch.float64),
                "contacts": torch.tensor([[True, False]] * 7),
                "step": torch.arange(7, dtype=torch.int32),
            },
        ),
        make_clip(frames=1),
    ]


def same(stored: Clip, clip: Clip) -> bool:
    expected = clip.to(torch.float32)
    moved, still = stored.translations_local, expected.translations_local
    return (
        stored.skeleton == clip.skeleton
        and (stored.fps, stored.name) == (clip.fps, clip.name)
        and dict(stored.labels) == dict(clip.labels)
        and torch.equal(stored.offsets, expected.offsets)
        and torch.equal(stored.root_positions, expected.root_positions)
        and torch.equal(stored.rotations_local, expected.rotations_local)
        and (still is None if moved is None else still is not None and torch.equal(moved, still))
        and set(stored.tracks) == set(clip.tracks)
        and all(torch.equal(stored.tracks[name], expected.tracks[name]) for name in clip.tracks)
    )


def read_first(store: Store) -> tuple[str, float]:
    """Runs in another process."""
    return store[0].name, float(store[0].rotations_local.sum())


def pack_again(folder: Path, times: int) -> int:
    """Runs in several processes: pack the same places as the others, some of them damaged."""
    skeleton = Skeleton(("Hips",), (-1,))
    still = torch.tensor([[[1.0, 0, 0, 0]]]).expand(50, 1, 4)
    clip = Clip(skeleton, torch.zeros(1, 3), 30.0, torch.ones(50, 3), still)
    whole = 0
    for key in range(times):
        store = cached(folder, f"key{key}", lambda: [clip])
        whole += len(store) == 1 and bool((store[0].root_positions == 1).all())
    return whole


def test_packed_clips_come_back_in_float32(clips: list[Clip], tmp_path: Path) -> None:
    store = pack(iter(clips), tmp_path / "deep" / "packed")
    assert len(store) == 3
    assert all(same(stored, clip) for stored, clip in zip(store, clips, strict=True))
    assert [clip.name for clip in Store.open(tmp_path / "deep" / "packed")[:2]] == ["erste", "made"]
    assert store[-1] is store[2]
    assert store[0].skeleton is store[2].skeleton
    with pytest.raises(IndexError):
        store[3]


def test_an_empty_store_can_be_opened(tmp_path: Path) -> None:
    assert len(pack([], tmp_path / "empty")) == 0


def test_packing_leaves_nothing_else_behind(clips: list[Clip], tmp_path: Path) -> None:
    def failing() -> Iterator[Clip]:
        yield clips[0]
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        pack(failing(), tmp_path / "packed")
    assert list(tmp_path.iterdir()) == []
    pack(clips, tmp_path / "packed")
    assert [path.name for path in tmp_path.iterdir()] == ["packed"]


def test_a_whole_store_is_not_overwritten(clips: list[Clip], tmp_path: Path) -> None:
    pack(clips, tmp_path / "packed")
    with pytest.raises(DataError, match="already holds a store"):
        pack(clips[:1], tmp_path / "packed")
    assert len(Store.open(tmp_path / "packed")) == 3


def test_writing_to_a_tensor_changes_no_file(clips: list[Clip], tmp_path: Path) -> None:
    store = pack(clips, tmp_path / "packed")
    store[0].rotations_local.zero_()
    assert same(Store.open(tmp_path / "packed")[0], clips[0])


def test_the_files_are_plain_arrays_and_json(clips: list[Clip], tmp_path: Path) -> None:
    pack(clips, tmp_path / "packed")
    names = sorted(path.name for path in (tmp_path / "packed").iterdir())
    assert names == ["booleans.npy", "floats.npy", "integers.npy", "manifest.json"]
    assert not any(b"\x80\x04" in path.read_bytes()[:2] for path in (tmp_path / "packed").iterdir())
    manifest = json.loads(json.loads((tmp_path / "packed/manifest.json").read_text())["manifest"])
    assert [entry["name"] for entry in manifest["clips"]] == ["erste", "made", "made"]


def test_a_store_reaches_other_processes_by_its_path(clips: list[Clip], tmp_path: Path) -> None:
    store = pack(clips, tmp_path / "packed")
    assert len(pickle.dumps(store)) < 500
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, mp_context=context) as pool:
        name, total = pool.submit(read_first, store).result()
    assert name == "erste"
    assert total == float(store[0].rotations_local.sum())


def damage_nothing_there(folder: Path) -> None:
    for path in folder.iterdir():
        path.unlink()


def damage_cut(folder: Path) -> None:
    data = (folder / "floats.npy").read_bytes()
    (folder / "floats.npy").write_bytes(data[: len(data) // 2])


def damage_one_bit(folder: Path) -> None:
    data = bytearray((folder / "floats.npy").read_bytes())
    data[len(data) // 2] ^= 1
    (folder / "floats.npy").write_bytes(bytes(data))


def damage_empty_array(folder: Path) -> None:
    (folder / "floats.npy").write_bytes(b"")


def damage_manifest(folder: Path) -> None:
    text = (folder / "manifest.json").read_text()
    (folder / "manifest.json").write_text(text.replace("erste", "letzte"))


def damage_half_manifest(folder: Path) -> None:
    text = (folder / "manifest.json").read_text()
    (folder / "manifest.json").write_text(text[: len(text) // 2])


def damage_binary_manifest(folder: Path) -> None:
    (folder / "manifest.json").write_bytes(bytes(range(256)))


def damage_list_manifest(folder: Path) -> None:
    (folder / "manifest.json").write_text("[1, 2]")


def damage_old_format(folder: Path) -> None:
    document = json.loads((folder / "manifest.json").read_text())
    text = document["manifest"].replace('"format":1', '"format":0')
    (folder / "manifest.json").write_text(
        json.dumps({"checksum": zlib.crc32(text.encode()), "manifest": text})
    )


def damage_pickle(folder: Path) -> None:
    (folder / "floats.npy").write_bytes(pickle.dumps([1, 2, 3]))


def damage_object_array(folder: Path) -> None:
    np.save(folder / "floats.npy", np.array([None], dtype=object), allow_pickle=True)


DAMAGES = [value for name, value in sorted(globals().items()) if name.startswith("damage_")]


@pytest.mark.parametrize("damage", DAMAGES)
def test_damage_is_noticed_and_the_cache_is_built_again(
    clips: list[Clip], tmp_path: Path, damage: Callable[[Path], None]
) -> None:
    assert len(DAMAGES) == 11
    calls = []

    def build() -> list[Clip]:
        calls.append(1)
        return clips

    cached(tmp_path, "key", build)
    cached(tmp_path, "key", build)
    assert len(calls) == 1
    damage(tmp_path / "key")
    with pytest.raises(DataError, match="not a whole store"):
        Store.open(tmp_path / "key")
    store = cached(tmp_path, "key", build)
    assert len(calls) == 2
    assert all(same(stored, clip) for stored, clip in zip(store, clips, strict=True))
    assert [path.name for path in tmp_path.iterdir()] == ["key"]


def test_a_file_in_the_place_of_the_store_is_replaced(clips: list[Clip], tmp_path: Path) -> None:
    (tmp_path / "key").write_text("not a folder")
    assert len(cached(tmp_path, "key", lambda: clips)) == 3


def test_writers_at_the_same_place_all_end_with_a_whole_store(tmp_path: Path) -> None:
    for damaged in range(0, 20, 2):
        (tmp_path / f"key{damaged}").mkdir()
        (tmp_path / f"key{damaged}" / "manifest.json").write_text("{")
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(2, mp_context=context) as pool:
        counts = list(pool.map(pack_again, [tmp_path] * 2, [20] * 2))
    assert counts == [20, 20]
    shutil.rmtree(tmp_path / "key0")
    with ThreadPoolExecutor(4) as threads:
        counts = list(threads.map(pack_again, [tmp_path] * 4, [20] * 4))
    assert counts == [20] * 4
    assert {path.name for path in tmp_path.iterdir()} == {f"key{key}" for key in range(20)}


def test_what_a_killed_writer_left_is_removed_after_a_day(
    clips: list[Clip], tmp_path: Path
) -> None:
    old, fresh = tmp_path / ".key.00.part", tmp_path / ".key.01.part"
    old.mkdir()
    fresh.mkdir()
    os.utime(old, (0, 0))
    cached(tmp_path, "key", lambda: clips)
    assert not old.exists()
    assert fresh.exists()


def test_a_key_changes_with_files_and_options_only(tmp_path: Path) -> None:
    file = tmp_path / "one.bvh"
    file.write_text("one")
    os.utime(file, (1, 1))
    key = fingerprint([file], {"fps": 30.0})
    assert fingerprint([file], {"fps": 30.0}) == key
    keys = {key, fingerprint([file], {"fps": 60.0}), fingerprint([file, file], {"fps": 30.0})}
    os.utime(file, (2, 2))
    keys.add(fingerprint([file], {"fps": 30.0}))
    file.write_text("more")
    os.utime(file, (2, 2))
    keys.add(fingerprint([file], {"fps": 30.0}))
    assert len(keys) == 5


def test_a_key_of_a_missing_file_names_it(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"one\.bvh: cannot be read"):
        fingerprint([tmp_path / "one.bvh"], {})


def test_the_cache_lies_where_the_environment_says(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert default_folder() == tmp_path / "posecast"
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    assert default_folder() == tmp_path / "home" / ".cache" / "posecast"


def test_a_place_that_cannot_be_written_is_an_os_error(clips: list[Clip], tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(OSError):
        pack(clips, tmp_path / "file" / "packed")
