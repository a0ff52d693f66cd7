"""Losses: one function a term, each the mean over batch and frames, and their weighted sum.

Every function is differentiable wherever it is evaluated, gimbal lock included, and none takes a
number out of its graph.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from posecast.config import did_you_mean
from posecast.errors import ConfigError
from posecast.geometry.euler import ORDERS, quaternion_to_euler
from posecast.representation.codec import Codec
from posecast.skeleton import Skeleton
from posecast.skeleton.kinematics import joint_positions

ASIN_MARGIN = 1e-6  # keeps the slope of asin finite at gimbal lock, as in QuaterNet's training


def euler_l1(
    predicted: Float[Tensor, "*batch joints 4"],
    target: Float[Tensor, "*batch joints 4"],
    *,
    order: str = "zyx",
) -> Float[Tensor, ""]:
    """Mean absolute difference of Euler angles, radians, the short way round the circle.

    Over all angles of all joints, the root's and those of motionless joints included. Does not
    change with the sign of a quaternion.

    Args:
        predicted: unit quaternions.
        target: unit quaternions; gradients do not flow into them.
        order: of the three intrinsic rotations.

    Source: Pavllo et al. 2018, section 3.4.
    """
    angles = quaternion_to_euler(predicted, order=order, margin=ASIN_MARGIN)
    true_angles = quaternion_to_euler(target.detach(), order=order, margin=ASIN_MARGIN)
    difference = torch.remainder(angles - true_angles + math.pi, 2 * math.pi) - math.pi
    return difference.abs().mean()


def quaternion_dot(
    predicted: Float[Tensor, "*batch joints 4"], target: Float[Tensor, "*batch joints 4"]
) -> Float[Tensor, ""]:
    """Mean of 1 - <p, q>: zero for equal quaternions, 2 for opposite ones.

    Depends on signs, as published: prediction and target must lie on one hemisphere.

    Source: Pavllo et al. 2019 (IJCV), section 4.1, the variant trained with teacher forcing only.
    """
    return (1 - (predicted * target).sum(-1)).mean()


def position(
    predicted: Float[Tensor, "*batch joints 4"],
    target: Float[Tensor, "*batch joints 4"],
    *,
    skeleton: Skeleton,
    offsets: Float[Tensor, "*#batch joints 3"],
) -> Float[Tensor, ""]:
    """Mean distance of joints, metres, after forward kinematics on one body held at the origin.

    Does not change with the sign of a quaternion, nor when both motions are turned together.

    Source: Pavllo et al. 2018, section 3.5, without the height and displacement of the root.
    """
    found = joint_positions(skeleton, predicted, offsets, None)
    true = joint_positions(skeleton, target, offsets, None)
    # The norm of an exact zero, which every root has, passes on a zero gradient.
    return torch.linalg.vector_norm(found - true, dim=-1).mean()


def root_l1(
    predicted: Float[Tensor, "*batch channels"], target: Float[Tensor, "*batch channels"]
) -> Float[Tensor, ""]:
    """Mean absolute difference of root channels, metres."""
    return (predicted - target).abs().mean()


@dataclass(frozen=True, eq=False)
class Comparison:
    """A training rollout beside the truth: what every term may look at.

    Args:
        codec: how motion was written as features.
        predicted: features, projected to valid ones.
        raw: what the network put out for the joints, before residual and projection.
        target: features of the true frames, their signs continuous with the prefix.
        offsets: the body of each window, metres.
        order: Euler order of the terms that measure angles.
    """

    codec: Codec
    predicted: Float[Tensor, "batch frames features"]
    raw: Float[Tensor, "batch frames joints joint_dim"]
    target: Float[Tensor, "batch frames features"]
    offsets: Float[Tensor, "batch joints 3"]
    order: str = "zyx"

    @cached_property
    def predicted_rotations(self) -> Float[Tensor, "batch frames joints 4"]:
        """Local rotations of the prediction."""
        return self._rotations(self.predicted)

    @cached_property
    def target_rotations(self) -> Float[Tensor, "batch frames joints 4"]:
        """Local rotations of the truth."""
        return self._rotations(self.target)

    def _rotations(
        self, features: Float[Tensor, "batch frames features"]
    ) -> Float[Tensor, "batch frames joints 4"]:
        """Local rotations of features."""
        return self.codec.representation.decode(
            self.codec.split(features).joints, self.offsets[:, None]
        )


def _euler(comparison: Comparison) -> Float[Tensor, ""]:
    return euler_l1(
        comparison.predicted_rotations, comparison.target_rotations, order=comparison.order
    )


def _quaternion(comparison: Comparison) -> Float[Tensor, ""]:
    return quaternion_dot(comparison.predicted_rotations, comparison.target_rotations)


def _penalty(comparison: Comparison) -> Float[Tensor, ""]:
    return comparison.codec.representation.penalty(comparison.raw)


def _position(comparison: Comparison) -> Float[Tensor, ""]:
    return position(
        comparison.predicted_rotations,
        comparison.target_rotations,
        skeleton=comparison.codec.skeleton,
        offsets=comparison.offsets[:, None],
    )


def _root(comparison: Comparison) -> Float[Tensor, ""]:
    split = comparison.codec.split
    return root_l1(split(comparison.predicted).root, split(comparison.target).root)


LOSSES: dict[str, Callable[[Comparison], Tensor]] = {
    "euler": _euler,
    "quaternion": _quaternion,
    "penalty": _penalty,
    "position": _position,
    "root": _root,
}


class Loss(NamedTuple):
    """The value to descend, and its terms before weighting, by name."""

    total: Float[Tensor, ""]
    terms: dict[str, Tensor]


@dataclass(frozen=True)
class Objective:
    """A weighted sum of terms.

    Args:
        terms: weight of each term of ``LOSSES``; QuaterNet's are the default.
        order: Euler order of the terms that measure angles.

    Raises:
        ConfigError: no term, an unknown one, or a weight that is not positive.
    """

    terms: Mapping[str, float]
    order: str = "zyx"

    def __post_init__(self) -> None:
        if not self.terms:
            raise ConfigError(f"an objective needs a term; known: {', '.join(LOSSES)}")
        for name, weight in self.terms.items():
            if name not in LOSSES:
                raise ConfigError(f"unknown loss {name!r}; {did_you_mean(name, LOSSES)}")
            if not weight > 0:
                raise ConfigError(f"loss {name!r} has weight {weight}; expected more than 0")
        if self.order not in ORDERS:
            raise ConfigError(
                f"order {self.order!r} is unknown; {did_you_mean(self.order, ORDERS)}"
            )

    def check(self, codec: Codec) -> None:
        """Refuse a codec that these terms do not fit, before any training.

        Raises:
            ConfigError: root channels without a loss, or a loss without root channels.
        """
        channels = codec.root_dim
        if channels and "root" not in self.terms:
            raise ConfigError(
                f"the codec writes {channels} root channels that no loss trains; "
                "add root: 1.0 to the loss, or write no root channels"
            )
        if not channels and "root" in self.terms:
            raise ConfigError(
                "loss 'root' needs root channels, but the codec writes none; "
                "set its root to displacement, or leave the loss out"
            )

    def __call__(self, comparison: Comparison) -> Loss:
        """All terms and their weighted sum."""
        terms = {name: LOSSES[name](comparison) for name in self.terms}
        weighted = [weight * terms[name] for name, weight in self.terms.items()]
        return Loss(torch.stack(weighted).sum(), terms)
