"""CMU's motion capture: salsa (subjects 60, 61) as BVH, and subjects 01 to 03 as ASF/AMC."""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

from posecast.corpora.loading import Cache, Progress, check_root, find, load, prepare
from posecast.corpora.splitting import split_clips
from posecast.errors import ConfigError, DataError
from posecast.geometry import quaternion
from posecast.io.asf_amc import read_amc
from posecast.io.bvh import read_bvh
from posecast.motion import Clip, Corpus

CREDIT = (
    "The data are from mocap.cs.cmu.edu, created with funding from NSF EIA-0196217; free for "
    "research and commercial use, not to be resold as data."
)

SALSA_PATTERN = r"6[01]_\d\d\.bvh"
SALSA_TRIALS = (1, 2, 3, 4, 5, 6, 7, 9, 10, 11, 12, 13, 14, 15)
"""Trial 08 of both dancers is not part of the published conversion."""
SALSA_FILES = tuple(f"{who}/{who}_{trial:02d}.bvh" for who in (60, 61) for trial in SALSA_TRIALS)
SALSA_FPS = 60.0
_SALSA_HEADER_FPS = 120.0

ASF_PATTERN = r"0[123]_\d\d\.amc"
ASF_TRIALS = {"01": 14, "02": 10, "03": 4}
ASF_FILES = tuple(
    f"{subject}/{subject}_{trial:02d}.amc"
    for subject, trials in ASF_TRIALS.items()
    for trial in range(1, trials + 1)
)
ASF_VALIDATION = ("02/02_02.amc", "02/02_09.amc")
_ASF_ACTIONS = {
    "01": 14 * ("playground",),
    "02": tuple(
        "walk walk run jump punch bend swordplay swordplay swordplay wash".split()  # noqa: SIM905
    ),
    "03": 4 * ("uneven terrain",),
}

_T_POSE = math.radians(15)


def cmu_salsa(
    root: Path | str,
    *,
    fps: float | int | None = None,
    cache: Cache = None,
    subjects: Collection[str | int] = ("61",),
    progress: Progress | None = None,
    workers: int = 0,
) -> Corpus:
    """Salsa, split as in Andreou et al. 2022, Table 3: subject 61, trials 1-12, 13, 14 and 15.

    Two faults of the files are mended: the header says 120 frames per second, the recordings have
    60; and the first frame is an inserted T pose, which is dropped. Brought to 30 frames per
    second, training has both phases, validation and test the first alone. Labels: subject, trial,
    action.

    Args:
        root: folder with ``60/60_01.bvh`` ... ``61/61_15.bvh``, or all of them side by side.
        fps: frames per second, 30 by default.
        cache: see ``loading.Cache``.
        subjects: ``("61",)``; with ``"60"`` too, the other dancer's trials 1 to 12 are added to
            training. Trials 13 to 15 are the dances held out, seen from the partner: never used.
        progress: called with files read and files in all.
        workers: see ``loading.load``.

    Raises:
        ConfigError: subjects other than 60 and 61, or without 61.
        DataError: no file of the corpus is there, or one cannot be read.
    """
    chosen_subjects = {str(subject) for subject in subjects}
    if not chosen_subjects <= {"60", "61"} or "61" not in chosen_subjects:
        raise ConfigError(
            f"cmu-salsa: subjects {', '.join(sorted(chosen_subjects))}; expected 61 (the split is "
            "that of its trials), and 60 if wanted for training"
        )
    names = [
        name for name in SALSA_FILES if salsa_splits([name])[name] and name[:2] in chosen_subjects
    ]
    files = _by_usual_name(check_root(root), SALSA_PATTERN, names, "61/61_01.bvh")
    read = partial(_read_salsa, fps=30.0 if fps is None else float(fps))
    loaded = load(list(files.values()), read, cache=cache, progress=progress, workers=workers)

    chosen = salsa_splits(files)
    notes = (
        *loaded.notes,
        "The headers say 120 frames per second; the recordings have 60 and are read so.",
        "The first frame of each file, an inserted T pose, is dropped.",
        CREDIT,
    )
    splits = split_clips(loaded.clips, lambda clip: chosen[clip.labels["file"]])
    missing = tuple(name for name in names if name not in files)
    return Corpus("cmu-salsa", loaded.clips, splits, missing, notes)


