"""A slow BVH reader that shares no code with ours: line by line, 3x3 matrices, one joint at a time.

It knows the semantics only (a position channel replaces the OFFSET, rotations multiply in the order
listed); text is expected to be decoded already, and well formed.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


@dataclass
class _Joint:
    name: str
    parent: _Joint | None
    offset: list[float] = field(default_factory=list)
    channels: list[str] = field(default_factory=list)


class World(NamedTuple):
    """Names as written; positions (frames, joints, 3) in file units and axes; frame time."""

    names: list[str]
    positions: NDArray[np.float64]
    frame_time: float


def world_positions(text: str, frames: list[int] | None = None) -> World:
    """World position of every joint in some frames (all by default)."""
    hierarchy, motion = re.split(r"(?im)^\s*motion\s*$", text, maxsplit=1)
    joints = _joints(hierarchy)
    head, _, numbers = (
        re.split(r"(?i)frame\s*time\s*:?", motion, maxsplit=1)[1].strip().partition("\n")
    )
    width = sum(len(joint.channels) for joint in joints)
    words = numbers.split()
    rows = [words[start : start + width] for start in range(0, len(words) - width + 1, width)]
    wanted = range(len(rows)) if frames is None else frames
    positions = [_pose(joints, [float(word) for word in rows[frame]]) for frame in wanted]
    return World([joint.name for joint in joints], np.array(positions), float(head))


def _joints(hierarchy: str) -> list[_Joint]:
    joints: list[_Joint] = []
    open_: list[_Joint | None] = []
    pending = re.sub(r"([{}])", r"\n\1\n", hierarchy)
    opened: _Joint | None = None
    for line in (raw.strip() for raw in pending.splitlines()):
        words = line.split()
        if not words:
            continue
        keyword = words[0].lower()
        if keyword in ("root", "joint"):
            opened = _Joint(line[len(words[0]) :].strip(), open_[-1] if open_ else None)
            joints.append(opened)
        elif keyword == "end":
            opened = None
        elif keyword == "{":
            open_.append(opened)
        elif keyword == "}":
            open_.pop()
        elif keyword == "offset" and open_[-1] is not None:
            open_[-1].offset = [float(word) for word in words[1:4]]
        elif keyword == "channels" and open_[-1] is not None:
            open_[-1].channels = [word.lower() for word in words[2:]]
    return joints


def _pose(joints: list[_Joint], row: list[float]) -> list[NDArray[np.float64]]:
    matrices: dict[int, NDArray[np.float64]] = {}
    places: dict[int, NDArray[np.float64]] = {}
    column = 0
    for joint in joints:
        local, turn = list(joint.offset), np.eye(3)
        for channel in joint.channels:
            axis = "xyz".index(channel[0])
            if channel.endswith("position"):
                local[axis] = row[column]
            else:
                turn = turn @ _elementary(axis, row[column])
            column += 1
        if joint.parent is None:
            matrices[id(joint)], places[id(joint)] = turn, np.array(local)
        else:
            above = matrices[id(joint.parent)]
            matrices[id(joint)] = above @ turn
            places[id(joint)] = places[id(joint.parent)] + above @ np.array(local)
    return [places[id(joint)] for joint in joints]


def _elementary(axis: int, degrees: float) -> NDArray[np.float64]:
    cosine, sine = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    second, third = (axis + 1) % 3, (axis + 2) % 3
    matrix = np.eye(3)
    matrix[second, second] = matrix[third, third] = cosine
    matrix[second, third], matrix[third, second] = -sine, sine
    return matrix
