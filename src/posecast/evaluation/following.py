"""How well a walk does what its course asks: where to be, when, how fast, facing where."""

from __future__ import annotations

import math
from typing import Protocol, runtime_checkable

import torch
from jaxtyping import Float
from torch import Tensor

from posecast.motion.gait import Gait
from posecast.motion.nearest import nearest_places
from posecast.motion.path import Path
from posecast.motion.tracks import FACING, SPEED

REACH = 2.5
"""Leg lengths along the path before and after where a walk is to be, within which the place is
sought that it is at: two metres of an adult, so that who comes to a crossing is on their branch."""

SLACK = 2.0
"""Seconds before and after the time of a way point in which its passing is sought."""


@runtime_checkable
class Followed(Protocol):
    """A course as scores see it; ``generation.Course`` is one."""

    @property
    def path(self) -> Path:
        """With the tracks ``speed`` (m/s) and ``facing``."""

    @property
    def duration(self) -> float:
        """Seconds from the start to the end; of a closed path, once around."""

    def distance(self, time: Float[Tensor, "*times"]) -> Float[Tensor, "*times"]:
        """Arc length reached after some seconds, metres."""

    def arrival(self, distance: Float[Tensor, "*places"]) -> Float[Tensor, "*places"]:
        """Seconds after which some arc lengths are reached."""


def frame_times(frames: int, *, fps: float, start: float = 0.0) -> Float[Tensor, "frames"]:
    """Seconds after the start of the course of each frame."""
    return start + torch.arange(frames, dtype=torch.float64) / fps


def path_distances(
    root: Float[Tensor, "frames 2"],
    path: Path,
    *,
    near: Float[Tensor, "frames"],
    reach: float,
) -> Float[Tensor, "frames"]:
    """Metres on the floor from the root to the nearest place of the path that is near in arc.

    Args:
        root: (x, z), metres.
        near: arc length where it is to be, metres.
        reach: how far before and after it to look, metres.
    """
    nearest = path.nearest(root, near=near, reach=reach)
    return (path.at(nearest).position - root).norm(dim=-1)


def arrival_errors(
    root: Float[Tensor, "frames 2"], course: Followed, *, fps: float, start: float = 0.0
) -> Float[Tensor, "marks"]:
    """Seconds late, negative: early, at each way point to be passed while the walk lasts.

    When the root passes is when it is nearest, from frame to frame on a straight line, within
    ``SLACK`` of the planned time; who is later still counts as so late. A way point whose passing
    might lie before the first frame or after the last one is not counted, so that a walk should go
    on for ``SLACK`` beyond the end of its course; nor is one where the course starts: nobody has to
    get there.

    Args:
        root: (x, z), metres.
        start: seconds after the start of the course of the first frame.
    """
    last = start + (len(root) - 1) / fps
    marks = course.path.marks
    planned = course.arrival(marks)
    if course.path.closed:
        laps = torch.arange(math.ceil(last / course.duration) + 1, dtype=torch.float64)
        planned = (laps[:, None] * course.duration + planned).flatten()
        marks = marks.repeat(len(laps))
    least = start + SLACK if start > 0 else 1e-9
    asked = (planned >= least) & (planned <= last - SLACK + 1 / fps)
    if len(root) < 2 or not asked.any():
        return root.new_zeros(0)
    places = course.path.at(marks[asked]).position
    passed = nearest_places(
        root,
        places,
        spacing=1 / fps,  # so that an arc length of the root's way is a time
        closed=False,
        near=planned[asked] - start,
        reach=SLACK,
    ).arc_length
    return start + passed - planned[asked]


def facing_errors(
    gait: Gait, course: Followed, times: Float[Tensor, "frames"]
) -> Float[Tensor, "frames"]:
    """Degrees between where the body faces and where it is to face, 0 to 180.

    Args:
        gait: whose facing is without the turning to and fro of single steps.
        times: of its frames, seconds after the start of the course.
    """
    asked = course.path.direction(FACING, course.distance(times))
    (x, z), (asked_x, asked_z) = gait.facing.unbind(-1), asked.unbind(-1)
    angle = torch.atan2(x * asked_z - z * asked_x, x * asked_x + z * asked_z)
    return torch.rad2deg(angle).abs()


def speed_errors(
    gait: Gait, course: Followed, times: Float[Tensor, "frames"]
) -> Float[Tensor, "frames"]:
    """Metres a second by which the root, without the surge of single steps, is too fast or slow."""
    return (gait.speed - course.path.scalar(SPEED, course.distance(times))).abs()