def cmu_asf(
    root: Path | str,
    *,
    fps: float | int | None = None,
    cache: Cache = None,
    progress: Progress | None = None,
    workers: int = 0,
) -> Corpus:
    """Subject 02 (walk, run, jump, swordplay ...) for training, 01 and 03 as unseen bodies.

    Validation is trials 02 (walk) and 09 (swordplay) of subject 02, each of which has a like in
    training. 120 frames per second are brought to 30; training has all four phases, validation
    and test the first alone. Labels: subject, trial, action.

    Args:
        root: folder with ``01/01.asf``, ``01/01_01.amc`` ... ``03/03_04.amc``.
        fps: frames per second, 30 by default.
        cache: see ``loading.Cache``.
        progress: called with files read and files in all.
        workers: see ``loading.load``.

    Raises:
        DataError: no file of the corpus is there, or one cannot be read.
    """
    trials = asf_trials(root, fps=fps, cache=cache, progress=progress, workers=workers)
    chosen = asf_splits(ASF_FILES)
    notes = (
        *trials.notes,
        "Test bodies, subjects 01 and 03, are not those trained on, subject 02.",
        "Validation: trials 02 and 09 of subject 02.",
    )
    splits = split_clips(trials.clips, lambda clip: chosen[clip.labels["file"]])
    return replace(trials, splits=splits, notes=notes)


def asf_trials(
    root: Path | str,
    *,
    fps: float | int | None = None,
    cache: Cache = None,
    progress: Progress | None = None,
    workers: int = 0,
) -> Corpus:
    """The trials of ``cmu_asf``, whose arguments and errors these are, in no split."""
    files = _by_usual_name(check_root(root), ASF_PATTERN, ASF_FILES, "02/02_01.amc")
    read = partial(_read_trial, fps=30.0 if fps is None else float(fps))
    skeletons = sorted({body for file in files.values() for body in file.parent.glob("*.as[fF]")})
    loaded = load(
        list(files.values()),
        read,
        also=skeletons,
        cache=cache,
        progress=progress,
        workers=workers,
    )
    missing = tuple(name for name in ASF_FILES if name not in files)
    return Corpus("cmu-asf", loaded.clips, {}, missing, (*loaded.notes, CREDIT))


def salsa_splits(names: Iterable[str]) -> dict[str, str | None]:
    """What each file, ``61/61_13.bvh``, is for; see ``cmu_salsa``. ``None``: for nothing."""
    chosen: dict[str, str | None] = {}
    for name in names:
        subject, trial = name[:2], int(name[6:8])
        held_out = None if subject == "60" else "validation" if trial == 13 else "test"
        chosen[name] = "train" if trial <= 12 else held_out
    return chosen


def asf_splits(names: Iterable[str]) -> dict[str, str]:
    """What each file, ``02/02_01.amc``, is for; see ``cmu_asf``."""
    return {
        name: "test"
        if not name.startswith("02/")
        else "validation"
        if name in ASF_VALIDATION
        else "train"
        for name in names
    }


def usual_name(file: Path) -> str:
    """``61/61_13.bvh``, wherever the file is."""
    return f"{file.name[:2]}/{file.name.lower()}"


def _by_usual_name(root: Path, pattern: str, names: Sequence[str], example: str) -> dict[str, Path]:
    """The files of these names, wherever below the folder they are."""
    found: dict[str, Path] = {}
    for file in find(root, pattern).values():
        name = usual_name(file)
        if name in found:
            raise DataError(
                root, f"{name} is there twice: {found[name]} and {file}; give the folder of one"
            )
        found[name] = file
    files = {name: found[name] for name in names if name in found}
    if not files:
        raise DataError(root, f"none of the {len(names)} files is there, such as {example}")
    return files


def _read_salsa(file: Path, *, fps: float) -> tuple[Clip, ...]:
    clip = read_bvh(file, unit=0.01, up="y")
    if abs(clip.fps - _SALSA_HEADER_FPS) < 1:
        clip = replace(clip, fps=SALSA_FPS)
    if clip.frames > 1 and is_t_pose(clip):
        clip = clip.cut(1, clip.frames)
    subject, trial = re.split("[_.]", file.name)[:2]
    named = {"subject": subject, "trial": trial, "file": usual_name(file)}
    return prepare(clip, fps, action="salsa", **named)


def is_t_pose(clip: Clip) -> bool:
    """Whether the first frame was put there: the root is not turned at all, no joint much.

    In the files at hand no joint of it is turned by more than 11 degrees.
    """
    still = quaternion.identity(like=clip.rotations_local)
    first = quaternion.angle(clip.rotations_local[0], still)
    root = clip.skeleton.roots[0]
    return bool((first[root] < 1e-6) & (first.max() < _T_POSE))


def _read_trial(file: Path, *, fps: float) -> tuple[Clip, ...]:
    clip = read_amc(file)
    subject, trial = re.split("[_.]", file.name)[:2]
    action = _ASF_ACTIONS[subject][int(trial) - 1]
    named = {"subject": subject, "trial": trial, "file": usual_name(file)}
    return prepare(clip, fps, action=action, **named)
