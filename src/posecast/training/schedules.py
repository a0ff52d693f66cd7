"""What changes as training goes on: random streams addressed by epoch, and the learning rate."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import torch

from posecast.errors import ConfigError


def derived_seed(seed: int, *place: str | int) -> int:
    """A seed for one place of one run, such as ``derived_seed(7, "feed", epoch, step)``.

    Every random decision has an address instead of a turn in a queue, so a resumed run, or one
    spread over more processes, decides the same things.
    """
    text = "/".join(str(part) for part in (seed, *place))
    return int.from_bytes(hashlib.blake2b(text.encode(), digest_size=8).digest(), "big") >> 1


def derived_generator(seed: int, *place: str | int) -> torch.Generator:
    """A generator on the CPU for one place of one run: see ``derived_seed``."""
    return torch.Generator().manual_seed(derived_seed(seed, *place))


@dataclass(frozen=True)
class LearningRate:
    """``start * decay ** epoch``, or a step function of the updates made so far.

    Args:
        start: learning rate of the first update.
        decay: factor of each decay; 1 keeps the rate.
        every: updates between two decays, ``floor(updates / every)`` in the exponent (Martinez et
            al. 2017); ``None`` decays once an epoch (Pavllo et al. 2018).
        points: updates before which the rate decays, instead of regularly (Jain et al. 2016).

    Raises:
        ConfigError: a rate or decay that is not positive, a decay above 1, ``every`` or points
            below 1 or out of order, or both.
    """

    start: float = 1e-3
    decay: float = 0.999
    every: int | None = None
    points: tuple[int, ...] | None = None

    def __post_init__(self) -> None:
        if not self.start > 0:
            raise ConfigError(f"learning rate {self.start}: expected more than 0")
        if not 0 < self.decay <= 1:
            raise ConfigError(f"learning-rate decay {self.decay}: expected more than 0, at most 1")
        if self.every is not None and self.every < 1:
            raise ConfigError(f"learning rate decays every {self.every} updates: expected >= 1")
        if self.points is not None:
            if self.every is not None:
                raise ConfigError("learning rate decays regularly or at given updates; choose one")
            _check_points(self.points, "learning rate decays")

    def at(self, *, epoch: int, update: int) -> float:
        """The rate for an update, both counted from 0."""
        if self.points is not None:
            return self.start * self.decay ** sum(update >= point for point in self.points)
        return self.start * self.decay ** (epoch if self.every is None else update // self.every)


@dataclass(frozen=True)
class NoiseLevels:
    """Noise on the inputs that grows as training goes on (Fragkiadaki et al. 2015).

    Args:
        levels: pairs of a number of updates and the standard deviation from there on; 0 before the
            first.

    Raises:
        ConfigError: no level, updates out of order, or a negative deviation.
    """

    levels: tuple[tuple[int, float], ...]

    def __post_init__(self) -> None:
        _check_points([update for update, _ in self.levels], "noise changes")
        found = [level for _, level in self.levels]
        if not all(0 <= level < math.inf for level in found):
            raise ConfigError(f"noise levels {found}: expected standard deviations, 0 or more")

    def at(self, update: int) -> float:
        """The standard deviation for an update, counted from 0."""
        return next((level for point, level in reversed(self.levels) if update >= point), 0.0)


def _check_points(points: Sequence[int], what: str) -> None:
    """Refuse numbers of updates that are not ascending."""
    if not points or points[0] < 0 or any(a >= b for a, b in pairwise(points)):
        raise ConfigError(
            f"{what} at updates {list(points)}: expected at least one, 0 or more, ascending"
        )
