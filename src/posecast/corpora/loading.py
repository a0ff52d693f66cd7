"""Reading the files of a corpus, once: through the cache, and in several processes if asked."""

from __future__ import annotations

import multiprocessing
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal, NamedTuple

import torch
from torch import Tensor

from posecast.errors import DataError
from posecast.motion import Clip, Store, resample, unroll
from posecast.motion.cache import cached, default_folder, fingerprint
from posecast.motion.store import pack

Cache = Path | str | Literal[False] | None
"""Where parsed files are kept: a folder, ``None`` for the user's cache, ``False`` for nowhere."""

Progress = Callable[[int, int], None]
"""Called with the number of files read so far and of all files."""

_FILES_A_TASK = 8


class Loaded(NamedTuple):
    """What came of reading: the clips, and what should be said about how they were kept."""

    clips: Sequence[Clip]
    notes: tuple[str, ...] = ()


def check_root(root: Path | str) -> Path:
    """The folder of a corpus.

    Raises:
        DataError: there is no such folder.
    """
    folder = Path(root)
    if not folder.is_dir():
        raise DataError(root, "there is no such folder; give the one that holds the corpus")
    return folder


def find(root: Path, pattern: str) -> dict[str, Path]:
    """Files below a folder whose name matches, by path below it, in the order of these paths.

    Args:
        root: the folder.
        pattern: regular expression for the whole file name, not for its folders.
    """
    wanted = re.compile(pattern, re.IGNORECASE)
    found = {
        file.relative_to(root).as_posix(): file
        for file in root.rglob("*")
        if wanted.fullmatch(file.name) and file.is_file()
    }
    return dict(sorted(found.items()))


def load(
    files: Sequence[Path],
    read: partial[tuple[Clip, ...]],
    *,
    also: Sequence[Path] = (),
    cache: Cache = None,
    progress: Progress | None = None,
    workers: int = 0,
) -> Loaded:
    """All clips of the files, in their order, in float32.

    Args:
        files: what to read.
        read: a function of a module, with all its options bound by keyword; they are part of the
            cache's key. Called with one file; gives the clips it holds.
        also: further files that reading depends on, such as skeletons; part of the key too.
        cache: see ``Cache``. If the user's cache cannot be written, the clips are kept in memory
            and a note says so.
        progress: see ``Progress``; not called if the clips are in the cache.
        workers: processes to read with, started by ``spawn``, so that a script which asks for them
            needs an ``if __name__ == "__main__"``; 0 reads here.

    Raises:
        DataError: a file cannot be read, or a cache that was named cannot be written.
    """
    folder = None if cache is False else default_folder() if cache is None else Path(cache)

    def build(place: Path | None) -> Iterable[Clip]:
        if workers:
            return _read_in_parallel(files, read, workers, progress, place)
        return _read_here(files, read, progress)

    if folder is None:
        return Loaded([_in_memory(clip) for clip in build(None)])
    bound = {"function": f"{read.func.__module__}.{read.func.__qualname__}", **read.keywords}
    key = fingerprint([*files, *also], bound)
    try:
        return Loaded(cached(folder, key, lambda: build(folder)))
    except OSError as error:
        reason = error.strerror or str(error)
        if cache is not None:
            raise DataError(
                folder, f"cannot keep parsed clips ({reason}); name another cache, or set it false"
            ) from error
        note = f"Parsed clips are not kept: {folder} cannot be written ({reason})."
        return Loaded([_in_memory(clip) for clip in build(None)], (note,))


def prepare(clip: Clip, fps: float, **labels: str) -> tuple[Clip, ...]:
    """A clip as corpora hold it: labeled, signs continuous in time, at the rate wanted.

    Signs are made continuous over the whole recording before frames are left out, as in Pavllo et
    al. 2018, so that all phases agree.
    """
    return resample(unroll(replace(clip, labels={**clip.labels, **labels})), fps)


def _read_here(
    files: Sequence[Path], read: partial[tuple[Clip, ...]], progress: Progress | None
) -> Iterator[Clip]:
    for number, file in enumerate(files, start=1):
        yield from read(file)
        if progress:
            progress(number, len(files))


def _read_in_parallel(
    files: Sequence[Path],
    read: partial[tuple[Clip, ...]],
    workers: int,
    progress: Progress | None,
    place: Path | None,
) -> Iterator[Clip]:
    """Workers pack what they read, a few files each time; only paths travel between processes."""
    tasks = [files[first : first + _FILES_A_TASK] for first in range(0, len(files), _FILES_A_TASK)]
    if place is not None:
        place.mkdir(parents=True, exist_ok=True)
    context = multiprocessing.get_context("spawn")
    done = 0
    with (
        TemporaryDirectory(prefix=".", suffix=".part", dir=place) as temporary,
        ProcessPoolExecutor(workers, mp_context=context) as pool,
    ):
        places = [Path(temporary) / str(number) for number in range(len(tasks))]
        try:
            for task, packed in zip(
                tasks, pool.map(_read_and_pack, tasks, [read] * len(tasks), places), strict=True
            ):
                yield from Store(packed, verify=False)
                done += len(task)
                if progress:
                    progress(done, len(files))
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


def _read_and_pack(files: Sequence[Path], read: partial[tuple[Clip, ...]], place: Path) -> Path:
    torch.set_num_threads(1)
    pack((clip for file in files for clip in read(file)), place)
    return place


def _in_memory(clip: Clip) -> Clip:
    """The clip in float32 with tensors of its own, not those of a file that will be removed."""

    def own(values: Tensor) -> Tensor:
        return values.clone()

    small = clip.to(torch.float32)
    moved = small.translations_local
    return replace(
        small,
        offsets=own(small.offsets),
        root_positions=own(small.root_positions),
        rotations_local=own(small.rotations_local),
        translations_local=None if moved is None else own(moved),
        tracks={track: own(values) for track, values in small.tracks.items()},
        source=None,
    )
