"""Writing a BVH document as text: the hierarchy, and numbers by the hundred thousand."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from os import PathLike

import numpy as np
from jaxtyping import Float
from numpy.typing import NDArray

from posecast.errors import DataError
from posecast.io.atomic import atomic_write
from posecast.io.bvh_document import BvhDocument, BvhJoint, depth_first

MICRO = 1_000_000
_DEEPEST_INDENT = 40
"""Deeper levels are not indented further: a chain of joints stays linear in the file."""


def write_bvh_document(document: BvhDocument, path: str | PathLike[str]) -> None:
    """Write a document; reading it back gives the same joints and exactly the same numbers.

    Both are in the order of ``depth_first``, the only one that text can have.

    Layout of lines and spelling of keywords are the usual ones, not those of the file it may have
    been read from. Numbers have as many digits as they need (``repr``).

    Raises:
        DataError: the file cannot be written, a number is not finite, or the rows do not have one
            number for each channel.
    """
    values = document.values
    columns = sum(len(joint.channels) for joint in document.joints)
    if values.ndim != 2 or values.shape[1] != columns:
        raise DataError(path, f"values of shape {values.shape} for {columns} channels")
    if not np.isfinite(values).all():
        raise DataError(path, "a value to be written is not finite; mend the clip first")
    document = depth_first(document)
    values = document.values
    rows = "\n".join(" ".join(map(repr, row)) for row in values.tolist())
    write_text(path, document, rows.encode("ascii") + b"\n")


def write_text(path: str | PathLike[str], document: BvhDocument, rows: bytes) -> None:
    """Write a hierarchy and rows that are text already; ``document.values`` gives their number.

    The document must be in the order of ``depth_first``, as its rows are.
    """
    lines = [
        "HIERARCHY",
        *_hierarchy(document.joints),
        "MOTION",
        f"Frames: {len(document.values)}",
        f"Frame Time: {document.frame_time}",
    ]
    head = "".join(line + "\n" for line in lines)
    if document.encoding == "utf-16":
        data = (
            (head + rows.decode("ascii"))
            .replace("\n", document.newline)
            .encode("utf-16", errors="replace")
        )
    else:
        data = _encode(head, document.encoding) + rows
        if document.newline != "\n":
            data = data.replace(b"\n", document.newline.encode("ascii"))
    with atomic_write(path) as temporary:
        temporary.write_bytes(data)


def _encode(text: str, encoding: str) -> bytes:
    """Encode; names that the source's encoding lacks make it UTF-8."""
    try:
        return text.encode(encoding)
    except UnicodeEncodeError:
        return text.encode("utf-8", errors="replace")


def _hierarchy(joints: tuple[BvhJoint, ...]) -> Iterator[str]:
    """Lines of the hierarchy of joints that are in the order of ``depth_first``."""
    depths: list[int] = []
    for joint in joints:
        depth = 0 if joint.parent < 0 else depths[joint.parent] + 1
        yield from _closed(depths[-1] if depths else -1, depth)
        depths.append(depth)
        indent = "  " * min(depth, _DEEPEST_INDENT)
        inner = "  " * min(depth + 1, _DEEPEST_INDENT)
        yield f"{indent}{'ROOT' if joint.parent < 0 else 'JOINT'} {joint.name}".rstrip()
        yield indent + "{"
        yield f"{inner}OFFSET {' '.join(joint.offset)}"
        yield f"{inner}CHANNELS {' '.join([str(len(joint.channels)), *joint.channels])}"
        for end in joint.ends:
            yield f"{inner}End {end.name}".rstrip()
            yield inner + "{"
            yield f"{inner}  OFFSET {' '.join(end.offset)}"
            yield inner + "}"
    yield from _closed(depths[-1] if depths else -1, 0)


def _closed(last: int, depth: int) -> Iterator[str]:
    """Braces of all joints that end after one of depth ``last`` and before one of ``depth``."""
    for level in range(last, depth - 1, -1):
        yield "  " * min(level, _DEEPEST_INDENT) + "}"


def six_decimals(micro: Float[np.ndarray, "frames channels"]) -> bytes:
    """Rows of text with six decimals, several times faster than ``%.6f``.

    Args:
        micro: whole millionths, held exactly, so of a size below 2**53.

    Every number gets a record of fixed width with zero bytes where it is shorter; taking the zero
    bytes out afterwards is one pass. Some rows at a time, so that all of it stays in the cache.
    """
    rows = max(1, _CHUNK // max(1, micro.shape[1]))
    greatest = np.abs(micro).max(initial=0)
    if greatest >= 10**8 * MICRO:
        return _six_decimals_slowly(micro)
    whole_type = np.uint32 if greatest < 2**32 else np.uint64
    return b"".join(
        _some_rows(micro[start : start + rows], whole_type) for start in range(0, len(micro), rows)
    )


_CHUNK = 2**15


def _some_rows(
    micro: Float[np.ndarray, "frames channels"], whole_type: type[np.unsignedinteger]
) -> bytes:
    """Text of a few rows, by way of records with zero bytes in what a number does not need."""
    size = np.abs(micro).astype(whole_type)
    whole = size // MICRO
    fraction = size - whole * MICRO
    tenths = fraction // 100
    full, short, pairs = _digits(10**4, 4, "0"), _digits(10**4, 4, "\0"), _digits(100, 2, "0")
    text = np.zeros(micro.shape, dtype=_RECORD)
    text["sign"] = np.where(micro < 0, np.uint8(ord("-")), np.uint8(0))
    if whole.max(initial=0) >= 10**4:
        high = whole // 10**4
        low = whole - high * 10**4
        text["high"] = np.where(high > 0, short.take(high), 0)
        text["low"] = np.where(high > 0, full.take(low), short.take(low))
    else:
        text["low"] = short.take(whole)
    text["dot"] = ord(".")
    text["tenths"] = full.take(tenths)
    text["last"] = pairs.take(fraction - tenths * 100)
    text["blank"] = ord(" ")
    text["blank"][:, -1] = ord("\n")
    return text.tobytes().translate(None, b"\0")


def _six_decimals_slowly(micro: Float[np.ndarray, "frames channels"]) -> bytes:
    """The same for numbers of any size."""

    def text(value: float) -> str:
        whole, fraction = divmod(abs(int(value)), MICRO)
        return f"{'-' if value < 0 else ''}{whole}.{fraction:06d}"

    return "".join(" ".join(map(text, row)) + "\n" for row in micro.tolist()).encode("ascii")


@cache
def _digits(count: int, width: int, pad: str) -> NDArray[np.unsignedinteger]:
    """All numbers below ``count`` as text of a fixed width, each as one word of memory."""
    text = b"".join(str(number).rjust(width, pad).encode("ascii") for number in range(count))
    return np.frombuffer(text, f"u{width}")


_RECORD = np.dtype(
    [
        ("sign", "u1"),
        ("high", "u4"),
        ("low", "u4"),
        ("dot", "u1"),
        ("tenths", "u4"),
        ("last", "u2"),
        ("blank", "u1"),
    ]
)
