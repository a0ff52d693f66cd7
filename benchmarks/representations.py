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
from collections.abc import Callable, Sequence
from functools import partial

import torch
from benchmarks.timing import paired, rows_of, table
from torch import Tensor

from posecast.geometry import quaternion
from posecast.motion import Motion
from posecast.recipe import load_recipe
from posecast.representation import REPRESENTATIONS, build_representation
from posecast.skeleton import Skeleton, named_skeleton
from posecast.training import training_loss

POSES = 20_000
MILLION = 1_000_000
HALFWAY = 138
"""The epoch by which QuaterNet reads the truth in half of the steps: 0.995^138 is 0.5."""


def run(*, rounds: int = 3, overrides: Sequence[str] = ()) -> list[dict[str, object]]:
    """Rows ``name, candidate, seconds, ratio, foreign_load``; ratio > 1: faster than the first.

    Encoding and decoding are held against ``ortho6d``'s, training steps against quaternions'.
    """
    skeleton = named_skeleton("cmu-31").skeleton
    return [
        *_coding(skeleton, rounds + 2),
        *_acrnn_steps(skeleton, rounds, overrides),
        *_quaternet_steps(named_skeleton("h36m-32").skeleton, rounds, overrides),
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
        name = f"{task}, a million poses of {len(skeleton)} joints"
        rows += rows_of(name, timings, times=MILLION / POSES)
    return rows


def _acrnn_steps(
    skeleton: Skeleton, rounds: int, overrides: Sequence[str]
) -> list[dict[str, object]]:
    """Seconds of an update, network and optimizer."""
    calls: dict[str, Callable[[], object]] = {
        kind: _step("acrnn-quaternion", skeleton, [f"representation={{kind: {kind}}}", *overrides])
        for kind in REPRESENTATIONS
    }
    calls["dual_quaternion, all losses"] = _step("acrnn-dual-quaternion-all", skeleton, overrides)
    return rows_of("training step of acRNN", paired(calls, "quaternion", rounds=rounds, warmup=1))


def _quaternet_steps(
    skeleton: Skeleton, rounds: int, overrides: Sequence[str]
) -> list[dict[str, object]]:
    """Seconds of an update, network and optimizer."""
    names = ("quaternet-vel", "quaternet-dual-quaternion", "quaternet-dual-quaternion-positions")
    calls = {name: _step(name, skeleton, overrides) for name in names}
    return rows_of("training step of QuaterNet", paired(calls, names[0], rounds=rounds, warmup=1))


def _step(name: str, skeleton: Skeleton, overrides: Sequence[str]) -> Callable[[], object]:
    """An update of a fresh network on made-up windows."""
    recipe = load_recipe(name, overrides)
    plan = recipe.plan
    motion = random_motion(skeleton, plan.batch, plan.prefix + plan.horizon)
    plain = recipe.build_codec(skeleton)
    forecaster = recipe.build_forecaster(recipe.build_codec(skeleton, plain.measure([motion])))
    optimizer = torch.optim.Adam(forecaster.parameters(), lr=1e-4, fused=True)
    mask = recipe.feed.mask(plan.horizon, HALFWAY, torch.Generator().manual_seed(0))

    def update() -> Tensor:
        loss = training_loss(
            forecaster, motion, prefix=plan.prefix, mask=mask, objective=recipe.objective
        ).total
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        return loss.detach()

    return update


def random_motion(skeleton: Skeleton, batch: int, frames: int) -> Motion:
    """Smooth random motion of one body."""
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
    parser.add_argument(
        "overrides", nargs="*", help="of the recipes, such as model.backbone.hidden=64"
    )
    arguments = parser.parse_args()
    rows = run(rounds=arguments.rounds, overrides=arguments.overrides)
    print(json.dumps(rows, indent=1) if arguments.json else table(rows))


if __name__ == "__main__":
    main()
