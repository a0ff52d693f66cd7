"""What changes as training goes on: random streams addressed by epoch, and the learning rate."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass

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

    Raises:
        ConfigError: a rate or decay that is not positive, a decay above 1, ``every`` below 1.
    """

    start: float = 1e-3
    decay: float = 0.999
    every: int | None = None

    def __post_init__(self) -> None:
        if not self.start > 0:
            raise ConfigError(f"learning rate {self.start}: expected more than 0")
        if not 0 < self.decay <= 1:
            raise ConfigError(f"learning-rate decay {self.decay}: expected more than 0, at most 1")
        if self.every is not None and self.every < 1:
            raise ConfigError(f"learning rate decays every {self.every} updates: expected >= 1")

    def at(self, *, epoch: int, update: int) -> float:
        """The rate for an update, both counted from 0."""
        return self.start * self.decay ** (epoch if self.every is None else update // self.every)
