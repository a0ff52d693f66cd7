"""Representations of a joint's local rotation, one small class each."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import torch
from jaxtyping import Float
from torch import Tensor

from posecast.errors import ConfigError
from posecast.geometry import conversions, quaternion
from posecast.geometry.euler import ORDERS, euler_to_quaternion, quaternion_to_euler
from posecast.representation.base import Content

Features = Float[Tensor, "*batch joints joint_dim"]
Rotations = Float[Tensor, "*batch joints 4"]
Bodies = Float[Tensor, "*#batch joints 3"]


class _Rigid:
    """What representations of rotations alone have in common: bones are as long as the body's."""

    states: ClassVar[frozenset[Content]] = frozenset({"rotations"})

    def translations(self, features: Features, offsets: Bodies) -> None:
        """None: bones are rigid."""

    def positions(self, features: Features) -> None:
        """None: they follow from forward kinematics."""

    def continuous(self, features: Features) -> Features:
        """The features as they are."""
        return features


@dataclass(frozen=True)
class Quaternion(_Rigid):
    """Local rotations as unit quaternions (w, x, y, z), signs as they come (Pavllo et al. 2018)."""

    states: ClassVar[frozenset[Content]] = frozenset({"rotations", "signs", "constraint"})

    @property
    def joint_dim(self) -> int:
        """Numbers a joint."""
        return 4

    def encode(self, rotations: Rotations, offsets: Bodies) -> Rotations:
        """The rotations themselves."""
        return rotations

    def decode(self, features: Rotations, offsets: Bodies) -> Rotations:
        """The rotations, scaled to unit length."""
        return quaternion.normalize(features)

    def identity(self, like: Rotations) -> Rotations:
        """The rotation that turns nothing, in the shape of ``like``."""
        return quaternion.identity(*like.shape[:-1], like=like)

    def compose(self, delta: Rotations, base: Rotations) -> Rotations:
        """Left product ``delta base``: a turn seen from the parent.

        ``delta`` is not scaled to unit length first; ``project`` follows (Pavllo et al. 2018,
        section 3.1, as in their code).
        """
        return quaternion.product(delta, base)

    def project(self, features: Rotations) -> Rotations:
        """Scale to unit length; a zero output becomes the identity."""
        return quaternion.normalize(features)

    def penalty(self, raw: Rotations) -> Float[Tensor, ""]:
        """Mean of (w^2 + x^2 + y^2 + z^2 - 1)^2 (Pavllo et al. 2018, eq. 1, without its weight)."""
        return (raw.square().sum(-1) - 1).square().mean()


class _Unbounded(_Rigid):
    """Features of which every value is valid."""

    def project(self, features: Features) -> Features:
        """The features as they are: all are valid."""
        return features

    def penalty(self, raw: Features) -> Float[Tensor, ""]:
        """Zero: all features are valid."""
        return raw.new_zeros(())


@dataclass(frozen=True)
class AxisAngle(_Unbounded):
    """Local rotations as rotation vectors: axis times angle, radians, at most pi as encoded.

    A joint that turns past pi jumps to the opposite vector, as this representation does.
    """

    @property
    def joint_dim(self) -> int:
        """Numbers a joint."""
        return 3

    def encode(self, rotations: Rotations, offsets: Bodies) -> Features:
        """Rotation vectors; see ``quaternion.log``."""
        return quaternion.log(rotations)

    def decode(self, features: Features, offsets: Bodies) -> Rotations:
        """Unit quaternions of rotation vectors of any length."""
        return quaternion.exp(features)

    def identity(self, like: Features) -> Features:
        """Zeros: no turn."""
        return torch.zeros_like(like)

    def compose(self, delta: Features, base: Features) -> Features:
        """The vector of the turn ``base``, then ``delta`` as seen from the parent."""
        return quaternion.log(quaternion.product(quaternion.exp(delta), quaternion.exp(base)))


