"""Two representations side by side: rotations, and where joints are."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from posecast.representation.base import Content, Representation
from posecast.representation.positions import Offsets, Positions, local_translations
from posecast.skeleton import Skeleton

Features = Float[Tensor, "*batch joints joint_dim"]


@dataclass(frozen=True)
class Joined:
    """The numbers of one representation of rotations, then three of positions or offsets, a joint.

    Rotations come from the first part alone. With ``offsets`` the second part is the body, which
    the network reads and puts out, so that one network serves many bodies (Andreou et al. 2022,
    section 7.3); with ``positions`` it is redundant and steadies the first (section 7.1).

    Args:
        rotations: how joints are turned; rotations only.
        extra: where they are.
        skeleton: whose joints.
    """

    rotations: Representation
    extra: Positions | Offsets
    skeleton: Skeleton

    @property
    def joint_dim(self) -> int:
        """Numbers a joint."""
        return self.rotations.joint_dim + self.extra.joint_dim

    @property
    def states(self) -> frozenset[Content]:
        """What either part states."""
        return self.rotations.states | self.extra.states

    def encode(
        self,
        rotations: Float[Tensor, "*batch joints 4"],
        offsets: Float[Tensor, "*#batch joints 3"],
    ) -> Features:
        """Both parts."""
        return torch.cat([part.encode(rotations, offsets) for part in self._parts], dim=-1)

    def decode(
        self, features: Features, offsets: Float[Tensor, "*#batch joints 3"]
    ) -> Float[Tensor, "*batch joints 4"]:
        """Rotations of the first part."""
        return self.rotations.decode(self._split(features)[0], offsets)

    def translations(
        self, features: Features, offsets: Float[Tensor, "*#batch joints 3"]
    ) -> Float[Tensor, "*batch joints 3"]:
        """Where the second part puts joints from their parents, as the first part turns these."""
        turns, places = self._split(features)
        if isinstance(self.extra, Offsets):
            return places
        return local_translations(self.skeleton, self.rotations.decode(turns, offsets), places)

    def positions(self, features: Features) -> Float[Tensor, "*batch joints 3"] | None:
        """What the second part states of positions."""
        return self.extra.positions(self._split(features)[1])

    def continuous(self, features: Features) -> Features:
        """Each part made continuous."""
        return self._each("continuous", features)

    def identity(self, like: Features) -> Features:
        """The identities of both parts."""
        return self._each("identity", like)

    def compose(self, delta: Features, base: Features) -> Features:
        """Each part composed with its own."""
        return self._each("compose", delta, base)

    def project(self, features: Features) -> Features:
        """Each part projected."""
        return self._each("project", features)

    def penalty(self, raw: Features) -> Float[Tensor, ""]:
        """That of the rotations."""
        return self.rotations.penalty(self._split(raw)[0])

    @property
    def _parts(self) -> tuple[Any, Any]:
        return self.rotations, self.extra

    def _split(self, features: Features) -> tuple[Tensor, Tensor]:
        turns, places = features.split([self.rotations.joint_dim, self.extra.joint_dim], dim=-1)
        return turns, places

    def _each(self, method: str, *arguments: Features) -> Features:
        """The same method of both parts, on their shares of the arguments."""
        shares = zip(*(self._split(argument) for argument in arguments), strict=True)
        done = [
            getattr(part, method)(*share) for part, share in zip(self._parts, shares, strict=True)
        ]
        return torch.cat(done, dim=-1)
