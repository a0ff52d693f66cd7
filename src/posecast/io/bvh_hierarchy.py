"""Reading the HIERARCHY part of a BVH file: braces, names, offsets, channels."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from os import PathLike

from posecast.errors import DataError
from posecast.io.bvh_document import AXES, BvhEnd, BvhJoint, is_channel, is_position

_WORD = re.compile(r"\s*+([{}]|[^\s{}]++)")
_NUMBER = re.compile(r"[+-]?+(?:\d++\.?+\d*+|\.\d++)(?:[eE][+-]?+\d++)?+", re.ASCII)


def is_number(word: str) -> bool:
    """Whether a word is a decimal number; ``nan``, ``inf`` and ``1_000`` are not."""
    return _NUMBER.fullmatch(word) is not None


def not_a_number(word: str, what: str) -> str:
    """The sentence for a word that should have been a number, with its likely cause."""
    shown = repr(word[:40])
    if "," in word:
        return (
            f"found {shown}, expected {what}; a comma is not a decimal sign in BVH: replace every "
            "',' by '.', or export again with an English number format"
        )
    if word.lower().lstrip("+-")[:3] in ("nan", "inf", "1.#"):
        return (
            f"found {shown}, expected {what}; the program that wrote the file lost the value: "
            "cut these frames away, or export again"
        )
    return f"found {shown}, expected {what}; mend the line, or export again"


class _Words:
    """The words of a text one after the other, braces apart, with the line of the last one."""

    def __init__(self, path: str | PathLike[str], lines: list[str]) -> None:
        self.path = path
        self.lines = lines
        self.row = 0
        self.column = 0

    @property
    def line(self) -> int:
        """Line of the word read last, counted from 1."""
        return min(self.row, len(self.lines) - 1) + 1

    def next(self) -> str | None:
        """The next word, or ``None`` at the end of the text."""
        while self.row < len(self.lines):
            if found := _WORD.match(self.lines[self.row], self.column):
                self.column = found.end()
                return found[1]
            self.row, self.column = self.row + 1, 0
        return None

    def rest(self) -> str:
        """What is left of the line before an opening brace, without blanks around it."""
        text = self.lines[self.row]
        brace = text.find("{", self.column)
        stop = len(text) if brace < 0 else brace
        found, self.column = text[self.column : stop].strip(), stop
        return found

    def number(self, what: str) -> str:
        """The next word, which must be a number."""
        word = self.next()
        if word is None or not is_number(word):
            raise self.error(not_a_number(word or "the end of the text", what))
        return word

    def expect(self, wanted: str, after: str) -> None:
        """Read one word, which must be ``wanted``."""
        word = self.next()
        if word is None or word.upper() != wanted:
            raise self.error(f"found {_shown(word)}, expected {wanted!r} after {after}")

    def error(self, message: str) -> DataError:
        """An error at the line of the word read last."""
        return DataError(self.path, message, self.line)


@dataclass
class _Open:
    """A joint or an End Site while it is being read."""

    name: str
    parent: int
    is_end: bool = False
    offset: tuple[str, str, str] | None = None
    channels: tuple[str, ...] | None = None
    ends: list[BvhEnd] = field(default_factory=list)


def parse_hierarchy(path: str | PathLike[str], lines: list[str]) -> tuple[BvhJoint, ...]:
    """Joints of the text from ``HIERARCHY`` up to ``MOTION``; any case, any layout of lines.

    One pass without recursion: nesting may be as deep as the file is long.

    Raises:
        DataError: the text is not a hierarchy; the line is that of the first thing unexpected.
    """
    words = _Words(path, lines)
    words.expect("HIERARCHY", "the start of the file")
    joints: list[_Open] = []
    stack: list[tuple[int, _Open]] = []
    while (word := words.next()) is not None:
        keyword = word.upper()
        place, top = stack[-1] if stack else (-1, None)
        if top is None:
            if keyword != "ROOT":
                raise words.error(_unexpected(word, top))
            stack.append((len(joints), _open(words, word, -1)))
            joints.append(stack[-1][1])
        elif keyword == "}":
            _close(words, top, joints)
            stack.pop()
        elif keyword == "OFFSET" and top.offset is None:
            x, y, z = (words.number("one of the three numbers of an OFFSET") for _ in AXES)
            top.offset = (x, y, z)
        elif keyword == "CHANNELS" and top.channels is None and not top.is_end:
            top.channels = _read_channels(words, top.name)
        elif keyword == "JOINT" and not top.is_end:
            stack.append((len(joints), _open(words, word, place)))
            joints.append(stack[-1][1])
        elif keyword == "END" and not top.is_end:
            stack.append((-1, _open(words, word, place, is_end=True)))
        else:
            raise words.error(_unexpected(word, top))
    if stack:
        raise words.error(
            f"{len(stack)} '{{' without a '}}' where the hierarchy ends; the file is cut off, or "
            "braces are missing: copy or export it again"
        )
    if not joints:
        raise words.error("the hierarchy has no ROOT, expected at least one joint")
    return tuple(
        BvhJoint(
            joint.name,
            joint.parent,
            joint.offset or ("0", "0", "0"),
            joint.channels or (),
            tuple(joint.ends),
        )
        for joint in joints
    )


def _open(words: _Words, keyword: str, parent: int, *, is_end: bool = False) -> _Open:
    opened = _Open(words.rest(), parent, is_end)
    words.expect("{", f"{keyword} {opened.name[:40]}".rstrip())
    return opened


def _close(words: _Words, closed: _Open, joints: list[_Open]) -> None:
    if closed.offset is None:
        what = "an End Site" if closed.is_end else f"joint {closed.name[:40]!r}"
        raise words.error(f"{what} ends without an OFFSET; add 'OFFSET x y z' (three numbers)")
    if closed.is_end:
        joints[closed.parent].ends.append(BvhEnd(closed.name, closed.offset))


def _read_channels(words: _Words, name: str) -> tuple[str, ...]:
    count = words.next()
    if count is None or not (count.isascii() and count.isdigit() and len(count) < 4):
        raise words.error(f"found {_shown(count)}, expected the number of channels, 0 to 999")
    channels: list[str] = []
    for _ in range(int(count)):
        word = words.next()
        if word is None or not is_channel(word):
            raise words.error(
                f"found {_shown(word)}, expected channel {len(channels) + 1} of {count} of joint "
                f"{name[:40]!r}: Xposition, Yposition, Zposition, Xrotation, Yrotation or "
                "Zrotation; correct the number after CHANNELS or the names"
            )
        channels.append(word)
    positions = [channel[0].lower() for channel in channels if is_position(channel)]
    if len(set(positions)) < len(positions):
        raise words.error(f"joint {name[:40]!r} has a position channel twice; remove one")
    return tuple(channels)


def _unexpected(word: str, top: _Open | None) -> str:
    if is_channel(word):
        return f"found {_shown(word)}: more channels than CHANNELS counts; correct the number"
    if top is None:
        expected = "ROOT or MOTION"
    elif top.is_end:
        expected = "one OFFSET and '}' (an End Site has nothing else)"
    else:
        expected = "one OFFSET, at most one CHANNELS, JOINT, End Site or '}'"
    return f"found {_shown(word)}, expected {expected}; mend the line, or export again"


def _shown(word: str | None) -> str:
    return "the end of the text" if word is None else repr(word[:40])
