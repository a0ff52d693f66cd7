"""Motion matching: the recorded moment most like the one that is walked, and its way ahead.

After Clavet 2016, Motion Matching and the Road to Next-Gen Animation, and Holden et al. 2020,
Learned Motion Matching, section 3.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from posecast.config import did_you_mean
from posecast.errors import ConfigError, SkeletonError
from posecast.generation.inertia import Posture
from posecast.generation.match_features import (
    AHEAD,
    EVEN,
    Ahead,
    Features,
    Joints,
    Scale,
    Weights,
    seen_from,
)
from posecast.geometry import quaternion
from posecast.motion import Clip, find_feet, reproportion
from posecast.motion.own_axes import mirror_on_own_axes
from posecast.motion.tracks import FACING, PATH, PHASE
from posecast.skeleton.kinematics import joint_positions


class Frames(NamedTuple):
    """All frames of all clips, one clip after the other; float64.

    Args:
        rotations_local: unit quaternions relative to the parent.
        root_positions: metres.
        path: (x, z) of the root without the sway of single steps: where the character is.
        heading: where it faces, radians from +z towards +x.
        phase: place in the walk cycle, radians.
        ends: whether the clip ends here.
    """

    rotations_local: Float[Tensor, "frames joints 4"]
    root_positions: Float[Tensor, "frames 3"]
    path: Float[Tensor, "frames 2"]
    heading: Float[Tensor, "frames"]
    phase: Float[Tensor, "frames"]
    ends: Bool[Tensor, "frames"]


class MotionMatcher:
    """A database of moments: every frame of some clips after which they go on for long enough.

    A moment is described from where the character is, the root's place on the floor without the
    sway of single steps, and from where it faces (``Features``); so it does not matter where and
    in what direction a clip was recorded.

    Args:
        clips: with the tracks of their gait (``motion.with_gait``), all of one frame rate.
        offsets: the body that walks, metres; every clip is brought to it (``reproportion``).
            ``None``: that of the first clip.
        style: only clips with this label ``style``; ``None``: all.
        mirrored: take the mirror image of every clip, too.
        weights: what counts how much.

    Raises:
        ConfigError: no clips, none of the style, several frame rates, a clip without tracks, or
            none long enough.
        SkeletonError: several skeletons, one of several roots or without feet, or a body that is
            not symmetric to be mirrored.
    """

    def __init__(
        self,
        clips: Iterable[Clip],
        *,
        offsets: Float[Tensor, "joints 3"] | None = None,
        style: str | None = None,
        mirrored: bool = True,
        weights: Weights = EVEN,
    ) -> None:
        chosen = _chosen(clips, style)
        first = chosen[0]
        self.skeleton, self.fps = first.skeleton, float(first.fps)
        self.offsets = (first.offsets if offsets is None else offsets).double()
        self.ahead = tuple(max(1, round(seconds * self.fps)) for seconds in AHEAD)
        if mirrored:
            chosen = [*chosen, *map(mirror_on_own_axes, chosen)]
        bodies = [
            reproportion(clip.to(torch.float64), self.offsets, body="matched") for clip in chosen
        ]
        self.frames = _joined(bodies)
        self.feet = find_feet(self.skeleton, self.offsets, self._positions(slice(0, first.frames)))
        self.moments = self._moments([clip.frames for clip in bodies])
        features = self.features(self.moments)
        self._scale = Scale(features, weights)
        self._rows = self._scale.rows(features)
        self._row_of = torch.full((len(self.frames.ends),), -1)
        self._row_of[self.moments] = torch.arange(len(self.moments))

    def features(self, frames: Int[Tensor, " moments"]) -> Features:
        """What moments of the database are compared by.

        Args:
            frames: none the first of its clip, all with the clip's next ``ahead`` frames.
        """
        later = frames[:, None] + torch.tensor(self.ahead)
        heading = self.frames.heading[later]
        return seen_from(
            self.frames.path[frames],
            self.frames.heading[frames],
            ahead=Ahead(
                self.frames.path[later], torch.stack([heading.sin(), heading.cos()], dim=-1)
            ),
            now=self.joints(self._positions(frames)),
            before=self.joints(self._positions(frames - 1)),
            fps=self.fps,
        )

    def joints(self, positions: Float[Tensor, "*moments joints 3"]) -> Joints:
        """Of all joints those that are compared."""
        root = self.skeleton.roots[0]
        return Joints(positions[..., list(self.feet.toes), :], positions[..., root, :])

    def match(self, query: Features, *, playing: int | None = None) -> int:
        """The frame of the database that is most like a moment.

        Args:
            query: the moment.
            playing: a frame that is to be preferred if no other is more like it.
        """
        apart = (self._rows - self._scale.rows(query)).square().sum(-1)
        best = int(apart.argmin())
        if playing is not None and (row := int(self._row_of[playing])) >= 0:
            best = row if apart[row] <= apart[best] else best
        return int(self.moments[best])

    def start(self, query: Features) -> int:
        """The frame whose way ahead is most like that of a moment, however the body stands."""
        way = self._scale.way
        apart = (self._rows[:, :way] - self._scale.rows(query)[:way]).square().sum(-1)
        return int(self.moments[apart.argmin()])

    def placed(self, frame: int, place: Float[Tensor, "2"], turn: Float[Tensor, ""]) -> Posture:
        """A frame and the one before it, put down elsewhere on the floor.

        Args:
            frame: of the database.
            place: where its ``path`` is put, (x, z), metres.
            turn: by how much it is turned about the vertical, radians.
        """
        pair = slice(frame - 1, frame + 1)
        about = quaternion.about_axis(place.new_tensor((0.0, 1.0, 0.0)), turn)
        rotations = self.frames.rotations_local[pair].clone()
        root = self.skeleton.roots[0]
        rotations[:, root] = quaternion.product(about, rotations[:, root])
        way = self.frames.root_positions[pair] - on_floor(self.frames.path[frame])
        return Posture(rotations, on_floor(place) + quaternion.rotate(about, way))

    def _positions(self, frames: Tensor | slice) -> Float[Tensor, "frames joints 3"]:
        return joint_positions(
            self.skeleton,
            self.frames.rotations_local[frames],
            self.offsets,
            self.frames.root_positions[frames],
        )

    def _moments(self, lengths: Sequence[int]) -> Int[Tensor, " moments"]:
        """Frames with one before them and enough after them in their clip."""
        longest, needed = max(lengths), self.ahead[-1] + 2
        if longest < needed:
            raise ConfigError(
                f"no clip is long enough to be matched: the longest has {longest} frames, expected "
                f"{needed} or more ({needed / self.fps:.3g} s); give longer clips"
            )
        found, first = [], 0
        for length in lengths:
            found.append(torch.arange(first + 1, max(first + 1, first + length - self.ahead[-1])))
            first += length
        return torch.cat(found)


def on_floor(place: Float[Tensor, "*places 2"]) -> Float[Tensor, "*places 3"]:
    """Places (x, z) as (x, 0, z)."""
    x, z = place.unbind(-1)
    return torch.stack([x, torch.zeros_like(x), z], dim=-1)


def _chosen(clips: Iterable[Clip], style: str | None) -> list[Clip]:
    """The clips of a style, once it is sure that they can be played one after the other."""
    every = list(clips)
    if not every:
        raise ConfigError("no clips to match; expected at least one that walks")
    styles = {clip.labels.get("style", "") for clip in every}
    chosen = [clip for clip in every if style in (None, clip.labels.get("style"))]
    if not chosen:
        raise ConfigError(f"no clip is of style {style!r}; {did_you_mean(str(style), styles)}")
    for clip in chosen:
        _check(clip, chosen[0])
    return chosen


def _check(clip: Clip, first: Clip) -> None:
    """Refuse a clip that cannot be played after the first."""
    if clip.skeleton != first.skeleton or len(clip.skeleton.roots) != 1:
        raise SkeletonError(
            f"clip {clip.name!r} has {len(clip.skeleton)} joints and {len(clip.skeleton.roots)} "
            f"roots, clip {first.name!r} {len(first.skeleton)} joints; expected the same skeleton "
            "in all, with one root"
        )
    if clip.fps != first.fps:
        raise ConfigError(
            f"clip {clip.name!r} has {clip.fps:g} frames per second, {first.name!r} {first.fps:g}; "
            "bring all to one rate (motion.resample)"
        )
    missing = [name for name in (PATH, FACING, PHASE) if name not in clip.tracks]
    if missing:
        raise ConfigError(
            f"clip {clip.name!r} has no track {' and no '.join(missing)}; analyse its gait first "
            "(motion.with_gait)"
        )


def _joined(clips: Sequence[Clip]) -> Frames:
    """All frames of some clips."""
    facing = torch.cat([clip.tracks[FACING] for clip in clips])
    ends = torch.cat([torch.arange(clip.frames) == clip.frames - 1 for clip in clips])
    return Frames(
        rotations_local=torch.cat([clip.rotations_local for clip in clips]),
        root_positions=torch.cat([clip.root_positions for clip in clips]),
        path=torch.cat([clip.tracks[PATH] for clip in clips]),
        heading=torch.atan2(facing[:, 0], facing[:, 1]),
        phase=torch.remainder(torch.cat([clip.tracks[PHASE] for clip in clips]), 2 * math.pi),
        ends=ends,
    )
