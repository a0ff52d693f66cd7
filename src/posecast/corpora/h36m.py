"""Human3.6M as exponential maps: the split of the short-term protocols, with its known faults."""

from __future__ import annotations

import filecmp
import re
from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Literal

from posecast.corpora.loading import Cache, Progress, check_root, find, load, prepare
from posecast.corpora.splitting import split_clips
from posecast.errors import DataError
from posecast.io.h36m import read_h36m
from posecast.motion import Clip, Corpus

ACTIONS = (
    "walking",
    "eating",
    "smoking",
    "discussion",
    "directions",
    "greeting",
    "phoning",
    "posing",
    "purchases",
    "sitting",
    "sittingdown",
    "takingphoto",
    "waiting",
    "walkingdog",
    "walkingtogether",
)
SUBJECTS = ("S1", "S5", "S6", "S7", "S8", "S9", "S11")
TEST_SUBJECT = "S5"
FILES = tuple(
    f"{subject}/{action}_{recording}.txt"
    for subject in SUBJECTS
    for action in ACTIONS
    for recording in (1, 2)
)
"""All 210 recordings, as paths below the folder of the corpus."""

# Even frames (25 per second) of recordings 1 and 2 of subject 5: only lengths in these ranges give
# the published window starts (Martinez et al. 2017, code; the ranges follow from its generator).
TEST_FRAMES: Mapping[str, tuple[tuple[int, int], tuple[int, int]]] = {
    "walking": ((1296, 1548), (1191, 1330)),
    "eating": ((1577, 2009), (1106, 1189)),
    "smoking": ((1577, 2009), (1549, 2213)),
    "discussion": ((1577, 4262), (2215, 3153)),
    "directions": ((2215, 3153), (816, 1189)),
    "greeting": ((679, 985), (1549, 2213)),
    "phoning": ((1577, 2009), (565, 1105)),
    "posing": ((1106, 1190), (525, 1189)),
    "purchases": ((1238, 1479), (1331, 1588)),
    "sitting": ((1577, 2009), (1549, 2213)),
    "sittingdown": ((2215, 3153), (1840, 2213)),
    "takingphoto": ((1589, 4262), (1238, 1479)),
    "waiting": ((1577, 4262), (2215, 3153)),
    "walkingdog": ((679, 985), (565, 1105)),
    "walkingtogether": ((1480, 1548), (1331, 1746)),
}

PATTERN = rf"({'|'.join(ACTIONS)})_[12]\.txt"


KNOWN_COPIES = tuple(
    f"{folder}_{number}.txt"
    for folder in ("S6/posing", "S8/smoking", "S9/discussion", "S11/sittingdown")
    for number in (1, 2)
)
"""Training recordings that, in the files in circulation, are the test subject's of that name."""


def h36m(
    root: Path | str,
    *,
    fps: float | int | None = None,
    cache: Cache = None,
    trajectory: Literal["increments", "world"] = "increments",
    validation: Literal["6", "11", 6, 11] | None = None,
    copies: Literal["drop", "keep"] = "drop",
    phases: Literal["both", "even"] = "both",
    check_lengths: bool = True,
    progress: Progress | None = None,
    workers: int = 0,
) -> Corpus:
    """Subjects 1, 6, 7, 8, 9, 11 for training, 5 for testing; 25 frames per second.

    50 frames per second are halved by taking even and odd frames: training has both copies, if
    nothing else is said, test and validation the even one (label ``phase`` "0") alone. Labels:
    subject, action, recording.

    Args:
        root: folder with ``S1`` ... ``S11``, or one above it.
        fps: frames per second, 25 by default.
        cache: see ``loading.Cache``.
        trajectory: the root as in the files, from frame to frame, which is what QuaterNet trains
            on, or summed up in the world; see ``read_h36m``.
        validation: subject whose recordings leave training. The published runs have none and a
            fixed schedule; Jain et al. used 11, an option of QuaterNet's code 6.
        copies: eight training recordings in circulation are byte for byte recordings of the test
            subject. ``"drop"`` leaves those that are found out of training and validation;
            ``"keep"`` trains on them, as everybody did.
        phases: copies to train on: ``"both"``, as Pavllo et al. and Jain et al. do, or ``"even"``,
            as Martinez et al. and Aksan et al.
        check_lengths: leave out test recordings that are too short for the published windows, and
            call them missing.
        progress: called with files read and files in all.
        workers: see ``loading.load``.

    Raises:
        DataError: no recording is there, or one cannot be read.
    """
    folder = check_root(root)
    files = recordings(folder)
    if not files:
        raise DataError(
            root,
            "no recording of Human3.6M is there; expected exponential-map text such as "
            "S1/walking_1.txt, in folders S1, S5, S6, S7, S8, S9, S11",
        )
    twins = copies_of_test(files)
    kept = {n: file for n, file in files.items() if copies == "keep" or n not in twins}
    rate = 25.0 if fps is None else float(fps)
    read = partial(_read, fps=rate, trajectory=trajectory)
    loaded = load(list(kept.values()), read, cache=cache, progress=progress, workers=workers)
    clips = loaded.clips
    short = _too_short(clips) if check_lengths else ()
    chosen = file_splits([name for name in files if name not in short], validation)

    def use(clip: Clip) -> str | None:
        odd = clip.labels.get("phase", "0") != "0"
        return None if odd and phases == "even" else chosen.get(clip.labels["file"])

    by_split = split_clips(clips, use)
    notes = [*loaded.notes, *_notes(twins, copies == "drop", short)]
    missing = tuple(name for name in FILES if name not in files or name in short)
    return Corpus("h36m", clips, by_split, missing, tuple(notes))


