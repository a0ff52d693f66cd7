"""A training run as a process of its own: to be killed, or to be one of several.

Usage: worker.py FOLDER EPOCHS SECONDS_PER_EPOCH [DEVICES | auto] [ADVERSARY] [CARRY]

ADVERSARY: the arguments of one, as JSON; CARRY: the share of the windows that carry states.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path

import torch
from tiny import train

from posecast.training import Adversary

torch.set_num_threads(1)  # as in the suite: sums are in another order with more of them


def main() -> None:
    """Train as the arguments say."""
    folder, epochs, seconds = Path(sys.argv[1]), int(sys.argv[2]), float(sys.argv[3])
    devices = sys.argv[4] if len(sys.argv) > 4 else "auto"
    adversary = sys.argv[5] if len(sys.argv) > 5 else ""
    result = train(
        folder,
        epochs=epochs,
        devices=None if devices == "auto" else int(devices),
        adversary=Adversary(**json.loads(adversary)) if adversary else None,
        on_validation=lambda: time.sleep(seconds),
        carry=float(sys.argv[6]) if len(sys.argv) > 6 else 0.0,
    )
    if result.is_main_process:
        (folder / "done").write_text(f"{result.updates} {result.best.epoch}")


if __name__ == "__main__":
    main()
