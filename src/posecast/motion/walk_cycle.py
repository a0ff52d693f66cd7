"""Walk-cycle phase: which foot is the faster one, when they change, and how quickly."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch import Tensor

from posecast.motion.contacts import COOLDOWN, SPEED_GAP, foot_speeds
from posecast.motion.low_pass import gaussian

_LONGEST_STEP = 1.5
"""Seconds: what takes longer is no step of a walk."""

_USUAL_STEP = 0.55
"""Seconds, where a clip has a single step and nothing else tells."""

_PAUSE = 0.5
"""Seconds for which both feet may be still within a walk: longer than any double support."""

_CUT = 0.2
"""Seconds for which both feet may be still at an end of the clip that cuts through a walk."""

_SMOOTHING = 0.5
"""Standard deviation of the smoothing of the step rate, in steps."""


class WalkCycle(NamedTuple):
    """Where in the walk cycle each frame is.

    Args:
        phase: radians, growing by pi with each step: 0 modulo 2 pi where the right foot becomes
            the slower one, pi where the left one does, linear in between.
        walking: whether the phase means something.
        step_rate: radians of phase a second, smoothed; 0 where nobody walks.
        stride: seconds that two steps take, median; ``None`` where there is no whole step.
    """

    phase: Float[Tensor, "frames"]
    walking: Bool[Tensor, "frames"]
    step_rate: Float[Tensor, "frames"]
    stride: float | None


class _Switch(NamedTuple):
    """A change of the standing foot.

    Args:
        frame: when both feet are equally fast, between frames.
        noticed: frame in which the other one has become clearly faster.
        left: whether the left foot stands from then on.
    """

    frame: float
    noticed: int
    left: bool


class _Knot(NamedTuple):
    """A frame, or a moment between two, and its phase, which is linear up to the next knot."""

    frame: float
    phase: float


def find_walk_cycle(
    ankles: Float[Tensor, "frames 2 3"], *, fps: float | int, leg: float
) -> WalkCycle:
    """Find the walk cycle from the speeds of both feet, left and right.

    The standing foot changes once the other one is slower by ``SPEED_GAP``, at the last moment
    before at which both were equally fast, and not again for ``COOLDOWN``. In walking this is
    when the heel touches down, in running half-way through the flight before.

    A person walks from where a foot begins to move to where both stay still for more than half a
    second, if the standing foot changes in between; steps longer than 1.5 s are none. Before the
    first and after the last change of such a stretch the phase goes on at the rate of the step
    beside, by one step at most. Where nobody walks it leads on to the next stretch.

    Args:
        ankles: world positions, metres.
        fps: frames a second.
        leg: length of a leg, metres.

    Source: the code of Pavllo et al. 2020, where the left foot's contact begins at pi as here
    (their text has it the other way round). There a change is where the threshold is passed, and
    after the last one the phase stays as it is.
    """
    speed = foot_speeds(ankles, fps) / leg
    stretches = _stretches(speed, pause=_PAUSE * fps, cut=_CUT * fps)
    switches = _switches((speed[:, 0] - speed[:, 1]).tolist(), cooldown=COOLDOWN * fps)
    longest = _LONGEST_STEP * fps
    steps = [later.frame - sooner.frame for sooner, later in pairwise(switches)]
    steps = [step for step in steps if step <= longest]
    usual = float(np.median(steps)) if steps else _USUAL_STEP * fps
    walking = torch.zeros(len(ankles), dtype=torch.bool)
    knots: list[_Knot] = []
    for stretch in stretches:
        within = [switch for switch in switches if switch.noticed in stretch]
        if within:
            added = _stretch_knots(stretch, within, knots[-1].phase if knots else 0.0, usual)
            knots += added
            for start, stop in pairwise(knot.frame for knot in added):
                if stop - start <= longest:
                    walking[math.ceil(start) : math.floor(stop) + 1] = True
    phase = _interpolate(knots, len(ankles))
    rate = _smooth_rate(phase, walking, sigma=_SMOOTHING * usual) * fps
    return WalkCycle(phase, walking, rate, 2 * usual / fps if steps else None)


def _stretches(speed: Float[Tensor, "frames 2"], *, pause: float, cut: float) -> list[range]:
    """Frames from where a foot begins to move up to where both are still for longer than a pause.

    Args:
        speed: leg lengths a second.
        pause: frames.
        cut: the same at the ends of the clip.
    """
    stretches: list[range] = []
    for frame in (speed.amax(dim=-1) > SPEED_GAP).nonzero().flatten().tolist():
        first = frame
        if stretches and frame - stretches[-1].stop < pause:
            first = stretches.pop().start
        stretches.append(range(first, frame + 1))
    if stretches and stretches[0].start <= cut:
        stretches[0] = range(stretches[0].stop)
    if stretches and len(speed) - stretches[-1].stop <= cut:
        stretches[-1] = range(stretches[-1].start, len(speed))
    return stretches


def _switches(difference: list[float], *, cooldown: float) -> list[_Switch]:
    """Changes of the standing foot.

    Args:
        difference: speed of the left foot less that of the right one, leg lengths a second.
        cooldown: frames.
    """
    switches: list[_Switch] = []
    faster, free = 0, 0.0  # 1: the left foot is the faster one, -1: the right one, 0: not known
    for frame, gap in enumerate(difference):
        side = 1 if gap > 0 else -1
        if abs(gap) <= SPEED_GAP or side == faster or frame < free:
            continue
        crossing = _crossing(difference, frame, side)
        if crossing is not None:
            switches.append(_Switch(crossing, frame, left=side < 0))
        faster, free = side, frame + cooldown
    return switches


def _crossing(difference: list[float], place: int, side: int) -> float | None:
    """Last zero before a place from which on the sign is that side; ``None``: always was so."""
    while place > 0:
        before, here = side * difference[place - 1], side * difference[place]
        if before <= 0:
            return place - here / (here - before)
        place -= 1
    return None


def _stretch_knots(
    stretch: range, switches: list[_Switch], reached: float, usual: float
) -> list[_Knot]:
    """Phases of one stretch of walking, the first no less than what the stretch before reached.

    Args:
        stretch: its frames.
        switches: those within, one at least.
        reached: radians.
        usual: frames of a step where there is no other to compare with.
    """
    times = [max(switch.frame, stretch.start) for switch in switches]
    steps = [later - sooner for sooner, later in pairwise(times)] or [usual]
    before, after = times[0] - stretch.start, stretch.stop - 1 - times[-1]
    lead = math.pi * min(1.0, before / steps[0])
    follow = math.pi * min(1.0, after / steps[-1])
    place = math.pi if switches[0].left else 0.0
    rounds = math.ceil((reached + lead - place) / (2 * math.pi) - 1e-9)
    first = place + 2 * math.pi * max(rounds, 0)
    knots = [_Knot(time, first + math.pi * step) for step, time in enumerate(times)]
    if before > 0:
        knots.insert(0, _Knot(stretch.start, first - lead))
    if after > 0:
        knots.append(_Knot(stretch.stop - 1, knots[-1].phase + follow))
    return knots


def _interpolate(knots: list[_Knot], frames: int) -> Float[Tensor, "frames"]:
    """Phase of every frame; it stays as it is before the first and after the last knot."""
    if not knots:
        return torch.zeros(frames, dtype=torch.float64)
    times, phases = zip(*knots, strict=True)
    return torch.from_numpy(np.interp(np.arange(frames), times, phases))


def _smooth_rate(
    phase: Float[Tensor, "frames"], walking: Bool[Tensor, "frames"], *, sigma: float
) -> Float[Tensor, "frames"]:
    """Radians a frame, a Gaussian mean over the frames around in which somebody walks."""
    if not walking.any() or len(phase) < 2:
        return torch.zeros_like(phase)
    (rate,) = torch.gradient(phase)
    share = gaussian(walking.double(), sigma, ends="even")
    mean = gaussian(rate * walking, sigma, ends="even") / share.clamp_min(1e-12)
    return torch.where(walking, mean, 0.0)
