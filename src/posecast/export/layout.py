"""What the numbers of an exported step are: what a program in any language needs to know."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, Literal

from posecast.errors import ConfigError, SkeletonError
from posecast.export.graph import StepNetwork
from posecast.representation import (
    AxisAngle,
    Codec,
    DualQuaternion,
    Euler,
    Joined,
    Matrix,
    Offsets,
    Ortho6d,
    Positions,
    Quaternion,
)

Mode = Literal["exact", "fast"]
"""Weights in single precision, or the large ones in eight bits: see ``in_eight_bits``."""

FORMAT = 1
CONVENTIONS = (
    "metres, radians, seconds; right-handed, y up, a character facing +z has its left hand towards "
    "+x; quaternions (w, x, y, z), active, joint = parent * local"
)

_NUMBERS: Mapping[type, tuple[str, ...]] = {
    AxisAngle: ("x", "y", "z"),
    DualQuaternion: tuple(f"{part}_{axis}" for part in ("real", "dual") for axis in "wxyz"),
    Matrix: tuple(f"row{row}_column{column}" for row in range(3) for column in range(3)),
    Offsets: ("offset_x", "offset_y", "offset_z"),
    Ortho6d: tuple(f"column{column}_{axis}" for column in range(2) for axis in "xyz"),
    Positions: ("position_x", "position_y", "position_z"),
    Quaternion: ("w", "x", "y", "z"),
}
_ROOT = {
    "displacement": ("step_x", "height", "step_z"),
    "path": ("ahead", "height"),
    "path_lateral": ("ahead", "height", "left"),
}


def describe(
    network: StepNetwork,
    mode: Mode,
    *,
    offsets: Sequence[Sequence[float]],
    fps: float,
) -> dict[str, Any]:
    """What an exported step says of itself, ready for JSON.

    Args:
        network: what is exported.
        mode: how its weights are written.
        offsets: a body for the skeleton, metres, one row a joint.
        fps: frames per second of its steps.

    Returns:
        ``inputs``, ``outputs``: names in their order; ``feed_back``: which output is the next
        ``features``; ``features``: what each number of them is, such as ``hips.w``, ``root.height``
        or ``action.walk``; ``controls``: what each of those is; ``initial_state``: for each state
        the values before the first frame, ``null`` for zeros; and skeleton, body, rate and
        conventions.

    Raises:
        SkeletonError: the body is not of the skeleton.
        ConfigError: a frame rate that is none.
    """
    codec = network.forecaster.codec
    if len(offsets) != len(codec.skeleton):
        raise SkeletonError(
            f"offsets of {len(offsets)} joints; expected the {len(codec.skeleton)} of the skeleton"
        )
    if not 0 < fps < math.inf:
        raise ConfigError(f"fps: {fps}; expected a frame rate above 0")
    controls = network.forecaster.controls
    return {
        "format": FORMAT,
        "conventions": CONVENTIONS,
        "mode": mode,
        "fps": fps,
        "skeleton": {
            "names": list(codec.skeleton.names),
            "parents": list(codec.skeleton.parents),
            "offsets": [[float(number) for number in offset] for offset in offsets],
        },
        "inputs": list(network.names.inputs),
        "outputs": list(network.names.outputs),
        "feed_back": "emitted" if network.forecaster.feedback == "emitted" else "next_features",
        "features": feature_names(codec),
        "controls": _control_names(codec, 0 if controls is None else controls.input_dim),
        "initial_state": _initial_state(network),
    }


def feature_names(codec: Codec) -> list[str]:
    """What each of the features is: joint and number, root channel, or action."""
    numbers = number_names(codec.representation)
    joints = [f"{joint}.{number}" for joint in codec.written.names for number in numbers]
    named = _ROOT.get(codec.root, tuple(f"{codec.root}_{n}" for n in range(codec.root_dim)))
    root = [f"root.{channel}" for channel in named]
    return [*joints, *root, *(f"action.{action}" for action in codec.actions)]


def _control_names(codec: Codec, count: int) -> list[str]:
    """What each of the controls is, such as ``movement_x``, or their numbers where nothing says."""
    if codec.controls is None:
        return [f"control_{number}" for number in range(count)]
    return list(codec.controls.names)


def number_names(representation: object) -> tuple[str, ...]:
    """What the numbers of a joint are called in a representation, or in a part of one."""
    if isinstance(representation, Joined):
        return (*number_names(representation.rotations), *number_names(representation.extra))
    if isinstance(representation, Euler):
        return tuple(f"angle_{axis}" for axis in representation.order)
    return _NUMBERS[type(representation)]


def _initial_state(network: StepNetwork) -> list[dict[str, Any]]:
    """Shape and values of every state before the first frame, for one character."""
    names = [name for name in network.names.inputs if name.startswith("state_")]
    described: list[dict[str, Any]] = []
    for name, part in zip(names, network.initial_state(1), strict=True):
        values = None
        if part.any():
            # Nine digits tell numbers of single precision apart.
            values = [float(f"{value:.9g}") for value in part[0].flatten().tolist()]
        described.append({"name": name, "shape": list(part.shape[1:]), "values": values})
    return described
