"""One training run: from a forecaster and a corpus to checkpoints, logs and a state to resume."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from posecast.errors import ConfigError, DataError, SkeletonError
from posecast.model.forecaster import Forecaster
from posecast.motion.corpus import Corpus
from posecast.training.adversary import Adversary, Discriminators
from posecast.training.feeding import Feed
from posecast.training.keeping import BEST, LAST, RUN_FILES, STATE, Best, Keeper, Save, Validate
from posecast.training.objective import Objective
from posecast.training.plan import Machines, Plan, require_lightning
from posecast.training.recording import check_recording
from posecast.training.sampling import EveryRecording, Sampling, Windows
from posecast.training.state import TrainingState, check_settings, read_state
from posecast.training.trainer import build_trainer, quiet_lightning, run_training, training_mode

if TYPE_CHECKING:
    from lightning.pytorch.loggers import Logger

    from posecast.training.module import TrainingModule


_ENDINGS = ("patience", "least_improvement")
"""Settings that decide when a run ends, not how it goes."""


class FitResult(NamedTuple):
    """How a run ended.

    Args:
        folder: holds ``last`` and ``best`` (checkpoints), ``log.csv``, ``validation.csv`` and the
            state to resume from.
        epochs: epochs done in all.
        updates: optimizer steps done in all.
        averages: losses, learning rate and so on of the last epoch; empty if none was left.
        best: the best validation, if there was any.
        skipped: recordings of the training split that are shorter than a window.
        is_main_process: false in the processes that only helped; they should not report.
    """

    folder: Path
    epochs: int
    updates: int
    averages: Mapping[str, float]
    best: Best | None
    skipped: int
    is_main_process: bool


def fit(
    forecaster: Forecaster,
    corpus: Corpus,
    plan: Plan,
    *,
    objective: Objective,
    feed: Feed,
    folder: Path,
    sampling: Sampling | None = None,
    adversary: Adversary | None = None,
    machines: Machines | None = None,
    origin: Mapping[str, Any] | None = None,
    validate: Validate | None = None,
    save: Save | None = None,
    resume: bool = False,
    progress: bool = True,
    loggers: Sequence[Logger] | None = None,
) -> FitResult:
    """Train a forecaster in place on the training split of a corpus.

    A run may be killed at any moment and resumed: it then ends with the losses and weights it would
    have had, exactly so on a CPU with as many threads, elsewhere as far as the kernels are
    deterministic. PyTorch's global random state is left as it was found. With several processes
    every one of them calls this with the same arguments, and ``folder`` is shared between machines.

    Args:
        forecaster: what is trained; it ends with the weights of the last epoch.
        corpus: read through its split ``train`` only.
        plan: epochs, sizes, optimizer.
        objective: what to descend.
        feed: which steps of a rollout read the truth.
        folder: for checkpoints, logs and the state; made if it is not there.
        sampling: which recordings an epoch sees; ``None``: every one once.
        adversary: discriminators for the forecaster to deceive; ``None``: there are none.
        machines: processes and devices; ``None``: as found.
        origin: what the forecaster and the corpus were built from, plain values by name; a run is
            only resumed with the same. ``None``: nothing to compare but the shapes of the weights.
        validate: called in the main process only; decides which checkpoint is the best.
        save: called in the main process only, for ``folder / "last"`` and ``folder / "best"``.
        resume: go on from the state in ``folder``, if there is one.
        progress: show a bar, or lines now and then, on standard error.
        loggers: Lightning loggers beside the tables in CSV; ``None``: TensorBoard, if installed.

    Raises:
        ConfigError: parts that do not fit, a folder that holds a run which is not to be resumed,
            a state of a run with other settings, a loss that is no longer finite, or no Lightning.
        DataError: the folder cannot be written, or its state is damaged.
        SkeletonError: forecaster and corpus are of different skeletons.
    """
    require_lightning()
    objective.check(forecaster.codec)
    if corpus.skeleton != forecaster.codec.skeleton:
        raise SkeletonError(
            f"the forecaster's skeleton has joints {', '.join(forecaster.codec.skeleton.names)}; "
            f"corpus {corpus.name!r} has {', '.join(corpus.skeleton.names)}"
        )
    sampling = sampling or EveryRecording()
    windows = Windows(
        corpus,
        length=plan.prefix + plan.horizon,
        batch=plan.batch,
        seed=plan.seed,
        sampling=sampling,
        turn=plan.turn,
        mirror=plan.mirror,
        skip_start=plan.skip_start,
        skip_end=plan.skip_end,
        tracks=forecaster.codec.tracks,
        dtype=next(forecaster.parameters()).dtype,
    )
    settings = _settings(plan, objective, feed, sampling, adversary, corpus, origin or {})
    begin = _begin(forecaster, plan, settings, folder, resume=resume)
    keeper = Keeper(
        forecaster,
        plan,
        folder,
        settings=settings,
        begin=begin,
        validate=validate,
        save=save,
        discriminators=(
            None if adversary is None else Discriminators(adversary, forecaster, plan, begin)
        ),
    )
    if begin is not None and (begin.epoch == plan.epochs or keeper.is_enough()):
        main = os.environ.get("RANK", "0") == "0"
        return FitResult(folder, begin.epoch, begin.updates, {}, keeper.best, windows.skipped, main)
    with quiet_lightning(), training_mode(forecaster):
        machines = machines or Machines()
        trainer = build_trainer(plan, machines, folder, begin, loggers)
        if machines.cuda_graphs:
            check_recording(
                trainer.strategy.root_device, trainer.world_size, plan, adversary=adversary
            )
        module = _module(
            forecaster,
            windows,
            plan,
            objective,
            feed,
            begin,
            keeper,
            recorded=machines.cuda_graphs,
        )
        run_training(trainer, module, keeper, progress=progress)
        best = trainer.strategy.broadcast(keeper.best)
    return FitResult(
        folder,
        module.epochs,
        module.updates,
        module.last,
        best,
        windows.skipped,
        trainer.is_global_zero,
    )


def check_run(
    corpus: Corpus,
    plan: Plan,
    *,
    objective: Objective,
    feed: Feed,
    folder: Path,
    sampling: Sampling | None = None,
    adversary: Adversary | None = None,
    origin: Mapping[str, Any] | None = None,
) -> None:
    """Refuse a folder now that ``fit`` could not go on with later; nothing is written.

    Args:
        corpus, plan, objective, feed, folder, sampling, adversary, origin: see ``fit``.

    Raises:
        ConfigError: the folder has a run with other settings or more epochs, or half of one.
        DataError: the state in it is damaged.
    """
    sampling = sampling or EveryRecording()
    settings = _settings(plan, objective, feed, sampling, adversary, corpus, origin or {})
    _state(plan, settings, folder, resume=True)


def _settings(
    plan: Plan,
    objective: Objective,
    feed: Feed,
    sampling: Sampling,
    adversary: Adversary | None,
    corpus: Corpus,
    origin: Mapping[str, Any],
) -> dict[str, Any]:
    """What decides the outcome, as JSON would give it back."""
    numbers = asdict(plan)
    # More epochs may be asked for, and looking at a run more often does not change it.
    for name in ("epochs", "validate_every", "select_best_by", "save_every", *_ENDINGS):
        del numbers[name]
    training = [corpus.frames[index] for index in corpus.indices("train")]
    settings = {
        **origin,
        **numbers,
        "loss": {"terms": dict(objective.terms), "order": objective.order},
        "feed": repr(feed),
        "sampling": repr(sampling),
        "corpus": f"{corpus.name}: {len(training)} recordings, {sum(training)} frames",
    }
    if adversary is not None:
        settings["adversary"] = asdict(adversary)
    return dict(json.loads(json.dumps(settings)))


def _begin(
    forecaster: Forecaster, plan: Plan, settings: Mapping[str, Any], folder: Path, *, resume: bool
) -> TrainingState | None:
    """The state to go on from, its weights put into the forecaster; ``None``: a new run."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise DataError(folder, f"cannot be made ({error.strerror}); choose another") from None
    state = _state(plan, settings, folder, resume=resume)
    if state is None:
        return None
    try:
        forecaster.load_state_dict(dict(state.weights))
    except RuntimeError as error:
        reason = " ".join(str(error).split())
        raise ConfigError(f"{folder / STATE}: weights of another forecaster ({reason})") from None
    return state


