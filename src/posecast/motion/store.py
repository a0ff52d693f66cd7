"""Many clips packed in memory-mapped arrays beside a JSON manifest, so that files are parsed once.

A store is a folder. The arrays of all clips lie end to end in a few ``.npy`` files, in float32;
``manifest.json`` says where each clip begins and what it is called. Nothing in it is ever executed.
"""

from __future__ import annotations

import json
import os
import secrets
import shutil
import zlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO, Any, overload

import numpy as np
import torch
from torch import Tensor

from posecast.errors import DataError
from posecast.motion.clip import Clip
from posecast.skeleton import Skeleton

FORMAT = 1
"""Raised whenever a store written before could be read wrongly."""

_MANIFEST = "manifest.json"
_KINDS: dict[str, np.dtype[Any]] = {
    "floats": np.dtype("<f4"),
    "integers": np.dtype("<i8"),
    "booleans": np.dtype("?"),
}
_CHUNK = 1 << 22


def pack(clips: Iterable[Clip], folder: Path) -> Store:
    """Write clips to a new folder and open it.

    The folder appears whole or not at all; what was there and is not a whole store is replaced.
    Of several processes that pack the same folder at once one wins, and all open its store.
    Floats become float32, integers int64; ``Clip.source`` is not kept.

    Args:
        clips: consumed one by one, so that they need not fit in memory together.
        folder: where to; its parents are made.

    Raises:
        DataError: a whole store is there already.
        OSError: the disk is full, or closed to writing.
    """
    if _is_whole(folder):
        raise DataError(folder, "already holds a store; delete it first or name another folder")
    return pack_unless_there(clips, folder)


