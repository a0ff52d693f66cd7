"""Paired timing: all candidates in every round, in one process, shuffled; ratios round by round."""

from __future__ import annotations

import argparse
import json
import os
import random
import statistics
import time
from collections.abc import Callable, Mapping
from typing import NamedTuple


class Timing(NamedTuple):
    """How long one candidate takes, alone and beside the reference.

    Args:
        median_seconds: median over the rounds.
        ratio: median over the rounds of time(reference) / time(candidate); above 1 is faster.
        foreign_load: median share of a core that other processes used meanwhile; ``None`` where
            the system does not tell. Above about 0.15 the seconds are not to be quoted.
    """

    median_seconds: float
    ratio: float
    foreign_load: float | None


def paired(
    candidates: Mapping[str, Callable[[], object]],
    reference: str,
    rounds: int = 7,
    warmup: int = 2,
    seed: int = 0,
) -> dict[str, Timing]:
    """Time every candidate once a round, in an order shuffled anew for each round.

    A machine whose speed drifts slows all candidates of a round alike, so the ratio within a
    round is steadier than the ratio of two medians.

    Args:
        candidates: what to call, by name; results are dropped.
        reference: name of the candidate that the ratios refer to.
        rounds: timed rounds.
        warmup: rounds before them that are not timed.
        seed: of the shuffling.
    """
    if reference not in candidates:
        raise ValueError(f"reference {reference!r} is not among {', '.join(candidates)}")
    shuffle = random.Random(seed)
    names = list(candidates)
    seconds: dict[str, list[float]] = {name: [] for name in names}
    loads: dict[str, list[float]] = {name: [] for name in names}
    for round_ in range(warmup + rounds):
        shuffle.shuffle(names)
        for name in names:
            took, load = _once(candidates[name])
            if round_ >= warmup:
                seconds[name].append(took)
                if load is not None:
                    loads[name].append(load)
    return {
        name: Timing(
            median_seconds=statistics.median(seconds[name]),
            ratio=statistics.median(
                base / own for base, own in zip(seconds[reference], seconds[name], strict=True)
            ),
            foreign_load=statistics.median(loads[name]) if loads[name] else None,
        )
        for name in candidates
    }


def rows_of(
    name: str, timings: Mapping[str, Timing], *, times: float = 1.0
) -> list[dict[str, object]]:
    """A row ``name, candidate, seconds, ratio, foreign_load`` for every candidate.

    Args:
        name: of what they all do.
        timings: of the candidates.
        times: how many calls the seconds are to be of.
    """
    return [
        {
            "name": name,
            "candidate": candidate,
            "seconds": timing.median_seconds * times,
            "ratio": timing.ratio,
            "foreign_load": timing.foreign_load,
        }
        for candidate, timing in timings.items()
    ]


def table(rows: list[dict[str, object]]) -> str:
    """Rows with the same keys as a plain text table; numbers to three digits."""
    if not rows:
        return ""
    cells = [list(rows[0]), *([_format(value) for value in row.values()] for row in rows)]
    widths = [max(len(row[column]) for row in cells) for column in range(len(cells[0]))]
    return "\n".join(
        "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in cells
    )


def main_of(
    run: Callable[..., list[dict[str, object]]], description: str | None, rounds: int
) -> None:
    """Read options from the command line, and print the rows as a table, or as JSON."""
    parser = argparse.ArgumentParser(
        description=description, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rounds", type=int, default=rounds, help=f"default {rounds}")
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")
    arguments = parser.parse_args()
    rows = run(rounds=arguments.rounds)
    print(json.dumps(rows, indent=1) if arguments.json else table(rows))


def _format(value: object) -> str:
    if value is None:
        return "-"
    return f"{value:.3g}" if isinstance(value, float) else str(value)


def _once(call: Callable[[], object]) -> tuple[float, float | None]:
    """Seconds of one call and the foreign load meanwhile, in cores."""
    busy_before, own_before = _busy_seconds(), sum(os.times()[:4])
    start = time.perf_counter()
    call()
    took = time.perf_counter() - start
    busy_after, own_after = _busy_seconds(), sum(os.times()[:4])
    if busy_before is None or busy_after is None or took < _CLOCK_TICK * 5:
        return took, None
    return took, max(0.0, (busy_after - busy_before) - (own_after - own_before)) / took


_CLOCK_TICK = 0.01
"""Seconds; the resolution of the processor times that Linux gives."""


def _busy_seconds() -> float | None:
    """Processor time spent by the whole machine so far, or ``None`` where it does not say."""
    try:
        with open("/proc/stat", encoding="ascii") as lines:  # noqa: PTH123 - hot, no Path needed
            user, nice, system, _, _, interrupts, soft, *_ = map(int, lines.readline().split()[1:])
    except OSError:
        return None
    return (user + nice + system + interrupts + soft) * _CLOCK_TICK
