"""Reports of walks: a row for each walker, and for real clips, as Markdown, CSV and JSON."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeVar

import torch

from posecast.errors import ConfigError
from posecast.evaluation.following import SLACK, Followed
from posecast.evaluation.report import markdown_rows
from posecast.evaluation.steadiness import Steadiness
from posecast.evaluation.walks import Reference, WalkScores, score_walk
from posecast.motion import Clip

WALKS = "locomotion"
"""What the protocol is called."""


class Shown(NamedTuple):
    """How a score is shown.

    Args:
        title: of its column.
        unit: as ``WalkScores`` has it.
        digits: after the point.
    """

    title: str
    unit: str
    digits: int


SHOWN: dict[str, Shown] = {
    "path_mean": Shown("off the path", "m", 3),
    "path_max": Shown("at most", "m", 3),
    "arrival_mean": Shown("off the time", "s", 2),
    "arrival_max": Shown("at most", "s", 2),
    "facing": Shown("facing error", "deg", 1),
    "speed": Shown("speed error", "m/s", 3),
    "standing": Shown("feet on the floor", "share", 2),
    "slide_path": Shown("sliding, path", "cm a contact", 1),
    "slide_straight": Shown("sliding, straight", "cm a contact", 1),
    "slide_fast": Shown("sliding fast", "share", 2),
    "sink_mean": Shown("in the floor", "cm", 2),
    "sink_max": Shown("at most", "cm", 1),
    "lean": Shown("leaning", "deg", 1),
    "jitter": Shown("jitter", "m/s^3", 0),
    "bone_drift": Shown("bone drift", "mm", 2),
    "spectrum": Shown("spectrum distance", "Hz", 2),
    "power": Shown("power", "of real", 2),
}
"""Every score of ``WalkScores``."""

_Course = TypeVar("_Course", bound=Followed)


def score_walker(
    walk: Callable[[_Course, float], Clip],
    courses: Mapping[str, _Course],
    *,
    reference: Reference | None = None,
) -> dict[str, WalkScores]:
    """Let a walker walk every course, and a little beyond the end, and score each walk.

    Args:
        walk: anything that walks a course: (course, seconds) -> clip, whose first frame is at the
            start of the course.
        courses: by name.
        reference: see ``score_walk``.

    Raises:
        ConfigError: a clip that ends before its course does.
    """
    found = {}
    for name, course in courses.items():
        clip = walk(course, course.duration + SLACK)
        if clip.frames / clip.fps < course.duration:
            raise ConfigError(
                f"{name}: walked for {clip.duration:.4g} s, but the course lasts "
                f"{course.duration:.4g} s; walk to its end"
            )
        found[name] = score_walk(clip, course, reference=reference)
    return found


@dataclass(frozen=True)
class WalkRow:
    """Scores of one walker, or of real clips.

    Args:
        system: whose.
        runs: for each run, such as one training seed each, scores by path or clip.
        minutes: scores of a long walk, of the first run; ``None``: there was none.
    """

    system: str
    runs: tuple[Mapping[str, WalkScores], ...]
    minutes: Steadiness | None = None

    def __post_init__(self) -> None:
        if not self.runs or not all(self.runs):
            raise ConfigError(f"{self.system}: no walks to report; expected at least one a run")

    def mean(self, score: str) -> float:
        """Mean over the walks of a run, those without the score left out, and over runs."""
        return _mean([_mean(_values(run.values(), score)) for run in self.runs])

    def std(self, score: str) -> float | None:
        """Sample standard deviation over runs; ``None`` for one run."""
        if len(self.runs) < 2:
            return None
        means = [_mean(_values(run.values(), score)) for run in self.runs]
        return float(torch.tensor(means, dtype=torch.float64).std())


@dataclass(frozen=True)
class WalkReport:
    """A table of walkers on the same courses.

    Args:
        rows: walkers first, then what they are compared with.
        corpus: of the real clips; empty where there are none.
        split: of these.
        notes: what should be read beside the table; full sentences.
    """

    rows: tuple[WalkRow, ...]
    corpus: str = ""
    split: str = ""
    notes: tuple[str, ...] = ()

    def to_markdown(self) -> str:
        """One table, a row for each system; then one for every long walk, a row a minute."""
        head = ["system", *[f"{each.title} ({each.unit})" for each in SHOWN.values()], "walks"]
        rows = [head, ["---", *["---:" for _ in head[1:]]]]
        for row in self.rows:
            cells = [_cell(row.mean(name), row.std(name), name) for name in SHOWN]
            rows.append([row.system, *cells, str(len(row.runs[0]))])
        blocks = [f"Protocol {WALKS}", markdown_rows(rows)]
        blocks += [_minutes(row.system, row.minutes) for row in self.rows if row.minutes]
        notes = list(self.notes)
        if runs := max(len(row.runs) for row in self.rows) - 1:
            notes.append(f"Mean ± standard deviation over {runs + 1} runs.")
        if notes:
            blocks.append("\n".join(f"- {note}" for note in notes))
        return "\n\n".join(blocks) + "\n"

    def to_csv(self) -> str:
        """One line a number: system, score, unit, value, std, walks, runs."""
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(["system", "score", "unit", "value", "std", "walks", "runs"])
        for row in self.rows:
            for name, shown in SHOWN.items():
                value, std = _number(row.mean(name)), _number(row.std(name))
                sizes = [len(row.runs[0]), len(row.runs)]
                cells = ["" if each is None else each for each in (value, std)]
                writer.writerow([row.system, name, shown.unit, *cells, *sizes])
        return text.getvalue()

    def to_json(self) -> str:
        """One object: ``protocol``, ``corpus``, ``split``, ``units``, ``rows``.

        A row has ``system``, ``scores`` (name -> ``value`` and, with several runs, ``std``),
        ``runs`` (path -> name -> value) and, after a long walk, ``minutes`` and ``frozen``. What
        could not be measured is null.
        """
        content = {
            "protocol": WALKS,
            "corpus": self.corpus or None,
            "split": self.split or None,
            "units": {name: shown.unit for name, shown in SHOWN.items()},
            "rows": [_json_row(row) for row in self.rows],
            "notes": list(self.notes),
        }
        return json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False)


def _json_row(row: WalkRow) -> dict[str, Any]:
    found: dict[str, Any] = {"system": row.system, "scores": {}}
    for name in SHOWN:
        found["scores"][name] = {"value": _number(row.mean(name))}
        if len(row.runs) > 1:
            found["scores"][name]["std"] = _number(row.std(name))
    found["runs"] = [{name: _json_scores(each) for name, each in run.items()} for run in row.runs]
    if row.minutes is not None:
        found["minutes"] = [_json_scores(each) for each in row.minutes.minutes]
        found["frozen"] = _number(row.minutes.frozen)
    return found


def _json_scores(scores: WalkScores) -> dict[str, float | None]:
    return {name: _number(value) for name, value in scores._asdict().items()}


def _minutes(system: str, steadiness: Steadiness) -> str:
    """A table of a long walk, a row a minute."""
    rows = [
        ["minute", *[f"{each.title} ({each.unit})" for each in SHOWN.values()]],
        ["---:", *["---:" for _ in SHOWN]],
    ]
    for minute, scores in enumerate(steadiness.minutes, 1):
        cells = [_cell(value, None, name) for name, value in scores._asdict().items()]
        rows.append([str(minute), *cells])
    head = f"**{system}**, minute by minute; frozen {100 * steadiness.frozen:.0f} % of the seconds"
    return f"{head}\n\n{markdown_rows(rows)}"


def _cell(value: float, std: float | None, score: str) -> str:
    if math.isnan(value):
        return "-"
    digits = SHOWN[score].digits
    return f"{value:.{digits}f}" + ("" if std is None else f" ± {std:.{digits}f}")


def _values(walks: Iterable[WalkScores], score: str) -> list[float]:
    """A score of each walk that has it."""
    found = [float(getattr(walk, score)) for walk in walks]
    return [value for value in found if not math.isnan(value)]


def _mean(values: Sequence[float]) -> float:
    return sum(values) / len(values) if values else math.nan


def _number(value: float | None) -> float | None:
    """``None`` for what is no number."""
    return None if value is None or not math.isfinite(value) else value
