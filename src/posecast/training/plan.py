"""What a run is to do, and what it may run on: plain numbers, checked once."""

from __future__ import annotations

import importlib.util
import os
from dataclasses import dataclass
from typing import Literal

from posecast.errors import ConfigError
from posecast.training.schedules import LearningRate, NoiseLevels

STRATEGIES = ("auto", "ddp", "ddp_find_unused_parameters_true")


@dataclass(frozen=True)
class Plan:
    """How a forecaster is trained; with the corpus and its parts, this decides the outcome.

    Defaults are those of QuaterNet's short-term training (Pavllo et al. 2018).

    Args:
        epochs: epochs in all.
        batch: windows in a batch, over all processes together.
        prefix: frames given.
        horizon: frames to predict.
        seed: of every random choice in training.
        learning_rate: of the first update.
        decay: factor of the learning rate at each decay.
        decay_every: updates between decays; ``None``: once an epoch.
        decay_at: updates before which the rate decays, instead of regularly.
        clip: largest norm of the gradient; ``None``: as it comes.
        optimizer: ``adam``, or ``sgd`` without momentum.
        feedback_gradient: whether predictions that are fed back pass gradients on.
        turn: turn each window about the vertical by a random angle.
        mirror: exchange left and right in half of the windows.
        skip_start: frames at the start of every recording that are in no window, such as the first
            16 of Martinez et al. 2017, or those in which somebody stands and waits.
        skip_end: the same at its end.
        validate_every: epochs between validations; there is one after the last epoch, too.
        select_best_by: validation metric to keep the best checkpoint by, the lower the better;
            ``None``: the first one.
        save_every: epochs between saved states; ``None``: about once a minute.
        patience: validations in a row without improvement after which training ends early;
            ``None``: it never does.
        least_improvement: share of the value to beat by which a validation must be lower to count;
            every lower one is kept as the best.
        noise_at: pairs of a number of updates and the standard deviation of the noise on the inputs
            from there on (``Forecaster.input_noise``); ``None``: it stays what it is.
        carry: share of the windows that are read with what is remembered of windows of the update
            before, gradients aside, rather than with the initial state; an epoch begins with that.
            A network that has only ever remembered one window may count the time since its start,
            and lose its way soon after; so it learns to walk on.

    Raises:
        ConfigError: a number out of its range.
    """

    epochs: int = 3000
    batch: int = 60
    prefix: int = 50
    horizon: int = 10
    seed: int = 0
    learning_rate: float = 1e-3
    decay: float = 0.999
    decay_every: int | None = None
    decay_at: list[int] | None = None
    clip: float | None = 0.1
    optimizer: str = "adam"
    feedback_gradient: bool = True
    turn: bool = False
    mirror: bool = False
    skip_start: int = 0
    skip_end: int = 0
    validate_every: int = 1
    select_best_by: str | None = None
    save_every: int | None = None
    patience: int | None = None
    least_improvement: float = 0.0
    noise_at: list[list[float]] | None = None
    carry: float = 0.0

    def __post_init__(self) -> None:
        for name in (
            "epochs",
            "batch",
            "prefix",
            "horizon",
            "validate_every",
            "save_every",
            "patience",
        ):
            value = getattr(self, name)
            if value is not None and value < 1:
                raise ConfigError(f"{name} is {value}; expected 1 or more")
        for name in ("skip_start", "skip_end"):
            if getattr(self, name) < 0:
                raise ConfigError(f"{name} is {getattr(self, name)}; expected 0 frames or more")
        if not 0 <= self.seed < 2**63:
            raise ConfigError(f"seed is {self.seed}; expected 0 to 2**63 - 1")
        if self.clip is not None and not self.clip > 0:
            raise ConfigError(f"clip is {self.clip}; expected more than 0, or null for no clipping")
        if self.optimizer not in ("adam", "sgd"):
            raise ConfigError(f"optimizer {self.optimizer!r} is unknown; choose adam or sgd")
        if not 0 <= self.carry <= 1:
            raise ConfigError(f"carry is {self.carry}; expected a share, 0 to 1")
        if not 0 <= self.least_improvement < 1:
            raise ConfigError(
                f"least_improvement is {self.least_improvement}; expected a share, 0 or more and "
                "less than 1"
            )
        if self.least_improvement and self.patience is None:
            raise ConfigError(
                "least_improvement changes nothing without patience; set both, or leave it out"
            )
        _ = self.rate, self.noise  # check themselves

    @property
    def rate(self) -> LearningRate:
        """The learning rate of every update."""
        at = None if self.decay_at is None else tuple(self.decay_at)
        return LearningRate(self.learning_rate, self.decay, self.decay_every, at)

    @property
    def noise(self) -> NoiseLevels | None:
        """The noise of every update, where it changes."""
        if self.noise_at is None:
            return None
        if any(len(pair) != 2 for pair in self.noise_at):
            raise ConfigError(
                f"noise_at is {self.noise_at}; expected pairs of updates and a standard deviation"
            )
        return NoiseLevels(tuple((int(update), level) for update, level in self.noise_at))


@dataclass(frozen=True)
class Machines:
    """What a run may use. The outcome does not depend on it, but for rounding and dropout.

    Under ``torchrun``, ``auto`` devices and nodes are those it started processes for.

    Args:
        accelerator: ``auto``, ``cpu``, ``gpu``, or another that Lightning knows.
        devices: how many on each machine; ``auto``: every accelerator, or one process on a CPU.
        nodes: how many machines.
        strategy: ``auto`` (one process, or data parallel where there are several devices),
            ``ddp``, or ``ddp_find_unused_parameters_true`` for a network of which a rollout leaves
            parts unused.
        cuda_graphs: record a training step once and replay it, on a single NVIDIA GPU: the same
            training, several times as fast for networks of which a GPU does each operation sooner
            than it is asked for the next.
    """

    accelerator: str = "auto"
    devices: int | Literal["auto"] = "auto"
    nodes: int | Literal["auto"] = "auto"
    strategy: str = "auto"
    cuda_graphs: bool = False

    def __post_init__(self) -> None:
        if self.strategy not in STRATEGIES:
            raise ConfigError(
                f"strategy {self.strategy!r} is unknown; choose among: {', '.join(STRATEGIES)}"
            )
        for name, count in (("devices", self.devices), ("nodes", self.nodes)):
            if count != "auto" and count < 1:
                raise ConfigError(f"{name} is {count}; expected 1 or more, or none to take all")

    @property
    def processes(self) -> int | Literal["auto"]:
        """Devices on each machine, for Lightning."""
        started = _torchrun()
        return started[1] if started and self.devices == "auto" else self.devices

    @property
    def machines(self) -> int:
        """Number of machines, for Lightning."""
        started = _torchrun()
        if self.nodes != "auto":
            return self.nodes
        return started[0] // started[1] if started else 1


def require_lightning() -> None:
    """Ask for the one part of training that not everybody has, before any data is read.

    Raises:
        ConfigError: Lightning is not installed.
    """
    if importlib.util.find_spec("lightning") is None:
        raise ConfigError(
            "training needs Lightning, which is not installed; pip install posecast[train]"
        )


def _torchrun() -> tuple[int, int] | None:
    """Processes in all and on this machine, if ``torchrun`` started this one."""
    if "TORCHELASTIC_RUN_ID" not in os.environ:
        return None
    return int(os.environ["WORLD_SIZE"]), int(os.environ["LOCAL_WORLD_SIZE"])
