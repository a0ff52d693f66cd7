"""Bandai-Namco-Research-Motiondataset: walking and running in several styles, as BVH."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable
from functools import partial
from pathlib import Path

from posecast.corpora.loading import Cache, Progress, check_root, find, load, prepare
from posecast.corpora.splitting import split_clips, tenths
from posecast.errors import DataError
from posecast.io.bvh import read_bvh
from posecast.motion import Clip, Corpus, drop_joints

PATTERN = r"dataset-[12]_[a-z-]+_[a-z-]+_\d+\.bvh"
ROOT_JOINT = "joint_Root"

CREDIT = (
    "Bandai-Namco-Research-Motiondataset, Bandai Namco Research Inc., CC BY-NC 4.0: not for "
    "commercial use, and weights trained on it must say so."
)


def bandai_locomotion(
    root: Path | str,
    *,
    fps: float | int | None = None,
    cache: Cache = None,
    progress: Progress | None = None,
    workers: int = 0,
) -> Corpus:
    """Clips ``dataset-2_CONTENT_STYLE_NUMBER.bvh``, split within each content and style.

    In file-name order the last ten per cent of each (content, style) group are for testing and the
    ten per cent before for validation, rounded to whole files and at least one each. The unmoving
    ``joint_Root`` above ``Hips`` is folded away: 21 joints remain. Labels: content, style, action
    (the content), number.

    Args:
        root: folder with the files, at any depth.
        fps: frames per second, 30 by default, as recorded.
        cache: see ``loading.Cache``.
        progress: called with files read and files in all.
        workers: see ``loading.load``.

    Raises:
        DataError: no such file is there, or one cannot be read.
    """
    files = find(check_root(root), PATTERN)
    if not files:
        raise DataError(root, "no file is called like dataset-2_walk_normal_001.bvh")
    names = [file.name.lower() for file in files.values()]
    if len(set(names)) < len(names):
        twice = Counter(names).most_common(1)[0][0]
        raise DataError(root, f"{twice} is there more than once; give the folder of one")
    read = partial(_read, fps=30.0 if fps is None else float(fps))
    loaded = load(list(files.values()), read, cache=cache, progress=progress, workers=workers)
    chosen = file_splits(names)
    return Corpus(
        "bandai-locomotion",
        loaded.clips,
        split_clips(loaded.clips, lambda clip: chosen[clip.labels["file"]]),
        missing=gaps(names),
        notes=(
            *loaded.notes,
            "joint_Root, which does not move, is folded into Hips.",
            "Offsets are the bones of the motion; those the files name are not used.",
            CREDIT,
        ),
    )


def _read(file: Path, *, fps: float) -> tuple[Clip, ...]:
    clip = read_bvh(file, unit=0.01, up="y")
    _, content, style, number = re.split("[_.]", file.name)[:4]
    if ROOT_JOINT in clip.skeleton.names:
        clip = drop_joints(clip, [ROOT_JOINT], moving="mean")
    named = {"content": content, "style": style, "number": number, "file": file.name.lower()}
    return prepare(clip, fps, action=content, **named)


def file_splits(names: Iterable[str]) -> dict[str, str]:
    """What each file is for, by its place in its group; see ``bandai_locomotion``."""
    groups: dict[str, list[str]] = {}
    for name in sorted(names):
        groups.setdefault(name.rpartition("_")[0], []).append(name)
    return {name: split for group in groups.values() for name, split in tenths(group).items()}


def gaps(names: Iterable[str]) -> tuple[str, ...]:
    """Names that are not there although a higher number of their group is."""
    highest: dict[str, int] = {}
    there = set(names)
    for name in there:
        group, _, number = name.removesuffix(".bvh").rpartition("_")
        highest[group] = max(highest.get(group, 0), int(number))
    expected = (
        f"{group}_{number:03d}.bvh"
        for group in sorted(highest)
        for number in range(1, highest[group] + 1)
    )
    return tuple(name for name in expected if name not in there)
