"""Walking along a course, frame by frame: controls from the path, one step, one pose."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from posecast.errors import ConfigError
from posecast.generation.course import Course
from posecast.generation.gait_table import GaitTable
from posecast.geometry import quaternion
from posecast.model import Forecaster, Session, Steppable
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
    """

    forecaster: Forecaster
    course: Course
    table: GaitTable
    offsets: Float[Tensor, "joints 3"]
    fps: float
    style: int = 0
    lead: float = 0.0
    stepper: Steppable | None = None
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
        self._phase = torch.zeros(1, dtype=torch.float64)
        self._ahead = round(RUN_UP * self.fps)
        self._session = Session.start(self.stepper or self.forecaster, self._first())
        with torch.inference_mode():
            for early in range(-self._ahead, 0):
                self._step(self._tracks(early))

    def __iter__(self) -> Iterator[Pose]:
        return self

    def __next__(self) -> Pose:
        path = self.course.path
        if not path.closed and self.frame / self.fps > self.course.duration + self.lead:
            raise StopIteration
        with torch.inference_mode():
            tracks = self._tracks(self.frame)
            pose = self._pose(self._session.unread, tracks)
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
        controls = self.forecaster.codec.controls
        assert controls is not None
        self._session.step(controls.encode(tracks)[:, 0].to(self._session.unread))
        self._phase = torch.remainder(self._phase + tracks[STEP_RATE][0] / self.fps, 2 * math.pi)

    def _first(self) -> Float[Tensor, "batch frames features"]:
        """Features of the frame before the run-up: a step that begins, facing where it is to go."""
        codec, tracks = self.forecaster.codec, self._tracks(-self._ahead)
        x, z = tracks[MOVEMENT][0, 0].tolist()
        weight = next(self.forecaster.parameters())
        known = self.table.poses[self.style][None, None].double()
        standing = codec.decode(
            known, offsets=self.offsets[None].double(), anchor=torch.zeros(1, 3).double()
        )
        about = quaternion.about_axis(
            torch.tensor([0.0, 1.0, 0.0]).double(), torch.tensor(math.atan2(x, z)).double()
        )
        rotations = standing.rotations_local.clone()
        roots = list(codec.skeleton.roots)
        rotations[:, :, roots] = quaternion.product(
            about.expand_as(rotations[:, :, roots]), rotations[:, :, roots]
        )
        root = codec.split(known).root
        tracks |= {LONGITUDINAL: root[..., 0]}
        if codec.root_dim > 2:
            tracks |= {LATERAL: root[..., 2]}
        motion = Motion(
            rotations, standing.root_positions, self.offsets[None].double(), tracks=tracks
        )
        return codec.encode(motion).to(weight)

    def _pose(self, features: Tensor, tracks: dict[str, Tensor]) -> Pose:
        """The pose that features mean at a place of the course."""
        codec = self.forecaster.codec
        found = codec.decode(
            features[:, -1:].double(),
            offsets=self.offsets[None].double(),
            anchor=torch.zeros(1, 3, dtype=torch.float64),
            tracks=tracks,
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


def walked_clip(walk: Walk, seconds: float | None = None, *, name: str = "walk") -> Clip:
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
        skeleton=walk.forecaster.codec.skeleton,
        offsets=walk.offsets.double(),
        fps=walk.fps,
        root_positions=torch.stack([pose.root_position for pose in poses]),
        rotations_local=quaternion.unroll(torch.stack([pose.rotations_local for pose in poses])),
        tracks={
            track: torch.stack([pose.tracks[track] for pose in poses]) for track in poses[0].tracks
        },
        name=name,
    )
