"""A trained system: from a recipe to a run, from a run to a checkpoint, and back into memory."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import torch

from posecast.checkpoint import Checkpoint, load_checkpoint, save_checkpoint
from posecast.errors import ConfigError, DataError
from posecast.evaluation.scores import AVERAGE, Scores
from posecast.forecast import forecast_clip
from posecast.generation.gait_table import GaitTable, measure_gait
from posecast.model import Forecaster, ForecasterPredictor
from posecast.motion import Clip
from posecast.motion.corpus import Corpus
from posecast.recipe import Recipe
from posecast.recipe.fitting import check_corpus
from posecast.representation import Statistics
from posecast.shipped import checkpoint_folder
from posecast.skeleton import Skeleton

if TYPE_CHECKING:
    from posecast.training.plan import Machines
    from posecast.training.run import FitResult

STATISTICS = "statistics."
WEIGHTS = "forecaster."
GAIT = "gait."


@dataclass(frozen=True, eq=False)
class System:
    """A trained forecaster and what is needed to use it.

    Args:
        recipe: what it was built from.
        forecaster: the network, with its codec.
        offsets: a body for its skeleton, metres.
        progress: how far training had come.
        gait: what the walks it was trained on are like, for a network that follows paths.
    """

    recipe: Recipe
    forecaster: Forecaster
    offsets: tuple[tuple[float, float, float], ...]
    progress: Mapping[str, Any]
    gait: GaitTable | None = None

    @property
    def skeleton(self) -> Skeleton:
        """The joints it predicts."""
        return self.forecaster.codec.skeleton

    @property
    def fps(self) -> float:
        """Frames per second of its steps."""
        return self.recipe.fps

    @property
    def parameters(self) -> int:
        """Number of trained values."""
        return sum(weight.numel() for weight in self.forecaster.parameters())

    @cached_property
    def predictor(self) -> ForecasterPredictor:
        """What protocols score: ``predict(prefix, horizon)``."""
        return ForecasterPredictor(self.forecaster)

    def forecast(self, clip: Clip, *, horizon_ms: float) -> Clip:
        """A clip and what the system expects to follow it: see ``forecast.forecast_clip``."""
        return forecast_clip(
            self.predictor,
            clip,
            skeleton=self.skeleton,
            fps=self.fps,
            horizon_ms=horizon_ms,
            prefix=max(
                self.recipe.plan.prefix, self.recipe.protocol.frames(self.recipe.fps).prefix
            ),
        )


def load(folder: str | Path) -> System:
    """Read a system back from a checkpoint folder; nothing in the folder is executed.

    Args:
        folder: or the name of a model that comes with posecast (``shipped.shipped_models``).

    Raises:
        DataError: not a checkpoint, or one whose weights do not fit its recipe.
        ConfigError: a recipe this version does not understand.
    """
    checkpoint = load_checkpoint(checkpoint_folder(folder))
    recipe = Recipe(checkpoint.recipe)
    codec = recipe.build_codec(checkpoint.skeleton)
    statistics = _part(checkpoint.tensors, STATISTICS)
    if statistics:
        try:
            codec = recipe.build_codec(checkpoint.skeleton, statistics=Statistics(**statistics))
        except TypeError:
            raise DataError(
                folder, f"statistics {sorted(statistics)}; expected mean, scale"
            ) from None
    weights = {
        name: value.float() if value.dtype == torch.float16 else value
        for name, value in _part(checkpoint.tensors, WEIGHTS).items()
    }
    if checkpoint.fps != recipe.fps:
        raise DataError(
            folder,
            f"{checkpoint.fps:g} frames per second, but its recipe has {recipe.fps:g}; copy the "
            "folder again",
        )
    known = (WEIGHTS, STATISTICS, GAIT)
    strange = [name for name in checkpoint.tensors if not name.startswith(known)]
    if strange:
        raise DataError(folder, f"holds {strange[0]!r}, which no system has; copy the folder again")
    _check_weights(weights, recipe.outline(codec).state_dict(), folder)
    with torch.random.fork_rng(devices=[]):  # the weights drawn here are replaced at once
        forecaster = recipe.build_forecaster(codec)
    forecaster.load_state_dict(weights)
    forecaster.eval()
    gait = _part(checkpoint.tensors, GAIT)
    try:
        table = GaitTable.of(gait) if gait else None
    except TypeError:
        raise DataError(folder, f"gait of {sorted(gait)}; copy the folder again") from None
    return System(recipe, forecaster, checkpoint.offsets, checkpoint.progress, table)


def save(system: System, folder: str | Path, *, half: bool = False) -> None:
    """Write a system as a checkpoint folder, replacing an older checkpoint in one step.

    Args:
        system: what to write.
        folder: where to.
        half: write the weights in half precision, in half the space; they are read back as single.

    Raises:
        DataError: the folder cannot be written or holds something else.
    """
    statistics = system.forecaster.codec.statistics
    tensors = {
        WEIGHTS + name: value.detach().cpu().to(torch.float16 if half else value.dtype)
        for name, value in system.forecaster.state_dict().items()
    }
    if statistics is not None:
        tensors |= {STATISTICS + name: value for name, value in statistics._asdict().items()}
    if system.gait is not None:
        tensors |= {GAIT + name: value for name, value in system.gait.tensors().items()}
    save_checkpoint(
        Checkpoint(
            recipe=system.recipe.config,
            skeleton=system.skeleton,
            offsets=system.offsets,
            fps=system.fps,
            tensors=tensors,
            progress=system.progress,
        ),
        Path(folder),
    )


def train(
    recipe: Recipe,
    corpus: Corpus,
    folder: Path,
    *,
    start: System | None = None,
    machines: Machines | None = None,
    resume: bool = False,
    progress: bool = True,
) -> FitResult:
    """Train what a recipe describes; validation on the split of that name decides what is best.

    Writes ``folder/last`` and, where the corpus has validation clips, ``folder/best``, both as
    checkpoints, and logs beside them. The test split is never read.

    Args:
        recipe: what to train.
        corpus: what to train on, at the recipe's frame rate.
        folder: for the run.
        start: a trained system of the same network, to begin with its weights; ``None``: they are
            drawn.
        machines: processes and devices; ``None``: as found.
        resume: go on with the run that is in ``folder``.
        progress: show how far it is, on standard error.

    Raises:
        ConfigError: the weights of ``start`` are of another network or another skeleton.
    """
    from posecast.training.run import fit

    check_corpus(recipe, corpus)
    codec = recipe.build_codec(corpus.skeleton, recipe.measure(corpus))
    with torch.random.fork_rng(devices=[]):
        torch.random.manual_seed(recipe.plan.seed)
        forecaster = recipe.build_forecaster(codec)
    origin = recipe.origin
    if start is not None:
        _begin_with(forecaster, start)
        origin = {**origin, "start": _digest(start.forecaster)}
    body = corpus.clips[corpus.splits["train"][0]].offsets.double().tolist()
    offsets = tuple((x, y, z) for x, y, z in body)
    gait = None
    if codec.controls is not None and codec.follows_path:
        gait = measure_gait(corpus.split("train"), codec, codec.controls.styles)

    def write(place: Path, trained: Forecaster, state: Mapping[str, Any]) -> None:
        save(System(recipe, trained, offsets, state, gait), place)

    def validate(trained: Forecaster) -> dict[str, float]:
        scores = recipe.protocol.score(ForecasterPredictor(trained), corpus, "validation")
        return _summary(scores)

    return fit(
        forecaster,
        corpus,
        recipe.plan,
        objective=recipe.objective,
        feed=recipe.feed,
        sampling=recipe.sampling,
        adversary=recipe.adversary,
        folder=folder,
        machines=machines,
        origin=origin,
        validate=validate if corpus.splits.get("validation") else None,
        save=write,
        resume=resume,
        progress=progress,
    )


def _begin_with(forecaster: Forecaster, start: System) -> None:
    """Give a forecaster the weights of a trained system.

    Raises:
        ConfigError: they are of another network or another skeleton.
    """
    found, expected = start.forecaster.codec, forecaster.codec
    weights = start.forecaster.state_dict()
    wrong = [
        name
        for name, value in forecaster.state_dict().items()
        if name not in weights or weights[name].shape != value.shape
    ]
    differs = ""
    if found.skeleton.names != expected.skeleton.names:
        differs = "its skeleton has other joints"
    elif (found.root, found.controls) != (expected.root, expected.controls):
        differs = "its root channels or controls are others"
    elif type(found.representation) is not type(expected.representation):
        differs = "its representation is another"
    elif wrong:
        differs = f"{wrong[0]} has another size there"
    if differs:
        raise ConfigError(f"{start.recipe.name} cannot be begun with: {differs}")
    forecaster.load_state_dict(weights)


def _digest(forecaster: Forecaster) -> str:
    """What tells weights from others."""
    whole = hashlib.sha256()
    for name, value in sorted(forecaster.state_dict().items()):
        whole.update(name.encode())
        whole.update(value.detach().cpu().numpy().tobytes())
    return whole.hexdigest()[:16]


def check(recipe: Recipe, corpus: Corpus, folder: Path) -> None:
    """Refuse now what ``train`` with ``resume`` would refuse, when several runs are to come.

    Raises:
        ConfigError: the corpus does not fit, or ``folder`` holds a run with other settings.
        DataError: the state in ``folder`` is damaged.
    """
    from posecast.training.run import check_run

    check_corpus(recipe, corpus)
    check_run(
        corpus,
        recipe.plan,
        objective=recipe.objective,
        feed=recipe.feed,
        folder=folder,
        sampling=recipe.sampling,
        adversary=recipe.adversary,
        origin=recipe.origin,
    )


def _check_weights(
    found: Mapping[str, torch.Tensor], expected: Mapping[str, torch.Tensor], folder: str | Path
) -> None:
    """Refuse weights that the network has no place for, lacks, or could not compute with.

    Raises:
        DataError: naming up to three of them.
    """
    wrong = [
        f"{name} is {_shape(found.get(name))}, expected {_shape(expected.get(name))}"
        for name in sorted({*found, *expected})
        if _shape(found.get(name)) != _shape(expected.get(name))
    ]
    if wrong:
        more = f"; and {len(wrong) - 3} more" if len(wrong) > 3 else ""
        raise DataError(
            folder,
            f"the weights do not fit the recipe: {'; '.join(wrong[:3])}{more}; copy the folder "
            "again, or train anew",
        )
    for name, values in found.items():
        if not torch.isfinite(values).all():
            raise DataError(
                folder, f"weight {name} has values that are no numbers; the run went wrong"
            )


def _shape(values: torch.Tensor | None) -> str:
    """The shape of a tensor in words."""
    return "missing" if values is None else "x".join(map(str, values.shape)) or "one number"


def _summary(scores: Scores) -> dict[str, float]:
    """Average rows by name; first, to select by, the first metric's mean over the horizons."""
    averages = [row for row in scores.rows if row.action == AVERAGE]
    first = averages[0].metric
    over_horizons = [row.value for row in averages if row.metric == first]
    return {
        first: sum(over_horizons) / len(over_horizons),
        **{f"{row.metric}_{row.horizon_ms:g}ms": row.value for row in averages},
    }


def _part(tensors: Mapping[str, torch.Tensor], prefix: str) -> dict[str, torch.Tensor]:
    """The tensors whose names begin with ``prefix``, without it."""
    return {
        name.removeprefix(prefix): value
        for name, value in tensors.items()
        if name.startswith(prefix)
    }
