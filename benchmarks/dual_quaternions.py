"""Dual quaternions to and from root-relative, against PyMotion's: ``--help``.

PyMotion leaves the root's own rotation out of its chain, so the candidates are compared, and
timed, on poses whose root is not turned. From root-relative come local rotations and translations.
PyMotion's way there has no backward (it writes over what that needs), so the backward there is
timed against products of dual quaternions one joint after the other. A copy of the dual quaternions
says how much of the time is memory.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable

import torch
from benchmarks.timing import paired, rows_of, table
from pymotion.ops.skeleton_torch import from_root_dual_quat, to_root_dual_quat

from posecast.geometry import dual_quaternion, quaternion
from posecast.skeleton import local_to_root_dual, named_skeleton, root_to_local_motion

POSES = 6400


def run(*, compile_too: bool = True, rounds: int = 9) -> list[dict[str, object]]:
    """Rows ``name, candidate, seconds, ratio, foreign_load``; ratio > 1: faster than the first."""
    generator = torch.Generator().manual_seed(0)
    skeleton = named_skeleton("cmu-31").skeleton
    joints = len(skeleton)
    turns = quaternion.normalize(torch.randn(POSES, joints, 4, generator=generator))
    turns[:, 0] = quaternion.identity(POSES, like=turns)
    offsets = torch.randn(joints, 3, generator=generator)
    offsets[0] = 0
    origin = torch.zeros(POSES, 3)
    parents = torch.tensor(skeleton.parents).clamp_min(0)

    def there(turns: torch.Tensor) -> torch.Tensor:
        return local_to_root_dual(skeleton, turns, offsets)

    def back(dual: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        motion = root_to_local_motion(skeleton, dual)
        return motion.rotations, motion.translations

    def one_by_one(turns: torch.Tensor) -> torch.Tensor:
        local = dual_quaternion.from_rotation_translation(turns, offsets)
        done: list[torch.Tensor] = []
        for joint, parent in enumerate(skeleton.parents):
            own = local[:, joint]
            done.append(own if parent < 0 else dual_quaternion.product(done[parent], own))
        return torch.stack(done, dim=1)

    def back_one_by_one(dual: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        local = [
            dual[:, joint]
            if parent < 0
            else dual_quaternion.product(dual_quaternion.conjugate(dual[:, parent]), dual[:, joint])
            for joint, parent in enumerate(skeleton.parents)
        ]
        whole = torch.stack(local, dim=1)
        return whole[..., :4], dual_quaternion.translation(whole)

    to_root: dict[str, Callable[[torch.Tensor], object]] = {
        "PyMotion": lambda turns: to_root_dual_quat(turns, origin, parents, offsets),
        "one by one": one_by_one,
        "local_to_root_dual": there,
    }
    from_root: dict[str, Callable[[torch.Tensor], object]] = {
        "PyMotion": lambda dual: from_root_dual_quat(dual, parents),
        "one by one": back_one_by_one,
        "root_to_local_motion": back,
    }
    if compile_too:
        to_root["local_to_root_dual, compiled"] = torch.compile(there, dynamic=False)
        from_root["root_to_local_motion, compiled"] = torch.compile(back, dynamic=False)
    dual = there(turns)
    _check(to_root, turns)
    _check(from_root, dual)
    rows: list[dict[str, object]] = []
    for name, calls, given in (
        ("local to root-relative", to_root, turns),
        ("root-relative to local", from_root, dual),
    ):
        for task, run_one in (("forward", _forward), ("forward + backward", _both)):
            timed = {
                key: (lambda call=call, given=given, run_one=run_one: run_one(call, given))
                for key, call in calls.items()
                if key != "PyMotion" or task == "forward" or calls is from_root
            }
            if task == "forward":
                timed["a copy of the dual quaternions"] = dual.clone
            timings = paired(timed, next(iter(timed)), rounds=rounds, warmup=2)
            rows += rows_of(f"{name}, {task}, {POSES} x {joints}", timings)
    return rows


def _forward(call: Callable[[torch.Tensor], object], given: torch.Tensor) -> None:
    with torch.no_grad():
        call(given)


def _both(call: Callable[[torch.Tensor], object], given: torch.Tensor) -> None:
    """With a gradient of ones of everything that came out."""
    found = call(given.detach().requires_grad_())
    parts = found if isinstance(found, tuple) else (found,)
    torch.autograd.backward(list(parts), [torch.ones_like(part) for part in parts])


def _check(calls: dict[str, Callable[[torch.Tensor], object]], given: torch.Tensor) -> None:
    """Stop unless all agree below the root."""
    found = []
    for call in calls.values():
        result = call(given)
        parts = result if isinstance(result, tuple) else (result,)
        found.append(sorted((part[:, 1:] for part in parts), key=lambda part: part.shape[-1]))
    for other in found[1:]:
        for one, two in zip(found[0], other, strict=True):
            torch.testing.assert_close(two, one, atol=2e-4, rtol=0)


def main() -> None:
    """Print the table, or JSON."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--no-compile", action="store_true", help="leave torch.compile out")
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")
    parser.add_argument("--rounds", type=int, default=9, help="timed rounds (default 9)")
    arguments = parser.parse_args()
    rows = run(compile_too=not arguments.no_compile, rounds=arguments.rounds)
    print(json.dumps(rows, indent=1) if arguments.json else table(rows))


if __name__ == "__main__":
    main()
