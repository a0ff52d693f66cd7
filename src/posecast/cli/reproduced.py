"""What was measured of the rows of a printed table, beside what the paper prints."""

from __future__ import annotations

import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from posecast.cli.compared import spread
from posecast.evaluation import METRICS, Predictor, Scores
from posecast.evaluation.published import PublishedTable
from posecast.evaluation.report import markdown_rows
from posecast.evaluation.reproduced import PrintedTable, caveats
from posecast.evaluation.scores import AVERAGE
from posecast.motion.corpus import Corpus


@dataclass(frozen=True, eq=False)
class Found:
    """What was measured of one row.

    Args:
        printed: name of the row in the paper.
        system: name of our recipe or baseline.
        runs: scores, one a seed.
        predictor: the system, with the first seed.
        parameters: trained values; ``None`` for baselines.
        seconds: of training, one a seed.
        epochs: of training.
    """

    printed: str
    system: str
    runs: tuple[Scores, ...]
    predictor: Predictor
    parameters: int | None = None
    seconds: tuple[float, ...] = ()
    epochs: int = 0


@dataclass(frozen=True, eq=False)
class Reproduction:
    """A table of a paper and what was measured of it.

    Args:
        table: the paper's.
        found: rows that were measured, in its order.
        absent: rows whose recordings are missing, with the kind of their corpus.
        corpora: what was measured on.
        comparable: whether the paper's numbers may stand beside ours.
    """

    table: PrintedTable
    found: Sequence[Found]
    absent: Mapping[str, str]
    corpora: Sequence[Corpus]
    comparable: bool

    def to_markdown(self) -> str:
        """What was done, what it cost, then one table a metric, the paper's numbers above ours."""
        table, found = self.table, self.found
        scores = found[-1].runs[0]
        lead = [
            f"Ours: corpus {', '.join(self._names)}, protocol {scores.protocol}; mean ± standard "
            "deviation over seeds.",
            *self.caveats,
        ]
        blocks = [f"# {table.name}: {table.title}", " ".join(lead)]
        if any(each.parameters is not None for each in found):
            blocks.append(markdown_rows(_costs(found)))
        if self.comparable:
            measured = [part for part in table.parts if part.metric in scores.metrics]
            blocks += [_part(part, found) for part in measured]
        else:
            blocks += [_own(metric, found) for metric in scores.metrics]
        notes = [
            f"Left out as its recordings are missing: {row} (--root {kind}=DIR)."
            for row, kind in self.absent.items()
        ]
        notes += [*scores.notes, *(note for corpus in self.corpora for note in corpus.notes)]
        blocks.append("\n".join(f"- {note}" for note in dict.fromkeys(notes)))
        return "\n\n".join(block for block in blocks if block) + "\n"

    @property
    def caveats(self) -> tuple[str, ...]:
        """Why the paper's numbers are left out, or are not quite of the same; sentences."""
        if not self.comparable:
            return (self._unlike(),)
        said = (
            sentence
            for each in self.found
            for corpus in self.corpora
            for sentence in caveats(self.table, corpus, each.runs[0])
        )
        return tuple(dict.fromkeys(said))

    @property
    def _names(self) -> list[str]:
        return sorted({corpus.name for corpus in self.corpora})

    def _unlike(self) -> str:
        """Why the paper's numbers are left out."""
        names = self._names
        if self.found[-1].runs[0].protocol != self.table.protocol:
            what = f"protocol is {self.table.protocol}"
        elif set(names) <= set(self.table.corpora):
            what = f"{self.table.protocol} has other options"
        else:
            what = f"recordings are not those of {', '.join(names)}"
        return f"The paper's {what}: its numbers say nothing of ours, and are left out."

    def to_json(self) -> dict[str, Any]:
        """All numbers by name, those of every seed included."""
        return {
            "table": self.table.name,
            "title": self.table.title,
            "protocol": self.table.protocol,
            "comparable": self.comparable,
            "caveats": list(self.caveats),
            "windows": self.found[-1].runs[0].windows,
            "paper_windows": self.table.windows,
            "rows": [
                {
                    "row": each.printed,
                    "system": each.system,
                    "parameters": each.parameters,
                    "training_seconds": list(each.seconds),
                    "seeds": [[row._asdict() for row in run.rows] for run in each.runs],
                    "paper": {
                        part.metric: {
                            action: list(values)
                            for action, values in part.systems.get(each.printed, {}).items()
                        }
                        for part in self.table.parts
                    },
                }
                for each in self.found
            ],
        }


