"""Rhythm: how step rate and time on the floor follow from speed, and when each foot comes down."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from posecast.corpora.gait.body import Body
from posecast.corpora.gait.manner import Manner
from posecast.corpora.gait.pace import GRAVITY, GRID_RATE, Journey
from posecast.corpora.gait.signals import step

FOREVER = 1e3
"""Seconds: so long a foot has stood that stands at first, and will stand that stands last."""


SLOWEST = 0.42
"""Least step rate while moving at all, in units of the square root of gravity over leg length."""


LONGEST = (0.84, 1.36)
"""Longest step in walking and in running, in leg lengths."""


def running(froude: Float[ndarray, " times"]) -> Float[ndarray, " times"]:
    """0 in walking, 1 in running, in between around the speed where people change over.

    Args:
        froude: speed over the square root of gravity times leg length; people start to run near
            0.7 (Alexander 1989).
    """
    return step((froude - 0.56) / 0.14)


def step_rate(froude: Float[ndarray, " times"]) -> Float[ndarray, " times"]:
    """Steps a second, in units of the square root of gravity over leg length.

    Walking keeps the ratio of step length to step rate (Sekiya et al. 1996); running
    lengthens the step and hardly quickens it.
    """
    walk = np.sqrt(np.maximum(froude, 0.0) / 1.40)
    run = 0.72 + 0.09 * froude
    share = running(froude)
    return (1 - share) * walk + share * run


def duty(froude: Float[ndarray, " times"]) -> Float[ndarray, " times"]:
    """Share of the cycle that a foot is on the floor; below a half there is flight."""
    walk = 0.69 - 0.19 * np.minimum(froude, 0.6)
    run = np.maximum(0.42 - 0.20 * (froude - 0.72), 0.27)
    share = running(froude)
    return (1 - share) * walk + share * run


@dataclass(frozen=True, eq=False)
class Rhythm:
    """When to step.

    Args:
        count: steps taken so far, on the planning grid; whole numbers are touch-downs.
        rate: steps a second, on the planning grid.
        froude: dimensionless speed, on the planning grid.
        numbers: number of each touch-down; even ones are of the right foot.
        touchdowns: when they happen, seconds.
    """

    count: Float[ndarray, " grid"]
    rate: Float[ndarray, " grid"]
    froude: Float[ndarray, " grid"]
    numbers: Int[ndarray, " steps"]
    touchdowns: Float[ndarray, " steps"]


def keep_rhythm(journey: Journey, body: Body, manner: Manner, *, first: int, part: float) -> Rhythm:
    """Turn a speed into touch-downs.

    Each stretch of moving that ends in a rest ends with a touch-down; between two rests the rate
    is adjusted by a few percent so that whole steps fit.

    Args:
        first: number of the step before the first; its parity says which foot goes first.
        part: share of a step already taken when the clip begins in mid-motion.
    """
    times = journey.times
    froude = journey.speed.values / np.sqrt(GRAVITY * body.leg)
    share = running(froude)
    rate = np.maximum(step_rate(froude), SLOWEST) * np.sqrt(GRAVITY / body.leg)
    rate = rate * manner.tempo ** (1 - 0.6 * share)
    longest = (LONGEST[0] + share * (LONGEST[1] - LONGEST[0])) * body.leg
    rate = np.maximum(rate, journey.speed.values / longest)
    count = np.full_like(times, first)
    numbers, touchdowns = [first - 1, first], [-FOREVER - 1, -FOREVER]
    for begin, end in _stretches(journey):
        moving = slice(int(np.searchsorted(times, begin)), int(np.searchsorted(times, end)) + 1)
        taken = np.concatenate([[0.0], np.cumsum((rate[moving][1:] + rate[moving][:-1]) / 2)])
        taken /= GRID_RATE
        total = taken[-1]
        if begin == -np.inf:
            taken += np.ceil(total) - total if end < np.inf else part
        elif end < np.inf:
            taken *= max(2, round(total)) / total
        last = numbers[-1]
        whole = np.arange(1, int(taken[-1] + 1e-6) + 1)
        touchdowns.extend(np.interp(whole, taken, times[moving]))
        numbers.extend(last + whole)
        count[moving] = last + taken
        count[moving.stop :] = last + taken[-1]
    return Rhythm(count, rate, froude, np.array(numbers), np.array(touchdowns))


def _stretches(journey: Journey) -> list[tuple[float, float]]:
    """Stretches of moving, between the rests; an open end is infinite."""
    edges = [-np.inf, *(edge for rest in journey.rests for edge in rest), np.inf]
    pairs = zip(edges[::2], edges[1::2], strict=True)
    return [(begin, end) for begin, end in pairs if begin < end]
