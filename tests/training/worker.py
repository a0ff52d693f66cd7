"""A training run as a process of its own: to be killed, or to be one of several.

Usage: worker.py FOLDER EPOCHS SECONDS_PER_EPOCH [DEVICES]
"""

from __future__ import annotations

import sys
import time
from pathlib import Path

import torch
from tiny import train

torch.set_num_threads(1)  # as in the suite: sums are in another order with more of them


def main() -> None:
    """Train as the arguments say."""
    folder, epochs, seconds = Path(sys.argv[1]), int(sys.argv[2]), float(sys.argv[3])
    devices = int(sys.argv[4]) if len(sys.argv) > 4 else None
    result = train(
        folder, epochs=epochs, devices=devices, on_validation=lambda: time.sleep(seconds)
    )
    if result.is_main_process:
        (folder / "done").write_text(f"{result.updates} {result.best.epoch}")


if __name__ == "__main__":
    main()
