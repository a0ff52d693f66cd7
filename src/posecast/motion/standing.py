"""Where feet stand, also while they slide: told by heights, not by speed alone."""

from __future__ import annotations

from typing import NamedTuple

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from posecast.motion.contacts import COOLDOWN, NEAR, SPEED_GAP, foot_velocities

_LEVEL = 0.1
"""Quantile of all heights of a foot that is taken for where it stands."""

_SLIDE = 0.6
"""Leg lengths a second at which a foot that stands may slide.

What mostly moves faster is carried low over the floor: recorded feet that stand slide with up to
0.3, toes that swing move with 0.8 and more.
"""

_RESTS = 1e-5
"""Metres a frame: a foot that moves less does not move; rounding in float32 makes about 1e-6.

Feet that were recorded always move more, those that were generated or pinned do not.
"""

_SAMPLE = 500
"""So many places stand for all of a stretch of time."""

_SAME = 1e-9
"""Share, and metres or m/s, by which rounding may tell equal ways apart."""


class Stand(NamedTuple):
    """One foot stands.

    Args:
        foot: 0 the left one, 1 the right one.
        first: frame.
        last: frame; it still stands there.
    """

    foot: int
    first: int
    last: int

    @property
    def frames(self) -> slice:
        """From the first to the last, that included."""
        return slice(self.first, self.last + 1)


def lowest_heights(feet: Float[Tensor, "frames 2 3"]) -> Float[Tensor, "2"]:
    """Heights below which the feet are under the floor, metres.

    The floor is at 0, or where a foot stands if that is lower, as in clips whose floor is not at 0.
    """
    return feet[..., 1].quantile(_LEVEL, dim=0, interpolation="lower").clamp(max=0)


def median_place(places: Float[Tensor, "places 2"]) -> int:
    """Which place has the least way to all others, the first of several; of many, to a sample."""
    sample = places[:: 1 + len(places) // _SAMPLE]
    ways = torch.cdist(places, sample).sum(-1)
    return int((ways <= ways.min() * (1 + _SAME) + _SAME).long().argmax())


def shortest(fps: float | int) -> int:
    """Frames in which a foot stands at least."""
    return max(2, round(COOLDOWN * fps))


def find_stands(
    feet: Float[Tensor, "frames 2 3"], *, fps: float | int, leg: float, near: float = NEAR
) -> list[Stand]:
    """Stretches of time in which a foot stands on a level floor, slide as it may.

    In all of it the foot is no higher than ``near`` above where it stands, and rises and sinks more
    slowly than 0.205 leg lengths a second. Of that: as long as it rests altogether, if it does;
    else as long as its velocity on the floor is within the same 0.205 of its median, which is how
    it slides, unless that is faster than 0.6. At least 0.1 s each.

    Args:
        feet: world positions of the joint of each foot that stays while it stands, metres.
        fps: frames a second.
        leg: length of a leg, metres.
        near: leg lengths; infinite where the floor is not level.

    Returns:
        Those of the left foot, then those of the right one, in order of time.
    """
    height = torch.maximum(feet[..., 1], lowest_heights(feet))
    level = height.quantile(_LEVEL, dim=0, interpolation="lower")
    least = shortest(fps)
    velocity = foot_velocities(torch.stack([feet[..., 0], height, feet[..., 2]], dim=-1), fps)
    low = (velocity[..., 1].abs() < SPEED_GAP * leg) & (height <= level + near * leg)
    return [
        stand
        for foot in (0, 1)
        for stretch in _stretches(Stand(foot, 0, len(feet) - 1), low[:, foot], least)
        for stand in (
            _stretches(stretch, _resting(feet[:, foot]), least)
            or _stretches(stretch, _sliding(velocity[:, foot], stretch, leg), least)
        )
    ]


def _resting(foot: Float[Tensor, "frames 3"]) -> Bool[Tensor, "frames"]:
    """Where one foot is just where it was, or will be."""
    still = foot[:, [0, 2]].diff(dim=0).norm(dim=-1) < _RESTS
    never = still.new_zeros(1)
    return torch.cat([never, still]) | torch.cat([still, never])


def _sliding(
    velocity: Float[Tensor, "frames 3"], stretch: Stand, leg: float
) -> Bool[Tensor, "frames"]:
    """Where one foot slides as it mostly does within a stretch of time, if at all.

    Args:
        velocity: m/s.
        leg: metres.
    """
    floor = velocity[:, [0, 2]]
    usual = floor[stretch.first + median_place(floor[stretch.frames])]
    slides = usual.norm() < _SLIDE * leg
    return slides & ((floor - usual).norm(dim=-1) < SPEED_GAP * leg)


def _stretches(within: Stand, true: Bool[Tensor, "frames"], least: int) -> list[Stand]:
    """Runs of at least so many frames that are true, as far as they lie within another."""
    found, first = [], within.first
    for frame in range(within.first, within.last + 2):
        if frame > within.last or not true[frame]:
            if frame - first >= least:
                found.append(Stand(within.foot, first, frame - 1))
            first = frame + 1
    return found
