"""The Lightning module: a rollout, its losses, one clipped optimizer step, epoch by epoch.

The only file of the project that imports Lightning when it is imported itself.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

import lightning.pytorch as lightning
import torch
from torch import Tensor
from torch.optim import Optimizer

from posecast.errors import ConfigError
from posecast.model.forecaster import Forecaster
from posecast.model.recurrent import State
from posecast.training.adversary import Discriminators, Pair
from posecast.training.feeding import Feed
from posecast.training.objective import Objective
from posecast.training.optimizers import OPTIMIZERS
from posecast.training.recording import Recorder
from posecast.training.sampling import Batch, Windows
from posecast.training.schedules import (
    LearningRate,
    NoiseLevels,
    derived_generator,
    derived_seed,
)
from posecast.training.state import TrainingState, restore_moments
from posecast.training.step import Attempt, Carried, Example, attempt

AfterEpoch = Callable[[int, int, Mapping[str, float], Optimizer], Mapping[str, float]]


class TrainingModule(lightning.LightningModule):
    """Trains a forecaster on windows it draws itself; Lightning only counts the steps.

    Args:
        forecaster: what is trained, in place.
        windows: where the batches come from; its seed is that of all draws.
        objective: what to descend.
        feed: which steps read the truth.
        prefix: frames of a window that are given.
        learning_rate: for every update.
        clip: largest norm of the gradient of all parameters together; ``None``: as it comes.
        optimizer: a member of ``OPTIMIZERS``.
        feedback_gradient: whether predictions that are fed back pass gradients on.
        noise: standard deviation of the noise on the inputs for every update; ``None``: it stays
            what the forecaster has.
        discriminators: what the forecaster is to deceive; ``None``: its objective is all there is.
        carry: share of the windows read with what is remembered of those of the step before.
        recorded: whether steps are recorded as CUDA graphs; neither noise nor discriminators then.
        begin: the state to go on from; its weights are in the forecaster already.
        after_epoch: called in the main process with the epochs and updates done, the averages of
            the epoch and the optimizer; what it returns goes to the loggers.
        is_enough: asked in the main process after every epoch, whether to stop early; ``None``: run
            to the end.
    """

    def __init__(
        self,
        forecaster: Forecaster,
        *,
        windows: Windows,
        objective: Objective,
        feed: Feed,
        prefix: int,
        learning_rate: LearningRate,
        clip: float | None,
        optimizer: str = "adam",
        feedback_gradient: bool = True,
        noise: NoiseLevels | None = None,
        discriminators: Discriminators | None = None,
        carry: float = 0.0,
        recorded: bool = False,
        begin: TrainingState | None = None,
        after_epoch: AfterEpoch | None = None,
        is_enough: Callable[[], bool] | None = None,
    ) -> None:
        super().__init__()
        self.forecaster = forecaster
        self.windows = windows
        self.objective = objective
        self.feed = feed
        self.prefix = prefix
        self.rate = learning_rate
        self.clip = clip
        self.kind = optimizer
        self.feedback_gradient = feedback_gradient
        self.noise = noise
        self.discriminators = discriminators
        self.carry = carry
        self.recorder = (
            Recorder(forecaster, objective, prefix=prefix, feedback_gradient=feedback_gradient)
            if recorded
            else None
        )
        self.begin = begin
        self.after_epoch = after_epoch
        self.is_enough = is_enough
        self.last: dict[str, float] = {}
        self.epochs = 0 if begin is None else begin.epoch
        self._sums: dict[str, Tensor] = {}
        self._counts: dict[str, float] = {}
        self._judged: tuple[dict[str, Pair], Batch] | None = None
        self._state: State | None = None

    @property
    def epoch(self) -> int:
        """Number of the present epoch in the whole run, interruptions left out, from 0."""
        return self.current_epoch + (self.begin.epoch if self.begin else 0)

    @property
    def updates(self) -> int:
        """Optimizer steps done in the whole run."""
        return self.global_step + (self.begin.updates if self.begin else 0)

    def configure_optimizers(self) -> Optimizer:
        """The optimizer, with the moments it had if the run goes on."""
        rate = self.rate.at(epoch=self.epoch, update=self.updates)
        optimizer = OPTIMIZERS[self.kind](self.forecaster.parameters(), rate)
        if self.begin is not None:
            restore_moments(optimizer, self.forecaster, self.begin.moments)
        if self.discriminators is not None:
            # Theirs is not Lightning's: it would ask for every step to be written out by hand.
            self.discriminators.start(self.device)
        return optimizer

    def on_train_epoch_start(self) -> None:
        """Give dropout and whatever else draws from PyTorch's own stream a place in the run."""
        torch.manual_seed(
            derived_seed(self.windows.seed, "modules", self.epoch, "rank", self.global_rank)
        )
        self._sums, self._counts = {}, {}
        self._state = None  # so that a run that is resumed between epochs is the same run

    def training_step(self, step: int, batch_idx: int) -> Tensor:
        """The loss of this process's share, weighted so that processes average to the whole."""
        batch = self.windows.share(
            self.epoch, step, rank=self.global_rank, ranks=self.trainer.world_size
        )
        motion = batch.motion.map(lambda values: values.to(self.device))
        draws = derived_generator(self.windows.seed, "feed", self.epoch, step)
        if self.noise is not None:
            self.forecaster.input_noise = self.noise.at(self.updates)
        mask = self.feed.mask(self.windows.length - self.prefix, self.epoch, draws)
        example = Example.of(self.forecaster.codec, motion)
        carried = self._carried(batch.windows, step, len(example.features))
        if self.recorder is not None:
            loss, self._state = self.recorder(example, mask, carried)
        else:
            attempted = self._attempt(example, mask, carried)
            self._state = attempted.state
            loss = self.objective(attempted.comparison)
            if self.discriminators is not None:
                pairs = self.discriminators.pairs(attempted)
                loss = self.discriminators.oppose(loss, pairs)
                self._judged = pairs, batch
        self._count("loss", loss.total * batch.weight, batch.windows)
        for name, value in loss.terms.items():
            self._count(f"loss/{name}", value * batch.weight, batch.windows)
        return loss.total * batch.weight

    def _carried(self, windows: int, step: int, own: int) -> Carried | None:
        """What is remembered of the windows of the step before, for some of this step's.

        Args:
            windows: of the whole batch.
            step: of the epoch.
            own: windows of this process.
        """
        if not self.carry:
            return None
        draws = derived_generator(self.windows.seed, "carry", self.epoch, step)
        kept = torch.rand(windows, generator=draws) < self.carry
        kept = kept[self.global_rank :: self.trainer.world_size][:own]
        if self._state is None or len(kept) < own:  # nothing yet, or a window of no weight
            kept = torch.zeros(own, dtype=torch.bool)
        state = self._state
        if state is None:
            state = tuple(each.detach() for each in self.forecaster.initial_state(own))
        return Carried(kept.to(self.device), tuple(each[:own] for each in state))

    def _attempt(self, example: Example, mask: Tensor, carried: Carried | None) -> Attempt:
        """The forecaster's predictions beside the truth."""
        return attempt(
            self.forecaster,
            example,
            prefix=self.prefix,
            mask=mask,
            order=self.objective.order,
            feedback_gradient=self.feedback_gradient,
            carried=carried,
        )

    def on_before_optimizer_step(self, optimizer: Optimizer) -> None:
        """Let the discriminators learn from this step's predictions.

        The forecaster's gradients are formed by now, so the weights they went through may change.
        """
        if self.discriminators is None:
            return
        assert self._judged is not None
        pairs, batch = self._judged
        found = self.discriminators.learn(
            pairs,
            weight=batch.weight,
            epoch=self.epoch,
            update=self.updates,
            average=lambda values: self.trainer.strategy.reduce(values, reduce_op="mean"),
        )
        for name, value in found.items():
            self._count(name, value * batch.weight, batch.windows)
        self._judged = None

    def configure_gradient_clipping(
        self,
        optimizer: Optimizer,
        gradient_clip_val: float | None = None,
        gradient_clip_algorithm: str | None = None,
    ) -> None:
        """Clip the gradient's norm, note it, and set the learning rate of this update."""
        limit = float("inf") if self.clip is None else self.clip
        norm = torch.nn.utils.clip_grad_norm_(self.forecaster.parameters(), limit)
        self._count("gradient_norm", norm, 1)
        for group in optimizer.param_groups:
            group["lr"] = self.rate.at(epoch=self.epoch, update=self.updates)

    def on_train_epoch_end(self) -> None:
        """Average the epoch over all processes and hand it on in the main one."""
        self.last = {
            **self._averages(),
            "learning_rate": self.rate.at(epoch=self.epoch, update=self.updates - 1),
            "teacher_forcing": self.feed.share(self.epoch),
        }
        self.epochs = self.epoch + 1
        if self.trainer.is_global_zero and self.after_epoch is not None:
            row = self.after_epoch(
                self.epoch + 1, self.updates, self.last, self.trainer.optimizers[0]
            )
            for logger in self.trainer.loggers:
                logger.log_metrics(dict(row), step=self.epoch + 1)
        if self.is_enough is not None:
            # The main process alone validates; all stop together.
            self.trainer.should_stop = bool(self.trainer.strategy.broadcast(self.is_enough()))

    def _averages(self) -> dict[str, float]:
        """Means over the epoch and over all processes, each window counted once.

        Raises:
            ConfigError: a loss is not finite, on whichever process.
        """
        sums = torch.stack([value / self._counts[name] for name, value in self._sums.items()])
        values = self.trainer.strategy.reduce(sums, reduce_op="mean").tolist()
        means: dict[str, float] = dict(zip(self._sums, values, strict=True))
        if not all(math.isfinite(value) for value in values):
            raise ConfigError(
                f"training diverged in epoch {self.epoch + 1}: the loss is {means['loss']} "
                f"and the gradient's norm {means['gradient_norm']}; lower the learning rate, or "
                "clip harder (the last saved state is from before)"
            )
        return means

    def _count(self, name: str, value: Tensor, weight: float) -> None:
        """Add to a mean without waiting for the device."""
        value = value.detach() * weight
        self._sums[name] = self._sums[name] + value if name in self._sums else value
        self._counts[name] = self._counts.get(name, 0.0) + weight
