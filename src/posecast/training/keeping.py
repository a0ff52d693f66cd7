"""After every epoch: the tables, a validation, the best and last checkpoints, the state."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import torch
from torch.optim import Optimizer

from posecast.config import did_you_mean
from posecast.errors import ConfigError
from posecast.model.forecaster import Forecaster
from posecast.training.adversary import Discriminators
from posecast.training.journal import Display, Table
from posecast.training.plan import Plan
from posecast.training.state import TrainingState, optimizer_moments, write_state

Validate = Callable[[Forecaster], Mapping[str, float]]
"""Scores a forecaster, which is in evaluation mode, without gradients; lower is better."""

Save = Callable[[Path, Forecaster, Mapping[str, Any]], None]
"""Writes a forecaster and the progress of its training as a checkpoint folder."""

STATE, LAST, BEST = "state.safetensors", "last", "best"
LOG, VALIDATIONS = "log.csv", "validation.csv"
RUN_FILES = (STATE, LAST, BEST, LOG, VALIDATIONS)
"""What a run leaves in its folder; with any of them there, the folder holds a run."""
SECONDS_BETWEEN_STATES = 60.0


class Best(NamedTuple):
    """The best validation of a run.

    Args:
        epoch: epochs done by then.
        metric: what it was selected by.
        metrics: everything that was measured.
    """

    epoch: int
    metric: str
    metrics: Mapping[str, float]


class Waited(NamedTuple):
    """How long a run has waited for a better validation.

    Args:
        mark: lowest value so far.
        validations: in a row that were not lower by enough.
    """

    mark: float
    validations: int


class Keeper:
    """Keeps what a run must not lose, in the main process.

    Args:
        forecaster: what is trained.
        plan: when to validate and to save.
        folder: where everything goes.
        settings: what decides the outcome, kept with the state.
        begin: the state the run goes on from, if it does.
        validate: scores the forecaster.
        save: writes a checkpoint folder.
        discriminators: kept with the state, and in no checkpoint; ``None``: there are none.
    """

    def __init__(
        self,
        forecaster: Forecaster,
        plan: Plan,
        folder: Path,
        *,
        settings: Mapping[str, Any],
        begin: TrainingState | None,
        validate: Validate | None,
        save: Save | None,
        discriminators: Discriminators | None = None,
    ) -> None:
        self.discriminators = discriminators
        self.forecaster, self.plan, self.folder = forecaster, plan, folder
        self.settings, self.validate, self.save = settings, validate, save
        self.begin = 0 if begin is None else begin.epoch
        self.best = None if begin is None or begin.best is None else Best(**begin.best)
        kept = None if begin is None else begin.waited
        self.waited = None if kept is None else Waited(kept["mark"], int(kept["validations"]))
        self.display: Display | None = None
        self._validation: dict[str, float] = {}
        self._saved = self._told = time.monotonic()

    def is_enough(self) -> bool:
        """Whether validation has not improved for as long as the plan waits."""
        patience = self.plan.patience
        return (
            patience is not None
            and self.waited is not None
            and (self.waited.validations >= patience)
        )

    def open(self, *, progress: bool) -> Display:
        """Take the tables back to where the run begins, and make what shows its progress."""
        for stale in self.folder.glob(f".{Path(STATE).stem}.*"):
            stale.unlink(missing_ok=True)  # half a state, from a run that was killed while writing
        self.log = Table(self.folder / LOG, self.begin)
        self.validations = Table(self.folder / VALIDATIONS, self.begin)
        self.display = Display(begin=self.begin, epochs=self.plan.epochs, shown=progress)
        self._told = time.monotonic()
        return self.display

    def after_epoch(
        self, done: int, updates: int, averages: Mapping[str, float], optimizer: Optimizer
    ) -> dict[str, float]:
        """Note, validate, show and save.

        Args:
            done: epochs done.
            updates: optimizer steps done.
            averages: losses, learning rate and so on of the epoch.
            optimizer: whose moments are saved.

        Returns:
            what other logs should have, too.
        """
        now = time.monotonic()
        row = {"updates": updates, **averages, "seconds": round(now - self._told, 3)}
        self.log.add(done, row)
        final = done == self.plan.epochs
        found: dict[str, float] = {}
        if self.validate is not None and (final or done % self.plan.validate_every == 0):
            found = self._score(self.validate)
            self.validations.add(done, found)
            self._validation = found
        progress = {
            "epoch": done,
            "updates": updates,
            "seed": self.plan.seed,
            "training": dict(averages),
            "validation": self._validation,
        }
        if found and self._improves(done, found) and self.save is not None:
            self.save(self.folder / BEST, self.forecaster, progress)
        final = final or self.is_enough()
        if final or self._due(done):
            # The state comes last: a run killed in between does this epoch's checkpoint again.
            if self.save is not None:
                self.save(self.folder / LAST, self.forecaster, progress)
            self._keep(done, updates, optimizer)
        if self.display is not None:
            self.display.update(done, {"loss": averages["loss"], **self._headline()})
        self._told = time.monotonic()  # the next epoch's seconds are those of its training alone
        return {**row, **{f"validation/{name}": value for name, value in found.items()}}

    def _score(self, validate: Validate) -> dict[str, float]:
        """Validate in evaluation mode, then go back to training."""
        self.forecaster.eval()
        with torch.no_grad():
            found = {name: float(value) for name, value in validate(self.forecaster).items()}
        self.forecaster.train()
        metric = self.plan.select_best_by
        if not found:
            raise ConfigError("validation measured nothing; give it a metric, or leave it out")
        if metric is not None and metric not in found:
            raise ConfigError(
                f"select_best_by: validation measures no {metric!r}; {did_you_mean(metric, found)}"
            )
        return found

    def _headline(self) -> dict[str, float]:
        """The metric to select by, from the newest validation; empty before the first."""
        metric = self.plan.select_best_by or next(iter(self._validation), "")
        return {name: value for name, value in self._validation.items() if name == metric}

    def _improves(self, done: int, found: Mapping[str, float]) -> bool:
        """Whether this validation is the best so far; it is remembered if it is."""
        metric = next(iter(self._headline()))
        self._wait(found[metric])
        least = math.inf if self.best is None else self.best.metrics.get(metric, math.inf)
        if not found[metric] < least:
            return False
        self.best = Best(done, metric, dict(found))
        return True

    def _wait(self, value: float) -> None:
        """Count a validation that is not lower than all before by enough.

        One that is lower, if only by little, is what the next must be below: a run that creeps
        downwards ends, as with the code of Aksan et al. 2019.
        """
        least = 1 - self.plan.least_improvement
        if self.waited is None or value < self.waited.mark * least:
            self.waited = Waited(value, 0)
        else:
            mark, validations = self.waited
            self.waited = Waited(min(mark, value), validations + 1)

    def _due(self, done: int) -> bool:
        """Whether a state is to be saved now; the first is, so that an early kill costs little."""
        if self.plan.save_every is not None:
            return done % self.plan.save_every == 0
        return done == 1 or time.monotonic() - self._saved >= SECONDS_BETWEEN_STATES

    def _keep(self, done: int, updates: int, optimizer: Optimizer) -> None:
        """Write the state."""
        rivals = self.discriminators
        state = TrainingState(
            epoch=done,
            updates=updates,
            settings=self.settings,
            best=None if self.best is None else self.best._asdict(),
            weights=self.forecaster.state_dict(),
            moments=optimizer_moments(optimizer, self.forecaster),
            waited=None if self.waited is None else self.waited._asdict(),
            discriminators={} if rivals is None else rivals.networks.state_dict(),
            discriminator_moments={} if rivals is None else rivals.moments(),
        )
        write_state(state, self.folder / STATE)
        self._saved = time.monotonic()
