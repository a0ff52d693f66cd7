"""A training step of QuaterNet at paper size, beside the plain loop over ``torch.nn.GRU``."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from functools import partial
from typing import TypeVar

import torch
from benchmarks.timing import paired, table
from tests.references.plain_gru import velocity_rollout
from torch import Tensor

from posecast.geometry import quaternion
from posecast.model import DenseHead, Forecaster, GRUBackbone, rollout
from posecast.model.products import Weight, exact_products
from posecast.representation import Codec, Quaternion
from posecast.skeleton import Skeleton
from posecast.training.comparison import Comparison
from posecast.training.objective import Objective

BATCH, PREFIX, HORIZON = 60, 50, 10
JOINTS, HIDDEN, LAYERS = 32, 1000, 2
SHARES_OF_TRUTH = (1.0, 0.5, 0.0)
CLIP, RATE = 0.1, 1e-3
GOAL = 1.7
CEILING_GOAL = 0.65
STEPS = PREFIX + HORIZON - 1
FLOPS = (
    6
    * BATCH
    * (
        STEPS * 3 * HIDDEN * (4 * JOINTS + HIDDEN + (LAYERS - 1) * 2 * HIDDEN)
        + HORIZON * HIDDEN * 4 * JOINTS
    )
)
"""Multiplications and additions of the matrix products of a step, forward and twice backward."""

MEDIUM = "posecast, medium"

Result = TypeVar("Result")


def run(rounds: int = 5) -> list[dict[str, object]]:
    """Milliseconds of a step for three shares of true frames, and of its matrix products alone.

    Both candidates do forward, loss, backward, clipping and Adam on the same batch. The plain one
    calls ``nn.GRU`` once for the prefix and once for each frame after it, with PyTorch's default
    Adam. ``products`` is every matrix product of the step, each by the fastest exact kernel, and
    nothing else; ``floor_share`` is its time as a share of a step's. ``ceiling_share`` is the rate
    of a step's products as a share of the rate of one product of 2048 x 2048 matrices, which is as
    fast as this machine multiplies: a ratio to the plain loop says as much about the loop as about
    us, and differs between processors. With PyTorch's precision ``medium``, processors with AMX
    round the factors to bfloat16, others change nothing; it shows in ``gradient_difference``, the
    length of the difference to the plain gradient as a share of that gradient's length.
    """
    rows: list[dict[str, object]] = []
    ceiling = fastest_rate()
    for share in SHARES_OF_TRUTH:
        mask = [share == 1 or (share > 0 and step % 2 == 0) for step in range(HORIZON)]
        candidates = {
            "plain loop": _step(make_forecaster(), mask, plain=True),
            "posecast": _step(make_forecaster(), mask, plain=False),
            MEDIUM: _at_medium_precision(_step(make_forecaster(), mask, plain=False)),
            "products": _products(mask),
        }
        times = paired(candidates, reference="plain loop", rounds=rounds, warmup=1)
        floor = times["products"].median_seconds
        exact = _gradient(mask, plain=True)
        found = {
            "posecast": _gradient(mask, plain=False),
            MEDIUM: _at_medium_precision(partial(_gradient, mask, plain=False))(),
        }
        for name in candidates:
            rows.append(
                {
                    "share_of_truth": share,
                    "step": name,
                    "ms": 1e3 * times[name].median_seconds,
                    "ratio": times[name].ratio,
                    "goal": GOAL if name == "posecast" else None,
                    "ceiling_share": FLOPS / times[name].median_seconds / ceiling,
                    "ceiling_goal": CEILING_GOAL if name == "posecast" else None,
                    "floor_share": floor / times[name].median_seconds,
                    "gradient_difference": (
                        float((found[name] - exact).norm() / exact.norm())
                        if name in found
                        else None
                    ),
                    "foreign_load": times[name].foreign_load,
                    "threads": torch.get_num_threads(),
                }
            )
    return rows


def fastest_rate(size: int = 2048, rounds: int = 7) -> float:
    """Operations a second of one large product by the fastest exact kernel."""
    left, right = torch.randn(2, size, size)
    seconds: list[float] = []
    for _ in range(rounds):
        start = time.perf_counter()
        left @ right
        middle = time.perf_counter()
        with exact_products(left):
            left @ right
        seconds += (middle - start, time.perf_counter() - middle)
    return float(2 * size**3 / min(seconds))


def make_forecaster() -> Forecaster:
    """The velocity model, the same weights every time."""
    skeleton = Skeleton(tuple(map(str, range(JOINTS))), tuple(range(-1, JOINTS - 1)))
    forecaster = Forecaster(
        Codec(skeleton, Quaternion()),
        backbone=partial(GRUBackbone, hidden=HIDDEN, layers=LAYERS),
        head=DenseHead,
        residual="compose",
    )
    forecaster.reset_parameters(torch.Generator().manual_seed(0))
    return forecaster


def _loss(forecaster: Forecaster, mask: list[bool], *, plain: bool) -> Tensor:
    """QuaterNet's loss of one random batch."""
    generator = torch.Generator().manual_seed(1)
    start, speed = 0.5 * torch.randn(2, BATCH, 1, JOINTS, 3, generator=generator)
    seconds = torch.arange(PREFIX + HORIZON)[:, None, None] / 25
    rotations = quaternion.exp(start + speed * seconds)
    features = rotations.flatten(-2)
    prefix, truth = features[:, :PREFIX], features[:, PREFIX:]
    if plain:
        predicted, raw = velocity_rollout(forecaster, prefix, truth, mask)
    else:
        predicted, raw = rollout(forecaster, prefix, HORIZON, truth=truth, truth_mask=mask)
    comparison = Comparison(
        codec=forecaster.codec,
        predicted=predicted,
        raw=raw,
        emitted=predicted,
        target=truth,
        last=truth[:, 0],
        offsets=torch.zeros(BATCH, JOINTS, 3),
    )
    return Objective({"euler": 1.0, "penalty": 0.01})(comparison).total


