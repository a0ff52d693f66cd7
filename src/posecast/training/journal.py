"""What a run tells as it goes on: tables in CSV, and a progress bar or a line now and then."""

from __future__ import annotations

import csv
import time
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from posecast.io.atomic import atomic_write

SECONDS_BETWEEN_LINES = 30.0


class Table:
    """A CSV file that grows by one row an epoch and can be taken back to an earlier epoch.

    Numbers are written so that they read back exactly. A row with other names, as of a run that
    was asked to measure something else, adds columns; cells that were not measured are empty.

    Args:
        path: the file; its folder must exist.
        epoch: rows of later epochs are dropped, as a run that goes on will write them again.
            0 begins the table anew.
    """

    def __init__(self, path: Path, epoch: int) -> None:
        self.path = path
        self._columns: list[str] = []
        if epoch == 0 or not path.exists():
            path.unlink(missing_ok=True)
            return
        with path.open(newline="", encoding="utf-8") as file:
            head, *rows = list(csv.reader(file)) or [[]]
        # A kill may have left half a row at the end.
        kept = [row for row in rows if len(row) == len(head) and int(row[0]) <= epoch]
        with atomic_write(path) as temporary, temporary.open("w", newline="") as file:
            csv.writer(file, lineterminator="\n").writerows([head, *kept] if head else [])
        self._columns = head

    def add(self, epoch: int, row: Mapping[str, float]) -> None:
        """Append the row of an epoch."""
        new = [name for name in ("epoch", *row) if name not in self._columns]
        if new:
            self._widen(new)
        cells = {"epoch": str(epoch), **{name: repr(value) for name, value in row.items()}}
        with self.path.open("a", newline="", encoding="utf-8") as file:
            csv.writer(file, lineterminator="\n").writerow(
                [cells.get(name, "") for name in self._columns]
            )

    def _widen(self, new: list[str]) -> None:
        """Add columns on the right, empty so far."""
        rows: list[list[str]] = []
        if self._columns:
            with self.path.open(newline="", encoding="utf-8") as file:
                _, *rows = list(csv.reader(file))
        self._columns = [*self._columns, *new]
        with atomic_write(self.path) as temporary, temporary.open("w", newline="") as file:
            csv.writer(file, lineterminator="\n").writerows(
                [self._columns, *([*row, *("" for _ in new)] for row in rows)]
            )


class Display:
    """Shows how far a run has come, on standard error.

    A bar on a terminal; elsewhere, as in a log file, one line every half minute and at the end.

    Args:
        begin: epochs done before.
        epochs: epochs in all.
        shown: whether anything is shown.
        console: where to; ``None``: standard error.
    """

    def __init__(
        self, *, begin: int, epochs: int, shown: bool = True, console: Console | None = None
    ) -> None:
        self.begin, self.epochs, self.shown = begin, epochs, shown
        self.console = console or Console(stderr=True)
        self.started = self.told = time.monotonic()
        self.bar = Progress(
            TextColumn("training"),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("{task.fields[facts]}"),
            TimeRemainingColumn(),
            console=self.console,
            disable=not shown or not self.console.is_terminal,
        )
        self.task = self.bar.add_task("training", total=epochs, completed=begin, facts="")

    def __enter__(self) -> Display:
        self.bar.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.bar.stop()

    def update(self, done: int, facts: Mapping[str, float]) -> None:
        """Show that ``done`` epochs are done, with a few numbers by name."""
        words = "  ".join(f"{name} {value:.4g}" for name, value in facts.items())
        self.bar.update(self.task, completed=done, facts=words)
        now = time.monotonic()
        due = done == self.epochs or now - self.told >= SECONDS_BETWEEN_LINES
        if not self.shown or self.console.is_terminal or not due:
            return
        self.told = now
        left = (now - self.started) / (done - self.begin) * (self.epochs - done)
        self.console.print(
            f"training: epoch {done} of {self.epochs}  {words}  {left / 60:.1f} min left",
            highlight=False,
            soft_wrap=True,
        )
