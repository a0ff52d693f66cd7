"""Training steps recorded once as CUDA graphs, and replayed.

A step of a small network is thousands of operations that an accelerator finishes sooner than a
program can ask for them; a graph asks for all of them at once.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import torch
from jaxtyping import Bool
from torch import Tensor, nn

from posecast.errors import ConfigError
from posecast.model.forecaster import Forecaster
from posecast.model.recurrent import State
from posecast.model.rollout import gated_rollout
from posecast.training.adversary import Adversary
from posecast.training.objective import Loss, Objective
from posecast.training.plan import Plan
from posecast.training.step import Carried, Example, attempt


def check_recording(
    device: torch.device, processes: int, plan: Plan, *, adversary: Adversary | None
) -> None:
    """Refuse a run whose steps cannot be recorded.

    Raises:
        ConfigError: the device is no NVIDIA GPU, there are several processes, or something changes
            from step to step that a recording would hold still.
    """
    wanted = "training steps are recorded as CUDA graphs on one NVIDIA GPU"
    if device.type != "cuda":
        raise ConfigError(f"{wanted}; this run is on {device.type!r}: leave --cuda-graphs out")
    if processes > 1:
        raise ConfigError(f"{wanted}; this run has {processes} processes: ask for --devices 1")
    if adversary is not None or plan.noise_at is not None:
        changing = "adversary" if adversary is not None else "training.noise_at"
        raise ConfigError(
            f"{wanted}, which {changing} would change while training: leave --cuda-graphs out"
        )


class Recorder:
    """The loss of windows, its operations recorded once for every shape of batch.

    Recorded are the rollout, the loss and both their gradients, with weights and random streams
    where they are; what is left to the caller is the optimizer. Numbers that Python holds when a
    step is recorded, such as ``Forecaster.input_noise``, stay what they were.

    Args:
        forecaster: what is trained, on a CUDA device.
        objective: what to descend.
        prefix: frames of a window that are given.
        feedback_gradient: whether predictions that are fed back pass gradients on.
    """

    def __init__(
        self,
        forecaster: Forecaster,
        objective: Objective,
        *,
        prefix: int,
        feedback_gradient: bool = True,
    ) -> None:
        self.forecaster, self.objective = forecaster, objective
        self.prefix, self.feedback_gradient = prefix, feedback_gradient
        self._recorded: dict[tuple[torch.Size, ...], Callable[..., Any]] = {}

    def __call__(
        self, example: Example, mask: Bool[Tensor, "horizon"], carried: Carried | None = None
    ) -> tuple[Loss, State]:
        """The loss of windows and the state in the end, the same as of ``attempt``.

        Args:
            example: the windows.
            mask: one boolean a step of the horizon, on any device.
            carried: what is remembered of other windows; always given or never.
        """
        windows = [value for value in example if value is not None]
        memory = () if carried is None else (carried.kept, *carried.state)
        values = [mask.to(example.features.device), *windows, *memory]
        shapes = tuple(value.shape for value in values)
        if shapes not in self._recorded:
            self._recorded[shapes] = torch.cuda.make_graphed_callables(
                self.step(), tuple(value.clone() for value in values), allow_unused_input=True
            )
        total, *others = self._recorded[shapes](*values)
        terms, state = others[: len(self.objective.terms)], others[len(self.objective.terms) :]
        loss = Loss(total, dict(zip(self.objective.terms, terms, strict=True)))
        # The next replay writes where this one wrote, and reads what it is given before.
        return loss, tuple(each.clone() for each in state)

    def step(self) -> RecordableStep:
        """What is recorded, as a module of its own."""
        return RecordableStep(
            self.forecaster, self.objective, self.prefix, feedback_gradient=self.feedback_gradient
        )


class RecordableStep(nn.Module):
    """Mask and windows in, the loss and its terms out, by operations that never differ.

    Args:
        forecaster, objective, prefix, feedback_gradient: see ``Recorder``.
    """

    def __init__(
        self,
        forecaster: Forecaster,
        objective: Objective,
        prefix: int,
        *,
        feedback_gradient: bool,
    ) -> None:
        super().__init__()
        self.forecaster, self.objective = forecaster, objective
        self.prefix, self.feedback_gradient = prefix, feedback_gradient

    def forward(self, mask: Bool[Tensor, "horizon"], *values: Tensor) -> tuple[Tensor, ...]:
        """The loss, which has a gradient; its terms before weighting and the state have none."""
        windows = 2 if self.forecaster.controls is None else 3
        memory = values[windows:]
        attempted = attempt(
            self.forecaster,
            Example(*values[:windows]),
            prefix=self.prefix,
            mask=mask,
            order=self.objective.order,
            feedback_gradient=self.feedback_gradient,
            carried=Carried(memory[0], memory[1:]) if memory else None,
            roll=gated_rollout,
        )
        loss = self.objective(attempted.comparison)
        return (loss.total, *(value.detach() for value in loss.terms.values()), *attempted.state)
