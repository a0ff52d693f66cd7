"""What every representation of a pose provides, so that any network works on any of them."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from jaxtyping import Float
from torch import Tensor


@runtime_checkable
class Representation(Protocol):
    """A way to write the rotations of a pose as ``joint_dim`` numbers a joint.

    Laws, tested for every member of the table: ``decode(encode(x))`` is ``x`` as a rotation;
    ``project`` changes nothing twice; ``compose(identity(x), x)`` is ``x``.

    ``offsets`` are the translations of the joints from their parents in the rest pose, metres,
    broadcast against the batch axes of the rotations. A representation that has no use for them
    takes and ignores them, so that all are called alike.
    """

    @property
    def joint_dim(self) -> int:
        """Numbers a joint."""
        ...

    def encode(
        self,
        rotations: Float[Tensor, "*batch joints 4"],
        offsets: Float[Tensor, "*#batch joints 3"],
    ) -> Float[Tensor, "*batch joints joint_dim"]:
        """Features of local rotations (unit quaternions w, x, y, z)."""
        ...

    def decode(
        self,
        features: Float[Tensor, "*batch joints joint_dim"],
        offsets: Float[Tensor, "*#batch joints 3"],
    ) -> Float[Tensor, "*batch joints 4"]:
        """Local rotations of features.

        Raises:
            ConfigError: the representation has no rotations.
        """
        ...

    def identity(
        self, like: Float[Tensor, "*batch joints joint_dim"]
    ) -> Float[Tensor, "*batch joints joint_dim"]:
        """The change that changes nothing, in the shape of ``like``; ``compose`` leaves it out."""
        ...

    def compose(
        self,
        delta: Float[Tensor, "*batch joints joint_dim"],
        base: Float[Tensor, "*batch joints joint_dim"],
    ) -> Float[Tensor, "*batch joints joint_dim"]:
        """Apply a change to a pose: the group product, or the sum where there is none."""
        ...

    def project(
        self, features: Float[Tensor, "*batch joints joint_dim"]
    ) -> Float[Tensor, "*batch joints joint_dim"]:
        """The valid features nearest to what a network put out."""
        ...

    def penalty(self, raw: Float[Tensor, "*batch joints joint_dim"]) -> Float[Tensor, ""]:
        """How far raw network outputs are from valid ones; zero where every output is valid."""
        ...
