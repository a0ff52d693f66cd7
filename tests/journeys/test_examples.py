"""Every example runs as it says it does."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[2] / "examples"
SCRIPTS = sorted(EXAMPLES.glob("[0-9]*.py"))


def test_there_is_an_example() -> None:
    assert [script.name for script in SCRIPTS] == ["01_decoding_noise.py"]


@pytest.mark.parametrize("units", ["absolute", "relative"])
def test_noise_on_rotations_adds_up_down_the_tree(tmp_path: Path, units: str) -> None:
    out = tmp_path / "noise.png"
    done = subprocess.run(
        [sys.executable, str(SCRIPTS[0]), "--units", units, "--out", str(out)],
        capture_output=True,
        text=True,
        check=True,
        env={**os.environ, "OMP_NUM_THREADS": "1"},
    )
    rows = {
        match[1].strip(): [float(value) for value in match[2].split()]
        for match in re.finditer(r"^([a-z_6 ]+?)((?: +\d+\.\d+)+)$", done.stdout, re.MULTILINE)
    }
    assert len(rows) == 4
    for errors in rows.values():
        assert errors[0] == 0
        assert errors == sorted(errors)
    if units == "absolute":
        assert rows["dual_quaternion on the body"][2] < 0.6 * rows["quaternion"][2]
    assert out.stat().st_size > 10_000
