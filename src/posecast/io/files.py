"""Bringing the bytes of a file into memory, or saying in one line why that cannot be."""

from __future__ import annotations

from os import PathLike
from pathlib import Path

from posecast.errors import DataError


def check_is_file(path: str | PathLike[str]) -> Path:
    """``path`` as a ``Path``, known to be a regular file.

    Raises:
        DataError: there is no such file, or it is a folder or a device.
    """
    file = Path(path)
    try:
        if file.is_file():
            return file
        found = "is not a regular file" if file.exists() else "there is no such file"
    except (OSError, ValueError) as error:  # a closed folder above it, a name with a NUL
        raise DataError(path, f"cannot be looked up ({error}); check the path") from error
    raise DataError(path, f"{found}; check the path")


def read_text_bytes(path: str | PathLike[str], expected: str) -> bytes:
    """Content of a text file in any encoding that extends ASCII.

    Args:
        path: the file.
        expected: what the file should be, for the message: ``"AMC motion"``.

    Raises:
        DataError: the file cannot be read, is empty, or is binary (holds a zero byte).
    """
    file = check_is_file(path)
    try:
        content = file.read_bytes()
    except OSError as error:
        raise DataError(path, f"cannot be read ({error.strerror or error})") from error
    if not content.strip():
        raise DataError(path, f"is empty, expected {expected}; copy it again from its source")
    if (place := content.find(b"\0")) >= 0:
        raise DataError(
            path,
            f"holds a zero byte at position {place}, expected {expected}; it is binary, damaged, "
            "or UTF-16 (then save it as plain text)",
        )
    return content


def decode_text(content: bytes) -> str:
    """Text with ``\\n`` at line ends: UTF-8 where it is that, else Latin-1, which fits any byte."""
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = content.decode("latin-1")
    return text.replace("\r\n", "\n").replace("\r", "\n")