def _state(
    plan: Plan, settings: Mapping[str, Any], folder: Path, *, resume: bool
) -> TrainingState | None:
    """The state in a folder, of a run with these settings; ``None``: there is no run."""
    path = folder / STATE
    found = [name for name in RUN_FILES if (folder / name).exists()]
    if found and not resume:
        remedy = "resume it, or choose" if path.exists() else "choose"
        raise ConfigError(
            f"{folder} holds a training run already ({', '.join(found)}); {remedy} another folder"
        )
    if not path.exists():
        checkpoints = [name for name in (LAST, BEST) if name in found]
        if checkpoints:
            raise ConfigError(
                f"{folder} has {' and '.join(checkpoints)} but no {STATE} to go on from; choose "
                "another folder"
            )
        return None
    state = read_state(path)
    check_settings(state.settings, settings, path)
    if state.epoch > plan.epochs:
        raise ConfigError(
            f"{path}: {state.epoch} epochs are done, more than the {plan.epochs} asked"
        )
    return state


def _module(
    forecaster: Forecaster,
    windows: Windows,
    plan: Plan,
    objective: Objective,
    feed: Feed,
    begin: TrainingState | None,
    keeper: Keeper,
    *,
    recorded: bool,
) -> TrainingModule:
    """The Lightning module; Lightning is imported here, when training begins, and not before."""
    from posecast.training.module import TrainingModule

    return TrainingModule(
        forecaster,
        windows=windows,
        carry=plan.carry,
        recorded=recorded,
        objective=objective,
        feed=feed,
        prefix=plan.prefix,
        learning_rate=plan.rate,
        clip=plan.clip,
        optimizer=plan.optimizer,
        feedback_gradient=plan.feedback_gradient,
        noise=plan.noise,
        discriminators=keeper.discriminators,
        begin=begin,
        after_epoch=keeper.after_epoch,
        is_enough=None if plan.patience is None else keeper.is_enough,
    )
