"""Running a predictor on windows of a corpus, and checking what it gives back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple, Protocol, runtime_checkable

import torch
from torch import Tensor

from posecast.errors import ConfigError
from posecast.evaluation.metric import EVERY_JOINT, Counting, Scene
from posecast.evaluation.times import Frames
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
class Steered(Protocol):
    """A predictor that is told where the motion is to go."""

    @property
    def steered_by(self) -> tuple[str, ...]:
        """Names of the tracks it is told; none: it is not told anything."""
        ...

    def predict_along(self, prefix: Motion, horizon: int, ahead: Mapping[str, Tensor]) -> Motion:
        """The ``horizon`` frames after ``prefix``.

        Args:
            prefix: with its tracks.
            horizon: how many frames.
            ahead: the tracks of those frames.
        """
        ...


@runtime_checkable
class Replayer(Protocol):
    """A predictor that can say what it expected of the frames it was given, too."""

    def replay(self, prefix: Motion) -> Motion:
        """What it expects after each frame of ``prefix`` but the last, having read up to there."""
        ...


class Outcome(NamedTuple):
    """What metrics are shown of some windows, float64.

    Args:
        predicted: what the predictor said, in the frames after the prefix.
        target: what was true.
        scene: skeleton, frame rate, prefix, and what was expected of it where that was asked for.
    """

    predicted: Motion
    target: Motion
    scene: Scene


def run_predictor(
    predictor: Predictor,
    corpus: Corpus,
    windows: Sequence[Window],
    frames: Frames,
    *,
    replay: bool = False,
    counting: Counting = EVERY_JOINT,
    batch: int = 256,
) -> Outcome:
    """Predict some windows as far as the furthest horizon.

    Args:
        predictor: given prefixes in float64; what it returns may have any precision.
        corpus: where the windows are.
        windows: at least one.
        frames: of the prefix and the horizons.
        replay: whether to ask it for the prefix's frames as well, see ``Replayer``.
        counting: which joints metrics look at.
        batch: windows a call.

    Raises:
        ConfigError: what it returns is not what was asked for.
    """
    prefix, horizon = frames.prefix, frames.horizons[-1]
    told = predictor.steered_by if isinstance(predictor, Steered) else ()
    whole = _gather(corpus, windows, prefix + horizon, told)
    known, target = whole.cut(0, prefix), whole.cut(prefix)
    name = type(predictor).__name__
    predicted: list[Motion] = []
    replayed: list[Motion] = []
    with torch.no_grad():
        for piece, truth in zip(known.split(batch), target.split(batch), strict=True):
            if told and isinstance(predictor, Steered):
                found = predictor.predict_along(piece, horizon, truth.tracks or {})
            else:
                found = predictor.predict(piece, horizon)
            predicted.append(_checked(found, truth, f"{name}.predict"))
            if replay and isinstance(predictor, Replayer):
                found = predictor.replay(piece)
                replayed.append(_checked(found, piece.cut(1), f"{name}.replay"))
    again = Motion.join(replayed) if replayed else None
    scene = Scene(corpus.skeleton, corpus.fps, known, again, *counting)
    return Outcome(Motion.join(predicted), target, scene)


def _gather(
    corpus: Corpus, windows: Sequence[Window], length: int, tracks: Sequence[str]
) -> Motion:
    """Windows in float64; ``Corpus.gather`` gives the float32 of training."""
    clips = [
        corpus.clips[window.clip].cut(window.start, window.start + length) for window in windows
    ]
    return Motion(
        torch.stack([clip.rotations_local.double() for clip in clips]),
        torch.stack([clip.root_positions.double() for clip in clips]),
        torch.stack([clip.offsets.double() for clip in clips]),
        actions=tuple(clip.labels.get("action", "") for clip in clips),
        tracks={name: corpus.gather_track(windows, length, name).double() for name in tracks},
    )


def _checked(predicted: Motion, target: Motion, call: str) -> Motion:
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
                f"{call} returned {field} of shape {tuple(found.shape)}; expected "
                f"{tuple(expected.shape)}: windows, then only the {expected.shape[1]} new frames"
            )
        if not torch.isfinite(found).all():
            bad = int((~torch.isfinite(found)).flatten(1).any(1).sum())
            raise ConfigError(
                f"{call} returned {field} that are not finite in {bad} of {len(found)} "
                "windows; the model has diverged"
            )
    rotations = predicted.rotations_local.to(target.rotations_local)
    worst = float((torch.linalg.vector_norm(rotations, dim=-1) - 1).abs().max())
    if worst > 1e-3:
        raise ConfigError(
            f"{call} returned quaternions whose length is off 1 by up to {worst:.3g}; "
            "expected unit quaternions: normalize them"
        )
    return Motion(
        quaternion.normalize(rotations),
        predicted.root_positions.to(target.root_positions),
        target.offsets,
        None if moved is None else moved.to(target.offsets),
    )
