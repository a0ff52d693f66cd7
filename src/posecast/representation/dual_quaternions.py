"""Root-relative dual quaternions: where a joint is and how it is turned, in eight numbers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal, get_args

import torch
from jaxtyping import Float
from torch import Tensor

from posecast.errors import ConfigError
from posecast.geometry import dual_quaternion, quaternion
from posecast.representation.base import Content
from posecast.skeleton import Skeleton
from posecast.skeleton.dual_kinematics import from_parents, local_to_root_dual
from posecast.skeleton.kinematics import root_to_local

Duals = Float[Tensor, "*batch joints 8"]
Axes = Literal["floor", "body"]


@dataclass(frozen=True)
class DualQuaternion:
    """Unit dual quaternions of joints relative to the root (Andreou et al. 2022, section 4).

    Real part (w, x, y, z), then dual part = 1/2 (0, t) real with the translation t, metres. The
    tree is in the numbers: an error of one joint is not handed down to those below it. Signs
    are products of those of local rotations, so that all joints change sign with the root alone:
    were each joint's real part made positive for itself, a body that faces away would have as many
    forms as its joints have signs.

    Args:
        skeleton: whose joints.
        axes: ``floor``: the root's own rotation is part of the chain, as published, so that all
            numbers of a body that turns around change; ``body``: only the root's own numbers do,
            those of the joints below are as seen from it.

    Raises:
        ConfigError: unknown axes.
    """

    skeleton: Skeleton
    axes: Axes = "floor"
    states: ClassVar[frozenset[Content]] = frozenset(
        {"rotations", "signs", "translations", "positions", "constraint"}
    )

    def __post_init__(self) -> None:
        if self.axes not in get_args(Axes):
            raise ConfigError(f"axes: {self.axes!r} is not known; choose 'floor' or 'body'")

    @property
    def joint_dim(self) -> int:
        """Numbers a joint."""
        return 8

    def encode(
        self,
        rotations: Float[Tensor, "*batch joints 4"],
        offsets: Float[Tensor, "*#batch joints 3"],
    ) -> Duals:
        """Products of local dual quaternions down the tree; a root's translation is its offset."""
        if self.axes == "floor":
            return local_to_root_dual(self.skeleton, rotations, offsets)
        below = local_to_root_dual(self.skeleton, self._still_roots(rotations), offsets)
        own = dual_quaternion.from_rotation_translation(rotations, offsets)
        return torch.where(self._is_root(below), own, below)

    def decode(
        self, features: Duals, offsets: Float[Tensor, "*#batch joints 3"]
    ) -> Float[Tensor, "*batch joints 4"]:
        """Local rotations: the conjugate of the parent's real part times one's own, unit."""
        real = quaternion.normalize(features[..., :4])
        local = root_to_local(self.skeleton, self._chain(real))
        return local if self.axes == "floor" else torch.where(self._is_root(real), real, local)

    def translations(
        self, features: Duals, offsets: Float[Tensor, "*#batch joints 3"]
    ) -> Float[Tensor, "*batch joints 3"]:
        """Where joints are from their parents, as the parents are turned: bones may stretch."""
        unit = dual_quaternion.normalize(features)
        chain = self._chain(unit[..., :4])
        return from_parents(self.skeleton, chain, dual_quaternion.translation(unit))

    def positions(self, features: Duals) -> Float[Tensor, "*batch joints 3"]:
        """Translations of the features themselves; no forward kinematics."""
        unit = dual_quaternion.normalize(features)
        found = dual_quaternion.translation(unit)
        if self.axes == "floor":
            return found
        roots = torch.tensor(self._root_of, device=features.device)
        at, turn = found.index_select(-2, roots), unit[..., :4].index_select(-2, roots)
        return at + quaternion.rotate(turn, found - at)

    def continuous(
        self, features: Float[Tensor, "batch frames joints 8"]
    ) -> Float[Tensor, "batch frames joints 8"]:
        """Real parts continuous in time; all eight numbers change sign together."""
        return dual_quaternion.unroll(features, dim=1)

    def identity(self, like: Duals) -> Duals:
        """The motion that moves nothing, in the shape of ``like``."""
        return dual_quaternion.identity(*like.shape[:-1], like=like)

    def compose(self, delta: Duals, base: Duals) -> Duals:
        """Left product ``delta base``: a turn and a shift seen from the root."""
        return dual_quaternion.product(delta, base)

    def project(self, features: Duals) -> Duals:
        """Full normalization, both steps (eq. 13); a zero real part becomes no turn."""
        return dual_quaternion.normalize(features)

    def penalty(self, raw: Duals) -> Float[Tensor, ""]:
        """Mean of (|real|^2 - 1)^2 + <real, dual>^2 (eq. 16, without its weight)."""
        real, dual = raw[..., :4], raw[..., 4:]
        unit = (real.square().sum(-1) - 1).square()
        return (unit + (real * dual).sum(-1).square()).mean()

    @property
    def _root_of(self) -> list[int]:
        """The root above each joint."""
        found: list[int] = []
        for joint, parent in enumerate(self.skeleton.parents):
            found.append(joint if parent == -1 else found[parent])
        return found

    def _is_root(self, like: Tensor) -> Tensor:
        """(joints, 1): which joints are roots."""
        parents = torch.tensor(self.skeleton.parents, device=like.device)
        return (parents == -1)[:, None]

    def _still_roots(self, rotations: Tensor) -> Tensor:
        """The rotations, with those of roots set to the identity."""
        still = quaternion.identity(like=rotations)
        return torch.where(self._is_root(rotations), still, rotations)

    def _chain(self, real: Tensor) -> Tensor:
        """The rotations that joints are seen from, root-relative."""
        return real if self.axes == "floor" else self._still_roots(real)
