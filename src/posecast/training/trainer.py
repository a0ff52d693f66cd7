"""Lightning's trainer, made to count epochs and steps and to leave everything else to us."""

from __future__ import annotations

import atexit
import importlib.util
import logging
import warnings
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import torch

from posecast.errors import ConfigError
from posecast.model.forecaster import Forecaster
from posecast.training.keeping import Keeper
from posecast.training.plan import Machines, Plan
from posecast.training.state import TrainingState

if TYPE_CHECKING:
    from lightning.pytorch import Trainer
    from lightning.pytorch.loggers import Logger

    from posecast.training.module import TrainingModule


def build_trainer(
    plan: Plan,
    machines: Machines,
    folder: Path,
    begin: TrainingState | None,
    loggers: Sequence[Logger] | None,
) -> Trainer:
    """A Lightning trainer that counts epochs and steps, and leaves everything else to us."""
    from lightning.fabric.utilities.exceptions import MisconfigurationException
    from lightning.pytorch import Trainer
    from lightning.pytorch.loggers import TensorBoardLogger

    done = 0 if begin is None else begin.epoch
    if loggers is None and importlib.util.find_spec("tensorboard"):
        loggers = [TensorBoardLogger(folder, name="", version="tensorboard", purge_step=done + 1)]
    try:
        return Trainer(
            accelerator=machines.accelerator,
            devices=machines.processes,
            num_nodes=machines.machines,
            strategy=machines.strategy,
            max_epochs=plan.epochs - done,
            logger=list(loggers or ()),
            log_every_n_steps=1,
            default_root_dir=folder,
            enable_checkpointing=False,
            enable_progress_bar=False,
            enable_model_summary=False,
            use_distributed_sampler=False,
        )
    except (MisconfigurationException, TypeError, ValueError) as error:
        # Lightning looks for the devices here, and each of its accelerators says no in its own way.
        reason = " ".join(str(error).split())
        raise ConfigError(
            f"accelerator {machines.accelerator!r}, devices {machines.devices}, "
            f"nodes {machines.nodes}: {reason}; leave them out to take what there is"
        ) from None


def run_training(
    trainer: Trainer, module: TrainingModule, keeper: Keeper, *, progress: bool
) -> None:
    """Train, with PyTorch's random streams put back afterwards."""
    if trainer.world_size > 1:
        atexit.register(_leave_group)
    device = trainer.strategy.root_device
    own = [device] if device.type == "cuda" else []
    with ExitStack() as stack:
        stack.enter_context(torch.random.fork_rng(devices=own))
        if trainer.is_global_zero:
            stack.enter_context(keeper.open(progress=progress))
        try:
            trainer.fit(module, range(module.windows.steps))
        except SystemExit as stop:
            if trainer.interrupted and stop.code == 1:  # what Lightning makes of Ctrl-C
                raise KeyboardInterrupt from None
            raise


def _leave_group() -> None:
    """End the threads that processes talk through; one left to the end of Python may abort it."""
    if torch.distributed.is_initialized():
        torch.distributed.destroy_process_group()


@contextmanager
def training_mode(forecaster: Forecaster) -> Iterator[None]:
    """Dropout and the like are on in here, and as they were afterwards."""
    before = forecaster.training
    forecaster.train()
    try:
        yield
    finally:
        forecaster.train(before)


@contextmanager
def quiet_lightning() -> Iterator[None]:
    """Keep back Lightning's notes on hardware and on how it was called; warnings pass but three."""
    import lightning.pytorch  # noqa: F401  its import sets the levels that are changed here

    names = ("lightning.pytorch", "lightning.fabric")
    before = {name: logging.getLogger(name).level for name in names}
    with warnings.catch_warnings():
        # On a machine with a GPU that is not wanted: it was the caller who did not want it.
        warnings.filterwarnings("ignore", "GPU available but not used")
        # Lightning 2.6 names a class that PyTorch 2.13 has renamed; nobody here can change that.
        warnings.filterwarnings("ignore", r"`isinstance\(treespec, LeafSpec\)` is deprecated")
        # Recorded steps are warmed up on a stream of their own, and PyTorch sees that.
        warnings.filterwarnings("ignore", "The AccumulateGrad node's stream does not match")
        for name in names:
            logging.getLogger(name).setLevel(logging.WARNING)
        try:
            yield
        finally:
            for name, level in before.items():
                logging.getLogger(name).setLevel(level)
