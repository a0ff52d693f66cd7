"""Motion to and from the features of a network: joints, root channels, statistics."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from posecast.config import did_you_mean
from posecast.errors import ConfigError, SkeletonError
from posecast.geometry import quaternion
from posecast.motion import Motion
from posecast.representation.base import Representation
from posecast.representation.controls import Controls
from posecast.representation.root_channels import (
    ROOT_CHANNELS,
    RootChannels,
    place_root,
    root_tracks,
    write_root,
)
from posecast.skeleton import Skeleton


class Parts(NamedTuple):
    """The features of frames, taken apart.

    Args:
        joints: what the representation wrote for each joint.
        root: channels of the root; none of them when the codec leaves the root out.
        action: one for each action, 1 for the one that is done; none when the codec has no actions.
    """

    joints: Float[Tensor, "*batch joints joint_dim"]
    root: Float[Tensor, "*batch root"]
    action: Float[Tensor, "*batch actions"]


class Statistics(NamedTuple):
    """How features are shifted and scaled at a network's door: ``(features - mean) / scale``.

    Args:
        mean: one value a feature.
        scale: one positive value a feature: a standard deviation, or what a paper divides by.
    """

    mean: Float[Tensor, " features"]
    scale: Float[Tensor, " features"]


@dataclass(frozen=True, eq=False)
class Codec:
    """Motion of one skeleton as features (batch, frames, features), and back.

    The features of a frame are those of all joints, one joint after the other, then the root
    channels, then one for each action; ``split`` and ``merge`` name them. Features are physical: a
    forecaster standardizes by ``statistics`` where it reads, and undoes it where it answers.

    Signs of quaternions follow one rule, in training and in use: the real part of local rotations
    is not negative in the first frame, and signs are continuous from there on. Roots that follow a
    path keep the signs they have in the first frame: who walks in circles turns through both, and
    windows turned about the vertical by up to two full turns begin with both.

    Args:
        skeleton: whose joints are written.
        representation: how each joint is written.
        root: ``none`` writes no root channels, and ``decode`` holds the root at its anchor;
            ``displacement`` writes three, in metres and in the order x, y, z: the height y, and
            x and z as differences to the frame before (Zhou et al. 2018); ``path`` writes where the
            root is seen from its place on a path: how far ahead, and the height y (Pavllo et al.
            2018, section 3.4); ``path_lateral`` adds how far to the left.
        statistics: what forecasters of these features standardize by; ``None``: by nothing.
        joints: indices of the joints that are written, ascending; ``representation`` is of
            ``skeleton.select(joints)``. The others are held still. ``None``: all of them.
        actions: names of actions. The one that is done is a feature of 1 among zeros, which the
            network reads, and predicts as it does the rest (Martinez et al. 2017, "supervised");
            ``decode`` leaves it out. None: actions are not told.
        controls: what steers the motion from outside; ``None``: nothing does.
    """

    skeleton: Skeleton
    representation: Representation
    root: RootChannels = "none"
    statistics: Statistics | None = None
    joints: tuple[int, ...] | None = None
    actions: tuple[str, ...] = ()
    controls: Controls | None = None

    def __post_init__(self) -> None:
        twice = sorted({name for name in self.actions if self.actions.count(name) > 1})
        if twice:
            raise ConfigError(f"codec.actions: {twice[0]!r} is there twice; name each action once")
        if self.joints is not None and list(self.joints) != sorted(set(self.joints)):
            raise ConfigError(f"codec.joints: {list(self.joints)}; expected indices in order")
        if self.root not in ROOT_CHANNELS:
            raise ConfigError(
                f"codec.root: {self.root!r} is not known; choose among: {', '.join(ROOT_CHANNELS)}"
            )
        if self.statistics is None:
            return
        for name, values in self.statistics._asdict().items():
            if values.shape != (self.feature_dim,):
                raise ConfigError(
                    f"codec.statistics: {name} has {tuple(values.shape)} values; expected "
                    f"{self.feature_dim}, one a feature"
                )

    @cached_property
    def written(self) -> Skeleton:
        """The joints that features write: all of the skeleton, or those of ``joints``."""
        return self.skeleton if self.joints is None else self.skeleton.select(self.joints)

    def choose(self, of_joints: Float[Tensor, "*batch joints n"]) -> Float[Tensor, "*batch some n"]:
        """Of what is there for every joint of the skeleton, that of the joints written."""
        if self.joints is None:
            return of_joints
        return of_joints.index_select(-2, torch.tensor(self.joints, device=of_joints.device))

    @property
    def root_dim(self) -> int:
        """Number of root channels."""
        return ROOT_CHANNELS[self.root]

    @property
    def follows_path(self) -> bool:
        """Whether root channels are relative to a path."""
        return bool(root_tracks(self.root))

    @property
    def tracks(self) -> tuple[str, ...]:
        """Names of the tracks of a motion that are read, beside its poses."""
        steering = () if self.controls is None else self.controls.tracks
        return (*root_tracks(self.root), *steering)

    @property
    def joint_features(self) -> int:
        """Number of features of all joints together, without the root channels."""
        return len(self.written) * self.representation.joint_dim

    @property
    def feature_dim(self) -> int:
        """Number of features of a frame."""
        return self.joint_features + self.root_dim + len(self.actions)

    def split(self, features: Float[Tensor, "*batch features"]) -> Parts:
        """Joints, root channels and actions of features; views, not copies."""
        sizes = [self.joint_features, self.root_dim, len(self.actions)]
        joints, root, action = features.split(sizes, dim=-1)
        return Parts(joints.unflatten(-1, (len(self.written), -1)), root, action)

    def merge(
        self,
        joints: Float[Tensor, "*batch joints joint_dim"],
        root: Float[Tensor, "*batch root"],
        action: Float[Tensor, "*batch actions"] | None = None,
    ) -> Float[Tensor, "*batch features"]:
        """Features of joints, root channels and, where the codec has actions, those."""
        parts = [joints.flatten(-2)]
        if self.root_dim:
            parts.append(root)
        if action is not None:
            parts.append(action)
        return torch.cat(parts, dim=-1) if len(parts) > 1 else parts[0]

    def encode(self, motion: Motion) -> Float[Tensor, "batch frames features"]:
        """Features of a motion.

        Raises:
            SkeletonError: the motion has another number of joints than the skeleton.
            ConfigError: the codec has actions, and the motion does none of them; or it follows a
                path, and the motion has no tracks.
        """
        rotations = motion.rotations_local
        if rotations.shape[-2] != len(self.skeleton):
            raise SkeletonError(
                f"motion of {rotations.shape[-2]} joints; expected the {len(self.skeleton)} joints "
                f"of the skeleton: {', '.join(self.skeleton.names)}"
            )
        joints = self.representation.continuous(
            self.representation.encode(
                self._continuous(self.choose(rotations)), self.choose(motion.offsets)[:, None]
            )
        )
        action = self._one_hot(motion) if self.actions else None
        return self.merge(joints, write_root(self.root, motion), action)

    def _continuous(
        self, rotations: Float[Tensor, "batch frames some 4"]
    ) -> Float[Tensor, "batch frames some 4"]:
        """The same rotations, their signs as the class says."""
        flip = rotations[:, :1, :, :1] < 0
        if self.follows_path:
            flip = flip.index_fill(2, torch.tensor(self.written.roots, device=flip.device), False)
        return quaternion.unroll(rotations * torch.where(flip, -1.0, 1.0).to(rotations), dim=1)

    def steer(self, motion: Motion) -> Float[Tensor, "batch frames controls"] | None:
        """Controls of a motion, from its tracks; ``None``: nothing steers it.

        Raises:
            ConfigError: the motion lacks a track.
        """
        if self.controls is None:
            return None
        return self.controls.encode(motion.tracks or {}).to(motion.root_positions)

    def _one_hot(self, motion: Motion) -> Float[Tensor, "batch frames actions"]:
        """1 for the action of each motion, in every frame."""
        shown = [""] * len(motion.offsets) if motion.actions is None else motion.actions
        for action in shown:
            if action not in self.actions:
                found = f"action {action!r} is unknown" if action else "no action is given"
                raise ConfigError(f"{found}; {did_you_mean(action, self.actions)}")
        numbers = torch.tensor([self.actions.index(action) for action in shown], dtype=torch.long)
        hot = torch.nn.functional.one_hot(numbers, len(self.actions)).to(motion.root_positions)
        return hot[:, None].expand(-1, motion.root_positions.shape[1], -1)

    def decode(
        self,
        features: Float[Tensor, "batch frames features"],
        *,
        offsets: Float[Tensor, "batch joints 3"],
        anchor: Float[Tensor, "batch 3"],
        held: Float[Tensor, "batch joints 4"] | None = None,
        tracks: Mapping[str, Float[Tensor, "batch frames ..."]] | None = None,
    ) -> Motion:
        """Motion of features that follow a known frame.

        Args:
            features: what a forecaster predicted.
            offsets: the body, metres.
            anchor: world position of the root in the frame before the first of ``features``,
                metres; displacements are summed up from there, or the root is held there.
            held: local rotations in that frame, which joints that are not written keep; ``None``:
                no rotation.
            tracks: of these frames, where they follow a path: its places ``path`` and directions
                ``movement``. ``None``: such a root stays above its anchor.

        Returns:
            Its bones stretch (``translations_local``) where the representation says where joints
            are; ``Motion.rigid`` is the same on the body at rest. Rotations are fitted where the
            representation states none.
        """
        joints, root, _ = self.split(features)
        bodies = self.choose(offsets)[:, None]
        rotations = self._beside(held, self.representation.decode(joints, bodies))
        moved = self.representation.translations(joints, bodies)
        if moved is not None and self.joints is not None:
            # The roots of what is written are on joints that are not, at the body's own offsets.
            roots = torch.tensor(self.written.roots, device=moved.device)
            ends = bodies.expand_as(moved).index_select(-2, roots).to(moved)
            moved = self._beside(offsets, moved.index_copy(-2, roots, ends))
        positions = place_root(self.root, root, anchor, tracks)
        return Motion(rotations, positions, offsets, moved)

    def _beside(
        self,
        held: Float[Tensor, "batch joints n"] | None,
        written: Float[Tensor, "batch frames some n"],
    ) -> Float[Tensor, "batch frames joints n"]:
        """What is written, and in every frame what the other joints hold (``None``: identity)."""
        if self.joints is None:
            return written
        shape = (*written.shape[:2], len(self.skeleton))
        if held is None:
            every = quaternion.identity(*shape, like=written)
        else:
            every = held[:, None].expand(*shape, -1).to(written)
        return every.index_copy(-2, torch.tensor(self.joints, device=written.device), written)

    def measure(
        self,
        motions: Iterable[Motion],
        *,
        divide_by: Literal["deviation", "variance"] = "deviation",
        least: float = 1e-4,
    ) -> Statistics:
        """Statistics of the features of some motions, over all batches and frames.

        Actions are left as they are: mean 0, scale 1.

        Args:
            motions: usually the training split, in pieces of any size.
            divide_by: ``deviation``, or ``variance`` as Aksan et al. (2019) did in their code.
            least: a feature whose deviation is smaller hardly moves and is not scaled.
        """
        count, total, squares = 0, torch.zeros(()), torch.zeros(())
        for motion in motions:
            features = self.encode(motion).detach().double().flatten(0, -2)
            count += features.shape[0]
            total = total + features.sum(0)
            squares = squares + features.square().sum(0)
        if not count:
            raise ConfigError("codec.measure: no frames to take statistics of")
        mean = total / count
        scale = (squares / count - mean.square()).clamp_min(0)
        still = scale < least**2
        if divide_by == "deviation":
            scale = scale.sqrt()
        scale = torch.where(still, torch.ones_like(scale), scale)
        told = len(self.actions)
        mean[len(mean) - told :], scale[len(scale) - told :] = 0, 1
        return Statistics(mean, scale)
