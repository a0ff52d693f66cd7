"""What motion matching compares moments by: the path ahead, the feet, and how they move."""

from __future__ import annotations

from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from posecast.geometry import quaternion
from posecast.motion.tracks import turned_on_floor

AHEAD = (1 / 3, 2 / 3, 1.0)
"""Seconds after a moment at which its path is looked at."""

_LEAST = 1e-3
"""Deviations below this (metres, m/s, unit vectors) do not tell moments apart."""


class Features(NamedTuple):
    """Moments as the character sees them: from its place on the floor, +z where it faces.

    Args:
        path: places (x, z) that it comes to, metres.
        facing: where it then faces, unit vectors (x, z).
        feet: left and right toes, metres.
        feet_velocity: m/s.
        root_velocity: m/s.
    """

    path: Float[Tensor, "*moments ahead 2"]
    facing: Float[Tensor, "*moments ahead 2"]
    feet: Float[Tensor, "*moments feet 3"]
    feet_velocity: Float[Tensor, "*moments feet 3"]
    root_velocity: Float[Tensor, "*moments 3"]


class Weights(NamedTuple):
    """How much each group of ``Features`` counts, once all deviate alike; 0: not at all."""

    path: float = 1.0
    facing: float = 1.0
    feet: float = 1.0
    feet_velocity: float = 1.0
    root_velocity: float = 1.0


EVEN = Weights()
"""Every group counts alike."""


class Joints(NamedTuple):
    """Places of the joints that are compared, in the world, metres.

    Args:
        feet: left and right toes.
        root: the root.
    """

    feet: Float[Tensor, "*moments feet 3"]
    root: Float[Tensor, "*moments 3"]


class Ahead(NamedTuple):
    """The way that lies ahead at the moments ``AHEAD``, in the world.

    Args:
        path: places (x, z), metres.
        facing: unit vectors (x, z).
    """

    path: Float[Tensor, "*moments ahead 2"]
    facing: Float[Tensor, "*moments ahead 2"]


def seen_from(
    place: Float[Tensor, "*moments 2"],
    heading: Float[Tensor, "*moments"],
    *,
    ahead: Ahead,
    now: Joints,
    before: Joints,
    fps: float,
) -> Features:
    """Moments as seen from where the character is.

    Args:
        place: (x, z) on the floor, metres.
        heading: where it faces, radians from +z towards +x.
        ahead: its way.
        now: its joints.
        before: its joints a frame earlier.
        fps: frames per second.
    """
    up = place.new_tensor((0.0, 1.0, 0.0))
    back = quaternion.about_axis(up, -heading)
    floor = torch.stack([place[..., 0], torch.zeros_like(heading), place[..., 1]], dim=-1)
    each = back[..., None, :]
    return Features(
        path=turned_on_floor(ahead.path - place[..., None, :], -heading),
        facing=turned_on_floor(ahead.facing, -heading),
        feet=quaternion.rotate(each, now.feet - floor[..., None, :]),
        feet_velocity=quaternion.rotate(each, (now.feet - before.feet) * fps),
        root_velocity=quaternion.rotate(back, (now.root - before.root) * fps),
    )


class Scale:
    """Features as rows of numbers whose squared distance says how alike two moments are.

    Each group is divided by its own deviation: the root of its summed variances.

    Args:
        features: all moments of a database.
        weights: of the groups.
    """

    def __init__(self, features: Features, weights: Weights) -> None:
        self._factors = []
        for values, weight in zip(features, weights, strict=True):
            rows = values.reshape(len(values), -1)
            deviation = rows.var(dim=0, correction=0).sum().sqrt()
            self._factors.append(weight / max(float(deviation), _LEAST))
        self.way = sum(values[0].numel() for values in (features.path, features.facing))

    def rows(self, features: Features) -> Float[Tensor, "*moments numbers"]:
        """Numbers of some moments; the first ``way`` are those of the way ahead."""
        moments = features.root_velocity.shape[:-1]
        return torch.cat(
            [
                factor * values.reshape(*moments, -1)
                for factor, values in zip(self._factors, features, strict=True)
            ],
            dim=-1,
        )
