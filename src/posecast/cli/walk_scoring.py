"""What ``posecast evaluate --protocol locomotion`` does: walkers on eight paths, in one table."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import torch

from posecast.cli.scoring import check_seeds, check_skeleton, corpus_of, decisive, options_of
from posecast.cli.terminal import progress_bar
from posecast.cli.walking import gait_of, style_number
from posecast.config import check_call, did_you_mean
from posecast.errors import ConfigError
from posecast.evaluation import BASELINE_NAMES
from posecast.evaluation.steadiness import steadiness
from posecast.evaluation.walk_report import WalkReport, WalkRow, score_walker
from posecast.evaluation.walks import Reference, reference_of, score_walk
from posecast.generation import (
    Course,
    MatchedWalk,
    MotionMatcher,
    Walk,
    pace_by_hand,
    walked_clip,
)
from posecast.generation.courses import eight_courses, eight_paths, round_eight, walking_speed
from posecast.motion import Clip, analyse_gait, find_feet, leg_length
from posecast.motion.corpus import Corpus
from posecast.motion.gait import with_gait
from posecast.motion.tracks import PHASE
from posecast.system import System, load

Walker = Callable[[Course, float], Clip]
"""Anything that walks: (course, seconds) -> clip, the first frame at the start of the course."""

ALIKE = 1.5
"""A real clip is compared with that is at most so many times as fast or as slow as is asked."""

MOSTLY = 0.9
"""Share of the frames of a real clip in which somebody walks."""


@dataclass(frozen=True)
class Asked:
    """Options of the protocol.

    Args:
        style: name of a style that the walker has; ``None``: its first.
        speed: m/s on straight stretches; ``None``: 1.1 for an adult.
        minutes: of a long walk round a figure eight; 0: none.
        paths: names of the paths to walk; ``None``: all eight.
        matching: whether a walker that matches motion in the training clips has a row, too.
    """

    style: str | None = None
    speed: float | None = None
    minutes: float = 0.0
    paths: list[str] | None = None
    matching: bool = False

    def __post_init__(self) -> None:
        for name in self.paths or ():
            if name not in (known := eight_paths()):
                raise ConfigError(f"protocol.paths: {name!r}; {did_you_mean(name, known)}")
        if self.paths == []:
            raise ConfigError("protocol.paths: no path; leave it out for all eight")
        if not 0 <= self.minutes < math.inf:
            raise ConfigError(f"protocol.minutes is {self.minutes}; expected 0 or more")


def network_walker(system: System, style: int) -> Walker:
    """The pose network of a checkpoint as a walker."""
    gait, offsets = gait_of(system), _body(system)

    def walk(course: Course, seconds: float) -> Clip:
        lead = max(0.0, seconds - course.duration)
        way = Walk(system.forecaster, course, gait, offsets, system.fps, style=style, lead=lead)
        return walked_clip(way, seconds)

    return walk


def matching_walker(data: Corpus, style: str | None) -> Walker:
    """Motion matching on the training clips of a corpus as a walker."""
    clips = [clip if PHASE in clip.tracks else with_gait(clip) for clip in data.split("train")]
    matcher = MotionMatcher(clips, style=style)

    def walk(course: Course, seconds: float) -> Clip:
        lead = max(0.0, seconds - course.duration)
        return walked_clip(MatchedWalk(matcher, course, lead=lead), seconds)

    return walk


def score_walkers(
    names: Sequence[str], *, corpus: str | None, root: Path | None, split: str
) -> WalkReport:
    """Score networks that walk along paths; beside them real clips, where a corpus is named.

    Args:
        names: checkpoint folders, runs of one recipe and those of others; and options of the
            protocol (``Asked``) and of the corpus, such as ``protocol.style=normal``.
        corpus: kind of corpus; ``None``: the one the first system was trained on.
        root: folder of the corpus. Without it and ``corpus`` nothing is compared with real clips.
        split: which of its clips are a row of the table.

    Raises:
        ConfigError: a checkpoint that does not walk, two of one run, or an option of something
            else.
        SkeletonError: the corpus has other joints than a system.
    """
    names, options = options_of(names)
    if options["model"]:
        raise ConfigError("model.feedback: a walker reads what it says; leave it out")
    check_call(Asked, options["protocol"], where="protocol")
    asked = Asked(**options["protocol"])
    groups = _grouped(names)
    first = next(iter(groups.values()))[0]
    for name, runs in groups.items():
        if (runs[0].skeleton, runs[0].fps) != (first.skeleton, first.fps):
            raise ConfigError(
                f"{name} has another skeleton or frame rate than {next(iter(groups))}; evaluate "
                "one at a time"
            )
    data = None
    if corpus is not None or root is not None:
        data = corpus_of(first, corpus, root, options["corpus"])
        check_skeleton(first, data)
    elif options["corpus"] or asked.matching:
        raise ConfigError("corpus: name one with --corpus, or its folder with --root")
    return _report(groups, asked, data, split)


def _grouped(names: Sequence[str]) -> dict[str, list[System]]:
    """Walkers by what tables call them: runs that differ in their seed alone are one."""
    groups: list[list[tuple[str, System]]] = []
    for name in names:
        if name in BASELINE_NAMES:
            raise ConfigError(f"{name} does not walk along paths; name checkpoint folders alone")
        system = load(name)
        gait_of(system)
        same = [group for group in groups if decisive(group[0][1]) == decisive(system)]
        if same:
            same[0].append((name, system))
        else:
            groups.append([(name, system)])
    found: dict[str, list[System]] = {}
    for group in groups:
        folders, runs = [name for name, _ in group], [system for _, system in group]
        check_seeds(folders, runs)
        title = runs[0].recipe.name
        shared = sum(each[0][1].recipe.name == title for each in groups) > 1
        found[f"{title} ({folders[0]})" if shared else title] = runs
    return found


def _report(
    groups: Mapping[str, Sequence[System]], asked: Asked, data: Corpus | None, split: str
) -> WalkReport:
    first = next(iter(groups.values()))[0]
    leg = _leg(first)
    speed = walking_speed(leg) if asked.speed is None else asked.speed
    style = _style_name(first, asked)
    reference, real = None, None
    if data is not None:
        reference = reference_of(_like(data, "train", style, speed / math.sqrt(leg)))
        clips = _like(data, split, style, speed / math.sqrt(leg))
        scores = {clip.name: score_walk(clip, reference=reference) for clip in clips}
        real = WalkRow(f"{data.name}, {split} clips", (scores,))
    rows = []
    with progress_bar("walks") as advance:
        total = sum(map(len, groups.values()))
        for name, runs in groups.items():
            rows.append(_row(name, runs, asked, reference))
            advance(sum(len(row.runs) for row in rows), total)
    if data is not None and asked.matching:
        walker = matching_walker(data, style)
        rows.append(_row_of("motion matching", [(first, walker)], asked, reference))
    paths = "Eight paths" if asked.paths is None else ", ".join(asked.paths)
    notes = [f"{paths} at {speed:.3g} m/s" + (f", style {style}." if style else ".")]
    if data is not None:
        notes.append(
            f"Real clips: {split} clips that walk at a like speed, along paths of their own; "
            "compared with such training clips."
        )
        notes += data.notes
    return WalkReport(
        (*rows, *(() if real is None else (real,))),
        corpus="" if data is None else data.name,
        split="" if data is None else split,
        notes=tuple(notes),
    )


def _row(name: str, runs: Sequence[System], asked: Asked, reference: Reference | None) -> WalkRow:
    """Scores of all runs of a system, and of a long walk of the first."""
    walkers = [(system, network_walker(system, _style(system, asked))) for system in runs]
    return _row_of(name, walkers, asked, reference)


def _row_of(
    name: str,
    walkers: Sequence[tuple[System, Walker]],
    asked: Asked,
    reference: Reference | None,
) -> WalkRow:
    """Scores of walkers, each on the courses that a system's gait asks for."""
    scores = []
    for system, walker in walkers:
        style = _style(system, asked)
        courses = eight_courses(gait_of(system), _leg(system), speed=asked.speed, style=style)
        courses = {path: courses[path] for path in asked.paths or courses}
        scores.append(score_walker(walker, courses, reference=reference))
    long = None
    if asked.minutes:
        system, walker = walkers[0]
        style, leg = _style(system, asked), _leg(system)
        speed = walking_speed(leg) if asked.speed is None else asked.speed
        course = pace_by_hand(round_eight(leg), gait_of(system), speed=speed, style=style)
        clip = walker(course, 60 * asked.minutes)
        long = steadiness(clip, course, reference=reference)
    return WalkRow(name, tuple(scores), long)


