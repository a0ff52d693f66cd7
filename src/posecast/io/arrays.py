"""Arrays from .npz and .npy files that nobody vouches for: no pickles, no bombs, no surprises."""

from __future__ import annotations

import lzma
import math
import re
import struct
import zipfile
import zlib
from collections.abc import Collection
from os import PathLike
from typing import Any

import numpy as np

from posecast.errors import DataError
from posecast.io.files import check_is_file

_MAGIC = b"\x93NUMPY"
_LONGEST_HEADER = 1 << 16
_ALWAYS_ALLOWED = 256 << 20
_LARGEST_RATIO = 200
"""Motion shrinks by a factor of 2 or 3; a file that claims much more wants to fill the memory."""
_LAST_CHARACTER = 0x10FFFF
_UNREADABLE = (
    zipfile.BadZipFile,
    zlib.error,
    lzma.LZMAError,
    EOFError,
    OSError,
    ValueError,
    OverflowError,
    NotImplementedError,  # a compression this Python does not have
    RuntimeError,  # an encrypted member
    struct.error,
)


def array_names(path: str | PathLike[str]) -> tuple[str, ...]:
    """Names of the arrays in an .npz file, as they stand in it.

    Raises:
        DataError: the file is missing or no .npz archive.
    """
    file = check_is_file(path)
    try:
        with zipfile.ZipFile(file) as archive:
            return tuple(name.removesuffix(".npy") for name in archive.namelist())
    except _UNREADABLE as error:
        raise _damaged(path, error) from error


def read_arrays(
    path: str | PathLike[str], names: Collection[str] | None = None
) -> dict[str, np.ndarray]:
    """Arrays of an .npz file by name; of ``names`` those that exist, or all.

    Only booleans, numbers and text come back, in native byte order and writable. Nothing is
    unpickled, and no more memory is taken than a recording of this file size may need.

    Raises:
        DataError: the file is missing, damaged, too strongly packed, or a wanted array holds
            Python objects.
    """
    file = check_is_file(path)
    arrays: dict[str, np.ndarray] = {}
    try:
        with zipfile.ZipFile(file) as archive:
            members = {info.filename.removesuffix(".npy"): info for info in archive.infolist()}
            wanted = {name: members[name] for name in members if names is None or name in names}
            size = sum(info.file_size for info in wanted.values())
            if size > max(_ALWAYS_ALLOWED, _LARGEST_RATIO * file.stat().st_size):
                raise DataError(
                    path,
                    f"claims to unpack to {size} bytes, {size // file.stat().st_size} times its "
                    "size; this is no recording, do not use the file",
                )
            for name, info in wanted.items():
                with archive.open(info) as stream:
                    # Asking for the size that is claimed keeps a lie about it harmless.
                    content = stream.read(info.file_size)
                    if stream.read(1):
                        raise DataError(path, f"array {name!r} is longer than it claims")
                arrays[name] = parse_array(path, name, content)
    except _UNREADABLE as error:
        raise _damaged(path, error) from error
    return arrays


def parse_array(path: str | PathLike[str], name: str, content: bytes) -> np.ndarray:
    """The array in the bytes of an .npy file.

    The header is matched, not evaluated, and must account for every byte that follows it.

    Args:
        path: where the bytes come from, for messages.
        name: what the array is called there.

    Raises:
        DataError: the bytes are no array of booleans, numbers or text.
    """
    header, start = _header(path, name, content)
    described = re.search(r"""['"]descr['"]\s*:\s*['"]([<>|=]?[A-Za-z]\d*)['"]""", header)
    order = re.search(r"""['"]fortran_order['"]\s*:\s*(True|False)""", header)
    sizes = re.search(r"""['"]shape['"]\s*:\s*\(([\d,\sL]*)\)""", header)
    if described is None or order is None or sizes is None:
        raise DataError(path, f"array {name!r} has an unknown header {header.strip()[:80]!r}")
    if not re.fullmatch(r"[<>|=]?([biufUS]\d{1,6}|\?)", described[1]):
        what = "Python objects" if described[1].endswith("O") else f"values of type {described[1]}"
        raise DataError(
            path, f"array {name!r} holds {what}, expected numbers or text; objects are not read"
        )
    try:
        dtype = np.dtype(described[1])
        shape = tuple(int(size.rstrip("L")) for size in re.findall(r"\d{1,18}L?", sizes[1]))
        found = len(content) - start
        if dtype.itemsize == 0 or math.prod(shape) * dtype.itemsize != found:
            raise DataError(
                path,
                f"array {name!r} has {found} bytes, expected {shape} times {dtype.itemsize}; "
                "copy the file again",
            )
        flat = np.frombuffer(content, dtype, offset=start)
        array = flat.reshape(shape, order="F" if order[1] == "True" else "C")
        array = array.astype(dtype.newbyteorder("="), order="C", copy=True)
        if dtype.kind == "U":
            codes = np.frombuffer(content, dtype.byteorder + "u4", offset=start)
            if (codes > _LAST_CHARACTER).any():
                raise DataError(path, f"array {name!r} holds numbers that are no characters")
    except (ValueError, OverflowError, TypeError, MemoryError) as error:
        raise _damaged(path, error) from error
    return array


def _header(path: str | PathLike[str], name: str, content: bytes) -> tuple[str, int]:
    """Header of an .npy file and where its data begin."""
    wide = content[6:7] in (b"\2", b"\3")
    start = 12 if wide else 10
    if not content.startswith(_MAGIC) or len(content) < start:
        raise DataError(path, f"{name!r} is no NumPy array, expected one; copy the file again")
    (length,) = struct.unpack("<I" if wide else "<H", content[8:start])
    if length > min(_LONGEST_HEADER, len(content) - start):
        raise DataError(path, f"array {name!r} is cut off in its header; copy the file again")
    return content[start : start + length].decode("latin-1"), start + length


def _damaged(path: str | PathLike[str], error: Any) -> DataError:
    reason = " ".join(str(error).split())[:120] or type(error).__name__
    return DataError(path, f"is damaged or no .npz archive ({reason}); copy the file again")
