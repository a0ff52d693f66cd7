"""How a pose is written as numbers, and those numbers for a network."""

from __future__ import annotations

import inspect
from collections.abc import Callable

from posecast.errors import ConfigError
from posecast.representation.base import Content, Representation
from posecast.representation.codec import Codec, Parts, Statistics
from posecast.representation.controls import Controls
from posecast.representation.dual_quaternions import DualQuaternion
from posecast.representation.joined import Joined
from posecast.representation.positions import Offsets, Positions
from posecast.representation.root_channels import RootChannels
from posecast.representation.rotations import AxisAngle, Euler, Matrix, Ortho6d, Quaternion
from posecast.skeleton import Skeleton


def _quaternion_positions(skeleton: Skeleton) -> Joined:
    return Joined(Quaternion(), Positions(skeleton), skeleton)


def _ortho6d_positions(skeleton: Skeleton) -> Joined:
    return Joined(Ortho6d(), Positions(skeleton), skeleton)


def _quaternion_offsets(skeleton: Skeleton) -> Joined:
    return Joined(Quaternion(), Offsets(), skeleton)


def _ortho6d_offsets(skeleton: Skeleton) -> Joined:
    return Joined(Ortho6d(), Offsets(), skeleton)


REPRESENTATIONS: dict[str, Callable[..., Representation]] = {
    "positions": Positions,
    "euler": Euler,
    "axis_angle": AxisAngle,
    "matrix": Matrix,
    "quaternion": Quaternion,
    "ortho6d": Ortho6d,
    "dual_quaternion": DualQuaternion,
    "quaternion+positions": _quaternion_positions,
    "ortho6d+positions": _ortho6d_positions,
    "quaternion+offsets": _quaternion_offsets,
    "ortho6d+offsets": _ortho6d_offsets,
}


def build_representation(kind: str, skeleton: Skeleton, **options: object) -> Representation:
    """A representation by name; those that depend on the skeleton are given it.

    Raises:
        ConfigError: there is no such representation; the message lists those there are.
    """
    if kind not in REPRESENTATIONS:
        raise ConfigError(
            f"representation {kind!r} is not known; choose among: {', '.join(REPRESENTATIONS)}"
        )
    make = REPRESENTATIONS[kind]
    if "skeleton" in inspect.signature(make).parameters:
        options = {"skeleton": skeleton, **options}
    return make(**options)


__all__ = [
    "REPRESENTATIONS",
    "AxisAngle",
    "Codec",
    "Content",
    "Controls",
    "DualQuaternion",
    "Euler",
    "Joined",
    "Matrix",
    "Offsets",
    "Ortho6d",
    "Parts",
    "Positions",
    "Quaternion",
    "Representation",
    "RootChannels",
    "Statistics",
    "build_representation",
]
