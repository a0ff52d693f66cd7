"""Carriage: how pelvis, chest and head ride on the legs, and how the arms answer them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float
from numpy import ndarray

from posecast.corpora.gait.body import SKELETON, Body
from posecast.corpora.gait.feet import Foot
from posecast.corpora.gait.footfalls import LEAN, directions
from posecast.corpora.gait.manner import Manner
from posecast.corpora.gait.pace import GRAVITY, GRID_RATE, Journey
from posecast.corpora.gait.rhythm import Rhythm, duty, running
from posecast.corpora.gait.signals import Sampled, Wobble, smooth, smooth_cover
from posecast.geometry.euler import euler_to_quaternion
from posecast.geometry.quaternion import rotate

REACH = (0.994, 0.986)
"""Largest share of its full length that a leg is stretched to, in walking and in running."""


class Restlessness(NamedTuple):
    """Slow variation of one clip."""

    swing: Wobble
    look: Wobble
    nod: Wobble
    lean: Wobble
    drift: Wobble

    @classmethod
    def draw(cls, generator: np.random.Generator) -> Restlessness:
        """Draw every wobble anew."""
        bounds = ((0.05, 0.4), (0.05, 0.35), (0.05, 0.5), (0.05, 0.4), (0.1, 0.6))
        return cls(*(Wobble.draw(generator, low, high) for low, high in bounds))


@dataclass(frozen=True, eq=False)
class Carriage:
    """The upper body over time. Angles of yaw, pitch (forward), roll (to the right), radians.

    Args:
        root: world position of the pelvis.
        pelvis, chest, head: orientation in the world.
        arms: forward swing of the left and the right upper arm, radians.
        elbows: their bend, radians.
        running: 0 in walking, 1 in running.
        facing: where the body faces, without the turning of the pelvis in each step, radians.
    """

    root: Sampled
    pelvis: Sampled
    chest: Sampled
    head: Sampled
    arms: Sampled
    elbows: Sampled
    running: Sampled
    facing: Sampled


def carry(
    journey: Journey,
    rhythm: Rhythm,
    feet: tuple[Foot, Foot],
    body: Body,
    manner: Manner,
    restless: Restlessness,
) -> Carriage:
    """Let the upper body follow the feet; the pelvis stays within reach of both ankles.

    Args:
        feet: the left and the right foot on the planning grid.
    """
    cue = _follow(journey, rhythm, feet, body, manner, restless)
    pelvis, chest, head = _trunk(cue, journey.times, manner, restless)
    root = _root(cue, journey, rhythm, body, manner, restless)
    root[:, 1] -= _sink(root, pelvis, feet, cue.running, body)
    arms, elbows = _swing(cue, journey.times, manner, restless)
    curves = (root, pelvis, chest, head, arms, elbows, cue.running, cue.facing)
    return Carriage(*(journey.sampled(curve) for curve in curves))


class _Cue(NamedTuple):
    """What the upper body goes by, on the planning grid.

    Args:
        facing: heading, smoothed, radians.
        apart: right foot ahead of the left one, in leg lengths.
        load: weight on the right leg less that on the left one, -1 to 1.
        running: 0 in walking, 1 in running.
        sideways: lean into a curve, to the left, radians.
        lean: lean forward of the trunk, radians.
    """

    facing: Float[ndarray, " grid"]
    apart: Float[ndarray, " grid"]
    load: Float[ndarray, " grid"]
    running: Float[ndarray, " grid"]
    sideways: Float[ndarray, " grid"]
    lean: Float[ndarray, " grid"]


def _follow(
    journey: Journey,
    rhythm: Rhythm,
    feet: tuple[Foot, Foot],
    body: Body,
    manner: Manner,
    restless: Restlessness,
) -> _Cue:
    """Read speed, curve and footwork; blurred in time, so that the body also anticipates them."""
    pace = np.sqrt(body.size) * GRID_RATE
    place, speed = journey.path.at(journey.distance.values), journey.speed.values
    facing = smooth(place.heading, 0.10 * pace)
    left, right = feet
    between = (right.ankle - left.ankle)[:, [0, 2]]
    apart = (between * directions(facing)[0]).sum(axis=-1) / body.leg
    load = right.standing.astype(float) - left.standing.astype(float)
    share = running(rhythm.froude)
    urge = smooth(np.gradient(speed, journey.times), 0.10 * pace) / GRAVITY
    lean = manner.lean + 0.05 * rhythm.froude + 0.06 * share + 0.6 * urge
    drift = 0.012 * manner.restlessness * restless.lean(journey.times)
    return _Cue(
        facing=facing,
        apart=smooth(apart, 0.055 * pace),
        load=smooth(load, 0.085 * pace),
        running=share,
        sideways=smooth(np.arctan(LEAN * place.curvature * speed**2 / GRAVITY), 0.12 * pace),
        lean=lean + drift,
    )


def _trunk(
    cue: _Cue, times: Float[ndarray, " grid"], manner: Manner, restless: Restlessness
) -> tuple[Float[ndarray, "grid 3"], Float[ndarray, "grid 3"], Float[ndarray, "grid 3"]]:
    """Pelvis and chest turn against each other; the head looks ahead and stays upright."""
    turning = 0.11 * manner.twist * cue.apart
    drop = manner.drop * cue.load
    look = 0.07 * manner.restlessness * restless.look(times)
    nod = 0.03 * manner.restlessness * restless.nod(times)
    pelvis = (
        cue.facing + turning,
        0.05 + 0.35 * cue.lean,
        -0.065 * (1 - 0.3 * cue.running) * drop - 0.7 * cue.sideways,
    )
    chest = (
        _sooner(cue.facing, 0.06) - (1.0 + 0.6 * cue.running) * turning,
        cue.lean + 0.55 * manner.slouch,
        0.012 * drop - cue.sideways,
    )
    head = (
        _sooner(cue.facing, 0.28) + look,
        0.02 + manner.gaze + 0.25 * manner.slouch + nod,
        -0.35 * cue.sideways,
    )
    return np.stack(pelvis, axis=-1), np.stack(chest, axis=-1), np.stack(head, axis=-1)


def _root(
    cue: _Cue,
    journey: Journey,
    rhythm: Rhythm,
    body: Body,
    manner: Manner,
    restless: Restlessness,
) -> Float[ndarray, "grid 3"]:
    """Pelvis as it would be on legs of any length: swaying, surging, rising and falling.

    The body is slowest in mid-stance and fastest when the weight goes from foot to foot.
    """
    ahead, leftwards = directions(cue.facing)
    drift = 0.006 * manner.restlessness * restless.drift(journey.times)
    sway = body.size * (drift - 0.024 * manner.sway * cue.load)
    stride = journey.speed.values / np.maximum(rhythm.rate, 1.0)
    wave = np.sin(2 * np.pi * (rhythm.count - duty(rhythm.froude)))
    surge = -0.016 * (1 - 0.65 * cue.running) * np.minimum(stride, body.leg) * wave
    floor = journey.path.at(journey.distance.values).position
    floor = floor + sway[:, None] * leftwards + surge[:, None] * ahead
    height = _height(rhythm, journey.speed.values, body, manner)
    return np.stack([floor[:, 0], height, floor[:, 1]], axis=-1)


def _sooner(values: Float[ndarray, " grid"], seconds: float) -> Float[ndarray, " grid"]:
    """The same curve a little earlier: gaze and chest go ahead of the pelvis in a turn."""
    shift = round(seconds * GRID_RATE)
    return np.concatenate([values[shift:], np.repeat(values[-1:], shift)])


def _height(
    rhythm: Rhythm, speed: Float[ndarray, " grid"], body: Body, manner: Manner
) -> Float[ndarray, " grid"]:
    """Pelvis above the floor: highest in mid-stance when walking, lowest there when running.

    Walking vaults over a stiff leg. Running is a spring: with amplitude A at step rate f the
    acceleration A (2 pi f)^2 comes close to gravity, and so the body flies.
    """
    share, rate = running(rhythm.froude), np.maximum(rhythm.rate, 1.0)
    vault = 0.12 * (speed / rate) ** 2 / (8 * body.leg) * manner.bounce
    spring = 0.85 * GRAVITY / (2 * np.pi * rate) ** 2 * manner.bounce
    wave = np.cos(2 * np.pi * (rhythm.count - duty(rhythm.froude)))
    walk = -manner.knee * body.leg + vault * (wave - 1)
    run = -(0.030 + manner.knee) * body.leg - spring * wave
    return body.ankle_height + body.leg + body.hip_drop + (1 - share) * walk + share * run


def _sink(
    root: Float[ndarray, "grid 3"],
    pelvis: Float[ndarray, "grid 3"],
    feet: tuple[Foot, Foot],
    share: Float[ndarray, " grid"],
    body: Body,
) -> Float[ndarray, " grid"]:
    """How far the pelvis must come down, smoothly, for both legs to reach their ankles."""
    turn = euler_to_quaternion(torch.from_numpy(pelvis), "yxz")
    excess, longest = np.zeros(len(root)), REACH[0] + share * (REACH[1] - REACH[0])
    for name, foot in zip(("LeftUpLeg", "RightUpLeg"), feet, strict=True):
        offset = body.offsets[SKELETON.index(name)]
        hip = root + rotate(turn, offset.expand(len(root), 3)).numpy()
        apart = ((hip - foot.ankle)[:, [0, 2]] ** 2).sum(axis=-1)
        tall = np.sqrt(np.maximum((longest * body.leg) ** 2 - apart, 0.0))
        excess = np.maximum(excess, hip[:, 1] - foot.ankle[:, 1] - tall)
    return smooth_cover(excess, round(0.05 * GRID_RATE * np.sqrt(body.size)))


def _swing(
    cue: _Cue, times: Float[ndarray, " grid"], manner: Manner, restless: Restlessness
) -> tuple[Float[ndarray, "grid 2"], Float[ndarray, "grid 2"]]:
    """Each arm swings with the opposite leg; elbows give way in front, and are bent in running."""
    share = cue.running
    gain = (0.42 + 0.16 * share) * manner.swing
    gain = gain * (1 + 0.10 * manner.restlessness * restless.swing(times))
    uneven = 1 + 0.15 * np.array([manner.unevenness, -manner.unevenness])
    swing = (gain * cue.apart)[:, None] * np.array([1.0, -1.0]) * uneven
    rest = 0.85 * cue.lean + 0.4 * manner.slouch - 0.22 * share
    give = np.tanh(3 * swing) / 3
    bent = (1 - share) * manner.elbow + share * 1.50
    return rest[:, None] + swing, bent[:, None] + (0.45 - 0.2 * share)[:, None] * give