def file_splits(names: Iterable[str], validation: str | int | None = None) -> dict[str, str]:
    """What each recording is for, by its subject; see ``h36m``."""
    by_subject = {TEST_SUBJECT: "test", f"S{validation}": "validation"}
    return {name: by_subject.get(name.split("/")[0], "train") for name in names}


def recordings(folder: Path) -> dict[str, Path]:
    """The recordings below a folder under their usual names, ``S5/walking_1.txt``, in order.

    Raises:
        DataError: one is there twice.
    """
    found: dict[str, Path] = {}
    for file in filter(is_recording, find(folder, PATTERN).values()):
        name = usual_name(file)
        if name in found:
            raise DataError(
                folder, f"{name} is there twice: {found[name]} and {file}; give the folder of one"
            )
        found[name] = file
    return {name: found[name] for name in FILES if name in found}


def is_recording(file: Path) -> bool:
    """Whether a file is called like a recording and lies in a subject's folder."""
    called = re.fullmatch(PATTERN, file.name, re.IGNORECASE) is not None
    return called and file.parent.name in SUBJECTS


def usual_name(file: Path) -> str:
    """``S5/walking_1.txt``, wherever the file is."""
    return f"{file.parent.name}/{file.name.lower()}"


def copies_of_test(files: Mapping[str, Path]) -> dict[str, str]:
    """Recordings of other subjects that are byte for byte one of the test subject, and which.

    Only files of exactly the size of a test recording are read. Where the test recording is not
    there to compare with, the copies that are known to be in circulation are taken for such.
    """
    by_size: dict[int, list[str]] = {}
    for name in files:
        if name.startswith(f"{TEST_SUBJECT}/"):
            by_size.setdefault(files[name].stat().st_size, []).append(name)
    copies: dict[str, str] = {}
    for name in files:
        if not name.startswith(f"{TEST_SUBJECT}/"):
            for twin in by_size.get(files[name].stat().st_size, ()):
                if filecmp.cmp(files[name], files[twin], shallow=False):
                    copies[name] = twin
    for name in KNOWN_COPIES:
        twin = f"{TEST_SUBJECT}/{name.split('/')[1]}"
        if name in files and twin not in files:
            copies[name] = twin
    return copies


def _read(
    file: Path, *, fps: float, trajectory: Literal["increments", "world"]
) -> tuple[Clip, ...]:
    clip = read_h36m(file, root=trajectory)
    return prepare(clip, fps, file=usual_name(file))


def _too_short(clips: Sequence[Clip]) -> tuple[str, ...]:
    """Test recordings cut off before the last published window."""
    short: list[str] = []
    for clip in clips:
        if clip.labels["subject"] == TEST_SUBJECT and clip.labels.get("phase", "0") == "0":
            ranges = TEST_FRAMES[clip.labels["action"]]
            fewest = ranges[int(clip.labels["recording"]) - 1][0]
            if clip.duration * 25 < fewest:
                short.append(clip.labels["file"])
    return tuple(short)


def _notes(twins: Mapping[str, str], dropped: bool, short: Sequence[str]) -> list[str]:
    notes = []
    if twins:
        pairs = ", ".join(f"{name} is {twin}" for name, twin in twins.items())
        what = "Left out of training" if dropped else "Trained on"
        notes.append(f"{what}, copies of test recordings: {pairs}.")
    if short:
        notes.append(f"Cut off, so the published windows do not fit: {', '.join(short)}.")
    return notes
