"""Reports: a system beside the baselines and the published numbers, as Markdown, CSV and JSON."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import torch

from posecast.errors import ConfigError
from posecast.evaluation.baselines import (
    BASELINE_NAMES,
    MEAN_POSE,
    has_training_clips,
    make_baseline,
)
from posecast.evaluation.bootstrap import bootstrap
from posecast.evaluation.metrics import METRICS
from posecast.evaluation.prediction import Predictor
from posecast.evaluation.protocol import Protocol
from posecast.evaluation.published import Published, find_published
from posecast.evaluation.scores import AVERAGE, Milliseconds, Scores
from posecast.motion.corpus import Corpus


class Line(NamedTuple):
    """One number of a report.

    Args:
        system: whose.
        action: action, or ``average``.
        metric: name in ``METRICS``.
        horizon_ms: milliseconds after the last true frame.
        value: mean over the windows, and over runs where there are several.
        std: sample standard deviation over runs; ``None`` for a single run.
        windows: how many windows are behind the value, in each run.
        published: the printed number, where there is one.
    """

    system: str
    action: str
    metric: str
    horizon_ms: Milliseconds
    value: float
    std: float | None
    windows: int
    published: Published | None


@dataclass(frozen=True)
class Report:
    """Runs of one system, and the baselines on the same windows.

    Args:
        runs: scores of the system, one a training seed.
        baselines: scores of the baselines; the system itself is not among them.
    """

    runs: tuple[Scores, ...]
    baselines: tuple[Scores, ...] = ()

    def __post_init__(self) -> None:
        if not self.runs:
            raise ConfigError("a report needs the scores of at least one run; found none")
        first = self.runs[0]
        for scores in (*self.runs, *self.baselines):
            if (scores.protocol, scores.corpus, scores.split) != (
                first.protocol,
                first.corpus,
                first.split,
            ) or scores.values.keys() != first.values.keys():
                raise ConfigError(
                    f"scores of {scores.system!r} ({scores.protocol} on {scores.corpus}, "
                    f"{scores.split}) do not fit those of {first.system!r} ({first.protocol} on "
                    f"{first.corpus}, {first.split}); score all on the same windows"
                )
        if any(scores.system != first.system for scores in self.runs):
            raise ConfigError("the runs of a report are of one system; make a report for each")

    @property
    def system(self) -> str:
        """Name of the system."""
        return self.runs[0].system

    @property
    def lines(self) -> tuple[Line, ...]:
        """All numbers of the system."""
        return _lines(self.runs)

    @property
    def baseline_lines(self) -> tuple[Line, ...]:
        """All numbers of the baselines, one baseline after the other."""
        return tuple(line for scores in self.baselines for line in _lines((scores,)))

    def to_json(self) -> str:
        """One object: ``system``, ``corpus``, ``protocol``, ``rows``, ``missing``.

        A row has ``action``, ``metric``, ``horizon_ms``, ``value``, ``windows`` and, where there
        is a printed number, ``published``; with several runs also ``std``. For a system that is no
        baseline itself, ``baselines`` lists theirs as objects of ``system`` and ``rows``.
        """
        first = self.runs[0]
        content: dict[str, Any] = {
            "system": self.system,
            "corpus": first.corpus,
            "protocol": first.protocol,
            "rows": [_json_row(line) for line in self.lines],
            "missing": list(first.missing),
        }
        if self.system not in BASELINE_NAMES:
            content["baselines"] = [
                {"system": scores.system, "rows": [_json_row(line) for line in _lines((scores,))]}
                for scores in self.baselines
            ]
        return json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False)

    def to_csv(self) -> str:
        """One line a number, baselines included; empty cells where there is nothing to say."""
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(
            ["system", "action", "metric", "horizon_ms", "value", "std", "windows", "published"]
        )
        for line in (*self.lines, *self.baseline_lines):
            printed = "" if line.published is None else line.published.value
            std = "" if line.std is None else line.std
            writer.writerow([*line[:5], std, line.windows, printed])
        return text.getvalue()

    def to_markdown(
        self, metrics: Sequence[str] | None = None, *, generator: torch.Generator | None = None
    ) -> str:
        """One table a metric, then what was left out and where printed numbers are from.

        Args:
            metrics: which metrics; all that were measured by default.
            generator: draws the bootstrap intervals of the system's averages, which are left out
                without it.
        """
        first = self.runs[0]
        blocks = [
            metric_table(metric, first, self._all_lines()) for metric in metrics or first.metrics
        ]
        notes = [*first.notes]
        if first.missing:
            notes.append(f"Missing files: {', '.join(first.missing)}.")
        if len(self.runs) > 1:
            notes.append(f"Mean ± standard deviation over {len(self.runs)} runs.")
        sources = {line.published.source for line in self._all_lines() if line.published}
        if sources:
            notes.append(f"In brackets, as printed: {'; '.join(sorted(sources))}.")
        if generator is not None:
            notes += self._intervals(metrics or first.metrics, generator)
        return "\n\n".join([*blocks, "\n".join(f"- {note}" for note in notes)]) + "\n"

    def _all_lines(self) -> tuple[Line, ...]:
        return (*self.lines, *self.baseline_lines)

    def _intervals(self, metrics: Iterable[str], generator: torch.Generator) -> list[str]:
        """Sentences with the bootstrap intervals of the system's averages."""
        first, notes = self.runs[0], []
        for name in metrics:
            groups = [first.values[action, name] for action in first.actions]
            low, high = bootstrap(groups, generator=generator)
            digits = METRICS[name].digits
            spans = ", ".join(
                f"{a:.{digits}f} to {b:.{digits}f}" for a, b in zip(low, high, strict=True)
            )
            notes.append(f"95 % of bootstrap averages of {self.system}, `{name}`: {spans}.")
        return notes


