"""``python -m benchmarks``: every benchmark in turn; ratios side by side in one process."""

from __future__ import annotations

import argparse
import json
import platform
from collections.abc import Callable
from pathlib import Path

import torch
from benchmarks import (
    bvh,
    decoding,
    dual_quaternions,
    generation,
    head,
    kinematics,
    recipe_steps,
    recording,
    representations,
    rollout,
    sampling,
    training_step,
)
from benchmarks.timing import table

BENCHMARKS: dict[str, Callable[[], list[dict[str, object]]]] = {
    "kinematics": kinematics.run,
    "dual_quaternions": dual_quaternions.run,
    "representations": representations.run,
    "head": head.run,
    "bvh": bvh.run,
    "training_step": training_step.run,
    "sampling": sampling.run,
    "decoding": decoding.run,
    "rollout": rollout.run,
    "generation": generation.run,
    "recipe_steps": recipe_steps.run,
    "recording": recording.run,
}

NAMES = (
    "name",
    "candidate",
    "reference",
    "share_of_truth",
    "step",
    "corpus",
    "augmentation",
    "characters",
)
"""What tells the rows of a benchmark apart."""


def main() -> None:
    """Run the benchmarks that were named, or all."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("names", nargs="*", choices=[*BENCHMARKS, []], help="which ones; all")
    parser.add_argument("--json", metavar="FILE", help="write all rows there, too")
    parser.add_argument(
        "--against", metavar="FILE", type=Path, help="rows of an earlier run, to stand beside these"
    )
    arguments = parser.parse_args()
    before = json.loads(arguments.against.read_text("utf-8")) if arguments.against else {}
    print(
        f"{platform.processor() or platform.machine()}, {torch.get_num_threads()} threads, "
        f"torch {torch.__version__}, Python {platform.python_version()}"
    )
    results: dict[str, list[dict[str, object]]] = {}
    for name in arguments.names or BENCHMARKS:
        results[name] = BENCHMARKS[name]()
        shown = _beside(results[name], before.get(name, [])) if before else results[name]
        print(f"\n{name}\n{table(shown)}", flush=True)
    if arguments.json:
        Path(arguments.json).write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")


def _beside(
    rows: list[dict[str, object]], before: list[dict[str, object]]
) -> list[dict[str, object]]:
    """Rows with the ratio that the same row had in an earlier run; ``None`` where it had none."""

    def name(row: dict[str, object]) -> tuple[object, ...]:
        return tuple(row.get(key) for key in NAMES)

    then = {name(row): row.get("ratio", row.get("share")) for row in before}
    return [{**row, "before": then.get(name(row))} for row in rows]


if __name__ == "__main__":
    main()
