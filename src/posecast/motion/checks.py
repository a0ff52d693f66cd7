"""Whether a clip's numbers are motion."""

from __future__ import annotations

from os import PathLike

import torch

from posecast.errors import DataError
from posecast.motion.clip import Clip

_UNIT_TOLERANCE = 1e-2
"""Half precision keeps quaternions of unit length to about a thousandth."""


def check_motion(where: str | PathLike[str], clip: Clip) -> None:
    """Refuse a clip with a number that is not finite, or a quaternion that is no rotation.

    Args:
        where: what the error names: a file, or a clip.
        clip: any clip.

    Raises:
        DataError: names the first frame, and the joint of a quaternion.
    """
    motion = {
        "offsets": clip.offsets,
        "root_positions": clip.root_positions,
        "rotations_local": clip.rotations_local,
        "translations_local": clip.translations_local,
    }
    for key, values in motion.items():
        if values is not None and not torch.isfinite(values).all():
            frame = int((~torch.isfinite(values)).nonzero()[0, 0])
            raise DataError(where, f"{key} has a value that is not finite in row {frame}")
    length = clip.rotations_local.detach().double().norm(dim=-1)
    if ((length - 1).abs() > _UNIT_TOLERANCE).any():
        frame, joint = ((length - 1).abs() > _UNIT_TOLERANCE).nonzero()[0].tolist()
        raise DataError(
            where,
            f"rotations_local has a quaternion of length {length[frame, joint]:.4g} in frame "
            f"{frame}, joint {clip.skeleton.names[joint]!r}, expected 1; normalize them",
        )