@dataclass(frozen=True)
class Euler(_Unbounded):
    """Local rotations as three Euler angles, radians, intrinsic.

    Angles jump by a full turn at +-pi and near gimbal lock, as this representation does. They
    have no group product of their own: a residual adds angles.

    Args:
        order: one of ``geometry.ORDERS``.

    Raises:
        ConfigError: the order is unknown.
    """

    order: str = "zyx"

    def __post_init__(self) -> None:
        if self.order not in ORDERS:
            raise ConfigError(f"order {self.order!r} is unknown; choose among {', '.join(ORDERS)}")

    @property
    def joint_dim(self) -> int:
        """Numbers a joint."""
        return 3

    def encode(self, rotations: Rotations, offsets: Bodies) -> Features:
        """Angles in the sequence of the order."""
        return quaternion_to_euler(rotations, self.order)

    def decode(self, features: Features, offsets: Bodies) -> Rotations:
        """Unit quaternions of any angles."""
        return euler_to_quaternion(features, self.order)

    def identity(self, like: Features) -> Features:
        """Zeros: no change of any angle."""
        return torch.zeros_like(like)

    def compose(self, delta: Features, base: Features) -> Features:
        """The sum of the angles."""
        return base + delta


@dataclass(frozen=True)
class Ortho6d(_Rigid):
    """Local rotations as the first two columns of their matrices (Zhou et al. 2019)."""

    states: ClassVar[frozenset[Content]] = frozenset({"rotations", "constraint"})

    @property
    def joint_dim(self) -> int:
        """Numbers a joint."""
        return 6

    def encode(self, rotations: Rotations, offsets: Bodies) -> Features:
        """First column, then second."""
        return conversions.quaternion_to_ortho6d(rotations)

    def decode(self, features: Features, offsets: Bodies) -> Rotations:
        """Gram-Schmidt, then unit quaternions with w >= 0."""
        return conversions.ortho6d_to_quaternion(features)

    def identity(self, like: Features) -> Features:
        """The first two columns of the identity matrix."""
        columns = like.new_tensor([1.0, 0.0, 0.0, 0.0, 1.0, 0.0])
        return columns.expand_as(like).clone()

    def compose(self, delta: Features, base: Features) -> Features:
        """``base`` turned by the rotation of ``delta``, as seen from the parent."""
        turned = conversions.ortho6d_to_matrix(delta) @ base.unflatten(-1, (2, 3)).mT
        return turned.mT.flatten(-2)

    def project(self, features: Features) -> Features:
        """Gram-Schmidt; edges as in ``geometry.ortho6d_to_matrix``."""
        return conversions.matrix_to_ortho6d(conversions.ortho6d_to_matrix(features))

    def penalty(self, raw: Features) -> Float[Tensor, ""]:
        """Mean squared deviation of A^T A from the identity, A the two columns."""
        return _off_orthonormal(raw.unflatten(-1, (2, 3)).mT)


@dataclass(frozen=True)
class Matrix(_Rigid):
    """Local rotations as matrices, row by row."""

    states: ClassVar[frozenset[Content]] = frozenset({"rotations", "constraint"})

    @property
    def joint_dim(self) -> int:
        """Numbers a joint."""
        return 9

    def encode(self, rotations: Rotations, offsets: Bodies) -> Features:
        """First row, second row, third row."""
        return conversions.quaternion_to_matrix(rotations).flatten(-2)

    def decode(self, features: Features, offsets: Bodies) -> Rotations:
        """Unit quaternions, w >= 0, of matrices that are rotations, as ``project`` makes them."""
        return conversions.matrix_to_quaternion(features.unflatten(-1, (3, 3)))

    def identity(self, like: Features) -> Features:
        """The identity matrix."""
        eye = torch.eye(3, dtype=like.dtype, device=like.device).flatten()
        return eye.expand_as(like).clone()

    def compose(self, delta: Features, base: Features) -> Features:
        """Matrix product ``delta base``; ``delta`` is made a rotation by ``project`` only."""
        turned = delta.unflatten(-1, (3, 3)) @ base.unflatten(-1, (3, 3))
        return turned.flatten(-2)

    def project(self, features: Features) -> Features:
        """The nearest rotation, see ``geometry.nearest_rotation``."""
        return conversions.nearest_rotation(features.unflatten(-1, (3, 3))).flatten(-2)

    def penalty(self, raw: Features) -> Float[Tensor, ""]:
        """Mean squared deviation of R^T R from the identity; reflections go unseen."""
        return _off_orthonormal(raw.unflatten(-1, (3, 3)))


def _off_orthonormal(columns: Float[Tensor, "*batch 3 columns"]) -> Float[Tensor, ""]:
    """Mean over everything but the last two axes of |A^T A - 1|^2 (Frobenius)."""
    eye = torch.eye(columns.shape[-1], dtype=columns.dtype, device=columns.device)
    return (columns.mT @ columns - eye).square().sum((-2, -1)).mean()
