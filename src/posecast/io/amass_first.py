"""The first release of AMASS, on the site of Deep Inertial Poser: pickles of 15 joints."""

from __future__ import annotations

from os import PathLike
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from posecast.errors import DataError
from posecast.geometry import quaternion
from posecast.geometry.conversions import matrix_to_quaternion
from posecast.io.amass import rest_offsets
from posecast.io.array_pickle import read_array_pickle
from posecast.motion import Clip
from posecast.skeleton import named_skeleton

FPS = 60.0
_JOINTS = 15
_NUMBERS = 9 * _JOINTS
_CROOKED = 1e-2


def read_amass_first(
    path: str | PathLike[str],
    *,
    template: str | PathLike[str] | Float[Tensor, "joints 3"] | None = None,
) -> Clip:
    """Read one recording on the skeleton ``smpl-22``, 60 frames per second.

    ``poses`` has 135 numbers a frame: the local rotation matrices of the 15 joints of ``smpl-15``.
    The other joints, the root among them, are not turned, and the root stands at the origin.

    Args:
        path: the .pkl file; it is read without executing anything, see ``array_pickle``.
        template: joint positions of the body at rest, as for ``read_amass``.

    Raises:
        DataError: the file cannot be read or holds no such motion.

    Source: the data of Huang et al. 2018 and Aksan et al. 2019.
    """
    entries = read_array_pickle(path)
    if "poses" not in entries:
        raise DataError(path, f"no motion: found {', '.join(sorted(entries)[:8])}, expected poses")
    whole, part = named_skeleton("smpl-22").skeleton, named_skeleton("smpl-15").skeleton
    matrices = _matrices(path, entries["poses"])
    rotations = quaternion.identity(len(matrices), len(whole), like=matrices)
    places = torch.tensor([whole.index(name) for name in part.names])
    rotations = rotations.index_copy(1, places, matrix_to_quaternion(matrices))
    labels = {"translation": "unknown"}
    offsets = rotations.new_zeros(len(whole), 3)
    if template is None:
        labels["offsets"] = "unknown"
    else:
        offsets, _ = rest_offsets(template)
    return Clip(
        skeleton=whole,
        offsets=offsets,
        fps=FPS,
        root_positions=rotations.new_zeros(len(matrices), 3),
        rotations_local=rotations,
        name=Path(path).stem,
        labels=labels,
    )


def _matrices(path: str | PathLike[str], poses: object) -> Float[Tensor, "frames joints 3 3"]:
    """Rotation matrices of the 15 joints."""
    try:
        numbers = np.asarray(poses, dtype=np.float64)
    except (TypeError, ValueError):
        raise DataError(path, "poses is not made of numbers") from None
    if numbers.ndim != 2 or numbers.shape[1] != _NUMBERS or not len(numbers):
        raise DataError(
            path,
            f"poses has shape {numbers.shape}, expected (frames, {_NUMBERS}): nine numbers for "
            f"each of {_JOINTS} joints",
        )
    if not np.isfinite(numbers).all():
        row = int(np.argwhere(~np.isfinite(numbers))[0, 0])
        raise DataError(path, f"poses has a value that is not finite in row {row}; leave it out")
    matrices = torch.from_numpy(numbers.reshape(-1, _JOINTS, 3, 3))
    off = (matrices @ matrices.mT - torch.eye(3, dtype=torch.float64)).abs().amax((1, 2, 3))
    if off.max() > _CROOKED or not bool((torch.linalg.det(matrices) > 0).all()):
        raise DataError(
            path, f"poses has a matrix in row {int(off.argmax())} that is no rotation; leave it out"
        )
    return matrices
