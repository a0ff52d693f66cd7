"""AMASS: a folder of SMPL-family .npz files, split by subset or by lists the user has."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from functools import partial
from pathlib import Path

from posecast.corpora.loading import Cache, Loaded, Progress, check_root, find, load, prepare
from posecast.corpora.splitting import Globs, choose_splits, split_clips
from posecast.errors import DataError
from posecast.io.amass import is_amass, read_amass
from posecast.io.arrays import array_names
from posecast.motion import Clip, Corpus

SUBSETS: Mapping[str, tuple[str, ...]] = {
    "validation": ("humaneva", "heva", "hdm05", "mpihdm05", "sfu", "mosh", "mpimosh"),
    "test": ("transitions", "transitionsmocap", "transition", "ssm", "ssmsynced"),
}
"""The usual split by subset (that of the body-model prior VPoser), in old and new spelling.

A subset is a folder; capitals, underscores and hyphens in its name do not count. All subsets that
are not named here are for training.
"""


def amass(
    root: Path | str,
    *,
    fps: float | int | None = None,
    cache: Cache = None,
    template: Path | str | None = None,
    splits: Path | str | Globs | None = None,
    progress: Progress | None = None,
    workers: int = 0,
) -> Corpus:
    """All motion files below a folder, on the skeleton ``smpl-22``, 60 frames per second.

    Which file is for what, in this order: ``splits``; else ``splits.yaml`` in the folder; else by
    subset, the topmost folder whose name is known: HumanEva, HDM05, SFU and MoSh are for
    validation, Transitions and SSM for testing, everything else for training. Training has every
    phase of a whole frame-rate ratio, validation and test the first. Labels: subset, subject (the
    folder of the file), file.

    Results on these files cannot be compared with those of Aksan et al. 2019, who used an early
    version of AMASS with other recordings and its own lists.

    Args:
        root: folder with the subsets, or one subset.
        fps: frames per second; recordings have 59 to 250.
        cache: see ``loading.Cache``.
        template: joint positions of the body at rest; see ``read_amass``. Without it offsets are
            zero and only measures of rotations mean anything.
        splits: patterns, or a YAML file with them, as for ``folder``.
        progress: called with files read and files in all.
        workers: see ``loading.load``.

    Raises:
        ConfigError: ``splits`` that name no file, or one for two splits.
        DataError: no motion is there, or a file cannot be read.
    """
    top = check_root(root)
    files = motions(top)
    if not files:
        raise DataError(
            root,
            "no motion of an SMPL body is there: expected .npz files with poses, or with "
            "root_orient and pose_body; shape.npz and *_stagei.npz hold bodies without motion",
        )
    chosen, note = choose_splits(
        list(files),
        top,
        splits,
        otherwise=lambda names: file_splits(names, top.name),
        rule="Split by subset: see posecast.corpora.amass.SUBSETS.",
    )
    used = {name: file for name, file in files.items() if name in chosen}
    loaded = load_bodies(
        used.values(),
        partial(_read, root=str(top)),
        fps=fps,
        template=template,
        cache=cache,
        progress=progress,
        workers=workers,
    )
    notes = [*loaded.notes, note]
    if template is None:
        notes.append("Bones have no length: no template of the body was given.")
    clips = loaded.clips
    by_split = split_clips(clips, lambda clip: chosen[clip.labels["file"]])
    return Corpus("amass", clips, by_split, notes=tuple(notes))


def load_bodies(
    files: Iterable[Path],
    read: Callable[..., tuple[Clip, ...]],
    *,
    fps: float | int | None,
    template: Path | str | None,
    cache: Cache,
    progress: Progress | None,
    workers: int,
) -> Loaded:
    """Read recordings of SMPL bodies, at 60 frames per second unless told otherwise.

    Args:
        files: in their order.
        read: reads one; it is given ``fps`` and ``template``, too.
        fps, template, cache, progress, workers: see ``amass``.
    """
    return load(
        list(files),
        partial(
            read,
            fps=60.0 if fps is None else float(fps),
            template=None if template is None else str(template),
        ),
        also=[] if template is None else [Path(template)],
        cache=cache,
        progress=progress,
        workers=workers,
    )


def motions(folder: Path) -> dict[str, Path]:
    """The .npz files below a folder that hold a motion of an SMPL body, by path below it."""
    return {
        name: file for name, file in find(folder, r".*\.npz").items() if is_amass(array_names(file))
    }


def file_splits(names: Iterable[str], top: str = "") -> dict[str, str]:
    """What each file is for, by its subset; see ``amass``."""
    return {name: subset_split(name, top)[1] for name in names}


def subset_split(name: str, top: str = "") -> tuple[str, str]:
    """The subset of a file and what it is for.

    Args:
        name: path of the file below the folder of the corpus.
        top: name of that folder, in case it is a subset itself.
    """
    folders = [top, *name.split("/")[:-1]]
    for part in folders:
        plain = part.lower().replace("_", "").replace("-", "")
        for split, subsets in SUBSETS.items():
            if plain in subsets:
                return part, split
    return folders[1] if len(folders) > 1 else top, "train"


def _read(file: Path, *, root: str, fps: float, template: str | None) -> tuple[Clip, ...]:
    clip = read_amass(file, template=template)
    name = file.relative_to(root).as_posix()
    subset = subset_split(name, Path(root).name)[0]
    return prepare(clip, fps, subset=subset, subject=file.parent.name, file=name)
