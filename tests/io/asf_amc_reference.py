"""A small actor and trial as ASF/AMC text, and a slow way to place bones by matrices."""

from __future__ import annotations

import itertools
import math
from pathlib import Path

import numpy as np

ASF = """# made for this test
:version 1.10
:name TEST
:units
  mass 1.0
  length 0.45
  angle deg
:documentation
   root begin end :not a section
   begin
:root
   order TX TY TZ RX RY RZ
   axis XYZ
   position 0 0 0
   orientation 0 0 0
:bonedata
  begin
     id 1
     name hip
     direction 0.6 -0.8 0
     length 2.5
     axis 0 0 0  XYZ
  end
  begin
     id 2
     name thigh
     direction 0.34202 -0.939693 0
     length 7.25e+000
     axis 10 -20 30 XYZ
     dof rx ry rz
     limits (-160.0 20.0)
            (-70.0 70.0)
            (-inf inf)
  end
  begin
     id 3
     name shin
     direction 0 -1 0
     length 7
     axis -90 7.62852e-016 20 ZXY
     dof rx
     limits (-10.0 170.0)
  end
  begin
     id 4
     name back
     direction 0 1 0
     length 4
     axis 15 25 35 YZX
     dof rz rx
     bodymass 3
  end
:hierarchy
  begin
    root back hip
    hip thigh
    thigh shin
  end
"""

AMC = """#!OML:ASF C:\\somewhere\\test.ASF
:FULLY-SPECIFIED
:DEGREES
1
root 1 2 3 10 20 30
back 5 -6
thigh 7 8 9e-001
shin -10
2
root 1.5 2 -3 100 -20 35
back 5.5 -6.25
thigh 7.125 80 9
shin -1.25e-015
"""


def elementary(axis: str, degrees: float) -> np.ndarray:
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return np.array(
        {
            "x": [[1, 0, 0], [0, c, -s], [0, s, c]],
            "y": [[c, 0, s], [0, 1, 0], [-s, 0, c]],
            "z": [[c, -s, 0], [s, c, 0], [0, 0, 1]],
        }[axis]
    )


def chained(order: str, degrees: list[float]) -> np.ndarray:
    """Turns about fixed axes, first letter first."""
    matrix = np.eye(3)
    for axis, angle in zip(order, degrees, strict=True):
        matrix = elementary(axis, angle) @ matrix
    return matrix


class SlowActor:
    """Bones read naively (well-formed files, degrees) and placed by the definition of the format.

    A bone starts where its parent ends and ends at start + W direction length, with
    W = W_parent C M C^T.
    """

    def __init__(self, asf: Path) -> None:
        words = asf.read_text().split(":bonedata")[1].split()
        self.bones: dict[str, dict[str, list[str]]] = {}
        keys = (
            "id",
            "bodymass",
            "name",
            "direction",
            "length",
            "axis",
            "dof",
            "limits",
            "begin",
            "end",
        )
        key, bone = "", {}
        for word in words[: words.index(":hierarchy")]:
            if word == "begin":
                bone = {"dof": []}
            if word in keys:
                key = word
                bone.setdefault(key, [])
            else:
                bone[key].append(word)
            if word == "end":
                self.bones[bone["name"][0]] = bone
        self.parent: dict[str, str] = {}
        for line in asf.read_text().split(":hierarchy")[1].splitlines():
            parent, *children = line.split() or [""]
            self.parent.update(dict.fromkeys(children, parent))

    def place(self, frame: dict[str, list[float]]) -> tuple[dict, dict]:
        """Start and end of every bone, in the unit of the file."""
        turn = {"root": chained("xyz", frame["root"][3:])}
        start: dict[str, np.ndarray] = {}
        end = {"root": np.array(frame["root"][:3])}
        waiting = list(self.parent)
        while waiting:
            name = waiting.pop(0)
            if self.parent[name] not in end:
                waiting.append(name)
                continue
            bone = self.bones[name]
            about = dict(zip("xyz", map(float, bone["axis"][:3]), strict=True))
            order = bone["axis"][3].lower()
            frame_axes = chained(order, [about[axis] for axis in order])
            moved = chained("".join(dof[1] for dof in bone["dof"]), frame.get(name, []))
            turn[name] = turn[self.parent[name]] @ frame_axes @ moved @ frame_axes.T
            start[name] = end[self.parent[name]]
            direction = np.array([float(part) for part in bone["direction"]])
            end[name] = start[name] + turn[name] @ direction * float(bone["length"][0])
        return start, end


def slow_frame(lines: list[str], number: int) -> dict[str, list[float]]:
    """The frame with this number, from 1."""
    start = lines.index(str(number))
    rows = itertools.takewhile(lambda line: not line.isdigit(), lines[start + 1 :])
    return {row.split()[0]: [float(word) for word in row.split()[1:]] for row in rows}
