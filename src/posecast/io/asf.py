"""Acclaim skeleton files (.asf): bones, their axis frames and the angles they turn by."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from typing import NamedTuple

import torch
from jaxtyping import Float64
from torch import Tensor

from posecast.errors import DataError
from posecast.geometry import quaternion
from posecast.io.files import decode_text, read_text_bytes
from posecast.skeleton import Skeleton

INCH = 0.0254
ROOT = "root"
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_TURNS = ("rx", "ry", "rz")
_SLIDES = ("tx", "ty", "tz")


class _Line(NamedTuple):
    """The words of one line and its number in the file, from 1."""

    number: int
    words: list[str]


@dataclass(frozen=True)
class AsfSkeleton:
    """An actor as an .asf file describes it; joints in depth-first order, the root first.

    A joint bears the name of a bone and sits at that bone's start.

    Args:
        skeleton: joint names and parents.
        offsets: the parent's bone (direction times length), metres: where the joint sits, seen
            from its parent at rest.
        bones: each joint's own bone from start to end at rest, metres; zero for the root.
        axes: rotation of each bone's axis frame; its angles turn about the axes of this frame.
        channels: for each joint the names of its values in an .amc file, in their order, among
            rx ry rz and, for the root, tx ty tz. The rotation named first is applied first.
        root_position: what is added to the root's translation, metres.
        unit: metres in one unit of length of the files.
        degrees: whether angles are in degrees unless the .amc says otherwise.
    """

    skeleton: Skeleton
    offsets: Float64[Tensor, "joints 3"]
    bones: Float64[Tensor, "joints 3"]
    axes: Float64[Tensor, "joints 4"]
    channels: tuple[tuple[str, ...], ...]
    root_position: Float64[Tensor, "3"]
    unit: float
    degrees: bool


def parse_number(path: str | PathLike[str], word: str, line: int) -> float:
    """A finite decimal number.

    Raises:
        DataError: ``word`` is none.
    """
    value = float(word) if _NUMBER.fullmatch(word) else math.nan
    if not math.isfinite(value):
        raise DataError(path, f"{word[:40]!r}, expected a finite number", line=line)
    return value


def read_asf(path: str | PathLike[str]) -> AsfSkeleton:
    """Read a skeleton file.

    A length x of a file with ``length s`` among its units is x / s inches; ``length 0.45`` is
    what CMU uses.

    Raises:
        DataError: the file is missing, empty, binary or damaged, or has bones that slide or
            change their length; see the message.

    Source: Acclaim skeleton format, version 1.10, as written by VICON BodyBuilder.
    """
    return _AsfReader(path).read()


class _AsfReader:
    """One pass over the sections of one file; keeps the path for messages."""

    def __init__(self, path: str | PathLike[str]) -> None:
        self.path = path
        self.sections = self._split(decode_text(read_text_bytes(path, "an ASF skeleton")))
        self.degrees = True
        self.unit = INCH

    def read(self) -> AsfSkeleton:
        self._read_units()
        bones = self._read_bones()
        parents = self._read_hierarchy(bones)
        names = list(parents)
        index = {name: joint for joint, name in enumerate(names)}
        root = self._fields("root")
        vectors = [[0.0] * 3, *(self._bone(bones[name]) for name in names[1:])]
        own = torch.tensor(vectors, dtype=torch.float64)
        above = [index.get(parents[name], -1) for name in names]
        offsets = torch.stack([own[parent] if parent >= 0 else own[0] for parent in above])
        frames = [root, *(bones[name] for name in names[1:])]
        angle_keys = ["orientation", *["axis"] * len(bones)]
        axes = [self._axes(frame, key) for frame, key in zip(frames, angle_keys, strict=True)]
        position = self._numbers(root["position"], 3) if "position" in root else [0.0] * 3
        return AsfSkeleton(
            skeleton=Skeleton(tuple(names), tuple(above)),
            offsets=offsets,
            bones=own,
            axes=torch.stack(axes),
            channels=(
                self._channels(self._need(root, "order", ":root"), (*_TURNS, *_SLIDES)),
                *(self._channels(bones[name].get("dof"), _TURNS) for name in names[1:]),
            ),
            root_position=torch.tensor(position, dtype=torch.float64) * self.unit,
            unit=self.unit,
            degrees=self.degrees,
        )

    def _split(self, text: str) -> dict[str, list[_Line]]:
        """Lines by section; comments, blank lines and what is before the first section go."""
        sections: dict[str, list[_Line]] = {}
        current: list[_Line] = []
        for number, line in enumerate(text.split("\n"), start=1):
            words = line.split()
            if not words or words[0].startswith("#"):
                continue
            if words[0].startswith(":"):
                current = sections.setdefault(words[0][1:].lower(), [])
                words = words[1:]
            if words:
                current.append(_Line(number, words))
        for needed in ("root", "bonedata", "hierarchy"):
            if needed not in sections:
                raise DataError(
                    self.path,
                    f"no section ':{needed}', found {sorted(sections) or 'none'}; it is cut off "
                    "or no ASF skeleton",
                )
        return sections

    def _fields(self, section: str) -> dict[str, _Line]:
        """``key value value`` lines of a section, by key."""
        return {
            line.words[0].lower(): _Line(line.number, line.words[1:])
            for line in self.sections.get(section, [])
        }

    def _need(self, fields: Mapping[str, _Line], key: str, where: str) -> _Line:
        if key not in fields:
            raise DataError(self.path, f"{where} has no {key!r}; copy the file again")
        return fields[key]

    def _numbers(self, line: _Line, count: int) -> list[float]:
        if len(line.words) < count:
            raise DataError(
                self.path, f"{len(line.words)} values, expected {count} numbers", line=line.number
            )
        return [parse_number(self.path, word, line.number) for word in line.words[:count]]

    def _read_units(self) -> None:
        units = self._fields("units")
        if "length" in units:
            (scale,) = self._numbers(units["length"], 1)
            if not 1e-6 <= scale <= 1e6:
                raise DataError(
                    self.path,
                    f"unit of length {scale:g}, expected a positive number such as 0.45",
                    line=units["length"].number,
                )
            self.unit = INCH / scale
        if "angle" in units:
            word = "".join(units["angle"].words[:1]).lower()
            if not word.startswith(("deg", "rad")):
                raise DataError(
                    self.path,
                    f"unit of angle {word[:40]!r}, expected deg or rad",
                    line=units["angle"].number,
                )
            self.degrees = word.startswith("deg")

    def _read_bones(self) -> dict[str, dict[str, _Line]]:
        """The fields of every ``begin … end`` block of the bone data, by the bone's name."""
        bones: dict[str, dict[str, _Line]] = {}
        block: dict[str, _Line] | None = None
        for number, words in self.sections["bonedata"]:
            key = words[0].lower()
            if key == "begin":
                block = {"begin": _Line(number, [])}
            elif block is None:
                raise DataError(self.path, f"{words[0][:40]!r}, expected 'begin'", line=number)
            elif key == "end":
                where = f"the bone that begins in line {block['begin'].number}"
                named = self._need(block, "name", where)
                name = " ".join(named.words)
                if name in bones or name == ROOT or not name:
                    raise DataError(
                        self.path,
                        f"bone name {name[:40]!r}, expected one that no other bone has",
                        line=named.number,
                    )
                bones[name] = block
                block = None
            else:
                block.setdefault(key, _Line(number, words[1:]))
        if block is not None or not bones:
            raise DataError(self.path, "the bone data are cut off; copy the file again")
        return bones

    def _read_hierarchy(self, bones: Mapping[str, object]) -> dict[str, str]:
        """Parent by name, in depth-first order; the root's parent is the empty name."""
        children: dict[str, list[str]] = {ROOT: [], **{name: [] for name in bones}}
        seen: set[str] = {ROOT}
        for number, words in self.sections["hierarchy"]:
            if len(words) == 1 and words[0].lower() in ("begin", "end"):
                continue
            for word in words:
                if word not in children:
                    raise DataError(self.path, f"no bone is called {word[:40]!r}", line=number)
            for child in words[1:]:
                if child in seen:
                    raise DataError(
                        self.path, f"{child!r} has a second parent, expected one", line=number
                    )
                seen.add(child)
                children[words[0]].append(child)
        parents: dict[str, str] = {}
        waiting = [(ROOT, "")]
        while waiting:
            name, parent = waiting.pop()
            parents[name] = parent
            waiting += [(child, name) for child in reversed(children[name])]
        if lost := [name for name in bones if name not in parents]:
            raise DataError(
                self.path, f"the hierarchy does not connect {lost[:5]} to the root; it is damaged"
            )
        return parents

    def _bone(self, fields: Mapping[str, _Line]) -> list[float]:
        """From the bone's start to its end at rest, metres."""
        where = f"bone {' '.join(fields['name'].words)!r}"
        direction = self._numbers(self._need(fields, "direction", where), 3)
        (length,) = self._numbers(self._need(fields, "length", where), 1)
        return [part * length * self.unit for part in direction]

    def _axes(self, fields: Mapping[str, _Line], angles_key: str) -> Float64[Tensor, "4"]:
        """The axis frame: turns by the angles x y z about fixed axes, in the order of letters."""
        letters = "xyz"
        if "axis" in fields and fields["axis"].words:
            letters = fields["axis"].words[-1].lower()
            if sorted(letters) != ["x", "y", "z"]:
                raise DataError(
                    self.path,
                    f"axis order {letters[:40]!r}, expected XYZ in some order",
                    line=fields["axis"].number,
                )
        turned = quaternion.identity(like=torch.zeros(1, dtype=torch.float64))
        if angles_key not in fields:
            return turned
        angles = torch.tensor(self._numbers(fields[angles_key], 3), dtype=torch.float64)
        if self.degrees:
            angles = torch.deg2rad(angles)
        unit = torch.eye(3, dtype=torch.float64)
        for axis in ("xyz".index(letter) for letter in letters):
            turned = quaternion.product(quaternion.about_axis(unit[axis], angles[axis]), turned)
        return turned

    def _channels(self, line: _Line | None, allowed: Sequence[str]) -> tuple[str, ...]:
        if line is None:
            return ()
        words = tuple(word.lower() for word in line.words)
        if len(set(words)) != len(words) or not set(words) <= set(allowed):
            raise DataError(
                self.path,
                f"degrees of freedom {' '.join(words)[:80]!r}, expected each at most once among "
                f"{' '.join(allowed)}; bones that slide or stretch are not supported",
                line=line.number,
            )
        return words
