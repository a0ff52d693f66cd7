"""Walking along a course by motion matching, frame by frame: play, pull, search, blend."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field

import torch
from jaxtyping import Float
from torch import Tensor

from posecast.errors import ConfigError
from posecast.generation.course import Course
from posecast.generation.inertia import Offset, Posture, shifted
from posecast.generation.match_features import Ahead, Features, seen_from
from posecast.generation.matching import MotionMatcher
from posecast.generation.walk import Pose
from posecast.motion.tracks import FACING, MOVEMENT, PATH, PHASE, SPEED, turned_on_floor
from posecast.skeleton import Skeleton
from posecast.skeleton.kinematics import joint_positions


@dataclass
class MatchedWalk:
    """Somebody under way along a course, played from recorded clips: an iterator of poses.

    It begins where the course does, with the moment whose way ahead is most like the course's. A
    clip then plays on at its own speed, turned and moved to where the character is. Every
    ``search_every`` seconds, and where a clip ends or goes on too shortly to be compared, the most
    similar moment of all is looked for: by the course ahead from where the character is at that
    time, and by feet and velocities as they are. If it is another, that one plays on, and what is
    shown goes over to it without a jump in place or velocity (``Offset``). It uses no random
    numbers.

    The track ``phase`` of a pose is that of the clip that plays: it jumps where another begins.

    Args:
        matcher: the recorded moments.
        course: where and how fast.
        lead: seconds to walk on beyond the end of an open course.
        search_every: seconds from one search to the next.
        half_life: seconds in which half of what is left of the clip before is gone.
        pull: seconds, the time constant with which place and facing of the character are drawn to
            where the course is at that time, in addition to what the clips do: after so long 63 %
            of being off is gone. Feet slide by what is pulled. ``None``: no pull.

    Raises:
        ConfigError: a time that is not positive.
    """

    matcher: MotionMatcher
    course: Course
    lead: float = 0.0
    search_every: float = 0.2
    half_life: float = 0.1
    pull: float | None = 1.0
    frame: int = field(default=0, init=False)

    def __post_init__(self) -> None:
        times = {"search_every": self.search_every, "half_life": self.half_life, "pull": self.pull}
        for name, seconds in times.items():
            if seconds is not None and not 0 < seconds < math.inf:
                raise ConfigError(f"{name} is {seconds}: expected a positive number of seconds")
        self._every = max(1, round(self.search_every * self.fps))
        start = self._course_at(0.0)
        self._place = start[PATH]
        self._offset = Offset.none(len(self.skeleton), like=self._place)
        self._before = self._offset.value
        self._playing = int(self.matcher.moments[0])
        self._turn = _bearing(start[FACING]) - self._heading(self._playing)
        self._playing, self._turn = self._turned_to(self.matcher.start(self._query()))

    @property
    def skeleton(self) -> Skeleton:
        """Of the clips."""
        return self.matcher.skeleton

    @property
    def offsets(self) -> Float[Tensor, "joints 3"]:
        """The body, metres."""
        return self.matcher.offsets

    @property
    def fps(self) -> float:
        """Frames per second of the clips."""
        return self.matcher.fps

    @property
    def playing(self) -> int:
        """The frame of the database that plays."""
        return self._playing

    def __iter__(self) -> Iterator[Pose]:
        return self

    def __next__(self) -> Pose:
        time = self.frame / self.fps
        if not self.course.path.closed and time > self.course.duration + self.lead:
            raise StopIteration
        if self.frame:
            self._play_on()
            if self.matcher.frames.ends[self._playing] or self.frame % self._every == 0:
                self._search()
        shown = self._shown()
        self.frame += 1
        return Pose(
            shown.rotations_local[1],
            shown.root_position[1],
            time,
            {**self._course_at(time), PHASE: self.matcher.frames.phase[self._playing]},
        )

    def _play_on(self) -> None:
        """One frame: by the clip's own way, less what is pulled."""
        frames, self._playing = self.matcher.frames, self._playing + 1
        step = frames.path[self._playing] - frames.path[self._playing - 1]
        self._place = self._place + turned_on_floor(step[None], self._turn)[0]
        self._before = self._offset.value
        self._offset = self._offset.after(1 / self.fps, half_life=self.half_life)
        if self.pull is None:
            return
        share = 1 - math.exp(-1 / (self.fps * self.pull))
        wanted = self._course_at(self.frame / self.fps)
        aside = _bearing(wanted[FACING]) - self._turn - self._heading(self._playing)
        self._place = self._place + share * (wanted[PATH] - self._place)
        self._turn = self._turn + share * _wrapped(aside)

    def _search(self) -> None:
        """Go on with the moment most like this one."""
        found = self.matcher.match(self._query(), playing=self._playing)
        if found == self._playing:
            return
        shown = self._shown()
        self._playing, self._turn = self._turned_to(found)
        self._offset = Offset.at_switch(shown, self._played(), fps=self.fps)

    def _turned_to(self, frame: int) -> tuple[int, Float[Tensor, ""]]:
        """Another frame, and how to turn it to face where the character faces."""
        return frame, self._turn + self._heading(self._playing) - self._heading(frame)

    def _played(self) -> Posture:
        """What the clip says, in the frame before and in this one."""
        return self.matcher.placed(self._playing, self._place, self._turn)

    def _shown(self) -> Posture:
        """What is to be seen, in the frame before (had it been pulled as well) and in this one."""
        return shifted(self._played(), torch.stack([self._before, self._offset.value]))

    def _query(self) -> Features:
        """This moment, if what plays goes on, with the course ahead of it."""
        shown, path = self._shown(), self.course.path
        now, before = (
            self.matcher.joints(joint_positions(self.skeleton, rotations, self.offsets, root))
            for rotations, root in zip(
                shown.rotations_local.flip(0), shown.root_position.flip(0), strict=True
            )
        )
        later = (self.frame + self._place.new_tensor(self.matcher.ahead)) / self.fps
        distance = self.course.distance(later)
        return seen_from(
            self._place,
            self._turn + self._heading(self._playing),
            ahead=Ahead(path.at(distance).position, path.direction(FACING, distance)),
            now=now,
            before=before,
            fps=self.fps,
        )

    def _heading(self, frame: int) -> Float[Tensor, ""]:
        return self.matcher.frames.heading[frame]

    def _course_at(self, time: float) -> dict[str, Tensor]:
        """Where the walk is meant to be."""
        path = self.course.path
        distance = self.course.distance(path.points.new_tensor(time))
        place = path.at(distance)
        return {
            PATH: place.position,
            MOVEMENT: place.tangent,
            FACING: path.direction(FACING, distance),
            SPEED: path.scalar(SPEED, distance),
        }


def _bearing(direction: Float[Tensor, "2"]) -> Float[Tensor, ""]:
    """Radians of a direction (x, z), from +z towards +x."""
    return torch.atan2(direction[0], direction[1])


def _wrapped(angle: Float[Tensor, ""]) -> Float[Tensor, ""]:
    """The same angle, the shorter way round."""
    return torch.remainder(angle + math.pi, 2 * math.pi) - math.pi
