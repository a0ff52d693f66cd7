"""Forward kinematics against a plain loop over joints: ``python benchmarks/kinematics.py --help``.

Two loops are the references. "loop, outer products" is tests/references/plain_kinematics.py,
the usual way to write it (QuaterNet's and its descendants'); "loop, library products" is the
same loop with the library's own, cheaper quaternion product. Every candidate is checked against
the first before it is timed. "floor" copies as many bytes as the task must read and write.

"positions" is what losses and metrics need; "positions and rotations" hands out the world
rotation of every joint, too, and both have a gradient in its backward.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path

import torch
from torch import Tensor

sys.path.insert(0, str(Path(__file__).parent))
sys.path.insert(0, str(Path(__file__).parents[1] / "tests/references"))
from plain_kinematics import plain_kinematics, plain_positions
from timing import paired, rows_of, table

from posecast.geometry import quaternion
from posecast.skeleton import Skeleton, forward_kinematics, joint_positions, named_skeleton

Place = Callable[[Tensor], Tensor]
"""From local rotations (poses, joints, 4) to positions (poses, joints, 3), or (poses, joints, 7)
with world rotations behind them."""

FLOATS = {3: (7, 18), 7: (11, 26)}
"""Numbers a joint that must move, for results of so many numbers a joint: forward, q in, results
out; and with a backward, results, q, their gradient in and dq out again."""


def run(*, compile_too: bool = False, rounds: int = 9) -> list[dict[str, object]]:
    """Rows ``name, candidate, seconds, ratio, foreign_load``; ratio > 1: faster than the loop."""
    rows: list[dict[str, object]] = []
    for poses, count in ((6400, rounds), (200_000, max(5, rounds // 2))):
        rows += _compare(poses, count, compile_too=compile_too)
    return rows


def _compare(poses: int, rounds: int, *, compile_too: bool) -> list[dict[str, object]]:
    """Forward, then forward and backward, for one number of poses."""
    generator = torch.Generator().manual_seed(0)
    skeleton = named_skeleton("cmu-31").skeleton
    joints = len(skeleton)
    rotations = quaternion.normalize(torch.randn(poses, joints, 4, generator=generator))
    offsets = torch.randn(joints, 3, generator=generator)
    roots = torch.randn(poses, 3, generator=generator)
    rows: list[dict[str, object]] = []
    for results, width, candidates in (
        ("positions", 3, _position_candidates(skeleton, offsets, roots, compile_too=compile_too)),
        ("positions and rotations", 7, _world_candidates(skeleton, offsets, roots)),
    ):
        weights = torch.randn(poses, joints, width, generator=generator)
        both = partial(_gradient, rotations, weights)
        _check(candidates, rotations, both)
        for task, call, floats in (
            ("forward", lambda place: place(rotations), FLOATS[width][0]),
            ("forward + backward", both, FLOATS[width][1]),
        ):
            calls = {name: _bound(call, place) for name, place in candidates.items()}
            source = torch.zeros(poses * joints * floats // 2)
            calls["floor"] = _bound(torch.zeros_like(source).copy_, source)
            timings = paired(calls, next(iter(candidates)), rounds=rounds, warmup=1)
            rows += rows_of(f"{results}, {task}, {poses} x {joints}", timings)
    return rows


def _gradient(rotations: Tensor, weights: Tensor, place: Place) -> Tensor:
    """That of the rotations, for a gradient of the results that is given: no loss is timed."""
    leaf = rotations.detach().requires_grad_()
    place(leaf).backward(weights)
    assert leaf.grad is not None
    return leaf.grad


def _position_candidates(
    skeleton: Skeleton, offsets: Tensor, roots: Tensor, *, compile_too: bool
) -> dict[str, Place]:
    """What is compared where positions are wanted; the first is the reference."""

    def positions(rotations: Tensor) -> Tensor:
        return joint_positions(skeleton, rotations, offsets, roots)

    found: dict[str, Place] = {
        "loop, outer products": lambda q: plain_positions(skeleton.parents, q, offsets, roots),
        "loop, library products": lambda q: _library_loop(skeleton, q, offsets, roots),
        "joint_positions": positions,
    }
    if compile_too:
        found["joint_positions, compiled"] = torch.compile(positions, dynamic=False)
    return found


def _world_candidates(skeleton: Skeleton, offsets: Tensor, roots: Tensor) -> dict[str, Place]:
    """What is compared where rotations are wanted, too; the first is the reference."""
    return {
        "loop, outer products": lambda q: torch.cat(
            plain_kinematics(skeleton.parents, q, offsets, roots), dim=-1
        ),
        "forward_kinematics": lambda q: torch.cat(
            forward_kinematics(skeleton, q, offsets, roots), dim=-1
        ),
    }


def _library_loop(skeleton: Skeleton, rotations: Tensor, offsets: Tensor, roots: Tensor) -> Tensor:
    """Joint after joint with the library's product; joints without children are not turned."""
    positions: list[Tensor] = []
    turned: dict[int, Tensor] = {}
    for joint, parent in enumerate(skeleton.parents):
        own = rotations[:, joint]
        if parent == -1:
            positions.append(roots + offsets[joint])
        else:
            bone = quaternion.rotate(turned[parent], offsets[joint])
            positions.append(positions[parent] + bone)
        if skeleton.children[joint]:
            turned[joint] = own if parent == -1 else quaternion.product(turned[parent], own)
    return torch.stack(positions, dim=1)


def _check(
    candidates: dict[str, Place], rotations: Tensor, both: Callable[[Place], Tensor]
) -> None:
    """Stop unless all agree with the first, gradients within the sphere of unit quaternions."""

    def tangent(gradient: Tensor) -> Tensor:
        return gradient - (gradient * rotations).sum(-1, keepdim=True) * rotations

    reference, *others = candidates.values()
    positions, gradient = reference(rotations), tangent(both(reference))
    for place in others:
        torch.testing.assert_close(place(rotations), positions, atol=1e-4, rtol=0)
        torch.testing.assert_close(tangent(both(place)), gradient, atol=1e-3, rtol=1e-3)


def _bound(call: Callable[..., object], argument: object) -> Callable[[], object]:
    return lambda: call(argument)


def main() -> None:
    """Print the table, or JSON."""
    parser = argparse.ArgumentParser(
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        epilog="example: python benchmarks/kinematics.py --threads 2",
    )
    parser.add_argument("--compile", action="store_true", help="what torch.compile adds, too")
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")
    parser.add_argument("--rounds", type=int, default=9, help="timed rounds (default 9)")
    parser.add_argument("--threads", type=int, help="threads for torch")
    arguments = parser.parse_args()
    if arguments.threads:
        torch.set_num_threads(arguments.threads)
    rows = run(compile_too=arguments.compile, rounds=arguments.rounds)
    print(json.dumps(rows, indent=1) if arguments.json else table(rows))


if __name__ == "__main__":
    main()