def _step(forecaster: Forecaster, mask: list[bool], *, plain: bool) -> Callable[[], Tensor]:
    """One update of the weights."""
    optimizer = torch.optim.Adam(forecaster.parameters(), lr=RATE, fused=None if plain else True)

    def update() -> Tensor:
        optimizer.zero_grad()
        loss = _loss(forecaster, mask, plain=plain)
        loss.backward()
        torch.nn.utils.clip_grad_norm_(forecaster.parameters(), CLIP)
        optimizer.step()
        return loss.detach()

    return update


def _at_medium_precision(call: Callable[[], Result]) -> Callable[[], Result]:
    """The same call with PyTorch's matrix-multiplication precision lowered meanwhile."""

    def lowered() -> Result:
        before = torch.get_float32_matmul_precision()
        torch.set_float32_matmul_precision("medium")
        try:
            return call()
        finally:
            torch.set_float32_matmul_precision(before)

    return lowered


def _gradient(mask: list[bool], *, plain: bool) -> Tensor:
    """The gradient of all weights at the start, as one vector."""
    forecaster = make_forecaster()
    weights = list(forecaster.parameters())
    gradients = torch.autograd.grad(_loss(forecaster, mask, plain=plain), weights)
    return torch.cat([gradient.flatten() for gradient in gradients])


def _products(mask: list[bool]) -> Callable[[], object]:
    """All matrix products of a step, on random factors."""
    steps, gates = STEPS, 3 * HIDDEN
    runs = [PREFIX]
    for given in mask[1:]:
        if given:
            runs[-1] += 1
        else:
            runs.append(1)
    sizes = [4 * JOINTS] + [HIDDEN] * (LAYERS - 1)
    inputs = [Weight(torch.randn(gates, size)) for size in sizes]
    states = [Weight(torch.randn(gates, HIDDEN)) for _ in sizes]
    output = Weight(torch.randn(4 * JOINTS, HIDDEN))
    wide, narrow = torch.randn(steps * BATCH, gates), torch.randn(steps * BATCH, HIDDEN)
    context, bias = narrow[: HORIZON * BATCH], torch.zeros(gates)
    answers = torch.randn(HORIZON * BATCH, 4 * JOINTS)
    # Backward adds to what is there: the memory of these is not asked for anew.
    onto = [torch.zeros(steps * BATCH, size) for size in (*sizes, HIDDEN)]
    totals = [torch.zeros(gates, size) for size in (*sizes, HIDDEN)]

    def call() -> None:
        for layer, (size, below, state) in enumerate(zip(sizes, inputs, states, strict=True)):
            for number, length in enumerate(runs):
                rows = length * BATCH
                below.product(narrow[:rows, :size].contiguous(), bias)
                if layer or number:
                    below.back(wide[:rows], onto=onto[layer][:rows])
            for _ in range(steps):
                state.product(narrow[:BATCH], bias)
                state.back(wide[:BATCH], onto=onto[-1][:BATCH])
            with exact_products(wide):
                totals[-1].addmm_(wide.t(), narrow)
                totals[layer].addmm_(wide.t(), narrow[:, :size])
        output.product(context, bias[: 4 * JOINTS])
        output.back(answers, onto=onto[-1][: HORIZON * BATCH])
        answers.t() @ context

    return call


def main() -> None:
    """Print the table, then the same as JSON."""
    rows = run()
    print(table(rows))
    print(json.dumps(rows))


if __name__ == "__main__":
    main()
