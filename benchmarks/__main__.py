"""``python -m benchmarks``: every benchmark in turn; ratios side by side in one process."""

from __future__ import annotations

import argparse
import json
import platform
from collections.abc import Callable
from pathlib import Path

import torch
from benchmarks import bvh, kinematics, rollout, sampling, training_step
from benchmarks.timing import table

BENCHMARKS: dict[str, Callable[[], list[dict[str, object]]]] = {
    "kinematics": kinematics.run,
    "bvh": bvh.run,
    "training_step": training_step.run,
    "sampling": sampling.run,
    "rollout": rollout.run,
}


def main() -> None:
    """Run the benchmarks that were named, or all."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("names", nargs="*", choices=[*BENCHMARKS, []], help="which ones; all")
    parser.add_argument("--json", metavar="FILE", help="write all rows there, too")
    arguments = parser.parse_args()
    print(
        f"{platform.processor() or platform.machine()}, {torch.get_num_threads()} threads, "
        f"torch {torch.__version__}, Python {platform.python_version()}"
    )
    results: dict[str, list[dict[str, object]]] = {}
    for name in arguments.names or BENCHMARKS:
        results[name] = BENCHMARKS[name]()
        print(f"\n{name}\n{table(results[name])}", flush=True)
    if arguments.json:
        Path(arguments.json).write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
