"""A finding, and the evidence that findings are drawn from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from posecast.corpora.examination import Facts

Severity = Literal["error", "warning", "note"]
"""An error makes files unusable or results wrong, a warning may; a note is good to know."""


@dataclass(frozen=True)
class Finding:
    """One thing that was found.

    Args:
        problem: what kind of thing, one word or two, the same for all of a kind.
        severity: see ``Severity``.
        message: what was found.
        remedy: what to do.
        files: which files, as paths below the folder examined; empty: the whole.
    """

    problem: str
    severity: Severity
    message: str
    remedy: str
    files: tuple[str, ...] = ()


@dataclass(frozen=True)
class Evidence:
    """What findings are drawn from.

    Args:
        kind: which corpus; "" if none.
        facts: of every file, readable or not.
        splits: what each file is for, as far as it is for something.
        missing: files that the corpus should have.
    """

    kind: str
    facts: tuple[Facts, ...]
    splits: Mapping[str, str | None]
    missing: tuple[str, ...] = ()

    @property
    def readable(self) -> list[Facts]:
        """Facts of the files that can be read."""
        return [fact for fact in self.facts if not fact.error]


def some(names: Sequence[str], most: int = 4) -> str:
    """The first few names, and how many there are besides."""
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return ", ".join(names[:most]) + more
