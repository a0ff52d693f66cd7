"""A store for each set of files and options, found again by its key, rebuilt when damaged."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path

from posecast.errors import DataError
from posecast.motion.clip import Clip
from posecast.motion.store import FORMAT, Store, pack_unless_there

_ABANDONED_AFTER = 24 * 3600.0


def default_folder() -> Path:
    """``$XDG_CACHE_HOME/posecast``, or ``~/.cache/posecast`` where that is not set."""
    base = os.environ.get("XDG_CACHE_HOME")
    return (Path(base) if base else Path.home() / ".cache") / "posecast"


def fingerprint(files: Sequence[Path], options: Mapping[str, object]) -> str:
    """A key that changes with the files, with what is asked of them, and with our readers.

    Files count by path, size and time of change, not by content. The source of the code that reads
    and transforms them is part of the key, so that a mended reader never meets its old results.

    Args:
        files: what will be read.
        options: everything else the clips depend on; must be plain numbers, text and lists.

    Raises:
        DataError: a file is not there.
    """
    digest = hashlib.blake2b(digest_size=16)
    digest.update(json.dumps([FORMAT, options], sort_keys=True).encode())
    for file in files:
        try:
            facts = file.stat()
        except OSError as error:
            raise DataError(file, f"cannot be read ({error.strerror or error})") from error
        digest.update(json.dumps([str(file.absolute()), facts.st_size, facts.st_mtime_ns]).encode())
    package = Path(__file__).parents[1]
    for part in ("geometry", "skeleton", "motion", "io", "corpora"):
        for source in sorted((package / part).glob("*.py")):
            digest.update(source.read_bytes())
    return digest.hexdigest()


def cached(folder: Path, key: str, build: Callable[[], Iterable[Clip]]) -> Store:
    """The store of this key, packed now if it is not there or not whole.

    Args:
        folder: where stores lie, one folder a key.
        key: see ``fingerprint``.
        build: makes the clips; called only if they must be packed.

    Raises:
        OSError: ``folder`` cannot be written.
    """
    place = folder / key
    try:
        return Store.open(place)
    except DataError:
        _sweep(folder)
        return pack_unless_there(build(), place)


def _sweep(folder: Path) -> None:
    """Remove what packing left behind when it was killed; nothing that may still be in use."""
    for pattern in (".*.part", ".*.old"):
        for left in folder.glob(pattern):
            try:
                abandoned = time.time() - left.stat().st_mtime > _ABANDONED_AFTER
            except FileNotFoundError:
                continue
            if abandoned:
                shutil.rmtree(left, ignore_errors=True)
