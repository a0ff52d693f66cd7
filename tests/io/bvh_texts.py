"""BVH text in the dialects met in the wild, each a small change of the same two-armed body."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class Dialect(NamedTuple):
    """One way of writing BVH.

    Args:
        content: bytes of the file.
        text: what a perfect reader of encodings makes of them, in plain line ends.
        notes: beginnings of the notes that reading it must give, no more and no fewer.
    """

    content: bytes
    text: str
    notes: tuple[str, ...] = ()


ROOT = "Xposition Yposition Zposition Zrotation Yrotation Xrotation"
TURNS = "Zrotation Xrotation Yrotation"


def channels(names: str) -> str:
    """A CHANNELS line."""
    return f"CHANNELS {len(names.split())} {names}".rstrip()


def numbers(columns: int, frames: int = 4, seed: int = 3) -> list[list[str]]:
    """Rows of text, six significant digits, all angles and positions well away from zero."""
    values = np.random.default_rng(seed).uniform(-170, 170, (frames, columns))
    return [[f"{value:.6g}" for value in row] for row in values]


def body(
    root: str = channels(ROOT),
    arm: str = channels(TURNS),
    hand: str = channels(TURNS),
    names: tuple[str, str, str] = ("Hips", "LeftArm", "LeftHand"),
    offset: str = "0 0 0",
    end: str = "End Site\n{\nOFFSET 0 1.5 0\n}\n",
) -> str:
    """Hierarchy of three joints in a chain."""
    return (
        f"HIERARCHY\nROOT {names[0]}\n{{\nOFFSET {offset}\n{root}\n"
        f"JOINT {names[1]}\n{{\nOFFSET 0.5 4.25 -1e-1\n{arm}\n"
        f"JOINT {names[2]}\n{{\nOFFSET 3 .5 0.\n{hand}\n{end}}}\n}}\n}}\n"
    )


def motion(rows: list[list[str]], frames: int | None = None, time: str = "0.04") -> str:
    """The MOTION section."""
    lines = "".join(" ".join(row) + "\n" for row in rows)
    return f"MOTION\nFrames: {len(rows) if frames is None else frames}\nFrame Time: {time}\n{lines}"


def _plain(text: str, *notes: str) -> Dialect:
    return Dialect(text.encode("utf-8"), text, notes)


def _uneven(declared: int) -> str:
    """Rows of twelve numbers on lines of seven and five."""
    lines = [piece for row in numbers(12) for piece in (row[:7], row[7:])]
    text = "\n".join(map(" ".join, lines))
    return f"{body()}MOTION\nFrames: {declared}\nFrame Time: 0.04\n{text}\n"


def _wrapped(width: int) -> str:
    words = [word for row in numbers(12) for word in row]
    lines = [" ".join(words[at : at + width]) for at in range(0, len(words), width)]
    return body() + "MOTION\nFrames: 4\nFrame Time: 0.04\n" + "\n".join(lines) + "\n"


_BASE = body() + motion(numbers(12))


def _channel_dialects() -> dict[str, Dialect]:
    """Which channels, in which order, on which joints."""
    six = channels(f"Xposition Yposition Zposition {TURNS}")
    late = channels("Zrotation Yrotation Xrotation Xposition Yposition Zposition")
    zyx = channels(f"Zposition Yposition Xposition {TURNS}")
    twice = channels("Xrotation Xrotation Zrotation")
    hinges = body(arm=channels("Xrotation"), hand=channels("Zrotation"))
    one_place = body(root=channels(f"Yposition {TURNS}"), offset="3 4 5")
    hierarchies = {
        "plain": (body(), 12),
        "mixed orders": (body(hand=channels("Yrotation Zrotation Xrotation")), 12),
        "proper order": (body(hand=channels("Zrotation Xrotation Zrotation")), 12),
        "six channels on all joints": (body(arm=six, hand=six), 18),
        "rotation before position": (body(root=late), 12),
        "hinge joints": (hinges, 8),
        "two channels": (body(arm=channels("Yrotation Xrotation")), 11),
        "no channels": (body(arm="CHANNELS 0"), 9),
        "no CHANNELS line": (body(arm=""), 9),
        "an axis twice": (body(arm=twice), 12),
        "four rotations": (body(arm=channels(f"Yrotation {TURNS}")), 13),
        "position order z y x": (body(root=zyx), 12),
        "some position channels": (one_place, 10),
        "root without positions": (body(root=channels(TURNS), offset="3 4 5"), 9),
        "root with an offset": (body(offset="10 -20 30.5"), 12),
        "no End Site": (body(end=""), 12),
        "a named End Site": (body(end="End Finger Tip\n{\nOFFSET 0 1 0\n}\n"), 12),
    }
    return {
        name: _plain(hierarchy + motion(numbers(columns)))
        for name, (hierarchy, columns) in hierarchies.items()
    }


def _spelling_dialects() -> dict[str, Dialect]:
    """Blanks, line ends, keywords, marks."""
    blank = _BASE.replace("0.04\n", "0.04\n\n \n")
    blank = blank.replace(numbers(12)[2][0], "\n" + numbers(12)[2][0])
    one_line = "HIERARCHY\n" + body().removeprefix("HIERARCHY\n").replace("\n", " ")
    small = _BASE.replace("End Site", "end site").replace("Frame Time", "frame time")
    for word in ("HIERARCHY", "ROOT", "JOINT", "OFFSET", "CHANNELS", "MOTION", "Frames"):
        small = small.replace(word, word.lower())
    power = _BASE.replace("OFFSET 3 ", "OFFSET 3.0E+00 ").replace(numbers(12)[1][3], "-1.5e1")
    return {
        "carriage returns": Dialect(_BASE.replace("\n", "\r\n").encode(), _BASE),
        "only carriage returns": Dialect(_BASE.replace("\n", "\r").encode(), _BASE),
        "mixed line ends": Dialect(_BASE.replace("}\n", "}\r\n").encode(), _BASE),
        "tabs": _plain(_BASE.replace(" ", "\t").replace("OFFSET", "\t\tOFFSET")),
        "trailing blanks": _plain(_BASE.replace("\n", "  \t\n")),
        "blank lines in the motion": _plain(blank),
        "byte-order mark": Dialect(b"\xef\xbb\xbf" + _BASE.encode(), _BASE),
        "null bytes at the end": Dialect(_BASE.encode() + b"\0\0", _BASE, ("2 bytes after",)),
        "end mark of DOS": Dialect(_BASE.encode() + b"\x1a", _BASE, ("1 bytes after",)),
        "UTF-16": Dialect(_BASE.encode("utf-16"), _BASE),
        "brace on the line of the name": _plain(_BASE.replace("\n{", " {")),
        "hierarchy on one line": Dialect((one_line + "\n" + motion(numbers(12))).encode(), _BASE),
        "small keywords": _plain(small),
        "odd case of channels": _plain(_BASE.replace("Zrotation", "zROTATION").replace("Xp", "xP")),
        "exponents": _plain(power),
    }


def _motion_dialects() -> dict[str, Dialect]:
    """The frame count, the frame time, rows and lines."""
    rows = numbers(12)
    rounded = "frame time 0.008333 read as 1/120"
    return {
        "Frames:4": _plain(_BASE.replace("Frames: 4", "Frames:4").replace("Time: ", "Time:")),
        "Frames : 4": _plain(_BASE.replace("Frames: ", "Frames : ").replace("Time: ", "Time : ")),
        "Frame time": _plain(_BASE.replace("Frame Time", "Frame time")),
        "rows wrapped at rows": _plain(_wrapped(4)),
        "rows wrapped anywhere": _plain(_wrapped(7)),
        "all rows on one line": _plain(_wrapped(48)),
        "wrapped, more declared": _plain(_uneven(9), "9 frames declared, 4 found"),
        "wrapped, fewer declared": _plain(_uneven(3), "3 frames declared, 4 found"),
        "milliseconds": _plain(body() + motion(rows, time="33.3"), "33.3 seconds a frame"),
        "more frames declared": _plain(body() + motion(rows, 9), "9 frames declared, 4 found"),
        "fewer frames declared": _plain(body() + motion(rows, 2), "2 frames declared, 4 found"),
        "a rounded frame time": _plain(body() + motion(rows, time="0.008333"), rounded),
    }


def _name_dialects() -> dict[str, Dialect]:
    """Names, encodings, roots."""

    def named(*names: str) -> str:
        return body(names=(names[0], names[1], names[2])) + motion(numbers(12))

    japanese, french = named("腰", "左腕", "ソ手"), named("Hüfte", "BrasÉ", "Main")
    second = body(names=("Other", "OtherArm", "OtherHand")).removeprefix("HIERARCHY\n")
    old = "the names are not UTF-8; read as "
    return {
        "names used twice": _plain(named("Bone", "Bone", "Bone_2"), "names used twice"),
        "no name": _plain(named("Hips", "", "Hand"), "names used twice or empty"),
        "blanks in names": _plain(named("My Hips", "Left  Arm", "L H")),
        "keywords in names": _plain(named("ROOT_JOINT", "MOTION", "OFFSET CHANNELS")),
        "Latin-1 names": Dialect(french.encode("latin-1"), french, (old + "Latin-1",)),
        "Shift-JIS names": Dialect(japanese.encode("cp932"), japanese, (old + "Shift-JIS",)),
        "UTF-8 names": _plain(japanese),
        "two roots": _plain(body() + second + motion(numbers(24)), "2 ROOTs"),
    }


DIALECTS = {
    **_channel_dialects(),
    **_spelling_dialects(),
    **_motion_dialects(),
    **_name_dialects(),
}
