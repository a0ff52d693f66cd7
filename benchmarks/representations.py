"""What each representation costs: encoding and decoding, and a training step of two networks.

A training step of acRNN is that of the recipe acrnn-quaternion with the representation in its
place: windows of 101 frames, 32 at a time, five true and five own frames in turn, on CMU's skeleton
of 31 joints. ``dual_quaternion, all losses`` is that of acrnn-dual-quaternion-all. One of QuaterNet
is that of quaternet-dual-quaternion beside that of quaternet-vel, on the skeleton of Human3.6M:
half of the steps read the truth.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from functools import partial

import torch
from benchmarks.timing import paired, table
from torch import Tensor

from posecast.geometry import quaternion
from posecast.motion import Motion
from posecast.recipe import load_recipe
from posecast.representation import REPRESENTATIONS, build_representation
from posecast.skeleton import Skeleton, named_skeleton
from posecast.training import training_loss
from posecast.training.feeding import ScheduledSampling

POSES = 20_000
MILLION = 1_000_000


def run(*, rounds: int = 3, hidden: int = 1024, batch: int = 32) -> list[dict[str, object]]:
    """Rows ``name, candidate, seconds, ratio, foreign_load``; ratio > 1: faster than the first.

    Encoding and decoding are held against ``ortho6d``'s, training steps against quaternions'.
    """
    skeleton = named_skeleton("cmu-31").skeleton
    return [
        *_coding(skeleton, rounds + 2),
        *_steps(skeleton, rounds, hidden, batch),
        *_quaternet_steps(rounds, hidden),
    ]


def _coding(skeleton: Skeleton, rounds: int) -> list[dict[str, object]]:
    """Seconds a million poses."""
    generator = torch.Generator().manual_seed(0)
    turns = quaternion.normalize(torch.randn(POSES, len(skeleton), 4, generator=generator))
    bodies = torch.randn(len(skeleton), 3, generator=generator)
    rows: list[dict[str, object]] = []
    made = {kind: build_representation(kind, skeleton) for kind in REPRESENTATIONS}
    encoded = {kind: each.encode(turns, bodies) for kind, each in made.items()}
    tasks: dict[str, dict[str, Callable[[], object]]] = {
        "encode": {kind: partial(each.encode, turns, bodies) for kind, each in made.items()},
        "decode": {
            kind: partial(each.decode, encoded[kind], bodies) for kind, each in made.items()
        },
    }
    for task, calls in tasks.items():
        with torch.no_grad():
            timings = paired(calls, "ortho6d", rounds=rounds, warmup=1)
        rows += [
            {
                "name": f"{task}, a million poses of {len(skeleton)} joints",
                "candidate": kind,
                "seconds": timing.median_seconds * MILLION / POSES,
                "ratio": timing.ratio,
                "foreign_load": timing.foreign_load,
            }
            for kind, timing in timings.items()
        ]
    return rows


def _steps(skeleton: Skeleton, rounds: int, hidden: int, batch: int) -> list[dict[str, object]]:
    """Seconds of an update, network and optimizer."""
    calls: dict[str, Callable[[], object]] = {
        kind: _step("acrnn-quaternion", skeleton, hidden, batch, f"representation={{kind: {kind}}}")
        for kind in REPRESENTATIONS
    }
    calls["dual_quaternion, all losses"] = _step(
        "acrnn-dual-quaternion-all", skeleton, hidden, batch
    )
    timings = paired(calls, "quaternion", rounds=rounds, warmup=1)
    return [
        {
            "name": f"training step of acRNN, {hidden} units, batch {batch}",
            "candidate": kind,
            "seconds": timing.median_seconds,
            "ratio": timing.ratio,
            "foreign_load": timing.foreign_load,
        }
        for kind, timing in timings.items()
    ]


def _quaternet_steps(rounds: int, hidden: int) -> list[dict[str, object]]:
    """Seconds of an update of QuaterNet, at its recipes' batch."""
    skeleton = named_skeleton("h36m-32").skeleton
    names = ("quaternet-vel", "quaternet-dual-quaternion", "quaternet-dual-quaternion-positions")
    units = hidden if hidden != 1024 else 1000
    calls = {name: _step(name, skeleton, units, None) for name in names}
    timings = paired(calls, names[0], rounds=rounds, warmup=1)
    return [
        {
            "name": f"training step of QuaterNet, {units} units",
            "candidate": name,
            "seconds": timing.median_seconds,
            "ratio": timing.ratio,
            "foreign_load": timing.foreign_load,
        }
        for name, timing in timings.items()
    ]


def _step(
    name: str, skeleton: Skeleton, hidden: int, batch: int | None, *overrides: str
) -> Callable[[], object]:
    """An update of a fresh network on made-up windows."""
    recipe = load_recipe(name, [f"model.backbone.hidden={hidden}", *overrides])
    motion = _motion(skeleton, batch or recipe.plan.batch, recipe.plan.prefix + recipe.plan.horizon)
    plain = recipe.build_codec(skeleton)
    forecaster = recipe.build_forecaster(recipe.build_codec(skeleton, plain.measure([motion])))
    optimizer = torch.optim.Adam(forecaster.parameters(), lr=1e-4, fused=True)
    if isinstance(recipe.feed, ScheduledSampling):
        generator = torch.Generator().manual_seed(0)
        mask = ScheduledSampling(0.5).mask(recipe.plan.horizon, 1, generator)
    else:
        mask = recipe.feed.mask(recipe.plan.horizon, 0, torch.Generator())

    def update() -> Tensor:
        loss = training_loss(
            forecaster, motion, prefix=recipe.plan.prefix, mask=mask, objective=recipe.objective
        ).total
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        return loss.detach()

    return update


def _motion(skeleton: Skeleton, batch: int, frames: int) -> Motion:
    generator = torch.Generator().manual_seed(0)
    joints = len(skeleton)
    start, speed = torch.randn(2, batch, 1, joints, 3, generator=generator)
    time = torch.arange(frames)[:, None, None] / 30
    bodies = torch.randn(joints, 3, generator=generator)
    bodies[0] = 0
    return Motion(
        quaternion.exp(start + speed * time),
        torch.randn(batch, frames, 3, generator=generator),
        bodies.expand(batch, joints, 3),
    )


def main() -> None:
    """Print the table, or JSON."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")
    parser.add_argument("--rounds", type=int, default=3, help="timed rounds (default 3)")
    parser.add_argument("--hidden", type=int, default=1024, help="units a layer (default 1024)")
    parser.add_argument("--batch", type=int, default=32, help="windows (default 32)")
    arguments = parser.parse_args()
    rows = run(rounds=arguments.rounds, hidden=arguments.hidden, batch=arguments.batch)
    print(json.dumps(rows, indent=1) if arguments.json else table(rows))


if __name__ == "__main__":
    main()
