"""A trained forecaster as a predictor: motion in, motion out."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from posecast.errors import ConfigError
from posecast.model.forecaster import Forecaster
from posecast.model.rollout import Rollout, rollout
from posecast.motion import Motion
from posecast.motion.tracks import MOVEMENT, PATH


@dataclass(frozen=True, eq=False)
class ForecasterPredictor:
    """A trained forecaster as a predictor: motion in, motion out, no gradients.

    Args:
        forecaster: what predicts; it is put into evaluation mode while it does.
        batch: how many motions are predicted at a time.
    """

    forecaster: Forecaster
    batch: int = 256

    def predict(self, prefix: Motion, horizon: int) -> Motion:
        """The ``horizon`` frames after each prefix, with its precision, on its device.

        The network runs in its own precision on its own device.
        """
        if self.steered_by:
            raise ConfigError(
                "this forecaster is steered along a path, which a forecast does not have; let it "
                "walk along one (posecast walk)"
            )
        return self.predict_along(prefix, horizon, {})

    @property
    def steered_by(self) -> tuple[str, ...]:
        """Names of the tracks that the forecaster has to be told; none: it is not steered."""
        codec = self.forecaster.codec
        return (*codec.tracks, *((MOVEMENT, PATH) if codec.follows_path else ()))

    def predict_along(
        self, prefix: Motion, horizon: int, ahead: Mapping[str, Float[Tensor, "batch _ ..."]]
    ) -> Motion:
        """As ``predict``, steered.

        Args:
            prefix: with the tracks ``steered_by``.
            horizon: how many frames.
            ahead: the same tracks of those frames.
        """
        codec = self.forecaster.codec

        def run(piece: Motion, known: Tensor, later: Mapping[str, Tensor]) -> Rollout:
            if codec.controls is None:
                return rollout(self.forecaster, known, horizon)
            whole = {
                name: torch.cat([(piece.tracks or {})[name], later[name]], 1) for name in later
            }
            controls = codec.controls.encode(whole).to(known)
            return rollout(self.forecaster, known, horizon, controls=controls)

        features = self._run(prefix, run, ahead)
        anchor = prefix.root_positions[:, -1]
        return self.forecaster.codec.decode(
            features.to(anchor),
            offsets=prefix.offsets,
            anchor=anchor,
            held=prefix.rotations_local[:, -1],
            tracks=ahead if codec.follows_path else None,
        )

    def replay(self, prefix: Motion) -> Motion:
        """What is expected after each frame of the prefix but the last, read so far: frames 2 on.

        Raises:
            ConfigError: a prefix of a single frame.
        """

        if self.steered_by:
            raise ConfigError("a steered forecaster cannot be asked what it expected; leave it out")

        def read(piece: Motion, known: Tensor, later: Mapping[str, Tensor]) -> Rollout:
            horizon = known.shape[1] - 1
            all_true = [True] * horizon
            return rollout(
                self.forecaster, known[:, :1], horizon, truth=known[:, 1:], truth_mask=all_true
            )

        features = self._run(prefix, read, {})
        count = features.shape[1]
        # One frame each, that goes on from the true frame before it.
        single = self.forecaster.codec.decode(
            features.to(prefix.root_positions).flatten(0, 1)[:, None],
            offsets=prefix.offsets.repeat_interleave(count, 0),
            anchor=prefix.root_positions[:, :-1].flatten(0, 1),
            held=prefix.rotations_local[:, :-1].flatten(0, 1),
        )
        moved = single.translations_local
        return Motion(
            single.rotations_local[:, 0].unflatten(0, (-1, count)),
            single.root_positions[:, 0].unflatten(0, (-1, count)),
            prefix.offsets,
            None if moved is None else moved[:, 0].unflatten(0, (-1, count)),
        )

    def _run(
        self,
        prefix: Motion,
        call: Callable[[Motion, Tensor, Mapping[str, Tensor]], Rollout],
        ahead: Mapping[str, Tensor],
    ) -> Tensor:
        """Features that follow, without gradients, a batch at a time."""
        codec, weight = self.forecaster.codec, next(self.forecaster.parameters())
        training = self.forecaster.training
        self.forecaster.eval()
        try:
            with torch.inference_mode():
                found: list[Tensor] = []
                for number, piece in enumerate(prefix.split(self.batch)):
                    batch = slice(number * self.batch, (number + 1) * self.batch)
                    later = {name: values[batch] for name, values in ahead.items()}
                    found.append(call(piece, codec.encode(piece).to(weight), later).features)
                return torch.cat(found)
        finally:
            self.forecaster.train(training)
