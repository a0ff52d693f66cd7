"""Small fabricated files in the formats of the named corpora."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np
import pytest


@pytest.fixture
def write_h36m(tmp_path: Path) -> Callable[..., Path]:
    """Write recordings of given lengths; each has its own numbers, drawn from a fixed seed."""

    def write(frames: dict[str, int] | Iterable[str], root: Path | None = None) -> Path:
        folder = root or tmp_path / "h36m"
        lengths = frames if isinstance(frames, dict) else dict.fromkeys(frames, 60)
        for number, (name, length) in enumerate(lengths.items()):
            values = np.random.default_rng(number).normal(0, 0.1, (length, 99))
            lines = [",".join(f"{value:.7f}" for value in row) for row in values]
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_text("\n".join(lines) + "\n")
        return folder

    return write
