"""The decoding loop of scheduled sampling, beside a plain two-layer ``nn.GRU`` called step by step.

QuaterNet's velocity model at paper size goes on from one frame; what it reads next is the truth or
what it said. Both give the same numbers; they are compared before anything is timed.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import torch
from benchmarks.timing import main_of, paired, rows_of
from benchmarks.training_step import BATCH, JOINTS, make_forecaster
from tests.references.plain_gru import velocity_rollout
from torch import Tensor

from posecast.geometry import quaternion
from posecast.model import Forecaster, rollout

STEPS = (10, 24)
"""Of Human3.6M at 25 and of AMASS at 60 frames per second: 400 ms."""

SHARES_OF_TRUTH = (1.0, 0.5, 0.0)


def run(rounds: int = 7) -> list[dict[str, object]]:
    """Rows ``name, candidate, seconds, ratio, foreign_load``; ratio > 1: faster than plain."""
    forecaster = make_forecaster()
    rows: list[dict[str, object]] = []
    for steps in STEPS:
        generator = torch.Generator().manual_seed(steps)
        drawn = torch.randn(BATCH, steps + 1, JOINTS, 4, generator=generator)
        frames = quaternion.normalize(drawn).flatten(-2)
        for share in SHARES_OF_TRUTH:
            mask = [share == 1 or (share > 0 and step % 2 == 0) for step in range(steps)]
            decoders = {
                "plain": partial(_plain, forecaster, frames[:, :1], frames[:, 1:], mask),
                "posecast": partial(_ours, forecaster, frames[:, :1], frames[:, 1:], mask),
            }
            _check(decoders)
            for task, change in (("forward", _forward), ("forward + backward", _gradient)):
                calls = {
                    name: partial(change, forecaster, decode) for name, decode in decoders.items()
                }
                name = f"{task}, {steps} steps, {share:.0%} true"
                rows += rows_of(name, paired(calls, "plain", rounds=rounds))
    return rows


def _plain(forecaster: Forecaster, first: Tensor, truth: Tensor, mask: list[bool]) -> Tensor:
    return velocity_rollout(forecaster, first, truth, mask)[0]


def _ours(forecaster: Forecaster, first: Tensor, truth: Tensor, mask: list[bool]) -> Tensor:
    return rollout(forecaster, first, truth.shape[1], truth=truth, truth_mask=mask).features


def _forward(forecaster: Forecaster, decode: Callable[[], Tensor]) -> Tensor:
    with torch.inference_mode():
        return decode()


def _gradient(forecaster: Forecaster, decode: Callable[[], Tensor]) -> None:
    forecaster.zero_grad()
    decode().sum().backward()


def _check(decoders: dict[str, Callable[[], Tensor]]) -> None:
    """Stop unless both give the same features."""
    with torch.inference_mode():
        plain, ours = (decode() for decode in decoders.values())
    # What is read again carries its rounding on.
    torch.testing.assert_close(ours, plain, atol=2e-3, rtol=1e-3)


if __name__ == "__main__":
    main_of(run, __doc__, rounds=7)