def metric_table(name: str, like: Scores, lines: Iterable[Line]) -> str:
    """What a metric is, and its values: a row for every action and system, then the average.

    Args:
        name: of the metric.
        like: scores on the same windows, for what is said of them.
        lines: of any systems and metrics.
    """
    metric = METRICS[name]
    left_out = ", ".join(like.joints_left_out[name]) or "none"
    head = (
        f"**{metric.title} ({metric.unit})**: `{name}`, protocol {like.protocol}, corpus "
        f"{like.corpus}, split {like.split}; joints left out: {left_out}"
    )
    columns = [f"{horizon:g} ms" for horizon in like.horizons_ms]
    rows = [
        ["action", "system", *columns, "windows"],
        ["---", "---", *["---:" for _ in columns], "---:"],
    ]
    found: dict[tuple[str, str], list[Line]] = {}
    for line in lines:
        if line.metric == name:
            found.setdefault((line.action, line.system), []).append(line)
    systems = dict.fromkeys(system for _, system in found)
    averaged = (AVERAGE,) if len(like.actions) > 1 else ()
    for action in (*like.actions, *averaged):
        for system in systems:
            cells = found[action, system]
            texts = [_cell(line, metric.digits) for line in cells]
            rows.append([_label(action, like), system, *texts, str(cells[0].windows)])
    return f"{head}\n\n{markdown_rows(rows)}"


def markdown_rows(rows: Iterable[Sequence[str]]) -> str:
    """Rows of a table in Markdown; the second says how columns are aligned."""
    return "\n".join("| " + " | ".join(row) + " |" for row in rows)


def _label(action: str, like: Scores) -> str:
    """The action; for the average also over how many actions it is."""
    if action != AVERAGE:
        return action
    measured, expected = len(like.actions), like.expected
    return f"average of {measured}" + ("" if measured == expected else f" (of {expected})")


def baseline_scores(
    protocol: Protocol, corpus: Corpus, split: str = "test", *, without: str = ""
) -> tuple[Scores, ...]:
    """Scores of a protocol's baselines on a corpus, but for one.

    The mean pose is left out where the corpus has no training clips.
    """
    return tuple(
        protocol.score(make_baseline(name, corpus), corpus, split, system=name)
        for name in protocol.baselines
        if name != without and (name != MEAN_POSE or has_training_clips(corpus))
    )


def evaluate(
    predictors: Predictor | Sequence[Predictor],
    protocol: Protocol,
    corpus: Corpus,
    *,
    system: str,
    split: str = "test",
) -> Report:
    """Score a system, or several runs of it, and the baselines, on the same windows.

    Raises:
        ConfigError: the corpus does not fit the protocol, or a predictor returns something else
            than it was asked for.
    """
    runs = predictors if isinstance(predictors, Sequence) else (predictors,)
    return Report(
        runs=tuple(protocol.score(run, corpus, split, system=system) for run in runs),
        baselines=baseline_scores(protocol, corpus, split, without=system),
    )


def _lines(runs: Sequence[Scores]) -> tuple[Line, ...]:
    """Rows of several runs of one system, averaged."""
    first = runs[0]
    complete = len(first.actions) == first.expected
    lines = []
    for rows in zip(*(scores.rows for scores in runs), strict=True):
        action, metric, horizon_ms, _, windows = rows[0]
        values = torch.tensor([row.value for row in rows], dtype=torch.float64)
        printed = find_published(
            first.system,
            first.protocol,
            action=action,
            metric=metric,
            horizon_ms=horizon_ms,
            complete=complete,
        )
        std = float(values.std()) if len(rows) > 1 else None
        mean = float(values.mean())
        lines.append(Line(first.system, action, metric, horizon_ms, mean, std, windows, printed))
    return tuple(lines)


def _json_row(line: Line) -> dict[str, Any]:
    row: dict[str, Any] = {
        "action": line.action,
        "metric": line.metric,
        "horizon_ms": line.horizon_ms,
        "value": line.value,
        "windows": line.windows,
    }
    if line.std is not None:
        row["std"] = line.std
    if line.published is not None:
        row["published"] = line.published.value
    return row


def _cell(line: Line, digits: int) -> str:
    """A value with its spread, and the printed number in brackets."""
    text = f"{line.value:.{digits}f}"
    if line.std is not None:
        text += f" ± {line.std:.{digits}f}"
    if line.published is not None:
        text += f" ({line.published.value:.{line.published.digits}f})"
    return text
