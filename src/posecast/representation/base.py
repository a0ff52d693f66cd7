"""What every representation of a pose provides, so that any network works on any of them."""

from __future__ import annotations

from typing import Literal, Protocol, runtime_checkable

from jaxtyping import Float
from torch import Tensor

Content = Literal["rotations", "signs", "translations", "positions", "constraint"]
"""What features may state of a joint, see ``Representation.states``."""


@runtime_checkable
class Representation(Protocol):
    """A way to write a pose as ``joint_dim`` numbers a joint.

    Laws, tested for every member of the table: ``decode(encode(x))`` is ``x`` as a rotation, or,
    where features state no rotations, puts every joint where it was; ``project`` changes nothing
    twice; ``compose(identity(x), x)`` is ``x``.

    ``offsets`` are the translations of the joints from their parents in the rest pose, metres,
    broadcast against the batch axes of the rotations. A representation that has no use for them
    takes and ignores them, so that all are called alike.
    """

    @property
    def joint_dim(self) -> int:
        """Numbers a joint."""
        ...

    @property
    def states(self) -> frozenset[Content]:
        """What the features say, and so which losses can be taken of them.

        ``rotations``: how joints are turned; ``signs``: which of ``q`` and ``-q``, too;
        ``translations``: where joints are from their parents, so that bones may stretch;
        ``positions``: where joints are from the root, without forward kinematics;
        ``constraint``: not all numbers are valid, see ``penalty``.
        """
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
        """Local rotations of features; fitted to them where they state none."""
        ...

    def translations(
        self,
        features: Float[Tensor, "*batch joints joint_dim"],
        offsets: Float[Tensor, "*#batch joints 3"],
    ) -> Float[Tensor, "*batch joints 3"] | None:
        """Translation of each joint from its parent, metres; ``None``: ``offsets``, bones rigid.

        With the rotations of ``decode`` they put every joint where the features say.
        """
        ...

    def positions(
        self, features: Float[Tensor, "*batch joints joint_dim"]
    ) -> Float[Tensor, "*batch joints 3"] | None:
        """Positions from the root, metres, as features state them; ``None``: they do not."""
        ...

    def continuous(
        self, features: Float[Tensor, "batch frames joints joint_dim"]
    ) -> Float[Tensor, "batch frames joints joint_dim"]:
        """The same poses, signs chosen so that each frame is near the one before; the first stays.

        What is encoded has signs that are continuous already; only products of it may not have.
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
