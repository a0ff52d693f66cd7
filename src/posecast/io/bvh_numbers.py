"""Reading the block of numbers of a BVH file: fast where it is regular, exact everywhere."""

from __future__ import annotations

import re
from os import PathLike

import numpy as np
from numpy.typing import NDArray

from posecast.errors import DataError
from posecast.io.bvh_document import BvhJoint
from posecast.io.bvh_hierarchy import is_number, not_a_number
from posecast.io.number_block import NumberBlock, parse_block

_INK = re.compile(rb"\S")


def parse_numbers(
    path: str | PathLike[str],
    data: bytes,
    *,
    begin: int,
    first_line: int,
    joints: tuple[BvhJoint, ...],
    declared: int,
) -> NDArray[np.float64]:
    """One row of numbers a frame, (frames, channels), correctly rounded.

    Args:
        path: of the file, for messages.
        data: the file.
        begin: where the numbers start in it, after the frame time.
        first_line: line of the file on which they start, counted from 1.
        joints: their channels are the columns.
        declared: number of frames the file announces. It decides only whether lines that are not
            rows are rows wrapped over several lines.

    Raises:
        DataError: something is not a finite number, or a row has too few or too many numbers.
    """
    columns = sum(len(joint.channels) for joint in joints)
    if not columns:
        raise DataError(path, "no joint has channels, so the file holds no motion; export again")
    if not _INK.search(data, begin):
        expected = f"{declared}; the file is cut off" if declared else "one or more; export again"
        raise DataError(path, f"no frames after the frame time, expected {expected}", first_line)
    parsed = parse_block(data, begin)
    if parsed is not None and _is_rows(parsed, columns):
        return parsed.numbers.reshape(-1, columns)
    # Latin-1 maps every byte to one character, so positions and speed are those of the bytes.
    lines = data[begin:].decode("latin-1").split("\n")
    if parsed is None:
        try:
            values = np.loadtxt(lines, comments=None, ndmin=2)
        except ValueError:
            pass
        else:
            if values.shape[1] == columns and np.isfinite(values).all():
                return values
    return _Block(path, lines, first_line, joints).rows(columns, declared)


def _is_rows(block: NumberBlock, columns: int) -> bool:
    """Whether every line has one number for each column, blank lines apart."""
    steps = np.diff(block.line_ends, prepend=0, append=len(block.numbers))
    return bool(((steps == columns) | (steps == 0)).all())


class _Block:
    """The slow road: word by word, with the line of everything."""

    def __init__(
        self,
        path: str | PathLike[str],
        lines: list[str],
        first_line: int,
        joints: tuple[BvhJoint, ...],
    ) -> None:
        self.path = path
        self.joints = joints
        self.numbers: list[float] = []
        self.counts: list[int] = []
        self.places: list[int] = []
        for place, line in enumerate(lines, start=first_line):
            words = line.split()
            if not words:
                continue
            self.counts.append(len(words))
            self.places.append(place)
            for word in words:
                number = float(word) if is_number(word) else np.nan
                if not np.isfinite(number):
                    raise self._bad_word(word, place)
                self.numbers.append(number)

    def rows(self, columns: int, declared: int) -> NDArray[np.float64]:
        """The numbers as rows, if rows and line ends can be brought together."""
        ends = np.cumsum(self.counts)
        total = int(ends[-1])
        whole_lines = all(count == columns for count in self.counts)
        aligned = int((ends % columns == 0).sum()) * columns == total
        # A width that has nothing to do with rows: every line but the last has as many numbers.
        filled = len(set(self.counts[:-1])) <= 1 and self.counts[-1] <= self.counts[0]
        announced = total == declared * columns
        wrapped = ((aligned or filled) and announced) or self._repeats(columns)
        if not (whole_lines or wrapped):
            raise self._bad_row(columns, declared)
        return np.array(self.numbers).reshape(-1, columns)

    def _repeats(self, columns: int) -> bool:
        """Whether every row is on lines of the same, different lengths: no coincidence."""
        lines = int(np.searchsorted(np.cumsum(self.counts), columns)) + 1
        pattern = self.counts[:lines]
        return (
            sum(pattern) == columns
            and len(set(pattern)) > 1
            and len(self.counts) % lines == 0
            and self.counts == pattern * (len(self.counts) // lines)
        )

    def _bad_word(self, word: str, line: int) -> DataError:
        channels = [
            f"{channel} of joint {joint.name[:40]!r}"
            for joint in self.joints
            for channel in joint.channels
        ]
        what = f"a number for {channels[len(self.numbers) % len(channels)]}"
        if is_number(word):
            return DataError(
                self.path, f"found {word[:40]!r}, expected {what}; it is too large to hold", line
            )
        return DataError(self.path, not_a_number(word, what), line)

    def _bad_row(self, columns: int, declared: int) -> DataError:
        """Blame the line on which the first row begins that does not end with a line."""
        filled, begin = 0, 0
        for index, count in enumerate(self.counts):
            if filled == 0:
                begin = index
            filled += count
            if filled == columns:
                filled = 0
            elif filled > columns:
                break
        if filled == 0 and columns in self.counts:
            begin = next(place for place, count in enumerate(self.counts) if count != columns)
            filled = columns + 1
        if filled == 0:
            return DataError(
                self.path,
                f"{self.counts[0]} numbers a line, and {sum(self.counts) // columns} frames in "
                f"all, expected {columns} a line (one for each channel) or rows wrapped over lines "
                f"for the {declared} frames declared; correct the channels or 'Frames:'",
                self.places[0],
            )
        found, remedy = self.counts[begin], "export again"
        if found < columns and filled < columns:
            found, remedy = filled, "the file is cut off: copy it again, or delete this row"
        return DataError(
            self.path,
            f"found {found} numbers, expected {columns} (one for each channel); {remedy}",
            self.places[begin],
        )
