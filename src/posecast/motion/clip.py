"""Clip, one recording in canonical form, and Motion, a batch of pieces of clips."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain
from operator import itemgetter
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from posecast.errors import DataError, SkeletonError
from posecast.skeleton import Skeleton


class Motion(NamedTuple):
    """A batch of equally long pieces of motion on one skeleton: what predictors read and return.

    Args:
        rotations_local: unit quaternions (w, x, y, z) relative to the parent.
        root_positions: position of the first root in the world, metres.
        offsets: translation of each joint from its parent in the rest pose, metres.
        translations_local: only where bones stretch, as a network may let them: the translation of
            each joint from its parent, frame by frame, metres. ``None``: bones are rigid.
        actions: what is done in each motion, as its clip's label ``action`` says, and "" where none
            does. ``None``: nobody asked.
        tracks: further values a frame, by name: see ``tracks``. ``None``: nobody asked.
    """

    rotations_local: Float[Tensor, "batch frames joints 4"]
    root_positions: Float[Tensor, "batch frames 3"]
    offsets: Float[Tensor, "batch joints 3"]
    translations_local: Float[Tensor, "batch frames joints 3"] | None = None
    actions: tuple[str, ...] | None = None
    tracks: Mapping[str, Float[Tensor, "batch frames ..."]] | None = None

    @property
    def bones(self) -> Float[Tensor, "batch _ joints 3"]:
        """Translation of each joint from its parent in every frame, or in one that is for all."""
        moved = self.translations_local
        return self.offsets[:, None] if moved is None else moved

    @property
    def rigid(self) -> Motion:
        """The same rotations on the body at rest: bones as long as its offsets."""
        return self._replace(translations_local=None)

    def map(self, change: Callable[[Tensor], Tensor]) -> Motion:
        """All tensors changed alike, such as moved to another device."""
        moved = self.translations_local
        return Motion(
            change(self.rotations_local),
            change(self.root_positions),
            change(self.offsets),
            None if moved is None else change(moved),
            self.actions,
            self._each_track(change),
        )

    def _each_track(self, change: Callable[[Tensor], Tensor]) -> dict[str, Tensor] | None:
        tracks = self.tracks
        return None if tracks is None else {name: change(tracks[name]) for name in tracks}

    def cut(self, start: int, stop: int | None = None) -> Motion:
        """Frames ``start`` up to, not including, ``stop``, as a slice counts them."""
        piece = slice(start, stop)
        moved = self.translations_local
        return self._replace(
            rotations_local=self.rotations_local[:, piece],
            root_positions=self.root_positions[:, piece],
            translations_local=None if moved is None else moved[:, piece],
            tracks=self._each_track(lambda values: values[:, piece]),
        )

    def split(self, batch: int) -> list[Motion]:
        """The same in pieces of at most ``batch`` motions, in order."""
        firsts = range(0, max(len(self.rotations_local), 1), batch)
        pieces = [slice(first, first + batch) for first in firsts]
        actions = self.actions
        return [
            self.map(itemgetter(piece))._replace(
                actions=None if actions is None else actions[piece]
            )
            for piece in pieces
        ]

    @staticmethod
    def join_frames(motions: Sequence[Motion]) -> Motion:
        """Motions of the same bodies one after the other in time; offsets and actions are those of
        the first, and tracks are left out.

        Bones that stretch in one of them are given frame by frame in all.
        """
        bones = [
            motion.bones.expand(-1, motion.rotations_local.shape[1], -1, -1) for motion in motions
        ]
        stretch = any(motion.translations_local is not None for motion in motions)
        return Motion(
            torch.cat([motion.rotations_local for motion in motions], dim=1),
            torch.cat([motion.root_positions for motion in motions], dim=1),
            motions[0].offsets,
            torch.cat(bones, dim=1) if stretch else None,
            motions[0].actions,
        )

    def clip(self, like: Clip, *, name: str, index: int = 0) -> Clip:
        """One motion of the batch as a clip.

        Args:
            like: its skeleton and frame rate; nothing else of it is kept.
            name: of the new clip.
            index: which motion.
        """
        moved = self.translations_local
        return Clip(
            skeleton=like.skeleton,
            offsets=self.offsets[index],
            fps=like.fps,
            root_positions=self.root_positions[index],
            rotations_local=self.rotations_local[index],
            translations_local=None if moved is None else moved[index],
            name=name,
        )

    @staticmethod
    def join(motions: Sequence[Motion]) -> Motion:
        """Batches one after the other; bones stretch in all or none, actions are known of all or
        left out, and so are tracks."""
        moved = [m.translations_local for m in motions if m.translations_local is not None]
        actions = [m.actions for m in motions if m.actions is not None]
        return Motion(
            torch.cat([motion.rotations_local for motion in motions]),
            torch.cat([motion.root_positions for motion in motions]),
            torch.cat([motion.offsets for motion in motions]),
            torch.cat(moved) if moved else None,
            tuple(chain(*actions)) if len(actions) == len(motions) else None,
            _joined_tracks([motion.tracks for motion in motions]),
        )


def _joined_tracks(all_tracks: Sequence[Mapping[str, Tensor] | None]) -> dict[str, Tensor] | None:
    """Tracks that every batch has, one batch after the other."""
    known = [tracks for tracks in all_tracks if tracks is not None]
    if len(known) < len(all_tracks):
        return None
    shared = [name for name in known[0] if all(name in tracks for tracks in known)]
    return {name: torch.cat([tracks[name] for tracks in known]) for name in shared}


@dataclass(frozen=True, eq=False)
class Clip:
    """One recording: skeleton, body, frame rate and motion. Metres, y up, (w, x, y, z), seconds.

    The world position of a root is ``root_positions`` plus that root's own offset, which readers
    set to zero for the first root.

    Args:
        skeleton: names and parents of the joints.
        offsets: translation of each joint from its parent in the rest pose, metres.
        fps: frames per second.
        root_positions: one world position a frame, metres.
        rotations_local: unit quaternions relative to the parent; for a root, to the world.
        translations_local: only for clips whose bones really move: the translation of every
            joint from its parent, frame by frame, in place of ``offsets``. ``None`` otherwise.
        name: what to call the clip in tables and messages, usually the file's stem.
        labels: facts about the recording, such as ``subject``, ``action``, ``style``.
        tracks: further values a frame, such as ``phase`` (T,) or ``contacts`` (T, 2); the frame
            axis comes first.
        source: conventions of the file it was read from, kept by the reader for the writer.
    """

    skeleton: Skeleton
    offsets: Float[Tensor, "joints 3"]
    fps: float
    root_positions: Float[Tensor, "frames 3"]
    rotations_local: Float[Tensor, "frames joints 4"]
    translations_local: Float[Tensor, "frames joints 3"] | None = None
    name: str = ""
    labels: Mapping[str, str] = field(default_factory=dict)
    tracks: Mapping[str, Tensor] = field(default_factory=dict)
    source: object | None = None

    def __post_init__(self) -> None:
        joints, frames = len(self.skeleton), self.frames
        if self.offsets.shape != (joints, 3) or self.rotations_local.shape[1:] != (joints, 4):
            raise SkeletonError(
                f"clip {self.name!r}: offsets {tuple(self.offsets.shape)} and rotations "
                f"{tuple(self.rotations_local.shape)} do not fit a skeleton of {joints} joints"
            )
        if self.rotations_local.shape[0] != frames:
            raise DataError(
                self.name or "clip",
                f"{frames} root positions but {self.rotations_local.shape[0]} frames of rotations",
            )
        if not frames:
            raise DataError(self.name or "clip", "no frames; expected at least one")
        if not 0 < self.fps < math.inf:
            raise DataError(
                self.name or "clip", f"{self.fps} frames per second; expected a positive number"
            )
        for track, values in self.tracks.items():
            if len(values) != frames:
                raise DataError(
                    self.name or "clip",
                    f"track {track!r} has {len(values)} values for {frames} frames",
                )

    @property
    def frames(self) -> int:
        """Number of frames."""
        return self.root_positions.shape[0]

    @property
    def duration(self) -> float:
        """Length in seconds, frames divided by frames per second."""
        return self.frames / self.fps

    def cut(self, start: int, stop: int) -> Clip:
        """Frames ``start`` up to, not including, ``stop``; tracks are cut along."""
        if not 0 <= start < stop <= self.frames:
            raise DataError(
                self.name or "clip",
                f"frames {start} to {stop} asked for, the clip has {self.frames}",
            )
        piece = slice(start, stop)
        return replace(
            self,
            root_positions=self.root_positions[piece],
            rotations_local=self.rotations_local[piece],
            translations_local=(
                None if self.translations_local is None else self.translations_local[piece]
            ),
            tracks={track: values[piece] for track, values in self.tracks.items()},
        )

    def to(self, dtype: torch.dtype) -> Clip:
        """The same clip with every floating-point tensor in another precision."""
        moved = self.translations_local
        return replace(
            self,
            offsets=self.offsets.to(dtype),
            root_positions=self.root_positions.to(dtype),
            rotations_local=self.rotations_local.to(dtype),
            translations_local=None if moved is None else moved.to(dtype),
            tracks={
                track: values.to(dtype) if values.is_floating_point() else values
                for track, values in self.tracks.items()
            },
        )

    def motion(self) -> Motion:
        """The clip as a batch of one."""
        return Motion(
            rotations_local=self.rotations_local[None],
            root_positions=self.root_positions[None],
            offsets=self.offsets[None],
            actions=(self.labels.get("action", ""),),
        )
