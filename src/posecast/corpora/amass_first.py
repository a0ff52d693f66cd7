"""The first release of AMASS with its published lists: the data of Aksan et al. 2019."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path

from posecast.corpora.amass import load_bodies
from posecast.corpora.loading import Cache, Progress, check_root, find, prepare
from posecast.corpora.splitting import split_clips
from posecast.errors import DataError
from posecast.io.amass_first import read_amass_first
from posecast.io.files import decode_text, read_text_bytes
from posecast.motion import Clip, Corpus

LISTS: Mapping[str, str] = {
    "train": "training_fnames.txt",
    "validation": "validation_fnames.txt",
    "test": "test_fnames.txt",
}
"""File names of the published lists, one recording a line."""


def amass_first(
    root: Path | str,
    *,
    fps: float | int | None = None,
    cache: Cache = None,
    template: Path | str | None = None,
    lists: Path | str | None = None,
    progress: Progress | None = None,
    workers: int = 0,
) -> Corpus:
    """Pickles of the first release, skeleton ``smpl-22``, 60 fps, split by the published lists.

    Names in a list are paths below ``root``, with or without their ending; a database's folder may
    be missing from a name if the rest is found once only. Labels: subset (topmost folder), file.

    Args:
        root: folder with one folder a database.
        fps: frames per second; recordings have 60.
        cache: see ``loading.Cache``.
        template: joint positions of the body at rest; see ``read_amass``. Without it only measures
            of rotations mean anything.
        lists: folder with ``training_fnames.txt``, ``validation_fnames.txt`` and
            ``test_fnames.txt``, which come with the code of Aksan et al.; ``None``: ``root``.
        progress: called with files read and files in all.
        workers: see ``loading.load``.

    Raises:
        DataError: no pickle is there, a list is missing or names files that are not there, or a
            file cannot be read.

    Source: Aksan et al. 2019, section 4.
    """
    top = check_root(root)
    files = find(top, r".*\.pkl")
    if not files:
        raise DataError(root, "no motion of the first release of AMASS is there: expected .pkl")
    chosen = file_splits(files, top if lists is None else check_root(lists))
    used = {name: files[name] for name in files if name in chosen}
    loaded = load_bodies(
        used.values(),
        partial(_read, root=str(top)),
        fps=fps,
        template=template,
        cache=cache,
        progress=progress,
        workers=workers,
    )
    notes = [
        *loaded.notes,
        f"Split by lists; {len(files) - len(used)} files are in none, not used.",
    ]
    if template is None:
        notes.append("Bones have no length: no template of the body was given.")
    by_split = split_clips(loaded.clips, lambda clip: chosen[clip.labels["file"]])
    return Corpus("amass-first", loaded.clips, by_split, notes=tuple(notes))


def file_splits(files: Iterable[str], folder: Path) -> dict[str, str]:
    """What each file is for, by the lists in a folder.

    Raises:
        DataError: a list is missing, names files that are not there, or one that another names.
    """
    by_name: dict[str, list[str]] = {}
    for file in files:
        parts = file.removesuffix(Path(file).suffix).split("/")
        for first in range(len(parts)):
            by_name.setdefault("/".join(parts[first:]), []).append(file)
    chosen: dict[str, str] = {}
    for split, name in LISTS.items():
        path = folder / name
        absent: list[str] = []
        for line in decode_text(read_text_bytes(path, "a list of recordings")).splitlines():
            wanted = line.strip().replace("\\", "/").removesuffix(".pkl")
            found = by_name.get(wanted, [])
            if wanted and len(found) != 1:
                absent.append(wanted if not found else f"{wanted} (of {len(found)} folders)")
            elif wanted and chosen.setdefault(found[0], split) != split:
                raise DataError(
                    path, f"{wanted} is for {split}, and for {chosen[found[0]]} by another list"
                )
        if absent:
            raise DataError(path, f"names recordings that are not there: {_some(absent)}")
    return chosen


def _some(names: Sequence[str], limit: int = 5) -> str:
    rest = f" and {len(names) - limit} more" if len(names) > limit else ""
    return ", ".join(names[:limit]) + rest


def _read(file: Path, *, root: str, fps: float, template: str | None) -> tuple[Clip, ...]:
    clip = read_amass_first(file, template=template)
    name = file.relative_to(root).as_posix()
    return prepare(clip, fps, subset=name.split("/")[0], file=name)
