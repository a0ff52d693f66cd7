"""Our own .npz archive: one clip, exact round trip. The format is public: docs/archive.md."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from posecast.errors import DataError, SkeletonError
from posecast.io.arrays import read_arrays
from posecast.io.atomic import atomic_write
from posecast.motion import Clip
from posecast.motion.checks import check_motion
from posecast.skeleton import Skeleton

FORMAT = "posecast-clip"
VERSION = 1
REQUIRED = ("names", "parents", "offsets", "fps", "root_positions", "rotations_local")
_TRACK = "track_"


def write_archive(clip: Clip, path: str | PathLike[str]) -> None:
    """Write a clip so that ``read_archive`` gives it back bit by bit, precision included.

    ``clip.source`` (conventions of the file it once came from) is not kept. The file is written
    beside its final place and renamed; equal clips give equal bytes.

    Raises:
        DataError: the place cannot be written, or the clip holds what the format cannot: values
            that are not finite, quaternions that are no rotations, bfloat16.
    """
    check_motion(path, clip)
    arrays: dict[str, np.ndarray] = {
        "format": np.array(FORMAT),
        "version": np.array(VERSION),
        "names": _texts(path, clip.skeleton.names),
        "parents": np.array(clip.skeleton.parents, dtype=np.int64),
        "offsets": _numbers(path, "offsets", clip.offsets),
        "fps": np.array(float(clip.fps)),
        "root_positions": _numbers(path, "root_positions", clip.root_positions),
        "rotations_local": _numbers(path, "rotations_local", clip.rotations_local),
        "name": _texts(path, clip.name),
        "labels": np.array(json.dumps(dict(clip.labels))),
    }
    if clip.translations_local is not None:
        arrays["translations_local"] = _numbers(path, "translations_local", clip.translations_local)
    for track, values in clip.tracks.items():
        arrays[_TRACK + track] = _numbers(path, _TRACK + track, values)
    with atomic_write(path) as temporary, temporary.open("wb") as file:
        np.savez(file, **arrays)  # type: ignore[arg-type]


def read_archive(path: str | PathLike[str]) -> Clip:
    """Read a clip from an archive of ours, or from one that another program wrote.

    Only ``names``, ``parents``, ``offsets``, ``fps``, ``root_positions`` and ``rotations_local``
    must be there. Arrays the format does not know are left alone.

    Raises:
        DataError: the file is missing, damaged, of a later version, lacks an array, or an array
            has the wrong shape or values; see the message.
    """
    arrays = read_arrays(path)
    if missing := [key for key in REQUIRED if key not in arrays]:
        raise DataError(
            path,
            f"no array {', '.join(missing)}; found {', '.join(sorted(arrays)) or 'none'}; "
            "docs/archive.md describes the format",
        )
    _check_version(path, arrays)
    try:
        names = tuple(str(name) for name in _shaped(path, arrays, "names", "U", ("joints",)))
        parents = _shaped(path, arrays, "parents", "iu", (len(names),))
        skeleton = Skeleton(names, tuple(int(parent) for parent in parents))
    except SkeletonError as error:
        raise DataError(path, str(error)) from error
    joints = len(skeleton)
    rotations = _shaped(path, arrays, "rotations_local", "f", ("frames", joints, 4))
    frames = len(rotations)
    moved = None
    if "translations_local" in arrays:
        moved = _shaped(path, arrays, "translations_local", "f", (frames, joints, 3))
    tracks = {
        key.removeprefix(_TRACK): _tensor(path, key, values)
        for key, values in arrays.items()
        if key.startswith(_TRACK)
    }
    for track, values in tracks.items():
        if values.ndim == 0 or len(values) != frames:
            raise DataError(
                path, f"track {track!r} has shape {tuple(values.shape)}, expected {frames} first"
            )
    clip = Clip(
        skeleton=skeleton,
        offsets=torch.from_numpy(_shaped(path, arrays, "offsets", "f", (joints, 3))),
        fps=_rate(path, arrays),
        root_positions=torch.from_numpy(_shaped(path, arrays, "root_positions", "f", (frames, 3))),
        rotations_local=torch.from_numpy(rotations),
        translations_local=None if moved is None else torch.from_numpy(moved),
        name=_text(path, arrays, "name", Path(path).stem),
        labels=_labels(path, arrays),
        tracks=tracks,
    )
    check_motion(path, clip)
    return clip


def _numbers(path: str | PathLike[str], key: str, values: Tensor) -> np.ndarray:
    try:
        return values.detach().cpu().numpy()
    except TypeError as error:
        raise DataError(
            path, f"{key} has type {values.dtype}, which NumPy lacks; use clip.to(torch.float32)"
        ) from error


def _texts(path: str | PathLike[str], texts: str | tuple[str, ...]) -> np.ndarray:
    array = np.array(texts)
    kept = array.tolist() if isinstance(texts, str) else tuple(array.tolist())
    if kept != texts:
        raise DataError(path, "a name ends with a zero character, which NumPy drops; rename it")
    return array


def _check_version(path: str | PathLike[str], arrays: Mapping[str, np.ndarray]) -> None:
    version = arrays.get("version", np.array(VERSION))
    if version.shape != () or version.dtype.kind not in "iu" or not 1 <= int(version) <= VERSION:
        raise DataError(
            path,
            f"version {version.tolist()!r} of the archive format, expected at most {VERSION}; "
            "it needs a later posecast",
        )


def _shaped(
    path: str | PathLike[str],
    arrays: Mapping[str, np.ndarray],
    key: str,
    kinds: str,
    expected: tuple[int | str, ...],
) -> np.ndarray:
    """An array, known to be of one of ``kinds`` and of a shape; a word is any size > 0."""
    array = arrays[key]
    fits = len(array.shape) == len(expected) and all(
        found == size if isinstance(size, int) else found > 0
        for found, size in zip(array.shape, expected, strict=True)
    )
    narrow = array.dtype.itemsize <= 8 or kinds == "U"
    if not (fits and narrow and array.dtype.kind in kinds):
        sizes = ", ".join(map(str, expected))
        types = {"U": "text", "iu": "integers", "f": "16, 32 or 64 bit floats"}[kinds]
        raise DataError(
            path, f"{key} is {array.dtype} {array.shape}, expected {types} of shape ({sizes})"
        )
    return array


def _tensor(path: str | PathLike[str], key: str, values: np.ndarray) -> Tensor:
    try:
        return torch.from_numpy(values)
    except TypeError as error:
        raise DataError(path, f"{key} has type {values.dtype}, expected numbers") from error


def _rate(path: str | PathLike[str], arrays: Mapping[str, np.ndarray]) -> float:
    fps = arrays["fps"]
    if fps.size != 1 or fps.dtype.kind not in "fiu" or not 0 < float(fps.item()) < math.inf:
        raise DataError(path, f"fps is {fps.tolist()!r}, expected one number > 0")
    return float(fps.item())


def _text(
    path: str | PathLike[str], arrays: Mapping[str, np.ndarray], key: str, otherwise: str
) -> str:
    if key not in arrays:
        return otherwise
    if arrays[key].dtype.kind != "U" or arrays[key].size != 1:
        raise DataError(path, f"{key} is {arrays[key].dtype} {arrays[key].shape}, expected a text")
    return str(arrays[key].item())


def _labels(path: str | PathLike[str], arrays: Mapping[str, np.ndarray]) -> dict[str, str]:
    text = _text(path, arrays, "labels", "{}")
    try:
        labels: Any = json.loads(text)
    except (ValueError, RecursionError):
        labels = None
    if not isinstance(labels, dict) or not all(isinstance(text, str) for text in labels.values()):
        raise DataError(path, f"labels are {text[:80]!r}, expected a JSON object of texts")
    return labels