def _like(data: Corpus, split: str, style: str | None, pace: float) -> list[Clip]:
    """Clips of a split that walk in a style, about as fast for their size as is asked.

    Args:
        pace: m/s by the root of the length of a leg.

    Raises:
        ConfigError: there are none.
    """
    found = []
    for clip in data.split(split):
        if style is not None and clip.labels.get("style") != style:
            continue
        gait = analyse_gait(clip)
        leg = leg_length(clip.skeleton, clip.offsets, find_feet(clip.skeleton, clip.offsets))
        own = float(gait.speed.mean()) / math.sqrt(leg)
        walks = float(gait.walking.double().mean()) >= MOSTLY
        if walks and pace / ALIKE <= own <= pace * ALIKE:
            found.append(clip)
    if not found:
        raise ConfigError(
            f"no {split} clip of corpus {data.name!r} walks as fast as is asked"
            + (f" in style {style!r}" if style else "")
            + "; ask for another speed (protocol.speed), style (protocol.style) or split (--split)"
        )
    return found


def _style(system: System, asked: Asked) -> int:
    return style_number(system, asked.style, option="protocol.style")


def _style_name(system: System, asked: Asked) -> str | None:
    """The style by its name; ``None`` for a walker that has none."""
    number, controls = _style(system, asked), system.forecaster.codec.controls
    return controls.styles[number] if controls is not None and controls.styles else None


def _body(system: System) -> torch.Tensor:
    return torch.tensor(system.offsets, dtype=torch.float64)


def _leg(system: System) -> float:
    offsets = _body(system)
    return leg_length(system.skeleton, offsets, find_feet(system.skeleton, offsets))
