"""Feeds: what each step of a training rollout reads, the true frame or the model's own.

A feed answers with one boolean a step, for the whole batch. Entry ``t`` belongs to the step that
predicts frame ``t`` of the horizon: true if the frame just before it is given, false if the
model's own prediction of that frame is fed back. Entry 0 reads the last frame of the prefix, which
is always given.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import torch
from jaxtyping import Bool
from torch import Tensor

from posecast.errors import ConfigError


@runtime_checkable
class Feed(Protocol):
    """Decides which steps read the truth. Same generator state, same mask."""

    def share(self, epoch: int) -> float:
        """Expected share of true frames among the steps after the first, epochs from 0."""
        ...

    def mask(self, horizon: int, epoch: int, generator: torch.Generator) -> Bool[Tensor, "horizon"]:
        """One boolean a step, on the CPU: true where the step reads the true frame."""
        ...


@dataclass(frozen=True)
class TeacherForcing:
    """Every step reads the truth."""

    def share(self, epoch: int) -> float:
        """Always 1."""
        return 1.0

    def mask(self, horizon: int, epoch: int, generator: torch.Generator) -> Bool[Tensor, "horizon"]:
        """All true; nothing is drawn."""
        return torch.ones(horizon, dtype=torch.bool)


@dataclass(frozen=True)
class FreeRunning:
    """Every step after the first reads what the model predicted, as in a forecast."""

    def share(self, epoch: int) -> float:
        """Always 0."""
        return 0.0

    def mask(self, horizon: int, epoch: int, generator: torch.Generator) -> Bool[Tensor, "horizon"]:
        """True for the first step only; nothing is drawn."""
        return torch.arange(horizon) == 0


@dataclass(frozen=True)
class ScheduledSampling:
    """From teacher forcing to free running: the truth with probability ``decay ** epoch``.

    One draw a step, shared by the whole batch, as QuaterNet's training does.

    Args:
        decay: factor from one epoch to the next, 0.995 in QuaterNet.

    Raises:
        ConfigError: ``decay`` outside [0, 1].

    Source: Bengio et al. 2015; Pavllo et al. 2018, section 3.4.
    """

    decay: float = 0.995

    def __post_init__(self) -> None:
        if not 0 <= self.decay <= 1:
            raise ConfigError(f"scheduled sampling with decay {self.decay}: expected 0 to 1")

    def share(self, epoch: int) -> float:
        """Probability of the truth in this epoch; 1 in the first."""
        return float(self.decay**epoch)

    def mask(self, horizon: int, epoch: int, generator: torch.Generator) -> Bool[Tensor, "horizon"]:
        """Independent draws; the first step is true whatever was drawn for it."""
        drawn = torch.rand(horizon, generator=generator, dtype=torch.float64) < self.share(epoch)
        return drawn | (torch.arange(horizon) == 0)


@dataclass(frozen=True)
class AutoConditioning:
    """Some true frames, then some of the model's own, over and over, true ones first.

    With one frame of prefix and 100 to predict this is the published pattern over 100 inputs.

    Args:
        true_frames: how many in a row are read from the truth, 5 as published.
        own_frames: how many in a row are the model's own, 5 as published.
        grow_every: epochs after which its own run is one frame longer, again and again, so that it
            is led ever farther; ``None``: the pattern stays, as published.

    Raises:
        ConfigError: no true frames, fewer than no own ones, or no epoch to grow after.

    Source: Zhou et al. 2018, section 3.
    """

    true_frames: int = 5
    own_frames: int = 5
    grow_every: int | None = None

    def __post_init__(self) -> None:
        if self.true_frames < 1 or self.own_frames < 0:
            raise ConfigError(
                f"auto-conditioning with {self.true_frames} true and {self.own_frames} own frames: "
                "expected 1 or more true ones, 0 or more own ones"
            )
        if self.grow_every is not None and self.grow_every < 1:
            raise ConfigError(
                f"auto-conditioning that grows every {self.grow_every} epochs: expected 1 or more"
            )

    def own(self, epoch: int) -> int:
        """How many frames in a row are the model's own in an epoch."""
        return self.own_frames + (0 if self.grow_every is None else epoch // self.grow_every)

    def share(self, epoch: int) -> float:
        """Share of true frames in a whole turn of the pattern."""
        return self.true_frames / (self.true_frames + self.own(epoch))

    def mask(self, horizon: int, epoch: int, generator: torch.Generator) -> Bool[Tensor, "horizon"]:
        """The pattern; the last frame of the prefix is the first of the true ones."""
        place = torch.arange(horizon) % (self.true_frames + self.own(epoch))
        return place < self.true_frames


FEEDS: dict[str, Callable[..., Feed]] = {
    "teacher_forcing": TeacherForcing,
    "free_running": FreeRunning,
    "scheduled_sampling": ScheduledSampling,
    "auto_conditioning": AutoConditioning,
}
