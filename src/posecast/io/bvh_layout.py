"""Conventions of a BVH file: unit, axes, frame rate, names, kept so that they can be written back.

A BVH file names neither its unit nor its vertical axis. Both are guessed from the body as it moves:

* unit: the longest way along bones from one joint to another (fingertip to toe) is about 1.35
  times the standing height of a person, whatever the pose. A height below 7 file units is taken
  as metres, below 40 as CMU's 1/0.45 inch, below 82 as inches, below 540 as centimetres (people
  of 0.82 to 5.4 m: the most common unit gets the widest range), above as millimetres.
* up: y, unless the posed body extends clearly more along z or x, stands clearly nearer to the
  floor there, and does not travel along it. The OFFSETs say nothing: bones often lie along x.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal, NamedTuple

import numpy as np
import torch
from jaxtyping import Float
from numpy.typing import NDArray
from torch import Tensor

from posecast.io.bvh_document import BvhJoint
from posecast.skeleton import Skeleton

Up = Literal["x", "y", "z"]

UNITS: dict[str, float] = {
    "m": 1.0,
    "1/0.45 inch (CMU)": 0.0254 / 0.45,
    "inch": 0.0254,
    "cm": 0.01,
    "mm": 0.001,
}
"""Metres per file unit."""

_HEIGHT_BELOW: dict[str, float] = {
    "m": 7,
    "1/0.45 inch (CMU)": 40,
    "inch": 82,
    "cm": 540,
    "mm": math.inf,
}
"""Standing height in file units up to which a unit is taken."""

_SPAN_PER_HEIGHT = 1.35
_PEOPLE = (0.8, 2.4)
"""Standing heights in metres that need no note."""


@dataclass(frozen=True)
class BvhLayout:
    """All that a clip's numbers no longer say about the file they were read from.

    Args:
        joints: as in the document: names, offsets, channels, End Sites as written.
        names: the clip's joint names: those of the file, made unique.
        unit: metres per file unit.
        up: the file's vertical axis.
        frame_time: seconds, as written.
        fps: what the clip got from it.
        encoding, newline: of the text.
        rows: (frames, channels) numbers of the file: a pose that has not changed since is written
            with the angles that it had, and others with windings near these. Not compared.
        notes: what is odd about the file, each true; see ``read_bvh``.
    """

    joints: tuple[BvhJoint, ...]
    names: tuple[str, ...]
    unit: float
    up: Up
    frame_time: str
    fps: float
    encoding: str = "utf-8"
    newline: str = "\n"
    rows: NDArray[np.float64] | None = field(default=None, compare=False, repr=False)
    notes: tuple[str, ...] = ()


class Guess(NamedTuple):
    """A guessed value, and why it may be wrong ("" when there is no reason to think so)."""

    value: float
    doubt: str


def unique_names(written: Sequence[str]) -> tuple[str, ...]:
    """Names that differ: the second ``Bone`` becomes ``Bone_2``, a nameless joint ``joint_5``."""
    taken, used = set(written), set[str]()
    following: dict[str, int] = {}
    result: list[str] = []
    for place, name in enumerate(written):
        unique = name
        if not name or name in used:
            base = name or "joint"
            number = following.get(base, 2 if name else place)
            while (unique := f"{base}_{number}") in taken:
                number += 1
            following[base] = number + 1
            taken.add(unique)
        used.add(unique)
        result.append(unique)
    return tuple(result)


def turn_vectors(vectors: Float[Tensor, "*batch 3"], up: Up) -> Float[Tensor, "*batch 3"]:
    """Vectors of a file with this vertical axis, in y-up axes (Blender's front becomes +z)."""
    x, y, z = vectors.unbind(-1)
    if up == "z":
        return torch.stack([x, z, -y], dim=-1)
    return torch.stack([-y, x, z], dim=-1) if up == "x" else vectors


def turn_vectors_back(vectors: Float[Tensor, "*batch 3"], up: Up) -> Float[Tensor, "*batch 3"]:
    """The inverse of ``turn_vectors``."""
    x, y, z = vectors.unbind(-1)
    if up == "z":
        return torch.stack([x, -z, y], dim=-1)
    return torch.stack([y, -x, z], dim=-1) if up == "x" else vectors


def turn_rotations(rotations: Float[Tensor, "*batch 4"], up: Up) -> Float[Tensor, "*batch 4"]:
    """Rotations of such a file in y-up axes: their axes turn as vectors do."""
    if up == "y":
        return rotations
    return torch.cat([rotations[..., :1], turn_vectors(rotations[..., 1:], up)], dim=-1)


def turn_rotations_back(rotations: Float[Tensor, "*batch 4"], up: Up) -> Float[Tensor, "*batch 4"]:
    """The inverse of ``turn_rotations``."""
    if up == "y":
        return rotations
    return torch.cat([rotations[..., :1], turn_vectors_back(rotations[..., 1:], up)], dim=-1)


def frame_rate(text: str) -> tuple[float, str]:
    """Frames per second of a frame time, and a note if its digits were taken as a rounding.

    A frame time that is the period of a usual rate, or of a whole number of frames per second,
    rounded or cut to the digits written, is that rate: 0.008333 is 1/120. Whole rates go before
    29.97 and its like. Anything else is taken as it stands.
    """
    seconds = float(text)
    rate = 1 / seconds
    if seconds > _LONGEST_FRAME:
        return rate, f"{text} seconds a frame; if that is milliseconds, correct the frame time"
    nearest = float(max(round(rate), 1))
    if math.isclose(rate, nearest, rel_tol=1e-12):
        return nearest, ""
    mantissa, _, exponent = text.lower().partition("e")
    decimals = len(mantissa.partition(".")[2]) - int(exponent or 0)
    step = 10.0 ** -min(max(decimals, 0), 300)
    for fps, shown in (*_USUAL_RATES.items(), (nearest, f"{nearest:g}")):
        short_by = 1 / fps - seconds
        largest = _ROUNDING if fps in _USUAL_RATES else _ROUNDING / 10
        if -step / 2 <= short_by < step and abs(fps - rate) < largest * rate:
            return fps, f"frame time {text} read as 1/{shown} s"
    return rate, ""


_LONGEST_FRAME = 2.0
"""Seconds; nobody records motion more slowly."""

_ROUNDING = 0.02
"""Largest relative change that rounding may make to a usual rate; a tenth of it to others."""

_USUAL_RATES: dict[float, str] = {
    **{float(fps): str(fps) for fps in (24, 25, 30, 48, 50, 60, 72, 75, 90, 100, 120, 144, 150)},
    **{float(fps): str(fps) for fps in (180, 200, 240, 250, 300, 360, 400, 480, 500, 1000)},
    **{fps * 1000 / 1001: f"({fps}000/1001)" for fps in (24, 30, 60, 120)},
}


def guess_unit(skeleton: Skeleton, lengths: Sequence[float]) -> Guess:
    """Metres per file unit from the lengths of the bones; see the head of this file.

    Args:
        skeleton: the joints.
        lengths: file units from each joint to its parent; 0 for roots and where it varies in time.
    """
    deepest = [0.0] * len(skeleton)
    span = 0.0
    for joint in reversed(range(len(skeleton))):
        parent = skeleton.parents[joint]
        if parent >= 0:
            reach = deepest[joint] + lengths[joint]
            span = max(span, deepest[parent] + reach)
            deepest[parent] = max(deepest[parent], reach)
    height = span / _SPAN_PER_HEIGHT
    if not 0 < height < math.inf:
        return Guess(UNITS["cm"], "no bone has a length to guess the unit from; taken as cm")
    name = next(unit for unit, limit in _HEIGHT_BELOW.items() if height < limit)
    metres = height * UNITS[name]
    doubt = ""
    if not _PEOPLE[0] < metres < _PEOPLE[1]:
        doubt = f"unit taken as {name}, a body {metres:.3g} m tall; give the unit if it is another"
    return Guess(UNITS[name], doubt)


def guess_up(positions: Float[Tensor, "frames joints 3"]) -> Up:
    """Vertical axis of a motion; see the head of this file.

    Args:
        positions: world positions of some frames, any unit, file axes; the hips first.
    """
    centered = positions - positions[:, :1]
    mean = centered.mean(dim=0)
    extent = mean.amax(dim=0) - mean.amin(dim=0)
    floor = positions.amin(dim=1).median(dim=0).values.abs()
    travel = positions[:, 0].std(dim=0, correction=0)
    limit = extent.max()
    score = extent - 0.5 * torch.minimum(floor, limit) - torch.minimum(travel, limit)
    x, y, z = score.tolist()
    if z > max(x, 1.1 * y, 0):
        return "z"
    return "x" if x > max(z, 1.5 * y, 0) else "y"


_UNWRITABLE = re.compile(r"[{}\x00-\x1f\x7f-\x9f\u2028\u2029]+")


def writable_name(name: str) -> str:
    """A joint name as it can stand in a file: without braces, line ends, blanks around it."""
    return _UNWRITABLE.sub("_", name).strip()
