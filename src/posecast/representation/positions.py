"""Representations that say where joints are: from the root, or from their parents."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import torch
from jaxtyping import Float
from torch import Tensor

from posecast.representation.base import Content
from posecast.skeleton import Skeleton
from posecast.skeleton.dual_kinematics import from_parents
from posecast.skeleton.kinematics import joint_positions, local_to_root
from posecast.skeleton.rotation_fit import fit_rotations

Vectors = Float[Tensor, "*batch joints 3"]


class _Translations:
    """What positions and offsets have in common: they are vectors, add up, and are all valid."""

    @property
    def joint_dim(self) -> int:
        """Numbers a joint."""
        return 3

    def continuous(self, features: Vectors) -> Vectors:
        """The features as they are."""
        return features

    def identity(self, like: Vectors) -> Vectors:
        """Zeros: no change."""
        return torch.zeros_like(like)

    def compose(self, delta: Vectors, base: Vectors) -> Vectors:
        """The sum."""
        return base + delta

    def project(self, features: Vectors) -> Vectors:
        """The features as they are: all are valid."""
        return features

    def penalty(self, raw: Vectors) -> Float[Tensor, ""]:
        """Zero: all features are valid."""
        return raw.new_zeros(())


@dataclass(frozen=True)
class Positions(_Translations):
    """Positions of the joints from the root, metres, the root's turn kept in them.

    They state no rotations. ``decode`` fits some, see ``skeleton.rotation_fit``: the twist of a
    bone about itself cannot be seen and is inferred, and end joints are not turned at all.

    Args:
        skeleton: whose joints.
    """

    skeleton: Skeleton
    states: ClassVar[frozenset[Content]] = frozenset({"positions", "translations"})

    def encode(
        self,
        rotations: Float[Tensor, "*batch joints 4"],
        offsets: Float[Tensor, "*#batch joints 3"],
    ) -> Vectors:
        """Forward kinematics with the first root at the origin."""
        found = joint_positions(self.skeleton, rotations, offsets, None)
        return found - found[..., :1, :]

    def decode(
        self, features: Vectors, offsets: Float[Tensor, "*#batch joints 3"]
    ) -> Float[Tensor, "*batch joints 4"]:
        """Rotations fitted to the positions; the twist is inferred."""
        return fit_rotations(self.skeleton, features, offsets)

    def translations(
        self, features: Vectors, offsets: Float[Tensor, "*#batch joints 3"]
    ) -> Vectors:
        """Where joints are from their parents, as the fitted rotations turn these."""
        return local_translations(self.skeleton, self.decode(features, offsets), features)

    def positions(self, features: Vectors) -> Vectors:
        """The features themselves."""
        return features


@dataclass(frozen=True)
class Offsets(_Translations):
    """Translations of joints from their parents, metres: the second half of a ``Joined``."""

    states: ClassVar[frozenset[Content]] = frozenset({"translations"})

    def encode(
        self,
        rotations: Float[Tensor, "*batch joints 4"],
        offsets: Float[Tensor, "*#batch joints 3"],
    ) -> Vectors:
        """The body, the same in every frame."""
        return offsets.expand(*rotations.shape[:-1], 3)

    def translations(
        self, features: Vectors, offsets: Float[Tensor, "*#batch joints 3"]
    ) -> Vectors:
        """The features themselves."""
        return features

    def positions(self, features: Vectors) -> None:
        """None: they take rotations, too."""


def local_translations(
    skeleton: Skeleton,
    rotations_local: Float[Tensor, "*batch joints 4"],
    positions_root: Vectors,
) -> Vectors:
    """Translations that, with these rotations, put every joint where the positions say."""
    return from_parents(skeleton, local_to_root(skeleton, rotations_local), positions_root)
