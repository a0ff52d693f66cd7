"""Reading what lies along a path between its points, and angles on the floor."""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from jaxtyping import Float, Int
from torch import Tensor


class Place(NamedTuple):
    """Where a path is at some arc lengths, and how it goes on there.

    Args:
        position: (x, z), metres.
        tangent: unit vector (x, z).
        curvature: 1/m, positive towards the left hand: towards +x when heading +z.
    """

    position: Float[Tensor, "*places 2"]
    tangent: Float[Tensor, "*places 2"]
    curvature: Float[Tensor, "*places"]


class Between(NamedTuple):
    """Places between neighbouring points.

    Args:
        before, after: the two points.
        fraction: of the way from the one to the other, 0 to 1.
    """

    before: Int[Tensor, "*places"]
    after: Int[Tensor, "*places"]
    fraction: Float[Tensor, "*places"]

    def number(self, values: Float[Tensor, " points"]) -> Float[Tensor, "*places"]:
        """Linear from point to point."""
        before = values[self.before]
        return before + self.fraction * (values[self.after] - before)

    def vector(self, values: Float[Tensor, "points 2"]) -> Float[Tensor, "*places 2"]:
        """Linear from point to point."""
        before = values[self.before]
        return before + self.fraction[..., None] * (values[self.after] - before)

    def angle(self, angles: Float[Tensor, " points"]) -> Float[Tensor, "*places"]:
        """Radians, the shorter way round; of two ways as long, that of falling angles."""
        before = angles[self.before]
        return before + self.fraction * wrapped(angles[self.after] - before)


def between_points(
    distance: Float[Tensor, "*places"], *, count: int, spacing: float, closed: bool
) -> Between:
    """The points around some arc lengths; beyond an open path's ends its last two or first two.

    Args:
        distance: arc lengths, metres.
        count: how many points.
        spacing: arc length from point to point, metres.
        closed: whether the first comes after the last.
    """
    place = distance / spacing
    if closed:
        before = place.floor()
        index = before.long()
        return Between(index % count, (index + 1) % count, place - before)
    place = place.clamp(0, count - 1)
    before = place.floor().clamp(max=count - 2)
    index = before.long()
    return Between(index, index + 1, place - before)


def wrapped(angle: Float[Tensor, "*any"]) -> Float[Tensor, "*any"]:
    """The same turn in radians, from -pi up to, not including, pi."""
    return torch.remainder(angle + math.pi, 2 * math.pi) - math.pi


def bearing(direction: Float[Tensor, "*any 2"]) -> Float[Tensor, "*any"]:
    """Radians from +z towards +x of vectors (x, z); 0 of the zero vector."""
    return torch.atan2(direction[..., 0], direction[..., 1])


def heading(angle: Float[Tensor, "*any"]) -> Float[Tensor, "*any 2"]:
    """Unit vectors (x, z) at some bearings, radians."""
    return torch.stack([angle.sin(), angle.cos()], dim=-1)
