"""Any directory of BVH files on one skeleton, split by a small YAML file or by a fixed rule."""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Literal

from posecast.corpora.loading import Cache, Progress, check_root, find, load, prepare
from posecast.corpora.splitting import SPLITS_FILE, Globs, choose_splits, split_clips, tenths
from posecast.errors import ConfigError, DataError, SkeletonError
from posecast.io.bvh import read_bvh
from posecast.motion import Clip, Corpus

_RATE_TOLERANCE = 1e-3
_NAMED = 5


def folder(
    root: Path | str,
    *,
    fps: float | int | None = None,
    cache: Cache = None,
    unit: float | None = None,
    up: Literal["x", "y", "z"] | None = None,
    splits: Path | str | Globs | None = None,
    progress: Progress | None = None,
    workers: int = 0,
) -> Corpus:
    """All BVH files below a folder.

    Which file is for what, in this order: ``splits``; else ``splits.yaml`` in the folder; else the
    last tenth of the paths, in their order, is for testing and the tenth before for validation. A
    file and its mirrored copy (``..._mirror``) always go together. Labels: file (the path below
    the folder), folder (the name of the one it is in, if not the top).

    Args:
        root: the folder, searched with all folders in it.
        fps: frames per second; by default those of the files, which must agree.
        cache: see ``loading.Cache``.
        unit: meters per unit of the files, such as 0.01; by default guessed from each body.
        up: vertical axis of the files; by default guessed from each motion.
        splits: for train, validation and test the paths below the folder, or patterns such as
            ``subject_1/*`` in which ``*`` stands for anything; or a YAML file that says so.
            Files that no pattern names are left out.
        progress: called with files read and files in all.
        workers: see ``loading.load``.

    Raises:
        ConfigError: patterns that name no file, or one file for two splits; different frame rates
            without ``fps``.
        DataError: no BVH file is there, or one cannot be read.
        SkeletonError: the files have different skeletons; it names those that differ.
    """
    top = check_root(root)
    files = find(top, r".*\.bvh")
    if not files:
        raise DataError(root, "no BVH file is there or in any folder below")
    chosen, note = choose_splits(
        list(files),
        top,
        splits,
        otherwise=file_splits,
        rule="Split by path: the last tenth is the test, the tenth before validation.",
    )
    used = {name: file for name, file in files.items() if name in chosen}
    first = next(iter(used.values()))
    read = partial(
        _read,
        root=str(top),
        unit=unit,
        up=up,
        fps=read_bvh(first).fps if fps is None else float(fps),
        like=str(first) if fps is None else None,
    )
    loaded = load(list(used.values()), read, cache=cache, progress=progress, workers=workers)
    _check_topologies(loaded.clips)
    by_split = split_clips(loaded.clips, lambda clip: chosen[clip.labels["file"]])
    return Corpus(top.name or "folder", loaded.clips, by_split, notes=(*loaded.notes, note))


def file_splits(names: Sequence[str]) -> dict[str, str]:
    """What each file is for: the last tenths of the paths, mirrored copies with their originals."""
    groups: dict[str, list[str]] = {}
    for name in names:
        groups.setdefault(_unmirrored(name), []).append(name)
    by_group = tenths(list(groups))
    return {name: by_group[group] for group in groups for name in groups[group]}


def _unmirrored(name: str) -> str:
    """A path without the mark of a mirrored copy, which belongs with the original."""
    return re.sub(r"[_-]mirr(or(ed)?)?(?=\.[^.]*$)", "", name, flags=re.IGNORECASE)


def _read(
    file: Path,
    *,
    root: str,
    unit: float | None,
    up: Literal["x", "y", "z"] | None,
    fps: float,
    like: str | None,
) -> tuple[Clip, ...]:
    clip = read_bvh(file, unit=unit, up=up)
    if like is not None and abs(clip.fps / fps - 1) > _RATE_TOLERANCE:
        raise ConfigError(
            f"{file} has {clip.fps:g} frames per second, {like} {fps:g}; "
            "give fps to bring all to one rate"
        )
    name = file.relative_to(root)
    labels = {"file": name.as_posix()}
    if name.parent.name:
        labels["folder"] = name.parent.name
    return prepare(clip, fps, **labels)


def _check_topologies(clips: Sequence[Clip]) -> None:
    first = clips[0]
    differing = sorted({clip.labels["file"] for clip in clips if clip.skeleton != first.skeleton})
    if differing:
        more = f" and {len(differing) - _NAMED} more" if len(differing) > _NAMED else ""
        raise SkeletonError(
            f"{', '.join(differing[:_NAMED])}{more}: not the skeleton of {first.labels['file']} "
            f"({len(first.skeleton)} joints); a corpus has one, so leave the others out in "
            f"{SPLITS_FILE}"
        )
