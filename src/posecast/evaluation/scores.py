"""Scores: what a predictor got under a protocol, window by window and as rows of a table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from posecast.errors import ConfigError

Milliseconds = int | float
"""Times of a protocol; whole numbers stay whole in tables and JSON."""

AVERAGE = "average"


class Row(NamedTuple):
    """One number of a table.

    Args:
        action: group of windows; ``average`` is the unweighted mean over all groups.
        metric: name in ``METRICS``.
        horizon_ms: time after the last true frame, milliseconds.
        value: mean over the windows, in the metric's unit.
        windows: how many windows are behind the value.
    """

    action: str
    metric: str
    horizon_ms: Milliseconds
    value: float
    windows: int


@dataclass(frozen=True)
class Scores:
    """What a predictor got under a protocol.

    Args:
        system: name of the predictor.
        corpus, protocol, split: where.
        horizons_ms: horizons of the columns.
        values: (action, metric) -> values (windows, horizons), float64.
        expected: number of actions if no file were missing.
        missing: files that would have been needed.
        notes: how the windows were chosen and what was left out.
        joints_left_out: metric -> joints that never enter its value.
    """

    system: str
    corpus: str
    protocol: str
    split: str
    horizons_ms: tuple[Milliseconds, ...]
    values: Mapping[tuple[str, str], Float[Tensor, "_ _"]]
    expected: int
    missing: tuple[str, ...]
    notes: tuple[str, ...]
    joints_left_out: Mapping[str, tuple[str, ...]]

    @property
    def actions(self) -> tuple[str, ...]:
        """Actions that were measured."""
        return tuple(dict.fromkeys(action for action, _ in self.values))

    @property
    def metrics(self) -> tuple[str, ...]:
        """Metrics that were measured."""
        return tuple(dict.fromkeys(metric for _, metric in self.values))

    @property
    def windows(self) -> dict[str, int]:
        """How many windows of each action were measured."""
        return {action: len(values) for (action, _), values in self.values.items()}

    @cached_property
    def rows(self) -> tuple[Row, ...]:
        """A row for every action, metric and horizon, then those of the average over actions."""
        rows = [
            Row(action, metric, horizon, value, len(values))
            for (action, metric), values in self.values.items()
            for horizon, value in zip(self.horizons_ms, values.mean(0).tolist(), strict=True)
        ]
        for metric in self.metrics:
            groups = [self.values[action, metric] for action in self.actions]
            mean = torch.stack([values.mean(0) for values in groups]).mean(0)
            windows = sum(len(values) for values in groups)
            rows += [
                Row(AVERAGE, metric, horizon, value, windows)
                for horizon, value in zip(self.horizons_ms, mean.tolist(), strict=True)
            ]
        return tuple(rows)

    def value(self, metric: str, horizon_ms: Milliseconds, action: str = AVERAGE) -> float:
        """One number by name.

        Raises:
            ConfigError: it was not measured.
        """
        for row in self.rows:
            if (row.action, row.metric, row.horizon_ms) == (action, metric, horizon_ms):
                return row.value
        raise ConfigError(
            f"no value for action {action!r}, metric {metric!r} at {horizon_ms:g} ms; measured "
            f"were {', '.join((*self.actions, AVERAGE))}; {', '.join(self.metrics)}; "
            f"{list_ms(self.horizons_ms)}"
        )


def list_ms(horizons: Sequence[Milliseconds]) -> str:
    """Horizons in words, for messages."""
    return ", ".join(f"{horizon:g}" for horizon in horizons) + " ms"
