"""Repertoire: what is performed in a corpus, by whom, in which style, at which speeds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from posecast.corpora.gait.body import CAST, Body
from posecast.corpora.gait.manner import STYLES, Manner
from posecast.corpora.gait.pace import GRAVITY, Change, Program

WALK, JOG, RUN = (0.37, 0.48), (0.78, 0.90), (1.00, 1.30)
"""Ranges of speed over the square root of gravity times leg length: 1.1 to 1.4 m/s, 2.2 to 2.6
and 2.9 to 3.7 m/s for an average adult."""


@dataclass(frozen=True)
class Act:
    """One entry of the repertoire.

    Args:
        action: what it is called; protocols group by it.
        gait: walk, jog, run, or mixed.
        paths: kinds of path it may follow.
        styles: styles it may be performed in.
        program: draws the speeds, given the generator, the length in seconds and the speed (m/s)
            that a dimensionless 1.0 stands for.
    """

    action: str
    gait: str
    paths: tuple[str, ...]
    styles: tuple[str, ...]
    program: Callable[[np.random.Generator, float, float], Program]


def _steady(range_: tuple[float, float]) -> Callable[[np.random.Generator, float, float], Program]:
    """One speed for the whole clip, from a range."""

    def draw(generator: np.random.Generator, seconds: float, unit: float) -> Program:
        return Program(unit * generator.uniform(*range_))

    return draw


def _start_stop(generator: np.random.Generator, seconds: float, unit: float) -> Program:
    """Stand, walk, stop, stand; in a long clip once more."""
    changes: list[Change] = []
    time = generator.uniform(0.5, 1.0)
    bouts = 2 if seconds >= 10.0 else 1
    length = (seconds - time - 1.0) / bouts
    for _ in range(bouts):
        starting, stopping = generator.uniform(1.0, 1.4), generator.uniform(1.1, 1.5)
        resting = generator.uniform(0.5, 1.0)
        changes.append(Change(time, starting, unit * generator.uniform(*WALK)))
        stop = max(time + length - resting - stopping, time + starting + 0.3)
        changes.append(Change(stop, stopping, 0.0))
        time += length
    return Program(0.0, tuple(changes))


def _speed_change(generator: np.random.Generator, seconds: float, unit: float) -> Program:
    """Through two or three gaits, faster and slower."""
    orders = (
        *((WALK, JOG, WALK), (WALK, RUN, JOG), (JOG, WALK, JOG)),
        *((RUN, JOG, WALK), (WALK, JOG, RUN), (JOG, RUN, WALK)),
    )
    levels = [unit * generator.uniform(*range_) for range_ in generator.choice(orders)]
    share = seconds / len(levels)
    changes = [
        Change(share * (place + generator.uniform(0.75, 0.95)), generator.uniform(1.2, 1.8), level)
        for place, level in enumerate(levels[1:])
    ]
    return Program(levels[0], tuple(changes))


_ANY = tuple(STYLES)
_LIVELY = ("neutral", "relaxed", "brisk", "proud")

REPERTOIRE = (
    Act("walk", "walk", ("straight",), _ANY, _steady(WALK)),
    Act("turn", "walk", ("corners",), _ANY, _steady(WALK)),
    Act("jog", "jog", ("straight", "wandering"), (*_LIVELY, "tired"), _steady(JOG)),
    Act("start-stop", "walk", ("straight", "arc", "wandering"), _ANY, _start_stop),
    Act("walk", "walk", ("wandering", "arc"), _ANY, _steady(WALK)),
    Act("run", "run", ("straight", "wandering"), _LIVELY, _steady(RUN)),
    Act("turn", "walk", ("eight", "s-curve"), _ANY, _steady(WALK)),
    Act("jog", "jog", ("arc", "s-curve", "eight"), (*_LIVELY, "tired"), _steady(JOG)),
    Act("speed-change", "mixed", ("straight", "wandering", "arc"), _LIVELY, _speed_change),
    Act("walk", "walk", ("wandering", "s-curve"), _ANY, _steady(WALK)),
    Act("run", "run", ("arc", "s-curve"), _LIVELY, _steady(RUN)),
    Act("turn", "walk", ("corners", "arc"), _ANY, _steady(WALK)),
)
"""Performed one after the other, again and again."""


def speed_unit(act: Act, body: Body, manner: Manner) -> float:
    """The speed in m/s that a dimensionless 1.0 stands for: bigger bodies are faster.

    Who walks slowly is not as slow in running, or it would be walking.
    """
    pace = manner.pace if act.gait == "walk" else manner.pace**0.5
    return float(np.sqrt(GRAVITY * body.leg)) * pace


def reserved_style(subject: int) -> str | None:
    """The style in which a subject is seen in test clips only; two of the eight have none."""
    styles = list(STYLES)
    place = 3 * (5 - subject) % len(CAST)
    return styles[place] if place < len(styles) else None
