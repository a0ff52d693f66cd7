"""CMU's original motion capture: an .amc file of joint angles and the .asf skeleton beside it."""

from __future__ import annotations

import math
import re
from os import PathLike
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float64
from torch import Tensor

from posecast.errors import DataError
from posecast.geometry import quaternion
from posecast.io.asf import AsfSkeleton, parse_number, read_asf
from posecast.io.files import check_is_file, decode_text, read_text_bytes
from posecast.motion import Clip
from posecast.skeleton import Skeleton

FPS = 120.0


def read_amc(
    path: str | PathLike[str],
    skeleton: str | PathLike[str] | None = None,
    *,
    fps: float = FPS,
    ends: bool = False,
) -> Clip:
    """Read one trial.

    A joint bears the name of a bone and sits where that bone starts, so the bones that leave the
    root start in it. This is the 31-joint skeleton of the BVH conversions. Where the last bones
    end is not a joint unless ``ends`` asks for it.

    The local rotation of a joint is C M C^-1: M turns about the axes of the bone's own frame by
    its degrees of freedom, the first listed first, and C is that frame.

    Args:
        path: the .amc file. ``02_05.amc`` gets the labels subject ``02``, trial ``05``.
        skeleton: the actor's .asf file. By default the one beside the .amc called like it or like
            its part before the underscore, else the only one there.
        fps: frames per second, which the format does not record. CMU's are 120; those of
            subjects 60 and 61 are 60.
        ends: add a joint ``<bone>_end`` without rotation at the end of each bone that has no
            child: toes, head, fingers, thumbs.

    Raises:
        DataError: a file is missing, empty, binary, cut off or damaged, or both do not belong
            together; see the message.
    """
    file = check_is_file(path)
    asf_path = Path(skeleton) if skeleton is not None else _find_skeleton(file)
    asf = read_asf(asf_path)
    reader = _AmcReader(file, asf_path, asf)
    values = reader.read()
    columns = {
        (joint, channel): values[:, column]
        for column, (joint, channel) in enumerate(reader.channels)
    }
    zero = values.new_zeros(len(values))
    translation = torch.stack([columns.get((0, f"t{axis}"), zero) for axis in "xyz"], dim=-1)
    clip = Clip(
        skeleton=asf.skeleton,
        offsets=asf.offsets,
        fps=fps,
        root_positions=translation * asf.unit + asf.root_position,
        rotations_local=_rotations(asf, values, reader.channels),
        name=file.stem,
        labels=_labels(file),
    )
    return _with_ends(clip, asf) if ends else clip


def _find_skeleton(file: Path) -> Path:
    """The .asf that belongs to an .amc file by its name, or the only one beside it."""
    beside = {
        other.stem: other
        for other in sorted(file.parent.iterdir())
        if other.suffix.lower() == ".asf"
    }
    for stem in (file.stem, file.stem.split("_")[0]):
        if stem in beside:
            return beside[stem]
    if len(beside) == 1:
        return next(iter(beside.values()))
    found = f"{len(beside)} skeletons beside it, none for it" if beside else "no skeleton beside it"
    raise DataError(
        file,
        f"{found}, expected {file.stem.split('_')[0]}.asf; name the skeleton (--skeleton FILE.asf)",
    )


def _labels(file: Path) -> dict[str, str]:
    named = re.fullmatch(r"(\w+)_(\d+)", file.stem)
    return {"subject": named[1], "trial": named[2]} if named else {}


class _Row(NamedTuple):
    """Where a bone's values stand among those of a frame."""

    joint: int
    column: int
    size: int


