"""The optimizers that a plan may name."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from torch.optim import SGD, Adam, Optimizer


def _adam(parameters: Any, rate: float) -> Optimizer:
    """Adam with its usual moments; one fused kernel where there is one."""
    parameters = list(parameters)
    fused = all(parameter.device.type in ("cpu", "cuda") for parameter in parameters)
    return Adam(parameters, lr=rate, fused=fused)


def _sgd(parameters: Any, rate: float) -> Optimizer:
    return SGD(parameters, lr=rate)


OPTIMIZERS: dict[str, Callable[[Any, float], Optimizer]] = {"adam": _adam, "sgd": _sgd}
