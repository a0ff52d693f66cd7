"""Session, a forecaster in mid-motion, and rollout, many of its steps: the only loop over time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple, Protocol, runtime_checkable

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from posecast.errors import ConfigError
from posecast.model.forecaster import Prediction
from posecast.model.recurrent import State


@runtime_checkable
class Steppable(Protocol):
    """What a session drives: a forecaster, or what steps in its place."""

    @property
    def feedback(self) -> Literal["valid", "emitted"]:
        """What is read of a prediction, see ``Forecaster``."""
        ...

    def initial_state(self, batch: int) -> State:
        """The state before anything was read."""
        ...

    def __call__(
        self,
        features: Float[Tensor, "batch frames features"],
        state: State,
        controls: Float[Tensor, "batch frames controls"] | None = None,
        *,
        last: int | None = None,
        generator: torch.Generator | None = None,
    ) -> Prediction:
        """Read frames and predict the frame after each, see ``Forecaster.forward``."""
        ...


@dataclass
class Session:
    """A forecaster in mid-motion: all that is needed to produce the next frame.

    Args:
        forecaster: what predicts.
        state: what its backbone remembers of the frames it has read; a value that can be kept, to
            go back to this moment later.
        unread: frames it is still to read: true ones, or its own last prediction.
        controls: controls of the unread frames, as far as they are known.
        generator: what input dropout draws from in training.
        feedback_gradient: whether a frame that was fed back passes gradients on.
    """

    forecaster: Steppable
    state: State
    unread: Float[Tensor, "batch frames features"]
    controls: Float[Tensor, "batch _ controls"] | None = None
    generator: torch.Generator | None = None
    feedback_gradient: bool = True

    @classmethod
    def start(
        cls,
        forecaster: Steppable,
        prefix: Float[Tensor, "batch frames features"],
        controls: Float[Tensor, "batch _ controls"] | None = None,
        *,
        state: State | None = None,
        generator: torch.Generator | None = None,
        feedback_gradient: bool = True,
    ) -> Session:
        """A session that has frames to read.

        Args:
            forecaster: what predicts.
            prefix: true frames, at least one.
            controls: of these frames, or of all but the last, whose controls ``step`` is given.
            state: what it remembers of frames before these; ``None``: that there were none.
            generator: what input dropout draws from in training.
            feedback_gradient: whether a frame that is fed back passes gradients on.
        """
        if state is None:
            state = forecaster.initial_state(prefix.shape[0])
        return cls(forecaster, state, prefix, controls, generator, feedback_gradient)

    def read(
        self,
        frames: Float[Tensor, "batch frames features"],
        controls: Float[Tensor, "batch _ controls"] | None = None,
    ) -> None:
        """Queue true frames behind those that are unread; the next step reads them all at once.

        Args:
            frames: true frames, any number.
            controls: of all unread frames whose controls are not known yet, in their order.
        """
        self.unread = torch.cat([self.unread, frames], dim=1)
        self._steer(controls)

    def step(
        self, controls: Float[Tensor, "batch controls"] | None = None
    ) -> Float[Tensor, "batch features"]:
        """Read what is unread, predict one frame, and feed it back.

        Args:
            controls: of the newest unread frame, for a forecaster that takes controls.
        """
        if controls is not None:
            self._steer(controls[:, None])
        return self.advance().features[:, 0]

    def advance(self, last: int = 1) -> Prediction:
        """Read what is unread in one call, predict after its ``last`` frames, feed the newest back.

        Raises:
            ConfigError: the controls of some unread frames are not known, or are too many.
        """
        known = 0 if self.controls is None else self.controls.shape[1]
        if self.controls is not None and known != self.unread.shape[1]:
            raise ConfigError(
                f"{self.unread.shape[1]} frames are unread, but the controls of {known} are known"
            )
        prediction = self.forecaster(
            self.unread, self.state, self.controls, last=last, generator=self.generator
        )
        self.state = prediction.state
        said = prediction.emitted if self.forecaster.feedback == "emitted" else prediction.features
        newest = said[:, -1:]
        self.unread = newest if self.feedback_gradient else newest.detach()
        self.controls = None
        return prediction

    def _steer(self, controls: Tensor | None) -> None:
        """Append the controls of frames."""
        if controls is not None and self.controls is not None:
            controls = torch.cat([self.controls, controls], dim=1)
        self.controls = self.controls if controls is None else controls


class Rollout(NamedTuple):
    """Frames predicted one after the other.

    Args:
        features: valid features of the horizon.
        raw: what the representation's penalty is taken of, see ``Prediction``.
        emitted: the features before they were projected.
        state: what the backbone remembers of all frames it has read.
    """

    features: Float[Tensor, "batch horizon features"]
    raw: Float[Tensor, "batch horizon joints joint_dim"]
    emitted: Float[Tensor, "batch horizon features"]
    state: State


def rollout(
    forecaster: Steppable,
    prefix: Float[Tensor, "batch frames features"],
    horizon: int,
    *,
    truth: Float[Tensor, "batch _ features"] | None = None,
    truth_mask: Bool[Tensor, " horizon"] | Sequence[bool] | None = None,
    controls: Float[Tensor, "batch _ controls"] | None = None,
    state: State | None = None,
    feedback_gradient: bool = True,
    generator: torch.Generator | None = None,
) -> Rollout:
    """Predict ``horizon`` frames after a prefix, in training as in use.

    Args:
        forecaster: what predicts.
        prefix: true frames, at least one.
        horizon: number of frames to predict.
        truth: the true frames of the horizon; the last one is never read.
        truth_mask: one boolean a predicted frame: whether the frame just before it is read from
            ``truth`` rather than from the forecaster's own prediction. The first frame follows the
            prefix, so the first entry says nothing. Each run of true frames is read in one call of
            the backbone. On the CPU, if it is a tensor. ``None``: own predictions throughout.
        controls: of the prefix and of the horizon; that of the last frame is never read.
        state: what the forecaster remembers of frames before the prefix; ``None``: that there were
            none.
        feedback_gradient: whether predictions that are fed back pass gradients on (Pavllo et al.
            2020 stop them in their convolutional network).
        generator: what input dropout draws from in training.

    Raises:
        ConfigError: nothing to read or to predict, or too little truth or controls.
    """
    given = [False] * horizon if truth_mask is None else [bool(each) for each in truth_mask]
    _check(prefix, horizon, truth, given, controls)
    session = Session.start(
        forecaster,
        prefix,
        state=state,
        generator=generator,
        feedback_gradient=feedback_gradient,
    )
    parts: list[Prediction] = []
    start = steered = 0
    while start < horizon:
        stop = next((step for step in range(start + 1, horizon) if not given[step]), horizon)
        true_run = prefix[:, :0] if truth is None else truth[:, start : stop - 1]
        read = prefix.shape[1] + stop - 1
        session.read(true_run, None if controls is None else controls[:, steered:read])
        parts.append(session.advance(stop - start))
        start, steered = stop, read
    return _joined(parts)


def gated_rollout(
    forecaster: Steppable,
    prefix: Float[Tensor, "batch frames features"],
    horizon: int,
    *,
    truth: Float[Tensor, "batch _ features"],
    truth_mask: Bool[Tensor, " horizon"],
    controls: Float[Tensor, "batch _ controls"] | None = None,
    state: State | None = None,
    feedback_gradient: bool = True,
    generator: torch.Generator | None = None,
) -> Rollout:
    """The same as ``rollout``, whatever the mask says by the same operations.

    Nothing looks into the mask: after the prefix every frame is read in a call of its own, and the
    mask chooses between the true frame and the one predicted. So the operations can be recorded
    once for all masks (``training.recording``); done one by one they are slower.

    Args:
        forecaster, prefix, horizon, truth, controls, state, feedback_gradient, generator: see
            ``rollout``.
        truth_mask: as for ``rollout``, on the device of ``prefix``.

    Raises:
        ConfigError: nothing to read or to predict, or too little truth or controls.
    """
    _check(prefix, horizon, truth, [True] * len(truth_mask), controls)
    given = prefix.shape[1]
    session = Session.start(
        forecaster,
        prefix,
        None if controls is None else controls[:, :given],
        state=state,
        generator=generator,
        feedback_gradient=feedback_gradient,
    )
    parts = [session.advance()]
    for step in range(1, horizon):
        read = given + step
        session.unread = torch.where(truth_mask[step], truth[:, step - 1 : step], session.unread)
        session._steer(None if controls is None else controls[:, read - 1 : read])
        parts.append(session.advance())
    return _joined(parts)


def _joined(parts: Sequence[Prediction]) -> Rollout:
    """Predictions one after the other."""
    return Rollout(
        torch.cat([part.features for part in parts], dim=1),
        torch.cat([part.raw for part in parts], dim=1),
        torch.cat([part.emitted for part in parts], dim=1),
        parts[-1].state,
    )


def _check(
    prefix: Tensor,
    horizon: int,
    truth: Tensor | None,
    given: list[bool],
    controls: Tensor | None,
) -> None:
    """Refuse a rollout that lacks what it would read."""
    if prefix.shape[1] < 1 or horizon < 1:
        raise ConfigError(
            f"a rollout needs at least one frame to read and one to predict; "
            f"found {prefix.shape[1]} and {horizon}"
        )
    if len(given) != horizon:
        raise ConfigError(f"truth_mask has {len(given)} entries for a horizon of {horizon} frames")
    known = 0 if truth is None else truth.shape[1]
    wanted = max((step for step in range(1, horizon) if given[step]), default=0)
    if known < wanted:
        raise ConfigError(f"truth_mask asks for {wanted} true frames; truth has {known}")
    read = prefix.shape[1] + horizon - 1
    if controls is not None and controls.shape[1] < read:
        raise ConfigError(f"{read} frames will be read, but there are {controls.shape[1]} controls")
