"""Reading and writing BVH against pybvh and numpy.loadtxt: ``python -m benchmarks.bvh --help``.

The file is ``--file``, or a salsa recording of the folder that POSECAST_DATA names, or else a
made-up one of the same size (2576 frames, 43 joints, 3.3 MB).

pybvh keeps Euler angles, a clip holds unit quaternions; so every direction has two rows: the same
numbers as pybvh (``document``), and all the way between file and quaternions (``quaternions``).
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pybvh
from benchmarks.timing import paired, table

from posecast.io.bvh import (
    BvhDocument,
    BvhJoint,
    read_bvh,
    read_bvh_document,
    write_bvh,
    write_bvh_document,
)

_SALSA = Path("cmu-salsa/61/61_09.bvh")
_JOINTS, _FRAMES = 43, 2576


def run(file: Path | None = None, rounds: int = 9) -> list[dict[str, object]]:
    """Rows of names, seconds and their ratio, above 1 if ours is faster."""
    with tempfile.TemporaryDirectory() as folder:
        source = file or _default_file(Path(folder))
        return _compare(source, Path(folder), rounds)


def _compare(source: Path, folder: Path, rounds: int) -> list[dict[str, object]]:
    clip, document, theirs = (
        read_bvh(source),
        read_bvh_document(source),
        pybvh.read_bvh_file(source),
    )
    root, quaternions = theirs.to_quat()
    numbers = _number_lines(source)

    def write_from_quaternions() -> None:
        theirs.from_quat(root, quaternions, inplace=False).write(folder / "pybvh.bvh")

    calls: dict[str, Callable[[], object]] = {
        "read document": lambda: read_bvh_document(source),
        "read quaternions": lambda: read_bvh(source),
        "pybvh read": lambda: pybvh.read_bvh_file(source),
        "pybvh read + to_quat": lambda: pybvh.read_bvh_file(source).to_quat(),
        "numpy.loadtxt": lambda: np.loadtxt(numbers),
        "write document, every digit": lambda: write_bvh_document(
            document, folder / "document.bvh"
        ),
        "write quaternions": lambda: write_bvh(clip, folder / "clip.bvh"),
        "pybvh write": lambda: pybvh.write_bvh_file(theirs, folder / "pybvh.bvh"),
        "pybvh from_quat + write": write_from_quaternions,
    }
    rows: list[dict[str, object]] = []
    for reference, names in (
        ("pybvh read", ["read document", "read quaternions"]),
        ("pybvh read + to_quat", ["read quaternions"]),
        ("numpy.loadtxt", ["read document"]),
        ("pybvh write", ["write document, every digit", "write quaternions"]),
        ("pybvh from_quat + write", ["write quaternions"]),
    ):
        timings = paired({key: calls[key] for key in (reference, *names)}, reference, rounds)
        rows.extend(
            {
                "name": name,
                "reference": reference,
                "seconds": timings[name].median_seconds,
                "reference_seconds": timings[reference].median_seconds,
                "ratio": timings[name].ratio,
                "foreign_load": timings[name].foreign_load,
            }
            for name in names
        )
    return rows


def _number_lines(source: Path) -> list[str]:
    lines = source.read_text(encoding="latin-1").splitlines()
    first = next(place for place, line in enumerate(lines) if line.startswith("Frame Time")) + 1
    return lines[first:]


def _default_file(folder: Path) -> Path:
    salsa = Path(os.environ.get("POSECAST_DATA", "")) / _SALSA
    return salsa if salsa.is_file() else _synthetic(folder / "synthetic.bvh")


def _synthetic(path: Path) -> Path:
    """A chain of joints that wave, written with seven significant digits a number."""
    joints = tuple(
        BvhJoint(
            f"joint{place}",
            place - 1,
            ("0", "4.0", "0"),
            ("Xposition", "Yposition", "Zposition") * (place == 0)
            + ("Zrotation", "Xrotation", "Yrotation"),
        )
        for place in range(_JOINTS)
    )
    random = np.random.default_rng(0)
    columns = 3 * _JOINTS + 3
    phase, speed = random.uniform(0, 6, columns), random.uniform(0.01, 0.1, columns)
    values = 30 * np.sin(phase + speed * np.arange(_FRAMES)[:, None])
    write_bvh_document(BvhDocument(joints, "0.00833333", np.round(values, 5)), path)
    return path


def main() -> None:
    """Print the table, or JSON."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--file", type=Path, help="a BVH file that pybvh can read too")
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--json", action="store_true", help="print JSON")
    arguments = parser.parse_args()
    rows = run(arguments.file, arguments.rounds)
    print(json.dumps(rows, indent=2) if arguments.json else table(rows))


if __name__ == "__main__":
    main()
