"""Running a predictor on windows of a corpus, and checking what it gives back."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

import torch

from posecast.errors import ConfigError
from posecast.geometry import quaternion
from posecast.motion.clip import Motion
from posecast.motion.corpus import Corpus, Window


@runtime_checkable
class Predictor(Protocol):
    """Anything that continues motion."""

    def predict(self, prefix: Motion, horizon: int) -> Motion:
        """The ``horizon`` frames after ``prefix``, without the prefix."""
        ...


@runtime_checkable
class Replayer(Protocol):
    """A predictor that can say what it expected of the frames it was given, too."""

    def replay(self, prefix: Motion) -> Motion:
        """What it expects after each frame of ``prefix`` but the last, having read up to there."""
        ...


def run_replay(predictor: Predictor, known: Motion) -> Motion:
    """What a predictor expected of the prefixes' frames after the first.

    Raises:
        ConfigError: it cannot say, or the prefix is a single frame.
    """
    name = type(predictor).__name__
    if not isinstance(predictor, Replayer):
        raise ConfigError(
            f"{name} has no replay(prefix), which metrics 'with prefix' need; leave these out"
        )
    if known.root_positions.shape[1] < 2:
        raise ConfigError("metrics 'with prefix' need a prefix of two frames or more")
    with torch.no_grad():
        return _checked(predictor.replay(known), known.cut(1), name)


def run_predictor(
    predictor: Predictor, corpus: Corpus, windows: Sequence[Window], prefix: int, horizon: int
) -> tuple[Motion, Motion, Motion]:
    """Prefix, prediction and truth of some windows, float64."""
    whole = _gather(corpus, windows, prefix + horizon)
    known, target = whole.cut(0, prefix), whole.cut(prefix)
    with torch.no_grad():
        predicted = predictor.predict(known, horizon)
    return known, _checked(predicted, target, type(predictor).__name__), target


def _gather(corpus: Corpus, windows: Sequence[Window], length: int) -> Motion:
    """Windows in float64; ``Corpus.gather`` gives the float32 of training."""
    clips = [
        corpus.clips[window.clip].cut(window.start, window.start + length) for window in windows
    ]
    return Motion(
        torch.stack([clip.rotations_local.double() for clip in clips]),
        torch.stack([clip.root_positions.double() for clip in clips]),
        torch.stack([clip.offsets.double() for clip in clips]),
    )


def _checked(predicted: Motion, target: Motion, name: str) -> Motion:
    """The prediction in the target's precision and place, if it is what was asked for."""
    moved = predicted.translations_local
    pairs = {
        "rotations_local": (predicted.rotations_local, target.rotations_local),
        "root_positions": (predicted.root_positions, target.root_positions),
    }
    if moved is not None:
        pairs["translations_local"] = (moved, target.rotations_local[..., 1:])
    for field, (found, expected) in pairs.items():
        if found.shape != expected.shape:
            raise ConfigError(
                f"{name}.predict returned {field} of shape {tuple(found.shape)}; expected "
                f"{tuple(expected.shape)}: windows, then only the {expected.shape[1]} new frames"
            )
        if not torch.isfinite(found).all():
            bad = int((~torch.isfinite(found)).flatten(1).any(1).sum())
            raise ConfigError(
                f"{name}.predict returned {field} that are not finite in {bad} of {len(found)} "
                "windows; the model has diverged"
            )
    rotations = predicted.rotations_local.to(target.rotations_local)
    worst = float((torch.linalg.vector_norm(rotations, dim=-1) - 1).abs().max())
    if worst > 1e-3:
        raise ConfigError(
            f"{name}.predict returned quaternions whose length is off 1 by up to {worst:.3g}; "
            "expected unit quaternions: normalize them"
        )
    return Motion(
        quaternion.normalize(rotations),
        predicted.root_positions.to(target.root_positions),
        target.offsets,
        None if moved is None else moved.to(target.offsets),
    )
