"""Readers and writers, one format a file: metres, y up, wxyz behind this door."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import Any

from posecast.errors import ConfigError, DataError
from posecast.io.amass import is_amass, read_amass
from posecast.io.amass_first import read_amass_first
from posecast.io.archive import read_archive, write_archive
from posecast.io.arrays import array_names
from posecast.io.asf_amc import read_amc
from posecast.io.atomic import atomic_write
from posecast.io.bvh import read_bvh, write_bvh
from posecast.io.glb import write_glb
from posecast.io.h36m import read_h36m, read_h36m_columns
from posecast.io.path_files import read_path, read_waypoints
from posecast.motion import Clip

__all__ = [
    "READERS",
    "WRITERS",
    "atomic_write",
    "read_amass",
    "read_amass_first",
    "read_amc",
    "read_archive",
    "read_bvh",
    "read_clip",
    "read_h36m",
    "read_h36m_columns",
    "read_path",
    "read_waypoints",
    "reader_options",
    "write_archive",
    "write_bvh",
    "write_clip",
    "write_glb",
]


def read_clip(path: str | PathLike[str], *, fps: float | None = None, **options: Any) -> Clip:
    """Read a recording in the format that its extension names.

    ``.npz`` is our own archive or AMASS, told apart by the arrays in it; ``.pkl`` the first release
    of AMASS, read without executing anything; ``.txt`` is Human3.6M; an ``.amc`` needs its ``.asf``
    beside it. docs/formats.md says more.

    Args:
        path: the file.
        fps: the true frame rate, in the place of a wrong one (in AMASS files, or of none); the
            frames stay as they are.
        options: of that format's reader, such as ``unit`` and ``up`` of ``read_bvh``, ``skeleton``
            of ``read_amc``, ``template`` of ``read_amass``.

    Raises:
        DataError: the extension is not known, or the file is not what its extension says.
        ConfigError: an option that this format does not have, or a rate that is not positive.
    """
    if fps is not None and not 0 < fps < math.inf:
        raise ConfigError(f"fps is {fps}: expected a positive number of frames per second")
    reader = _reader(path)
    known = _options(reader)
    for option in options:
        if option not in known:
            found = ", ".join(name for name in known if name != "fps") or "none"
            raise ConfigError(
                f"{path}: {option!r} is no option of files like this; those are: {found}"
            )
    if fps is not None and "fps" in known:
        return reader(path, fps=fps, **options)
    clip = reader(path, **options)
    return clip if fps is None else replace(clip, fps=fps)


def reader_options(path: str | PathLike[str]) -> tuple[str, ...]:
    """What the reader of a file's format can be told besides the file.

    Raises:
        DataError: the extension is not known, or an .npz file cannot be opened.
    """
    return _options(_reader(path))


def _reader(path: str | PathLike[str]) -> Callable[..., Clip]:
    """What reads a file."""
    reader = READERS[_extension(path, READERS, "read")]
    return _npz_reader(path) if reader is _read_npz else reader


def _options(reader: Callable[..., Clip]) -> tuple[str, ...]:
    """A reader's parameters but the path."""
    return tuple(inspect.signature(reader).parameters)[1:]


def write_clip(clip: Clip, path: str | PathLike[str]) -> tuple[str, ...]:
    """Write a clip in the format that the extension names; the file appears whole or not at all.

    Returns:
        What the format could not keep, one sentence each; nothing where all was kept.

    Raises:
        DataError: the extension is not known, or the file cannot be written.
    """
    return WRITERS[_extension(path, WRITERS, "write")](clip, path)


def _read_npz(path: str | PathLike[str]) -> Clip:
    return _npz_reader(path)(path)


def _npz_reader(path: str | PathLike[str]) -> Callable[..., Clip]:
    """What reads this .npz file; bodies without motion go to the reader that knows them."""
    names = array_names(path)
    return read_amass if is_amass(names) or "betas" in names else read_archive


def _write_glb(clip: Clip, path: str | PathLike[str]) -> tuple[str, ...]:
    write_glb(clip, path)
    return ()


def _write_npz(clip: Clip, path: str | PathLike[str]) -> tuple[str, ...]:
    write_archive(clip, path)
    return ()


READERS: dict[str, Callable[..., Clip]] = {
    ".amc": read_amc,
    ".bvh": read_bvh,
    ".npz": _read_npz,
    ".pkl": read_amass_first,
    ".txt": read_h36m,
}
"""What reads the files of an extension."""

WRITERS: dict[str, Callable[[Clip, str | PathLike[str]], tuple[str, ...]]] = {
    ".bvh": write_bvh,
    ".glb": _write_glb,
    ".npz": _write_npz,
}
"""What writes the files of an extension."""

_WRITTEN_ONLY = "GLB is only written; keep the clip as .bvh or .npz beside it, and read that"

_REMEDIES = {
    ".asf": "it holds a skeleton only; name the .amc file of a recording",
    ".c3d": "markers have no skeleton; solve them to BVH with the software they came from",
    ".fbx": "export it as BVH, for example with Blender",
    ".glb": _WRITTEN_ONLY,
    ".gltf": _WRITTEN_ONLY,
}


def _extension(path: str | PathLike[str], known: Mapping[str, object], verb: str) -> str:
    """The extension of ``path`` in small letters, which is in the table."""
    extension = Path(path).suffix.lower()
    if extension in known:
        return extension
    remedy = _REMEDIES.get(extension, "convert it first") if verb == "read" else "name it so"
    raise DataError(
        path,
        f"extension {extension!r}, expected one that posecast can {verb}: "
        f"{', '.join(sorted(known))}; {remedy}",
    )
