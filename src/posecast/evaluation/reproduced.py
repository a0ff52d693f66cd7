"""Which recipe reproduces which row of a published table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from posecast.config import did_you_mean
from posecast.errors import ConfigError
from posecast.evaluation.published import PRINTED_NAMES, PublishedTable, published_tables
from posecast.evaluation.scores import Milliseconds, Scores
from posecast.motion.corpus import Corpus

_AMASS: Mapping[str, str] = {
    "Zero-Velocity [20]": "zero-velocity",
    "RNN": "amass-rnn",
    "RNN-mean": "amass-rnn",
    "RNN-PJL": "amass-rnn-pjl",
    "RNN-SPL": "amass-rnn-spl",
    "RNN-SPL-indep.": "amass-rnn-spl-indep",
    "RNN-SPL-random": "amass-rnn-spl-random",
    "RNN-SPL-reverse": "amass-rnn-spl-reverse",
    "Seq2seq [20]*": "amass-seq2seq",
    "Seq2seq-PJL": "amass-seq2seq-pjl",
    "Seq2seq-SPL": "amass-seq2seq-spl",
    "Seq2seq-sampling [20]*": "amass-seq2seq-sampling",
    "Seq2seq-sampling-PJL": "amass-seq2seq-sampling-pjl",
    "Seq2seq-sampling-SPL": "amass-seq2seq-sampling-spl",
    "Seq2seq-dropout": "amass-seq2seq-dropout",
    "Seq2seq-dropout-PJL": "amass-seq2seq-dropout-pjl",
    "Seq2seq-dropout-SPL": "amass-seq2seq-dropout-spl",
    "QuaterNet [25]*": "amass-quaternet",
    "QuaterNet-SPL": "amass-quaternet-spl",
}
_ACRNN: Mapping[str, str] = {
    "quaternions (MSE)": "acrnn-quaternion",
    "quaternions-FK": "acrnn-quaternion-fk",
    "quaternions-positions (MSE)": "acrnn-quaternion-positions",
    "ortho6D (MSE)": "acrnn-ortho6d",
    "ortho6D-positions (MSE)": "acrnn-ortho6d-positions",
    "dual-quaternions (MSE)": "acrnn-dual-quaternion",
    "dual-quaternions (all)": "acrnn-dual-quaternion-all",
}
_HUMAN36M: Mapping[str, str] = {
    printed: ours for ours, names in PRINTED_NAMES.items() for printed in names
}
_BY_PROTOCOL: Mapping[str, Mapping[str, str]] = {"amass-spl": _AMASS, "cmu-acrnn": _ACRNN}
_RECORDINGS: Mapping[str, tuple[str, ...]] = {
    "amass-spl": ("amass-first", "amass"),
    "cmu-acrnn": ("cmu-salsa",),
}
_DIFFERENT: Mapping[str, str] = {
    "amass": "The paper's recordings are those of the first release of AMASS (amass-first); "
    "today's archives have others, so its numbers are near ours at best.",
    "cmu-salsa": "The paper's recordings are probably those of another subject, so its numbers say "
    "little of ours.",
}
# Windows and recordings behind the printed numbers: section 4 and lists of Aksan et al. 2019, and
# Pavllo et al. 2019. Andreou et al. 2022 do not say how many windows they take on Human3.6M.
_WINDOWS: Mapping[str, int] = {"amass-spl": 3304, "h36m-standard": 8, "h36m-128": 256}
_FILES: Mapping[str, Mapping[str, int]] = {
    "amass-first": {"train": 7865, "validation": 343, "test": 385},
}


class PrintedTable(NamedTuple):
    """A table of a paper, as far as it is about one protocol.

    Args:
        name: paper and number, as ``ijcv2019-1``, and the protocol if the table has several.
        parts: one for each metric, with the same systems.
        rows: printed name of a system -> our recipe or baseline.
    """

    name: str
    parts: tuple[PublishedTable, ...]
    rows: Mapping[str, str]

    @property
    def protocol(self) -> str:
        """Name of the protocol."""
        return self.parts[0].protocol

    @property
    def corpora(self) -> tuple[str, ...]:
        """Corpora that the paper's numbers may stand beside, the nearest to the paper's first."""
        return _RECORDINGS.get(self.protocol, ("h36m",))

    @property
    def windows(self) -> int | None:
        """How many windows the paper says it tests on, of an action where there are several."""
        return _WINDOWS.get(self.protocol)

    @property
    def horizons_ms(self) -> tuple[Milliseconds, ...]:
        """Horizons of its columns, ascending."""
        return tuple(sorted({horizon for part in self.parts for horizon in part.horizons_ms}))

    @property
    def title(self) -> str:
        """Table, and authors, title and year of the paper."""
        return f"{self.parts[0].source.split(', ')[1]} of {self.parts[0].title}"


def printed_tables() -> dict[str, PrintedTable]:
    """All tables that are known, by name."""
    sources: dict[str, dict[str, list[PublishedTable]]] = {}
    for part in published_tables():
        name = part.source.replace(", Table ", "-")
        sources.setdefault(name, {}).setdefault(part.protocol, []).append(part)
    found = {
        name if len(by_protocol) == 1 else f"{name}-{protocol}": parts
        for name, by_protocol in sources.items()
        for protocol, parts in by_protocol.items()
    }
    return {
        name: PrintedTable(
            name,
            tuple(parts),
            {system: _ours(part.protocol, system) for part in parts for system in part.systems},
        )
        for name, parts in found.items()
    }


def printed_table(name: str) -> PrintedTable:
    """A table by name.

    Raises:
        ConfigError: there is none; the message lists those there are.
    """
    tables = printed_tables()
    if name not in tables:
        raise ConfigError(f"no table is called {name!r}; {did_you_mean(name, tables)}")
    return tables[name]


def choose_rows(table: PrintedTable, wanted: Sequence[str]) -> dict[str, str]:
    """Rows by printed name or by ours -> our recipe or baseline; all of them for none wanted.

    Raises:
        ConfigError: the table has no such row.
    """
    if not wanted:
        return dict(table.rows)
    chosen: dict[str, str] = {}
    for each in wanted:
        rows = {row: system for row, system in table.rows.items() if each in (row, system)}
        if not rows:
            known = {*table.rows, *table.rows.values()}
            raise ConfigError(f"{table.name} has no row {each!r}; {did_you_mean(each, known)}")
        chosen |= rows
    return chosen


def small_form(system: str) -> str:
    """Name of the small form of a recipe, on the recordings of the recipe itself."""
    # quaternet-vel-small is another system, that of the demo.
    return "quaternet-vel-h36m-small" if system == "quaternet-vel" else f"{system}-small"


def caveats(table: PrintedTable, corpus: Corpus, scores: Scores) -> list[str]:
    """What is to be said where recordings or windows are not quite the paper's; sentences."""
    if corpus.name in _DIFFERENT:
        return [_DIFFERENT[corpus.name]]
    said: list[str] = []
    wanted = table.windows
    others = {action: count for action, count in scores.windows.items() if count != wanted}
    if wanted is not None and others:
        each = "" if "all" in others else " an action"
        counts = ", ".join(
            f"{name} {count}" if each else f"{count}" for name, count in others.items()
        )
        what = "window" if [*others.values()] == [1] else "windows"
        said.append(f"{counts} {what}; the paper has {wanted}{each}: not the same test set.")
    files = _FILES.get(corpus.name, {})
    found = {split: len(corpus.splits.get(split, ())) for split in files}
    if found != files:
        ours, theirs = (", ".join(map(str, counted.values())) for counted in (found, files))
        said.append(
            f"Recordings for training, validation and testing: {ours}; the paper has {theirs}."
        )
    return said


def _ours(protocol: str, printed: str) -> str:
    return _BY_PROTOCOL.get(protocol, _HUMAN36M)[printed]
