"""Whether a clip's numbers are motion, and whether a path is one to walk."""

from __future__ import annotations

import math
from os import PathLike

import torch

from posecast.errors import ConfigError, DataError
from posecast.motion.clip import Clip
from posecast.motion.path import Path

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


def check_path(
    where: str | PathLike[str],
    path: Path,
    *,
    least_length: float = 0.0,
    least_radius: float = 0.0,
) -> None:
    """Refuse a path that is shorter, or turns more sharply, than somebody needs.

    Nothing else does: a path may be as short and as sharp as it was drawn.

    Args:
        where: what the error names: a file, or a path.
        path: any.
        least_length: metres.
        least_radius: metres, of the path's ``curvatures``, that is, of corners as ``smoothing``
            rounds them; at a place where a straight path turns by a right angle it is 1.25 sigma.

    Raises:
        DataError: names the sharpest place, and the way point it is nearest to.
        ConfigError: a length or radius that is negative or not finite.
    """
    for name, least in (("least_length", least_length), ("least_radius", least_radius)):
        if not 0 <= least < math.inf:
            raise ConfigError(f"{name} is {least}: expected 0 metres or more")
    if path.length < least_length:
        raise DataError(
            where,
            f"{path.length:.3g} m long, expected at least {least_length:.3g} m; lead it farther",
        )
    sharpest = int(path.curvatures.abs().argmax())
    radius = 1 / max(float(path.curvatures[sharpest].abs()), 1e-12)
    if radius < least_radius:
        x, z = path.points[sharpest].tolist()
        distance = sharpest * path.spacing
        near = ""
        if len(path.marks):
            number = int((path.marks - distance).abs().argmin()) + 1
            near = f", near way point {number} of {len(path.marks)}"
        raise DataError(
            where,
            f"turns with a radius of {radius:.3g} m at (x, z) = ({x:.3g}, {z:.3g}), {distance:.3g} "
            f"m from its start{near}; expected at least {least_radius:.3g} m: widen the bend there",
        )
