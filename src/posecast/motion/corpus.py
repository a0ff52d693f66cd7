"""Corpus: clips with named splits, and windows into them that are counted, never listed."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import accumulate
from typing import NamedTuple, overload

import torch
from torch import Tensor

from posecast.errors import ConfigError, SkeletonError
from posecast.motion.clip import Clip, Motion
from posecast.skeleton import Skeleton

Wanted = Mapping[str, str | Iterable[str]]
"""Values a label may have: one, or any of several."""


class Window(NamedTuple):
    """Where a fixed-length piece begins.

    Args:
        clip: index into the clips of the corpus.
        start: its first frame.
    """

    clip: int
    start: int


@dataclass(frozen=True, eq=False)
class Windows(Sequence[Window]):
    """All windows of one length in some clips, in order of clip and then of time.

    Nothing is listed: a window is computed from its index, so millions of them cost nothing.

    Args:
        clips: indices of the clips.
        frames: length of each of these clips; one shorter than a window has none.
        length: frames in a window.
        stride: frames from one window to the next.
    """

    clips: tuple[int, ...]
    frames: tuple[int, ...]
    length: int
    stride: int = 1

    def __post_init__(self) -> None:
        if self.length < 1 or self.stride < 1:
            raise ConfigError(
                f"windows of {self.length} frames every {self.stride}: both must be at least 1"
            )

    @cached_property
    def _ends(self) -> tuple[int, ...]:
        """Number of windows in each clip and all clips before it."""
        counts = (max(0, (frames - self.length) // self.stride + 1) for frames in self.frames)
        return tuple(accumulate(counts))

    def __len__(self) -> int:
        return self._ends[-1] if self._ends else 0

    @overload
    def __getitem__(self, index: int) -> Window: ...
    @overload
    def __getitem__(self, index: slice) -> list[Window]: ...
    def __getitem__(self, index: int | slice) -> Window | list[Window]:
        if isinstance(index, slice):
            return [self._at(place) for place in range(*index.indices(len(self)))]
        if not -len(self) <= index < len(self):
            raise IndexError(f"window {index} of {len(self)}")
        return self._at(index % len(self))

    def __iter__(self) -> Iterator[Window]:
        for clip, frames in zip(self.clips, self.frames, strict=True):
            for start in range(0, frames - self.length + 1, self.stride):
                yield Window(clip, start)

    def _at(self, index: int) -> Window:
        place = bisect_right(self._ends, index)
        before = self._ends[place - 1] if place else 0
        return Window(self.clips[place], (index - before) * self.stride)


@dataclass(frozen=True, eq=False)
class Corpus:
    """Recordings on one topology at one frame rate, and which of them are for what.

    Offsets may differ from clip to clip. A clip may belong to several splits or to none.

    Args:
        name: what to call it in tables and messages.
        clips: the recordings; may be lazy, as ``motion.store.Store`` is.
        splits: names to indices into ``clips``, usually train, validation and test; a split may
            be empty.
        missing: files that belong to this corpus and were not found, as paths below its folder.
        notes: what was done about known faults of the data; full sentences.

    Raises:
        ConfigError: no clips, clips of different frame rates, or a split that names a clip which
            is not there.
        SkeletonError: clips of different topology.
    """

    name: str
    clips: Sequence[Clip]
    splits: Mapping[str, tuple[int, ...]]
    missing: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not len(self.clips):
            raise ConfigError(f"corpus {self.name!r} has no clips")
        first = self.clips[0]
        for clip in self.clips:
            if clip.skeleton != first.skeleton:
                raise SkeletonError(
                    f"corpus {self.name!r}: {clip.name!r} and {first.name!r} have different "
                    f"skeletons ({_difference(clip.skeleton, first.skeleton)}); "
                    "all clips of a corpus share one topology"
                )
            if clip.fps != first.fps:
                raise ConfigError(
                    f"corpus {self.name!r}: {clip.name!r} has {clip.fps:g} frames per second, "
                    f"{first.name!r} {first.fps:g}; give fps to bring all to one rate"
                )
        for split, indices in self.splits.items():
            outside = [index for index in indices if not 0 <= index < len(self.clips)]
            if outside:
                raise ConfigError(
                    f"corpus {self.name!r}: split {split!r} names clip {outside[0]}; "
                    f"there are {len(self.clips)}, counted from 0"
                )

    @property
    def skeleton(self) -> Skeleton:
        """The topology all clips share."""
        return self.clips[0].skeleton

    @property
    def fps(self) -> float:
        """Frames per second of every clip."""
        return self.clips[0].fps

    @cached_property
    def frames(self) -> tuple[int, ...]:
        """Length of each clip."""
        return tuple(clip.frames for clip in self.clips)

    def indices(self, split: str, labels: Wanted | None = None) -> tuple[int, ...]:
        """Indices of the clips of a split whose labels are as wanted.

        Args:
            split: name of the split.
            labels: for each label the value, or the values, it may have; a clip without the label
                is left out. ``None``: every clip.

        Raises:
            ConfigError: no split has this name.
        """
        if split not in self.splits:
            raise ConfigError(
                f"corpus {self.name!r} has no split {split!r}; it has {', '.join(self.splits)}"
            )
        wanted = {
            label: {values} if isinstance(values, str) else set(values)
            for label, values in (labels or {}).items()
        }
        return tuple(
            index
            for index in self.splits[split]
            if all(self.clips[index].labels.get(label) in wanted[label] for label in wanted)
        )

    def split(self, name: str, labels: Wanted | None = None) -> tuple[Clip, ...]:
        """The clips of a split, those with certain labels if asked for; see ``indices``."""
        return tuple(self.clips[index] for index in self.indices(name, labels))

    def windows(
        self, split: str, length: int, stride: int = 1, labels: Wanted | None = None
    ) -> Windows:
        """All windows of ``length`` frames in a split, one every ``stride`` frames of each clip.

        The same on every machine. Clips shorter than ``length`` have none. See ``indices`` for
        ``labels`` and errors.
        """
        clips = self.indices(split, labels)
        return Windows(clips, tuple(self.frames[clip] for clip in clips), length, stride)

    def gather(self, windows: Sequence[Window], length: int, tracks: Sequence[str] = ()) -> Motion:
        """Copy windows into one batch, float32, each with the offsets and the action of its clip.

        Bones that move (``translations_local``) are taken at their offsets.

        Args:
            windows: at least one.
            length: frames in each.
            tracks: names of those that are copied along, as float32.

        Raises:
            ConfigError: no windows, one that is not inside its clip, or a clip without a track.
        """
        if not len(windows):
            raise ConfigError("a batch needs at least one window; found none")
        batch, joints = len(windows), len(self.skeleton)
        rotations = torch.empty(batch, length, joints, 4)
        positions = torch.empty(batch, length, 3)
        offsets = torch.empty(batch, joints, 3)
        actions: list[str] = []
        for place, window in enumerate(windows):
            piece, clip = self._piece(window, length), self.clips[window.clip]
            rotations[place] = clip.rotations_local[piece]
            positions[place] = clip.root_positions[piece]
            offsets[place] = clip.offsets
            actions.append(clip.labels.get("action", ""))
        copied = {name: self.gather_track(windows, length, name).float() for name in tracks}
        return Motion(
            rotations, positions, offsets, actions=tuple(actions), tracks=copied if tracks else None
        )

    def gather_track(self, windows: Sequence[Window], length: int, track: str) -> Tensor:
        """Copy one track of the same windows into a batch (batch, length, ...), dtype kept.

        Raises:
            ConfigError: no windows, one outside its clip, or a clip without such a track.
        """
        if not len(windows):
            raise ConfigError("a batch needs at least one window; found none")
        pieces: list[Tensor] = []
        for window in windows:
            piece, clip = self._piece(window, length), self.clips[window.clip]
            if track not in clip.tracks:
                raise ConfigError(
                    f"clip {clip.name!r} of corpus {self.name!r} has no track {track!r}; "
                    f"it has {', '.join(clip.tracks) or 'none'}"
                )
            pieces.append(clip.tracks[track][piece])
        return torch.stack(pieces)

    def _piece(self, window: Window, length: int) -> slice:
        if not 0 <= window.clip < len(self.clips):
            raise ConfigError(
                f"window in clip {window.clip} of corpus {self.name!r}, which has {len(self.clips)}"
            )
        if not 0 <= window.start <= self.frames[window.clip] - length:
            raise ConfigError(
                f"window of {length} frames from frame {window.start} of clip {window.clip}: "
                f"that clip has {self.frames[window.clip]}"
            )
        return slice(window.start, window.start + length)


def _difference(found: Skeleton, expected: Skeleton) -> str:
    """How one topology differs from another, in a few words."""
    if len(found) != len(expected):
        return f"{len(found)} joints against {len(expected)}"
    for joint, (name, other) in enumerate(zip(found.names, expected.names, strict=True)):
        if name != other:
            return f"joint {joint} is {name!r} in one and {other!r} in the other"
    joint = next(
        joint
        for joint, (parent, other) in enumerate(zip(found.parents, expected.parents, strict=True))
        if parent != other
    )
    return f"{found.names[joint]!r} hangs from different joints"