class _AmcReader:
    """Values of one .amc file, in the order of the skeleton's channels."""

    def __init__(self, path: Path, asf_path: Path, asf: AsfSkeleton) -> None:
        self.path = path
        self.asf_path = asf_path
        self.degrees = asf.degrees
        self.channels = [
            (joint, channel) for joint, names in enumerate(asf.channels) for channel in names
        ]
        self.names = asf.skeleton.names
        self.dofs = asf.channels
        self.rows: dict[str, _Row] = {}
        column = 0
        for joint, (name, names) in enumerate(zip(self.names, asf.channels, strict=True)):
            self.rows[name] = _Row(joint, column, len(names))
            column += len(names)

    def read(self) -> Float64[Tensor, "frames channels"]:
        """All values, one row a frame; angles in radians, lengths in the file's unit."""
        text = decode_text(read_text_bytes(self.path, "AMC motion"))
        start = self._read_header(text)
        values = self._read_regular(text[start:])
        if values is None:
            values = self._read_line_by_line(text, start)
        if self.degrees:
            turns = [column for column, (_, name) in enumerate(self.channels) if name[0] == "r"]
            values[:, turns] = np.deg2rad(values[:, turns])
        return torch.from_numpy(values)

    def _read_header(self, text: str) -> int:
        """Where the lines after comments and ``:KEYWORDS`` begin; takes the unit of angle."""
        start = 0
        while start < len(text):
            end = text.find("\n", start)
            end = len(text) if end < 0 else end
            words = text[start:end].split()
            if words and not words[0].startswith(("#", ":")):
                return start
            if words and words[0].upper() in (":DEGREES", ":RADIANS"):
                self.degrees = words[0].upper() == ":DEGREES"
            start = end + 1
        raise DataError(self.path, "no frames, expected AMC motion; copy the file again")

    def _read_regular(self, text: str) -> np.ndarray | None:
        """All frames at once where each lists the same bones in the same order, else ``None``.

        The words of the file are then periodic, and every k-th belongs to one channel.
        """
        # float() takes underscores and foreign digits, which the careful way refuses.
        if not text.isascii() or ("_" in text and re.search(r"\d_|_\d", text)):
            return None
        words = text.split()
        places, width = self._first_frame(words)
        if len(places) != len(self.rows) - sum(not names for names in self.dofs):
            return None
        frames, rest = divmod(len(words), width)
        numbers = words[0::width]
        if rest or not words[0].isdigit() or len(words[0]) > 15:
            return None
        first = int(words[0])
        if numbers != [str(number) for number in range(first, first + frames)]:
            return None
        values = np.empty((frames, len(self.channels)))
        for name, place in places.items():
            if words[place::width].count(name) != frames:
                return None
            row = self.rows[name]
            for offset in range(row.size):
                try:
                    column = list(map(float, words[place + 1 + offset :: width]))
                except ValueError:
                    return None
                values[:, row.column + offset] = column
        return values if np.isfinite(values).all() else None

    def _first_frame(self, words: list[str]) -> tuple[dict[str, int], int]:
        """Where the bones' names stand among the words of the first frame, and its width."""
        places: dict[str, int] = {}
        place = 1
        while place < len(words) and (row := self.rows.get(words[place])) is not None:
            if row.size:
                if words[place] in places:
                    break
                places[words[place]] = place
            place += 1 + row.size
        return places, place

    def _read_line_by_line(self, text: str, start: int) -> np.ndarray:
        """Frames with comments, or bones in any order; finds the line that is wrong."""
        frames: list[list[float]] = []
        frame = 0
        missing: set[str] = set()
        moving = {name for name, row in self.rows.items() if row.size}
        number = text.count("\n", 0, start)
        lines = text[start:].rstrip().split("\n")
        last = number + len(lines)
        for line in lines:
            number += 1
            words = line.split()
            if not words or words[0].startswith("#"):
                continue
            if len(words) == 1 and words[0].isascii() and words[0].isdigit():
                self._check_frame(frame, missing, number)
                frame = self._next_frame(words[0], frame if frames else None, number)
                frames.append([math.nan] * len(self.channels))
                missing = set(moving)
                continue
            if not frames:
                raise DataError(
                    self.path, f"{words[0][:40]!r}, expected a frame number", line=number
                )
            row = self._check_row(words, missing, number, is_last=number == last)
            missing.discard(words[0])
            frames[-1][row.column : row.column + row.size] = [
                parse_number(self.path, word, number) for word in words[1:]
            ]
        self._check_frame(frame, missing, number)
        return np.array(frames)

    def _next_frame(self, word: str, frame: int | None, line: int) -> int:
        # A number of hundreds of digits is slow to convert, and none of these is a frame's.
        if len(word) > 15 or (frame is not None and int(word) != frame + 1):
            raise DataError(
                self.path,
                f"frame {word[:40]}, expected {'a number' if frame is None else frame + 1}; frames "
                "are lost, doubled or damaged, copy the file again",
                line=line,
            )
        return int(word)

    def _check_frame(self, frame: int, missing: set[str], line: int) -> None:
        if missing:
            raise DataError(
                self.path,
                f"frame {frame} ends without {len(missing)} of its bones "
                f"({', '.join(sorted(missing)[:3])}); it is cut off or damaged",
                line=line,
            )

    def _check_row(self, words: list[str], missing: set[str], line: int, *, is_last: bool) -> _Row:
        row = self.rows.get(words[0])
        if row is None:
            remedy = "name the skeleton that belongs to this motion"
            if is_last and any(name.startswith(words[0]) for name in self.rows):
                remedy = "the file is cut off, copy it again"
            raise DataError(
                self.path,
                f"bone {words[0][:40]!r} is not in {self.asf_path.name}; {remedy}",
                line=line,
            )
        if row.size and words[0] not in missing:
            raise DataError(self.path, f"{words[0]!r} stands twice in its frame", line=line)
        if len(words) - 1 != row.size:
            dofs = " ".join(self.dofs[row.joint]) or "none"
            raise DataError(
                self.path,
                f"{len(words) - 1} values for {words[0]!r}, expected {row.size} ({dofs}); "
                + ("the file is cut off, copy it again" if is_last else "mend the line"),
                line=line,
            )
        return row


def _rotations(
    asf: AsfSkeleton,
    values: Float64[Tensor, "frames channels"],
    channels: list[tuple[int, str]],
) -> Float64[Tensor, "frames joints 4"]:
    """Local rotations C M C^-1; a joint has up to three turns, those it lacks are by zero."""
    joints = len(asf.skeleton)
    angles = values.new_zeros(len(values), joints, 3)
    axes = values.new_zeros(joints, 3, 3)
    used = [0] * joints
    for column, (joint, channel) in enumerate(channels):
        if channel[0] == "r":
            angles[:, joint, used[joint]] = values[:, column]
            axes[joint, used[joint], "xyz".index(channel[1])] = 1
            used[joint] += 1
    first, second, third = quaternion.about_axis(axes, angles).unbind(-2)
    turned = quaternion.product(third, quaternion.product(second, first))
    return quaternion.product(asf.axes, quaternion.product(turned, quaternion.conjugate(asf.axes)))


def _with_ends(clip: Clip, asf: AsfSkeleton) -> Clip:
    """The clip with a joint at the end of each last bone, after all other joints."""
    last = [joint for joint, below in enumerate(clip.skeleton.children) if joint and not below]
    still = quaternion.identity(clip.frames, len(last), like=clip.rotations_local)
    return Clip(
        skeleton=Skeleton(
            (*clip.skeleton.names, *(f"{clip.skeleton.names[joint]}_end" for joint in last)),
            (*clip.skeleton.parents, *last),
        ),
        offsets=torch.cat([clip.offsets, asf.bones[last]]),
        fps=clip.fps,
        root_positions=clip.root_positions,
        rotations_local=torch.cat([clip.rotations_local, still], dim=1),
        name=clip.name,
        labels=clip.labels,
    )
