"""Writing files so that a reader sees the old one or the new one, never half of one."""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from os import PathLike
from pathlib import Path

from posecast.errors import DataError


def check_target(path: str | PathLike[str]) -> None:
    """Refuse a file that could not be written, before any work goes into it.

    Raises:
        DataError: the folder is missing, or ``path`` is a folder or device.
    """
    target = Path(os.path.realpath(path))
    if target.exists() and not target.is_file():
        raise DataError(path, "is not a regular file, so it cannot be replaced; name a file")
    if not target.parent.is_dir():
        raise DataError(path, f"there is no folder {target.parent}; make it first")


@contextmanager
def atomic_write(path: str | PathLike[str]) -> Iterator[Path]:
    """A temporary file beside ``path``, which takes its place when the block ends well.

    The temporary file exists (empty) inside the block and keeps the extension of ``path``, which
    some writers look at. If the block raises, it is removed and ``path`` is as it was. A symbolic
    link is followed: the file it points to is replaced.

    Args:
        path: the file to write; its folder must exist.

    Raises:
        DataError: the folder is missing or closed to writing, ``path`` is a folder or device, or
            the system refuses the block a write: a full disk, a quota, a lost network drive.
    """
    check_target(path)
    target = Path(os.path.realpath(path))
    # The stem is cut so that a name of the greatest length allowed still has a temporary one.
    temporary = target.with_name(f".{target.stem[:80]}.{secrets.token_hex(6)}{target.suffix}")
    try:
        # Not tempfile: its files are closed to other users, and would stay so after the rename.
        os.close(os.open(temporary, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o666))
    except OSError as error:
        reason = error.strerror or error
        raise DataError(path, f"cannot be written ({reason}); choose another folder") from error
    try:
        yield temporary
        temporary.replace(target)
    except BaseException as error:
        # On a drive that is gone, this fails for the same reason, which is the one to name.
        with suppress(OSError):
            temporary.unlink(missing_ok=True)
        if isinstance(error, OSError):
            reason = error.strerror or error
            raise DataError(path, f"cannot be written ({reason}); choose another place") from error
        raise
