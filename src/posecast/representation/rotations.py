"""Representations of a joint's local rotation, one small class each."""

from __future__ import annotations

from dataclasses import dataclass

from jaxtyping import Float
from torch import Tensor

from posecast.geometry import quaternion


@dataclass(frozen=True)
class Quaternion:
    """Local rotations as unit quaternions (w, x, y, z), signs as they come (Pavllo et al. 2018)."""

    @property
    def joint_dim(self) -> int:
        """Numbers a joint."""
        return 4

    def encode(
        self,
        rotations: Float[Tensor, "*batch joints 4"],
        offsets: Float[Tensor, "*#batch joints 3"],
    ) -> Float[Tensor, "*batch joints 4"]:
        """The rotations themselves."""
        return rotations

    def decode(
        self, features: Float[Tensor, "*batch joints 4"], offsets: Float[Tensor, "*#batch joints 3"]
    ) -> Float[Tensor, "*batch joints 4"]:
        """The rotations, scaled to unit length."""
        return quaternion.normalize(features)

    def identity(self, like: Float[Tensor, "*batch joints 4"]) -> Float[Tensor, "*batch joints 4"]:
        """The rotation that turns nothing, in the shape of ``like``."""
        return quaternion.identity(*like.shape[:-1], like=like)

    def compose(
        self, delta: Float[Tensor, "*batch joints 4"], base: Float[Tensor, "*batch joints 4"]
    ) -> Float[Tensor, "*batch joints 4"]:
        """Left product ``delta base``: a turn seen from the parent.

        ``delta`` is not scaled to unit length first; ``project`` follows (Pavllo et al. 2018,
        section 3.1, as in their code).
        """
        return quaternion.product(delta, base)

    def project(
        self, features: Float[Tensor, "*batch joints 4"]
    ) -> Float[Tensor, "*batch joints 4"]:
        """Scale to unit length; a zero output becomes the identity."""
        return quaternion.normalize(features)

    def penalty(self, raw: Float[Tensor, "*batch joints 4"]) -> Float[Tensor, ""]:
        """Mean of (w^2 + x^2 + y^2 + z^2 - 1)^2 (Pavllo et al. 2018, eq. 1, without its weight)."""
        return (raw.square().sum(-1) - 1).square().mean()
