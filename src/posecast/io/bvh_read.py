"""Reading a BVH file as a document: encoding, the two sections, the frame count."""

from __future__ import annotations

import re
from os import PathLike

from posecast.errors import DataError
from posecast.io.bvh_document import BvhDocument
from posecast.io.bvh_hierarchy import is_number, not_a_number, parse_hierarchy
from posecast.io.bvh_numbers import parse_numbers
from posecast.io.files import check_is_file

_MOTION = re.compile(rb"^[ \t]*+MOTION(?=[\s:]|\Z):?+", re.IGNORECASE | re.MULTILINE)
_BLANK = re.compile(rb"\s++")
_MOTION_LINES = (
    ("Frames", re.compile(r"frames\s*+:?+\s*+(.*+)", re.IGNORECASE), "Frames: 240"),
    (
        "Frame Time",
        re.compile(r"frame\s*+time\s*+:?+\s*+(.*+)", re.IGNORECASE),
        "Frame Time: 0.0333333",
    ),
)
_LONGEST = 1000
"""Characters in a line with a frame count or a frame time."""

_GREATEST_BYTES = 2**31
"""About three hours of a hundred joints at 120 frames per second; parsing takes ten times more."""


def read_bvh_document(path: str | PathLike[str]) -> BvhDocument:
    """Read a BVH file as it stands: names, orders, numbers, windings; no unit, no axes.

    Every dialect met in the wild is read (docs of ``posecast.io.bvh``). What is odd but has one
    meaning becomes a note of the document; what has no clear meaning is an error. The number of
    frames is that of the rows, whatever ``Frames:`` says.

    Raises:
        DataError: the file is missing, empty, too large, not BVH, cut off, or holds something
            that is not a finite number.
    """
    data, encoding, notes = _load(path)
    data, newline = (data, "\n") if b"\n" in data else (data.replace(b"\r", b"\n"), "\r")
    motion = _MOTION.search(data)
    header = data if motion is None else data[: motion.start()]
    if 2 * header.count(b"\r\n") > header.count(b"\n"):
        newline = "\r\n"
    text, encoding = _decode(header, encoding, notes)
    joints = parse_hierarchy(path, text.split("\n"))
    if motion is None:
        raise DataError(path, "there is no MOTION section, expected one after the hierarchy; "
                              "export the motion too, or copy the file again")  # fmt: skip
    declared, frame_time, begin = _parse_motion_header(path, data, motion.end())
    values = parse_numbers(
        path,
        data,
        begin=begin,
        first_line=data.count(b"\n", 0, begin) + 1,
        joints=joints,
        declared=declared,
    )
    if declared > len(values):
        notes.append(f"{declared} frames declared, {len(values)} found: the clip ends early")
    elif declared < len(values):
        notes.append(f"{declared} frames declared, {len(values)} found and kept")
    return BvhDocument(joints, frame_time, values, encoding, newline, tuple(notes))


def _load(path: str | PathLike[str]) -> tuple[bytes, str, list[str]]:
    """Bytes that begin with HIERARCHY, the encoding if a mark tells it, and a list for notes."""
    file = check_is_file(path)
    try:
        size = file.stat().st_size
        if size > _GREATEST_BYTES:
            raise DataError(
                path, f"{size} bytes, expected at most {_GREATEST_BYTES}; cut it into shorter files"
            )
        data = file.read_bytes()
    except OSError as error:
        raise DataError(path, f"cannot be read ({error.strerror or error})") from error
    encoding = ""
    try:
        if data.startswith((b"\xff\xfe", b"\xfe\xff")):
            data, encoding = data.decode("utf-16").encode("utf-8"), "utf-16"
        elif data.startswith(b"\xef\xbb\xbf"):
            data, encoding = data[3:], "utf-8-sig"
    except UnicodeError as error:
        raise DataError(path, f"is not the UTF-16 text its mark says ({error})") from error
    start = data[: 1 << 16].lstrip()
    if not start:
        raise DataError(path, "is empty, expected a BVH file; copy it again from its source")
    if start[:9].upper() != b"HIERARCHY":
        raise DataError(
            path, f"is not BVH: starts with {start[:16]!r}, expected HIERARCHY; check the file", 1
        )
    notes: list[str] = []
    if data[-1:] in (b"\0", b"\x1a"):
        kept = data.rstrip(b"\0\x1a")
        notes.append(f"{len(data) - len(kept)} bytes after the text (null or Ctrl-Z) are left out")
        data = kept
    return data, encoding, notes


def _decode(header: bytes, encoding: str, notes: list[str]) -> tuple[str, str]:
    """Text of the hierarchy and its encoding.

    Text that is not UTF-8 is Shift-JIS if it is valid as that and has a byte from 0x80 to 0x9F,
    which begins nearly every kana and most kanji and is a control code in Latin-1; else Latin-1.
    """
    try:
        return header.decode("utf-8"), encoding or "utf-8"
    except UnicodeDecodeError:
        pass
    if re.search(rb"[\x80-\x9f]", header):
        try:
            text = header.decode("cp932")
        except UnicodeDecodeError:
            pass
        else:
            notes.append("the names are not UTF-8; read as Shift-JIS")
            return text, "cp932"
    notes.append("the names are not UTF-8; read as Latin-1")
    return header.decode("latin-1"), "latin-1"


def _parse_motion_header(
    path: str | PathLike[str], data: bytes, begin: int
) -> tuple[int, str, int]:
    """Declared number of frames, frame time as written, and where the numbers start."""
    found: dict[str, str] = {}
    for wanted, pattern, example in _MOTION_LINES:
        if blank := _BLANK.match(data, begin):
            begin = blank.end()
        stop = _line_end(data, begin)
        text = data[begin : min(stop, begin + _LONGEST)].decode("latin-1").strip()
        match = pattern.fullmatch(text) if stop - begin < _LONGEST else None
        value = "" if match is None else match[1]
        problem = ""
        if match is None:
            problem = f"found {text[:40]!r}, expected {wanted!r}, such as {example!r}"
        elif wanted == "Frames" and not (value.isascii() and value.isdigit() and len(value) < 19):
            problem = f"found {value[:40]!r}, expected a number of frames, such as {example!r}"
        elif wanted == "Frame Time" and not is_number(value):
            problem = not_a_number(value, "seconds per frame")
        elif wanted == "Frame Time" and not 1e-9 < float(value) < 1e9:
            problem = f"{value[:40]} seconds per frame, expected more than 0, such as {example!r}"
        if problem:
            raise DataError(path, problem, data.count(b"\n", 0, begin) + 1)
        found[wanted], begin = value, stop
    return int(found["Frames"]), found["Frame Time"], begin


def _line_end(data: bytes, begin: int) -> int:
    """Where the next line begins."""
    stop = data.find(b"\n", begin)
    return len(data) if stop < 0 else stop + 1
