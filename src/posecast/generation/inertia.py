"""Inertialization: what is shown goes on smoothly where another clip begins to play."""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from posecast.geometry import quaternion

_HALF = 1.6783469900166612
"""Where (1 + y) exp(-y) is a half."""


class Posture(NamedTuple):
    """How a body stands in the world.

    Args:
        rotations_local: unit quaternions relative to the parent.
        root_position: metres.
    """

    rotations_local: Float[Tensor, "*moments joints 4"]
    root_position: Float[Tensor, "*moments 3"]


class Offset(NamedTuple):
    """What is shown less what is played, and how fast that changes.

    Args:
        value: a rotation vector for every joint, radians, in the axes of its parent, the root's in
            those of the world; the last row is that of the root's position, metres.
        velocity: the same a second.
    """

    value: Float[Tensor, "rows 3"]
    velocity: Float[Tensor, "rows 3"]

    @staticmethod
    def none(joints: int, *, like: Tensor) -> Offset:
        """Shown is what is played."""
        zero = like.new_zeros(joints + 1, 3)
        return Offset(zero, zero)

    @staticmethod
    def at_switch(shown: Posture, played: Posture, *, fps: float) -> Offset:
        """With what offset another clip has to begin.

        Args:
            shown: in the frame before and in this one, as it would go on.
            played: of the other clip, in the frame before the one it begins at and in that one.
            fps: frames per second.
        """
        before, now = difference(shown, played)
        return Offset(now, (now - before) * fps)

    def after(self, seconds: float, *, half_life: float) -> Offset:
        """What is left of it: a critically damped spring draws it to zero.

        Args:
            seconds: that pass.
            half_life: seconds in which an offset that does not move is halved.
        """
        rate = _HALF / half_life
        decay = math.exp(-rate * seconds)
        slope = self.velocity + rate * self.value
        return Offset(
            decay * (self.value + seconds * slope),
            decay * (self.velocity - rate * seconds * slope),
        )


def shifted(posture: Posture, value: Float[Tensor, "*moments rows 3"]) -> Posture:
    """A posture with an offset."""
    turns = quaternion.exp(value[..., :-1, :])
    return Posture(
        quaternion.normalize(quaternion.product(turns, posture.rotations_local)),
        posture.root_position + value[..., -1, :],
    )


def difference(shown: Posture, played: Posture) -> Float[Tensor, "*moments rows 3"]:
    """The offset with which one posture is the other: see ``Offset``."""
    turns = quaternion.product(shown.rotations_local, quaternion.conjugate(played.rotations_local))
    moved = shown.root_position - played.root_position
    return torch.cat([quaternion.log(turns), moved[..., None, :]], dim=-2)
