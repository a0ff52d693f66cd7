"""Where a body faces on the floor: across hips and shoulders, or from its root's Euler angles."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from posecast.geometry.euler import quaternion_to_euler
from posecast.motion.feet import Feet
from posecast.motion.proportions import body_parts
from posecast.skeleton import Skeleton

_FLAT = 0.1
"""Least share of the widths of hips and shoulders that is seen from above, to face anywhere."""


def body_heading(
    skeleton: Skeleton, positions: Float[Tensor, "frames joints 3"], feet: Feet
) -> Float[Tensor, "frames"]:
    """Where the body faces: at a right angle to hips and shoulders, both counting alike.

    Bending over, lying on the back or a somersault does not change it. Where left lies above right
    or below, as on the side, it is interpolated, and it is 0 if it always does; upside down in a
    cartwheel it is turned by half a turn.

    Args:
        positions: in the world, metres.
        feet: whose hips are meant. Shoulders are found by name, or do without.

    Returns:
        Radians from +z towards +x, continuous: full turns add up.
    """
    across = torch.zeros(len(positions), 3, dtype=torch.float64)
    pairs = [feet.hips, *_shoulders(skeleton)]
    for left, right in pairs:
        across += torch.nn.functional.normalize(
            (positions[:, left] - positions[:, right]).double(), dim=-1
        )
    # Forward of a left (x, z) is (-z, x), and the angle of a direction (x, z) is atan2(x, z).
    heading = torch.atan2(-across[:, 2], across[:, 0]).numpy()
    known = across[:, [0, 2]].norm(dim=-1).numpy() > _FLAT * len(pairs)
    if not known.any():
        return torch.zeros(len(positions), dtype=torch.float64)
    frames = np.arange(len(positions))
    return torch.from_numpy(np.interp(frames, frames[known], np.unwrap(heading[known])))


def _shoulders(skeleton: Skeleton) -> list[tuple[int, int]]:
    """Where the upper arms begin, left and right; nothing where elbows have no names."""
    above = set(body_parts(skeleton)["shoulders"])
    return [
        pair
        for pair in skeleton.left_right_pairs
        if pair[0] in above and not above & set(skeleton.children[pair[0]])
    ]


def root_heading(rotations: Float[Tensor, "frames 4"]) -> Float[Tensor, "frames"]:
    """Where the root faces, as published: the y angle of its Euler angles of order y-z-x.

    For skeletons that face +z where the root's rotation is the identity: it is at a right angle to
    the root's x axis. It jumps by half a turn where the root rolls past lying on its side.

    Args:
        rotations: of the root in the world.

    Returns:
        Radians from +z towards +x, continuous: full turns add up.

    Source: the code of Pavllo et al. 2020.
    """
    heading = quaternion_to_euler(rotations.double(), "yzx")[..., 0]
    return torch.from_numpy(np.unwrap(heading.numpy()))