def _costs(found: Sequence[Found]) -> list[list[str]]:
    """Rows of what each system is and took."""
    rows = [
        ["row", "system", "parameters", "epochs", "seeds", "training (s)"],
        ["---", "---", "---:", "---:", "---:", "---:"],
    ]
    for each in found:
        if each.parameters is not None:
            rows.append(
                [
                    each.printed,
                    each.system,
                    f"{each.parameters:,}",
                    str(each.epochs),
                    str(len(each.runs)),
                    spread(each.seconds),
                ]
            )
    return rows


def _part(part: PublishedTable, found: Sequence[Found]) -> str:
    """One metric: of every action and system what the paper prints, and what was measured."""
    metric = METRICS[part.metric]
    columns = [f"{horizon:g} ms" for horizon in part.horizons_ms]
    rows = [
        ["action", "system", "whose", *columns],
        ["---", "---", "---", *["---:" for _ in columns]],
    ]
    scores = found[-1].runs[0]
    measured = scores.actions
    for action in (*measured, *((AVERAGE,) if len(measured) > 1 else ())):
        for each in found:
            paper = _paper(part, each.printed, action, scores)
            own = _ours(each, part.metric, action, part.horizons_ms)
            label = action if action != AVERAGE else f"average of {len(measured)}"
            digits = metric.digits
            if paper is not None:
                cells = [f"{value:.{part.digits}f}" for value in paper.values]
                rows.append([label, each.printed, paper.whose, *cells])
            rows.append([label, each.system, "ours", *(spread(v, digits) for v in own)])
    return f"**{metric.title} ({metric.unit})**: `{part.metric}`\n\n{markdown_rows(rows)}"


def _own(name: str, found: Sequence[Found]) -> str:
    """One metric of ours alone."""
    metric, horizons = METRICS[name], found[-1].runs[0].horizons_ms
    columns = [f"{horizon:g} ms" for horizon in horizons]
    rows = [["system", *columns], ["---", *["---:" for _ in columns]]]
    for each in found:
        values = _ours(each, name, AVERAGE, horizons)
        rows.append([each.system, *(spread(value, metric.digits) for value in values)])
    return f"**{metric.title} ({metric.unit})**: `{name}`\n\n{markdown_rows(rows)}"


class _Paper(NamedTuple):
    """A row of the paper: whose its values are said to be, and one a horizon."""

    whose: str
    values: tuple[float, ...]


def _paper(part: PublishedTable, printed: str, action: str, like: Scores) -> _Paper | None:
    """What the paper prints, or the mean of its cells where it has no average of the same actions.

    Args:
        part: one metric of a table.
        printed: name of the row.
        action: one, or ``average`` over those that were measured.
        like: what was measured.
    """
    cells, measured = part.systems.get(printed, {}), like.actions
    if action in cells and (action != AVERAGE or len(measured) == like.expected):
        return _Paper("paper", cells[action])
    if action != AVERAGE or not all(each in cells for each in measured):
        return None
    columns = zip(*(cells[each] for each in measured), strict=True)
    means = tuple(statistics.fmean(column) for column in columns)
    return _Paper(f"paper, mean of the {len(measured)}", means)


def _ours(
    found: Found, metric: str, action: str, horizons: Sequence[int | float]
) -> list[tuple[float, ...]]:
    """For each horizon the values of all seeds."""
    return [tuple(run.value(metric, horizon, action) for run in found.runs) for horizon in horizons]
