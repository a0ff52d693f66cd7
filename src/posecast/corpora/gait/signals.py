"""Smooth functions of time: sampled curves, easing between two states, slow random variation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from numpy import ndarray

SINES = 5
"""Sine waves in one wobble: enough that it does not seem to repeat within a clip."""


@dataclass(frozen=True, eq=False)
class Sampled:
    """A smooth curve through equally spaced samples; it stays at its ends outside of them.

    Args:
        start: where the first sample lies (seconds, or metres of arc length).
        rate: samples per unit.
        values: the samples; the first axis is time or arc length.
    """

    start: float
    rate: float
    values: Float[ndarray, "samples *channels"]

    def __call__(self, at: Float[ndarray, " times"]) -> Float[ndarray, "times *channels"]:
        """Values between the samples (Catmull and Rom's cubic: continuous slope)."""
        last = len(self.values) - 1
        place = np.clip((at - self.start) * self.rate, 0, last)
        left = np.minimum(place.astype(int), last - 1)
        u = (place - left).reshape(-1, *[1] * (self.values.ndim - 1))
        before, here = self.values[np.maximum(left - 1, 0)], self.values[left]
        there, after = self.values[left + 1], self.values[np.minimum(left + 2, last)]
        rise, slope, next_slope = there - here, (there - before) / 2, (after - here) / 2
        second = 3 * rise - 2 * slope - next_slope
        third = slope + next_slope - 2 * rise
        return here + u * (slope + u * (second + u * third))


class State(NamedTuple):
    """Value, rate and acceleration at one end of an eased movement, one entry a movement."""

    value: Float[ndarray, " moves"] | float
    rate: Float[ndarray, " moves"] | float = 0.0
    acceleration: Float[ndarray, " moves"] | float = 0.0


def ease(u: Float[ndarray, " moves"], start: State, end: State) -> Float[ndarray, " moves"]:
    """Quintic from one state at u = 0 to another at u = 1; outside it keeps the end values."""
    u = np.clip(u, 0, 1)
    gap = end.value - start.value - start.rate - start.acceleration / 2
    rate = end.rate - start.rate - start.acceleration
    acceleration = end.acceleration - start.acceleration
    third = 10 * gap - 4 * rate + acceleration / 2
    fourth = -15 * gap + 7 * rate - acceleration
    fifth = 6 * gap - 3 * rate + acceleration / 2
    bend = start.acceleration / 2 + u * (third + u * (fourth + u * fifth))
    return start.value + u * (start.rate + u * bend)


def step(u: Float[ndarray, "*moves"]) -> Float[ndarray, "*moves"]:
    """From 0 at u <= 0 to 1 at u >= 1 with zero rate and acceleration at both ends."""
    u = np.clip(u, 0, 1)
    return u * u * u * (10 + u * (6 * u - 15))


def glide(
    u: Float[ndarray, " moves"],
    gather: Float[ndarray, " moves"] | float,
    settle: Float[ndarray, " moves"] | float,
) -> Float[ndarray, " moves"]:
    """From 0 to 1 at even speed, gathering it and settling down softly.

    A swinging foot moves like this: its top speed is lower than a quintic's.

    Args:
        gather, settle: shares of the time that the two ramps take.
    """
    u = np.clip(u, 0, 1)
    way = 1 - (gather + settle) / 2
    begun, left = np.minimum(u / gather, 1), np.minimum((1 - u) / settle, 1)
    gone = gather * begun**3 * (1 - begun / 2) + np.maximum(u - gather, 0)
    to_go = settle * left**3 * (1 - left / 2)
    return np.where(u > 1 - settle, way - to_go, gone) / way


def smooth(
    values: Float[ndarray, "samples *channels"], sigma: float
) -> Float[ndarray, "samples *channels"]:
    """Gaussian low-pass along the first axis; the ends are held.

    Args:
        sigma: standard deviation of the kernel, in samples.
    """
    half = max(1, round(4 * sigma))
    kernel = np.exp(-0.5 * (np.arange(-half, half + 1) / sigma) ** 2)
    return _filter(values, kernel / kernel.sum())


def smooth_cover(values: Float[ndarray, " samples"], half: int) -> Float[ndarray, " samples"]:
    """A smooth curve that is nowhere below ``values`` and stays close above.

    The running maximum over ``half`` samples to both sides, averaged by a kernel no wider than
    that: every term of the average is a maximum over the sample itself.
    """
    padded = np.pad(values, half, mode="edge")
    highest = np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1).max(axis=-1)
    kernel = 1 + np.cos(np.pi * np.arange(-half, half + 1) / (half + 1))
    return _filter(highest, kernel / kernel.sum())


def _filter(
    values: Float[ndarray, "samples *channels"], kernel: Float[ndarray, " taps"]
) -> Float[ndarray, "samples *channels"]:
    half = len(kernel) // 2
    padded = np.pad(values, [(half, half), *[(0, 0)] * (values.ndim - 1)], mode="edge")
    windows = np.lib.stride_tricks.sliding_window_view(padded, len(kernel), axis=0)
    return windows @ kernel


@dataclass(frozen=True, eq=False)
class Wobble:
    """Slow variation about zero with unit variance: what keeps a walk from repeating itself."""

    frequencies: Float[ndarray, " sines"]
    phases: Float[ndarray, " sines"]

    @classmethod
    def draw(cls, generator: np.random.Generator, slowest: float, fastest: float) -> Wobble:
        """Draw frequencies between two bounds, in Hz (or per metre)."""
        frequencies = generator.uniform(slowest, fastest, SINES)
        return cls(frequencies, generator.uniform(0, 2 * np.pi, SINES))

    def __call__(self, at: Float[ndarray, " times"]) -> Float[ndarray, " times"]:
        angles = 2 * np.pi * at[:, None] * self.frequencies + self.phases
        return np.sqrt(2 / SINES) * np.sin(angles).sum(axis=-1)
