"""One training step without a framework: windows in, losses out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from posecast.model.forecaster import Forecaster
from posecast.model.recurrent import State
from posecast.model.rollout import Rollout, rollout
from posecast.motion import Motion
from posecast.representation import Codec
from posecast.training.comparison import Comparison
from posecast.training.objective import Loss, Objective


class Example(NamedTuple):
    """Windows as a forecaster reads them.

    Args:
        features: of all frames, encoded in one piece, so that signs are continuous from the prefix
            into the horizon.
        offsets: the body of each window, those joints that the codec writes; metres.
        controls: of all frames, for a forecaster that takes them.
    """

    features: Float[Tensor, "batch frames features"]
    offsets: Float[Tensor, "batch joints 3"]
    controls: Float[Tensor, "batch frames controls"] | None = None

    @classmethod
    def of(cls, codec: Codec, motion: Motion) -> Example:
        """Windows of motion, written by a codec."""
        return cls(codec.encode(motion), codec.choose(motion.offsets), codec.steer(motion))


Roll = Callable[..., Rollout]
"""How a forecaster is rolled out: ``rollout`` or ``gated_rollout``."""


class Carried(NamedTuple):
    """What a forecaster still remembers of other windows when it begins to read new ones.

    Args:
        kept: windows of which the state goes on; the others begin with the initial state.
        state: of the backbone, without a gradient.
    """

    kept: Bool[Tensor, "batch"]
    state: State

    def over(self, initial: State) -> State:
        """The states to begin with."""
        return tuple(
            torch.where(self.kept.view(-1, *[1] * (fresh.dim() - 1)), old, fresh)
            for old, fresh in zip(self.state, initial, strict=True)
        )


class Attempt(NamedTuple):
    """What a forecaster made of windows in training.

    Args:
        given: features of the frames it was given.
        comparison: its predictions beside what really followed.
        state: what its backbone remembers in the end, without a gradient.
    """

    given: Float[Tensor, "batch prefix features"]
    comparison: Comparison
    state: State


def training_loss(
    forecaster: Forecaster,
    motion: Motion,
    *,
    prefix: int,
    mask: Bool[Tensor, "horizon"] | Sequence[bool],
    objective: Objective,
    feedback_gradient: bool = True,
    generator: torch.Generator | None = None,
) -> Loss:
    """Roll a forecaster out over windows and compare with what really followed.

    Args:
        forecaster: what is trained; its codec writes the windows as features.
        motion: windows of ``prefix`` frames and the horizon after them.
        prefix: frames that are given, at least one.
        mask: one boolean a step of the horizon, see ``feeding``.
        objective: what to descend.
        feedback_gradient: whether predictions that are fed back pass gradients on.
        generator: what input dropout draws from; ``None``: PyTorch's own.
    """
    return objective(
        attempt(
            forecaster,
            Example.of(forecaster.codec, motion),
            prefix=prefix,
            mask=mask,
            order=objective.order,
            feedback_gradient=feedback_gradient,
            generator=generator,
        ).comparison
    )


def attempt(
    forecaster: Forecaster,
    example: Example,
    *,
    prefix: int,
    mask: Bool[Tensor, "horizon"] | Sequence[bool],
    order: str,
    feedback_gradient: bool = True,
    generator: torch.Generator | None = None,
    carried: Carried | None = None,
    roll: Roll = rollout,
) -> Attempt:
    """Roll a forecaster out over windows, the truth beside it.

    Args:
        forecaster: what is trained; its codec writes the windows as features.
        example: windows of ``prefix`` frames and the horizon after them.
        prefix: frames that are given, at least one.
        mask: one boolean a step of the horizon, see ``feeding``.
        order: Euler order of the terms that measure angles.
        feedback_gradient: whether predictions that are fed back pass gradients on.
        generator: what input dropout draws from; ``None``: PyTorch's own.
        carried: what it remembers of other windows; ``None``: nothing.
        roll: how it is rolled out.
    """
    state = None if carried is None else carried.over(forecaster.initial_state(len(carried.kept)))
    given, truth = example.features[:, :prefix], example.features[:, prefix:]
    found = roll(
        forecaster,
        given,
        truth.shape[1],
        truth=truth,
        truth_mask=mask,
        controls=example.controls,
        state=state,
        feedback_gradient=feedback_gradient,
        generator=generator,
    )
    return Attempt(
        given,
        Comparison(
            codec=forecaster.codec,
            predicted=found.features,
            raw=found.raw,
            emitted=found.emitted,
            last=given[:, -1],
            scale=forecaster.scale,
            target=truth,
            offsets=example.offsets,
            order=order,
        ),
        tuple(each.detach() for each in found.state),
    )
