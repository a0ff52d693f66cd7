"""Walking along a course, frame by frame: controls from the path, one step, one pose."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol, runtime_checkable

import torch
from jaxtyping import Float
from torch import Tensor

from posecast.errors import ConfigError
from posecast.generation import relay
from posecast.generation.course import Course
from posecast.generation.gait_table import GaitTable
from posecast.geometry import quaternion
from posecast.model import Forecaster, Steppable
from posecast.motion import Clip, Motion
from posecast.motion.tracks import (
    FACING,
    LATERAL,
    LONGITUDINAL,
    MOVEMENT,
    PATH,
    PHASE,
    SPEED,
    STEP_RATE,
    STYLE,
)
from posecast.skeleton import Skeleton

RUN_UP = 1.0
"""Seconds walked before the start of a course, so that it begins in mid-stride."""


class Pose(NamedTuple):
    """One frame of a walk.

    Args:
        rotations_local: unit quaternions relative to the parent.
        root_position: in the world, metres.
        time: seconds after the start of the course.
        tracks: where the walk is meant to be: ``path``, ``movement``, ``facing`` (2,), ``speed``,
            ``phase`` ().
    """

    rotations_local: Float[Tensor, "joints 4"]
    root_position: Float[Tensor, "3"]
    time: float
    tracks: dict[str, Tensor]


@runtime_checkable
class Walker(Protocol):
    """Somebody under way along a course, whatever makes the poses."""

    @property
    def course(self) -> Course:
        """Where and how fast."""
        ...

    @property
    def skeleton(self) -> Skeleton:
        """Of the poses."""
        ...

    @property
    def offsets(self) -> Float[Tensor, "joints 3"]:
        """The body, metres."""
        ...

    @property
    def fps(self) -> float:
        """Poses a second."""
        ...

    def __iter__(self) -> Iterator[Pose]:
        """The poses from now on."""
        ...


@dataclass
class Walk:
    """Somebody under way along a course: an iterator of poses, one a frame.

    The root is at the course's own distance at every moment, and the network says how far ahead of
    it, how far beside and how high (Pavllo et al. 2018, section 3.4): a walk cannot stray.

    Args:
        forecaster: a pose network: its codec's root follows a path, and it takes controls.
        course: where and how fast.
        table: how the walker's steps begin.
        offsets: the body, metres.
        fps: frames per second of the network.
        style: which of the codec's styles; the first by default.
        lead: seconds to walk on beyond the end of an open course.
        stepper: what steps in the network's place, such as ``posecast.export.Stepper``; ``None``:
            it steps itself.
        renew: seconds after which the network begins anew, at the next step, with what it
            remembers (see ``relay``); ``None``: it never does.

    Raises:
        ConfigError: a network that follows no path, a style it has not, or a time that is none.
    """

    forecaster: Forecaster
    course: Course
    table: GaitTable
    offsets: Float[Tensor, "joints 3"]
    fps: float
    style: int = 0
    lead: float = 0.0
    stepper: Steppable | None = None
    renew: float | None = relay.RENEW
    frame: int = field(default=0, init=False)

    def __post_init__(self) -> None:
        codec = self.forecaster.codec
        if not codec.follows_path or codec.controls is None:
            raise ConfigError(
                "this checkpoint does not walk along paths: its root does not follow one, or "
                "nothing steers it; take one of a locomotion recipe (posecast recipes)"
            )
        styles = max(1, len(codec.controls.styles))
        if not 0 <= self.style < styles:
            raise ConfigError(f"style {self.style}: this walker has {styles}, counted from 0")
        if self.renew is not None and not self.renew >= relay.WARM + relay.FADE:
            raise ConfigError(
                f"renew is {self.renew} s; expected {relay.WARM + relay.FADE:g} s or more, or None"
            )
        self._phase = torch.zeros(1, dtype=torch.float64)
        self._network: Steppable = self.stepper or self.forecaster
        ahead = round(RUN_UP * self.fps)
        with torch.inference_mode():
            self._start = self._first()
            self._memories = [relay.begin(self._network, self._start, self._tracks(-ahead))]
            for early in range(-ahead, 0):
                self._step(self._tracks(early))

    @property
    def skeleton(self) -> Skeleton:
        """Of the codec."""
        return self.forecaster.codec.skeleton

    def __iter__(self) -> Iterator[Pose]:
        return self

    def __next__(self) -> Pose:
        path = self.course.path
        if not path.closed and self.frame / self.fps > self.course.duration + self.lead:
            raise StopIteration
        with torch.inference_mode():
            tracks = self._tracks(self.frame)
            pose = self._pose(tracks)
            self._step(tracks)
        self.frame += 1
        return pose

    def extend(self, course: Course) -> None:
        """Go on along a longer course, which agrees with the present one as far as it was walked.

        Raises:
            ConfigError: the walker would jump.
        """
        now = torch.tensor([self.frame / self.fps], dtype=torch.float64)
        old, new = (each.path.at(each.distance(now)).position for each in (self.course, course))
        if float((old - new).norm()) > course.path.spacing:
            raise ConfigError(
                f"after {float(now):.3g} s the new course is {float((old - new).norm()):.3g} m "
                "away from the walker; extend the path ahead of it only"
            )
        self.course = course

    def _tracks(self, frame: int) -> dict[str, Float[Tensor, "batch frames ..."]]:
        """What the course says of a frame, in batches of one frame."""
        time = torch.tensor([[frame / self.fps]], dtype=torch.float64)
        path, distance = self.course.path, self.course.distance(time)
        place = path.at(distance)
        found = {
            PATH: place.position,
            MOVEMENT: place.tangent,
            FACING: path.direction(FACING, distance),
            SPEED: path.scalar(SPEED, distance),
            PHASE: self._phase[None],
            STEP_RATE: path.scalar(STEP_RATE, distance),
        }
        assert self.forecaster.codec.controls is not None
        if styles := len(self.forecaster.codec.controls.styles):
            found[STYLE] = torch.eye(styles, dtype=torch.float64)[self.style][None, None]
        return found

    def _step(self, tracks: dict[str, Tensor]) -> None:
        """Predict the frame after the one of which the course says this."""
        codec, grown = self.forecaster.codec, tracks[STEP_RATE][0] / self.fps
        # A phase that has just gone round is that of a right touch-down.
        if self._is_old() and bool(self._phase < grown):
            self._memories.append(relay.begin(self._network, self._start, tracks))
        relay.advance(self._network, codec, self._memories, tracks)
        if len(self._memories) > 1 and relay.newer_share(self._memories[-1], self.fps) >= 1:
            del self._memories[0]
        self._phase = torch.remainder(self._phase + grown, 2 * math.pi)

    def _is_old(self) -> bool:
        """Whether the only memory there is is to be relieved."""
        if self.renew is None or len(self._memories) > 1:
            return False
        return self._memories[0].age >= (self.renew - relay.WARM - relay.FADE) * self.fps

    def _first(self) -> Float[Tensor, "1 1 features"]:
        """Features of the pose in which a step begins, facing ahead."""
        codec = self.forecaster.codec
        known = self.table.poses[self.style][None, None].double()
        body = self.offsets[None].double()
        standing = codec.decode(known, offsets=body, anchor=torch.zeros(1, 3).double())
        root = codec.split(known).root
        tracks = {LONGITUDINAL: root[..., 0]}
        if codec.root_dim > 2:
            tracks[LATERAL] = root[..., 2]
        found = codec.encode(
            Motion(standing.rotations_local, standing.root_positions, body, tracks=tracks)
        )
        return found.to(next(self.forecaster.parameters()))

    def _pose(self, tracks: dict[str, Tensor]) -> Pose:
        """The pose that is expected at a place of the course."""
        found = relay.expected(
            self.forecaster.codec, self._memories, tracks, offsets=self.offsets, fps=self.fps
        )
        return Pose(
            found.rotations_local[0, 0],
            found.root_positions[0, 0],
            self.frame / self.fps,
            {
                name: values[0, 0]
                for name, values in tracks.items()
                if name in (PATH, MOVEMENT, FACING, SPEED, PHASE)
            },
        )


def walked_clip(walk: Walker, seconds: float | None = None, *, name: str = "walk") -> Clip:
    """A walk as a clip, to the end of its course or for some seconds.

    Raises:
        ConfigError: a closed course, which never ends, without ``seconds``.
    """
    if seconds is None and walk.course.path.closed:
        raise ConfigError("a closed path has no end; say how many seconds to walk")
    poses: list[Pose] = []
    for pose in walk:
        if seconds is not None and pose.time >= seconds:
            break
        poses.append(pose)
    if not poses:
        raise ConfigError("nothing was walked: the course has ended already")
    return Clip(
        skeleton=walk.skeleton,
        offsets=walk.offsets.double(),
        fps=walk.fps,
        root_positions=torch.stack([pose.root_position for pose in poses]),
        rotations_local=quaternion.unroll(torch.stack([pose.rotations_local for pose in poses])),
        tracks={
            track: torch.stack([pose.tracks[track] for pose in poses]) for track in poses[0].tracks
        },
        name=name,
    )
