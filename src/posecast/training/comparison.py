"""A training rollout beside the truth: what every loss may look at."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from jaxtyping import Float
from torch import Tensor, nn

from posecast.representation.codec import Codec
from posecast.skeleton.kinematics import joint_positions


@dataclass(frozen=True, eq=False)
class Comparison:
    """A training rollout beside the truth: what every term may look at.

    Args:
        codec: how motion was written as features.
        predicted: features, projected to valid ones.
        raw: what the network put out for the joints, before residual and projection.
        emitted: features before they were projected, residual included.
        target: features of the true frames, their signs continuous with the prefix.
        last: features of the last frame given, which the first of ``target`` follows.
        offsets: the body of each window, those joints that the codec writes; metres.
        scale: what features are divided by where they are standardized; ``None``: by nothing.
        order: Euler order of the terms that measure angles.
    """

    codec: Codec
    predicted: Float[Tensor, "batch frames features"]
    raw: Float[Tensor, "batch frames joints joint_dim"]
    emitted: Float[Tensor, "batch frames features"]
    target: Float[Tensor, "batch frames features"]
    last: Float[Tensor, "batch features"]
    offsets: Float[Tensor, "batch joints 3"]
    scale: Float[Tensor, " features"] | None = None
    order: str = "zyx"

    @cached_property
    def predicted_rotations(self) -> Float[Tensor, "batch frames joints 4"]:
        """Local rotations of the prediction."""
        return self._rotations(self.predicted)

    @cached_property
    def target_rotations(self) -> Float[Tensor, "batch frames joints 4"]:
        """Local rotations of the truth."""
        return self._rotations(self.target)

    @cached_property
    def predicted_positions(self) -> Float[Tensor, "batch frames joints 3"]:
        """Positions from the root that the prediction states, or that follow from it, metres.

        Along a path they are from the floor below the root (Pavllo et al. 2020, section 3.7).
        """
        return self._positions(self.predicted)

    @cached_property
    def target_positions(self) -> Float[Tensor, "batch frames joints 3"]:
        """Positions from the root of the truth, metres."""
        return self._positions(self.target)

    @cached_property
    def last_positions(self) -> Float[Tensor, "batch 1 joints 3"]:
        """Positions from the root in the last frame given, metres."""
        return self._positions(self.last[:, None])

    @cached_property
    def predicted_translations(self) -> Float[Tensor, "batch frames joints 3"]:
        """Translations of joints from their parents that the prediction states, metres."""
        return self._translations(self.predicted)

    @cached_property
    def target_translations(self) -> Float[Tensor, "batch frames joints 3"]:
        """Translations of joints from their parents of the truth, metres."""
        return self._translations(self.target)

    def on_true_body(
        self, rotations: Float[Tensor, "batch frames joints 4"]
    ) -> Float[Tensor, "batch frames joints 3"]:
        """Positions from the root, by forward kinematics on the window's own body, metres."""
        return joint_positions(self.codec.written, rotations, self.offsets[:, None], None)

    def _rotations(self, features: Tensor) -> Tensor:
        joints = self.codec.split(features).joints
        return self.codec.representation.decode(joints, self.offsets[:, None])

    def _translations(self, features: Tensor) -> Tensor:
        joints, bodies = self.codec.split(features).joints, self.offsets[:, None]
        moved = self.codec.representation.translations(joints, bodies)
        return bodies.expand(*joints.shape[:-1], 3) if moved is None else moved

    def _positions(self, features: Tensor) -> Tensor:
        """Positions from the root; its height is theirs where it is predicted without the rest."""
        found = self._from_root(features)
        if not self.codec.follows_path:
            return found
        height = self.codec.split(features).root[..., 1]
        return found + nn.functional.pad(height[..., None, None], (1, 1))

    def _from_root(self, features: Tensor) -> Tensor:
        joints = self.codec.split(features).joints
        stated = self.codec.representation.positions(joints)
        if stated is not None:
            return stated
        rotations = self._rotations(features)
        if "translations" not in self.codec.representation.states:
            return self.on_true_body(rotations)
        bones = self._translations(features)
        return joint_positions(self.codec.written, rotations, bones, None)
