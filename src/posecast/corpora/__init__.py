"""Named corpora, one a file: which files, splits, joints, frame rate, known faults."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal

from posecast.config import did_you_mean
from posecast.corpora import amass, amass_first, bandai, bodies, cmu, folder, h36m, synthetic
from posecast.errors import ConfigError
from posecast.motion import Corpus

CORPORA: dict[str, Callable[..., Corpus]] = {
    "synthetic": synthetic.synthetic,
    "cmu-salsa": cmu.cmu_salsa,
    "cmu-asf": cmu.cmu_asf,
    "bandai-locomotion": bandai.bandai_locomotion,
    "h36m": h36m.h36m,
    "amass": amass.amass,
    "amass-first": amass_first.amass_first,
    "bodies": bodies.bodies,
    "folder": folder.folder,
}


COMMON = ("root", "fps", "cache", "progress")
"""What every corpus may be given, whether or not it has a use for it."""


def build_corpus(
    kind: str,
    *,
    root: Path | str | None = None,
    fps: float | int | None = None,
    cache: Path | str | Literal[False] | None = None,
    progress: Callable[[int, int], None] | None = None,
    **options: Any,
) -> Corpus:
    """Build a corpus by name.

    Args:
        kind: a key of ``CORPORA``.
        root: folder of the files; the synthetic corpus has none.
        fps: frames per second; by default what is usual for the corpus.
        cache: where parsed files are kept: a folder, ``None`` for ``~/.cache/posecast`` (or below
            ``$XDG_CACHE_HOME``), ``False`` for nowhere.
        progress: called with files read and files in all, by a corpus that reads files.
        options: further arguments of that corpus, such as ``validation="11"`` of ``h36m``.

    Raises:
        ConfigError: an unknown kind or option, or a missing ``root``.
        DataError: files are missing or cannot be read.
    """
    if kind not in CORPORA:
        raise ConfigError(f"corpus {kind!r} is not known; {did_you_mean(kind, CORPORA)}")
    build = CORPORA[kind]
    parameters = inspect.signature(build).parameters
    for option in options:
        if option not in parameters:
            known = [name for name in parameters if name not in COMMON]
            raise ConfigError(
                f"corpus {kind!r}: unknown option {option!r}; {did_you_mean(option, known)}"
            )
    common = dict(zip(COMMON, (root, fps, cache, progress), strict=True))
    given = {
        name: value
        for name, value in common.items()
        if value is not None and name in parameters  # nothing to cache or wait for: not a mistake
    }
    if root is None and parameters["root"].default is inspect.Parameter.empty:
        raise ConfigError(f"corpus {kind!r} is read from files: give root, the folder they are in")
    return build(**given, **options)


__all__ = ["COMMON", "CORPORA", "build_corpus"]
