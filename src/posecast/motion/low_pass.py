"""Gaussian low-pass filters in time, and what they take to lie beyond the ends."""

from __future__ import annotations

from typing import Literal

import torch
from jaxtyping import Float, Int
from torch import Tensor

_REACH = 4.0
"""Standard deviations after which the kernel is cut off, as in SciPy."""


def low_pass(
    values: Float[Tensor, "frames *channels"], sigma: float
) -> Float[Tensor, "frames *channels"]:
    """Low-pass that does not cut corners: Gaussian of the values, plus Gaussian of what it missed.

    A Gaussian pulls a circle inwards by the share a = (w sigma)^2 / 2 of its radius, w being the
    angle turned a frame; what is left here is about a^2. Lines stay lines up to their ends
    (``ends="odd"``).

    Args:
        sigma: standard deviation, frames. An oscillation of period P is left with the share
            1 - (1 - g)^2 of its amplitude, where g = exp(-2 pi^2 sigma^2 / P^2).

    Source: Tukey 1977, Exploratory Data Analysis ("twicing").
    """
    once = gaussian(values, sigma)
    return once + gaussian(values - once, sigma)


def gaussian(
    values: Float[Tensor, "frames *channels"],
    sigma: float,
    *,
    ends: Literal["odd", "even"] = "odd",
) -> Float[Tensor, "frames *channels"]:
    """Gaussian low-pass along the first axis.

    Args:
        sigma: standard deviation, frames, positive.
        ends: beyond the last value the values before it again, backwards: ``"odd"`` turned about
            that value by half a turn, so that a line goes on straight; ``"even"`` as they were,
            the last one twice ("reflect" in SciPy).
    """
    half = int(_REACH * sigma + 0.5)
    kernel = torch.exp(-0.5 * (torch.arange(-half, half + 1, dtype=torch.float64) / sigma) ** 2)
    kernel = (kernel / kernel.sum()).to(values)
    places = torch.arange(-half, len(values) + half)
    longer = _odd(values, places) if ends == "odd" else _even(values, places)
    rows = longer.reshape(len(longer), -1).t()[:, None]
    smooth = torch.nn.functional.conv1d(rows, kernel[None, None])
    return smooth[:, 0].t().reshape(values.shape)


def _odd(values: Tensor, places: Int[Tensor, "places"]) -> Tensor:
    """Values at places before, within and beyond, continued by half turns about the ends."""
    last = len(values) - 1
    if last == 0:
        return values.expand(len(places), *values.shape[1:])
    round_trips = torch.div(places, 2 * last, rounding_mode="floor")
    there = places - 2 * last * round_trips
    back = (there > last).reshape(-1, *(1,) * (values.ndim - 1))
    mirrored = 2 * values[last] - values[(2 * last - there).clamp(max=last)]
    within = torch.where(back, mirrored, values[there.clamp(max=last)])
    drift = 2 * round_trips.reshape(back.shape) * (values[last] - values[0])
    return within + drift


def _even(values: Tensor, places: Int[Tensor, "places"]) -> Tensor:
    """Values at places before, within and beyond, continued by reflection."""
    count = len(values)
    there = torch.remainder(places, 2 * count)
    return values[torch.where(there < count, there, 2 * count - 1 - there)]
