"""Bootstrap intervals of averages over actions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import torch
from torch import Tensor


class Interval(NamedTuple):
    """Ends of a bootstrap interval, one a horizon."""

    low: tuple[float, ...]
    high: tuple[float, ...]


def bootstrap(
    groups: Sequence[Tensor],
    *,
    generator: torch.Generator,
    level: float = 0.95,
    resamples: int = 2000,
) -> Interval:
    """Percentile interval of the average over actions, resampling windows within each action.

    Windows may overlap, so the true uncertainty is larger: a lower bound, not a promise.

    Args:
        groups: values (windows, horizons) of each action.
        generator: makes the draws.
        level: share of the resampled averages between the ends.
        resamples: how many averages are drawn.
    """
    draws = []
    for values in groups:
        chosen = torch.randint(len(values), (resamples, len(values)), generator=generator)
        draws.append(values[chosen].mean(1))
    averages = torch.stack(draws).mean(0)
    tails = averages.new_tensor([(1 - level) / 2, (1 + level) / 2])
    low, high = torch.quantile(averages, tails, dim=0)
    return Interval(tuple(low.tolist()), tuple(high.tolist()))
