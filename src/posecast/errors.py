"""What a user can cause; the command line prints these without a traceback and exits with 2."""

from __future__ import annotations

from os import PathLike, fspath


class PosecastError(Exception):
    """Base of every error that a user can cause and can mend."""


class ConfigError(PosecastError):
    """A recipe, an override or a combination of parts that does not fit."""


class SkeletonError(PosecastError):
    """A skeleton that is not a forest, or one that does not match another."""


class DataError(PosecastError):
    """A file or folder that is not what it should be.

    Args:
        path: the file or folder.
        message: what was found, what was expected, what to do.
        line: line in the file, counted from 1, where that is known.
    """

    def __init__(self, path: str | PathLike[str], message: str, line: int | None = None) -> None:
        self.path = fspath(path)
        self.line = line
        self.message = message
        place = self.path if line is None else f"{self.path}, line {line}"
        super().__init__(f"{place}: {message}")

    def __reduce__(self) -> tuple[type[DataError], tuple[str, str, int | None]]:
        """Make the same error again, as when it comes out of a worker process."""
        return type(self), (self.path, self.message, self.line)