def pack_unless_there(clips: Iterable[Clip], folder: Path) -> Store:
    """As ``pack``, but a whole store that is there by the time this one is ready is opened."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    temporary = folder.with_name(f".{folder.name[:80]}.{secrets.token_hex(6)}.part")
    temporary.mkdir()
    try:
        arrays = {kind: _Appender(temporary / f"{kind}.npy", _KINDS[kind]) for kind in _KINDS}
        try:
            skeletons: dict[Skeleton, int] = {}
            entries = [_append(clip, arrays, skeletons) for clip in clips]
        finally:
            for array in arrays.values():
                array.close()
        manifest = {
            "format": FORMAT,
            "arrays": {kind: [array.length, array.checksum] for kind, array in arrays.items()},
            "skeletons": [[skeleton.names, skeleton.parents] for skeleton in skeletons],
            "clips": entries,
        }
        text = json.dumps(manifest, ensure_ascii=False, separators=(",", ":"))
        document = json.dumps({"checksum": zlib.crc32(text.encode()), "manifest": text})
        (temporary / _MANIFEST).write_text(document, encoding="utf-8")
        _move_into_place(temporary, folder)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)
    return Store.open(folder)


class _Appender:
    """One growing ``.npy`` file, its length and its checksum."""

    def __init__(self, path: Path, dtype: np.dtype[Any]) -> None:
        self.dtype, self.length, self.checksum = dtype, 0, 0
        self._file: IO[bytes] = path.open("wb")
        self._write_header()

    def _write_header(self) -> None:
        # NumPy pads the header for the growth of the first axis, so its size does not change.
        header = {"descr": self.dtype.str, "fortran_order": False, "shape": (self.length,)}
        np.lib.format.write_array_header_1_0(self._file, header)

    def append(self, values: Tensor) -> list[int]:
        """Write values; returns [first position, shape ...] to find them again."""
        data = np.ascontiguousarray(values.detach().cpu().numpy(), dtype=self.dtype).tobytes()
        self._file.write(data)
        self.checksum = zlib.crc32(data, self.checksum)
        first, self.length = self.length, self.length + values.numel()
        return [first, *values.shape]

    def close(self) -> None:
        self._file.seek(0)
        self._write_header()
        self._file.flush()
        os.fsync(self._file.fileno())
        self._file.close()


def _append(
    clip: Clip, arrays: dict[str, _Appender], skeletons: dict[Skeleton, int]
) -> dict[str, Any]:
    """Write the numbers of a clip and return its entry in the manifest."""

    def place(values: Tensor) -> list[Any]:
        floating = values.is_floating_point()
        kind = "floats" if floating else "booleans" if values.dtype == torch.bool else "integers"
        return [kind, *arrays[kind].append(values)]

    moved = clip.translations_local
    return {
        "name": clip.name,
        "skeleton": skeletons.setdefault(clip.skeleton, len(skeletons)),
        "fps": clip.fps,
        "labels": dict(clip.labels),
        "offsets": place(clip.offsets),
        "root_positions": place(clip.root_positions),
        "rotations_local": place(clip.rotations_local),
        "translations_local": None if moved is None else place(moved),
        "tracks": {track: place(values) for track, values in clip.tracks.items()},
    }


def _move_into_place(temporary: Path, folder: Path) -> None:
    """Rename a complete folder to its place, unless a whole store is there by now."""
    while True:
        try:
            temporary.rename(folder)
        except OSError:
            if not folder.exists():
                raise
            if _is_whole(folder):
                return
            # A folder with something in it cannot be replaced: move it aside in one step first.
            aside = folder.with_name(f".{folder.name[:80]}.{secrets.token_hex(6)}.old")
            try:
                folder.rename(aside)
            except FileNotFoundError:
                continue  # another process was faster
            if aside.is_dir():
                shutil.rmtree(aside, ignore_errors=True)
            else:
                aside.unlink(missing_ok=True)
        else:
            return


@dataclass(frozen=True)
class _Entry:
    """What the manifest says of one clip."""

    name: str
    skeleton: Skeleton
    fps: float
    labels: dict[str, str]
    values: dict[str, list[Any]]
    tracks: dict[str, list[Any]]


def _is_whole(folder: Path) -> bool:
    try:
        Store.open(folder)
    except DataError:
        return False
    return True


class Store(Sequence[Clip]):
    """The clips of a packed folder, made on demand; float32.

    Memory-mapped copy-on-write: the file is only read, pages are shared between processes, and
    writing to a tensor changes no file. Sending a store to another process sends its path.

    Args:
        folder: where it was packed.
        verify: compare the checksum of every array, which reads it once (about 1 GB/s).
    """

    def __init__(self, folder: Path, *, verify: bool = True) -> None:
        self.folder = folder
        try:
            self._read(verify)
        except (OSError, EOFError, ValueError, LookupError, TypeError, AttributeError) as error:
            reason = " ".join(str(error).split()) or type(error).__name__
            raise DataError(
                folder, f"not a whole store of format {FORMAT} ({reason}); delete it and pack again"
            ) from error

    @classmethod
    def open(cls, folder: Path) -> Store:
        """Open a packed folder and check it.

        Raises:
            DataError: it is missing, incomplete, damaged or of another format.
        """
        return cls(folder)

    def _read(self, verify: bool) -> None:
        document = json.loads((self.folder / _MANIFEST).read_text(encoding="utf-8"))
        text = document["manifest"]
        if zlib.crc32(text.encode()) != document["checksum"]:
            raise ValueError("the manifest was changed")
        manifest = json.loads(text)
        if manifest["format"] != FORMAT:
            raise ValueError(f"format {manifest['format']}")
        self._arrays = {
            kind: _map(self.folder / f"{kind}.npy", dtype, manifest["arrays"][kind], verify)
            for kind, dtype in _KINDS.items()
        }
        skeletons = [Skeleton(tuple(names), tuple(above)) for names, above in manifest["skeletons"]]
        self._entries = tuple(_entry(raw, skeletons) for raw in manifest["clips"])
        self._made: dict[int, Clip] = {}

    def __len__(self) -> int:
        return len(self._entries)

    @overload
    def __getitem__(self, index: int) -> Clip: ...
    @overload
    def __getitem__(self, index: slice) -> list[Clip]: ...
    def __getitem__(self, index: int | slice) -> Clip | list[Clip]:
        if isinstance(index, slice):
            return [self[place] for place in range(*index.indices(len(self)))]
        if not -len(self) <= index < len(self):
            raise IndexError(f"clip {index} of {len(self)}")
        index %= len(self)
        if index not in self._made:
            entry = self._entries[index]
            self._made[index] = Clip(
                skeleton=entry.skeleton,
                fps=entry.fps,
                name=entry.name,
                labels=entry.labels,
                tracks={track: self._tensor(place) for track, place in entry.tracks.items()},
                **{field: self._tensor(place) for field, place in entry.values.items()},
            )
        return self._made[index]

    def _tensor(self, place: Sequence[Any]) -> Tensor:
        kind, first, *shape = place
        count = int(np.prod(shape, dtype=np.int64))
        return torch.from_numpy(self._arrays[kind][first : first + count].reshape(shape))

    def __reduce__(self) -> tuple[Any, ...]:
        return _reopen, (self.folder,)


def _reopen(folder: Path) -> Store:
    """In another process; what was checked once is not checked again."""
    return Store(folder, verify=False)


def _entry(raw: dict[str, Any], skeletons: Sequence[Skeleton]) -> _Entry:
    """One clip of the manifest."""
    fields = ("offsets", "root_positions", "rotations_local", "translations_local")
    return _Entry(
        name=raw["name"],
        skeleton=skeletons[raw["skeleton"]],
        fps=float(raw["fps"]),
        labels=raw["labels"],
        values={field: raw[field] for field in fields if raw[field] is not None},
        tracks=raw["tracks"],
    )


def _map(
    path: Path, dtype: np.dtype[Any], expected: Sequence[int], verify: bool
) -> np.ndarray[Any, np.dtype[Any]]:
    """Map one array and compare it with its length and checksum in the manifest."""
    length, checksum = expected
    if length == 0:
        return np.empty(0, dtype)  # an empty file range cannot be mapped
    array = np.load(path, mmap_mode="c", allow_pickle=False)
    if array.dtype != dtype or array.shape != (length,):
        raise ValueError(f"{path.name} holds {array.dtype} {array.shape}, not {dtype} ({length},)")
    if verify:
        found = 0
        for first in range(0, length, _CHUNK):
            found = zlib.crc32(array[first : first + _CHUNK].data, found)
        if found != checksum:
            raise ValueError(f"the numbers in {path.name} were changed")
    return np.asarray(array)
