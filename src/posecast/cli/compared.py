"""What a comparison found: the systems that took part, and their tables."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from posecast.evaluation import Report, Scores
from posecast.evaluation.report import markdown_rows, metric_table
from posecast.motion.corpus import Corpus
from posecast.recipe import Recipe
from posecast.system import System


class Cost(NamedTuple):
    """What a system took.

    Args:
        parameters: trained values.
        seconds: of training, validation and saving left out, one a seed.
        step_ms: milliseconds of an update: median over the epochs of all seeds.
    """

    parameters: int
    seconds: tuple[float, ...]
    step_ms: float


@dataclass(frozen=True, eq=False)
class Contestant:
    """One system of a comparison: its trained runs, its scores and its cost.

    Args:
        recipe: with the first seed.
        runs: trained systems, one a seed.
        report: scores of the runs.
        cost: what training took.
        curves: for each seed (updates, value) of the metric that runs are selected by.
    """

    recipe: Recipe
    runs: tuple[System, ...]
    report: Report
    cost: Cost
    curves: tuple[tuple[tuple[int, float], ...], ...]


def to_markdown(
    contestants: Sequence[Contestant], baselines: Sequence[Scores], corpus: Corpus
) -> str:
    """One table of costs, then one a metric with rows for every system and baseline."""
    first = contestants[0].report.runs[0]
    seeds = len(contestants[0].runs)
    rows = [
        ["system", "parameters", "training (s)", "step (ms)"],
        ["---", "---:", "---:", "---:"],
        *(
            [
                each.recipe.name,
                f"{each.cost.parameters:,}",
                spread(each.cost.seconds),
                f"{each.cost.step_ms:.0f}",
            ]
            for each in contestants
        ),
    ]
    blocks = [
        f"**{len(contestants)} systems on equal terms**: corpus {first.corpus}, protocol "
        f"{first.protocol}, {seeds} seed{'' if seeds == 1 else 's'} each"
        + (", mean ± standard deviation" if seeds > 1 else ""),
        markdown_rows(rows),
    ]
    reports = [*(each.report for each in contestants), *(Report((scores,)) for scores in baselines)]
    lines = [line for report in reports for line in report.lines]
    blocks += [metric_table(name, first, lines) for name in first.metrics]
    notes = [*first.notes, *corpus.notes]
    if first.missing:
        notes.append(f"Missing files: {', '.join(first.missing)}.")
    return "\n\n".join([*blocks, "\n".join(f"- {note}" for note in notes)]) + "\n"


def to_json(contestants: Sequence[Contestant], baselines: Sequence[Scores]) -> dict[str, Any]:
    """All numbers by name, those of every seed included."""
    return {
        "systems": [
            {
                "system": each.recipe.name,
                "parameters": each.cost.parameters,
                "training_seconds": list(each.cost.seconds),
                "step_ms": each.cost.step_ms,
                "validation": [[list(point) for point in curve] for curve in each.curves],
                "seeds": [[row._asdict() for row in run.rows] for run in each.report.runs],
            }
            for each in contestants
        ],
        "baselines": [
            {"system": scores.system, "rows": [row._asdict() for row in scores.rows]}
            for scores in baselines
        ],
    }


def spread(values: Sequence[float], digits: int = 0) -> str:
    """Mean and, of several values, sample standard deviation."""
    text = f"{statistics.fmean(values):.{digits}f}"
    return text if len(values) < 2 else f"{text} ± {statistics.stdev(values):.{digits}f}"
