"""Footfalls: where and when each foot is put down, and how it leaves the floor again."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray

from posecast.corpora.gait.body import Body
from posecast.corpora.gait.manner import Manner
from posecast.corpora.gait.pace import GRAVITY, Journey
from posecast.corpora.gait.rhythm import FOREVER, Rhythm, duty, running
from posecast.corpora.gait.signals import step

LONGEST_SWING = 0.52
"""Seconds that an adult's foot is in the air at most, however slowly the walk goes."""

FARTHEST = 0.46
"""A foot is put down at most so far ahead of the body, in leg lengths."""

BODY_OVER = (0.58, 0.70)
"""Where the body passes over the foot in mid-stance, walking and running: 0 ankle, 1 ball."""

HEEL_FOLLOWS = 0.22
"""The heel rises at the latest when the body is so far ahead of the foot, in leg lengths."""

FASTEST_SLAP = 4.5
"""Mean rate at which the foot comes down flat from heel strike, radians a second, at most."""

LEAN = 0.75
"""Share of a curve's sideways acceleration that the body leans against."""


@dataclass(frozen=True, eq=False)
class Footfalls:
    """Every time a foot stands, in order of touch-down.

    Args:
        left: whether it is the left foot.
        touchdown: the heel meets the floor, seconds.
        planted: the ball of the foot is down as well; the foot is flat.
        rising: the heel begins to rise.
        liftoff: the toes leave the floor.
        ball: x and z of the joint of the toes while planted, metres.
        yaw: direction of the foot, radians.
        strike: pitch of the foot at touch-down, toes up, radians.
        push: pitch at lift-off, heel up, radians.
        running: 0 in walking, 1 in running.
    """

    left: Bool[ndarray, " steps"]
    touchdown: Float[ndarray, " steps"]
    planted: Float[ndarray, " steps"]
    rising: Float[ndarray, " steps"]
    liftoff: Float[ndarray, " steps"]
    ball: Float[ndarray, "steps 2"]
    yaw: Float[ndarray, " steps"]
    strike: Float[ndarray, " steps"]
    push: Float[ndarray, " steps"]
    running: Float[ndarray, " steps"]


def plan_footfalls(
    journey: Journey,
    rhythm: Rhythm,
    body: Body,
    manner: Manner,
    generator: np.random.Generator,
) -> Footfalls:
    """Put the feet down so that the body passes over each in the middle of its stance.

    Args:
        generator: draws how far each foot lands from where it should, millimetres and degrees.
    """
    down, left = rhythm.touchdowns, rhythm.numbers % 2 == 1
    liftoff = _liftoffs(journey, rhythm, body)
    moment = (down + liftoff) / 2
    for begin, end in journey.rests:
        through = (down <= begin) & (liftoff >= end)
        moment = np.where(through, np.clip(moment, begin, end), moment)
    farthest = FARTHEST * body.leg
    distance = np.minimum(journey.distance(moment), journey.distance(down) + farthest)
    liftoff = np.minimum(liftoff, _passing(journey, distance + 1.1 * farthest))
    share = running(np.interp(moment, journey.times, rhythm.froude))
    ball, yaw = _spots(journey, rhythm, distance, moment, left, body, manner, generator)

    stance = np.minimum(liftoff - down, 1.2 * np.sqrt(body.size))
    double = np.append(np.inf, liftoff[:-1]) - down
    rocker = np.where(double > 0, np.minimum(0.14 * stance, 0.8 * double), 0.10 * stance)
    rocker = np.minimum(rocker, 0.19 * np.append(np.diff(down), np.inf))
    rise = np.minimum((0.45 + 0.15 * share) * (liftoff - down), 0.32 * np.sqrt(body.size))
    left_behind = _passing(journey, distance + HEEL_FOLLOWS * body.leg)
    rising = np.maximum(np.minimum(liftoff - rise, left_behind), down + 1.2 * rocker)
    stepped = np.diff(distance, prepend=distance[0]) / (0.85 * body.leg)
    strike = manner.strike * np.clip(stepped, 0.1, 1.15) * (1 - 0.65 * share)
    strode = (np.append(distance[2:], [distance[-1]] * 2) - distance) / (1.7 * body.leg)
    return Footfalls(
        left=left,
        touchdown=down,
        planted=down + rocker,
        rising=rising,
        liftoff=liftoff,
        ball=ball,
        yaw=yaw,
        strike=np.minimum(strike, FASTEST_SLAP * rocker),
        push=(1.0 - 0.1 * share) * manner.push * np.clip(strode, 0.15, 1.3) ** 0.5,
        running=share,
    )


def _liftoffs(journey: Journey, rhythm: Rhythm, body: Body) -> Float[ndarray, " steps"]:
    """When each foot leaves the floor: as long before it lands again as a swing takes."""
    down = rhythm.touchdowns
    froude = np.interp(down[1:-1], journey.times, rhythm.froude)
    swing = (1 - duty(froude)) * (down[2:] - down[:-2])
    swing = np.minimum(swing, LONGEST_SWING * np.sqrt(body.size))
    alone = 0.90 * (down[2:] - down[1:-1])
    swing = np.where(running(froude) < 0.5, np.minimum(swing, alone), swing)
    return np.append(down[2:] - swing, [FOREVER, FOREVER])


def _passing(journey: Journey, distance: Float[ndarray, " steps"]) -> Float[ndarray, " steps"]:
    """When the body comes by, seconds; infinite if it does not."""
    return np.interp(distance, journey.distance.values, journey.times, right=np.inf)


def _spots(
    journey: Journey,
    rhythm: Rhythm,
    distance: Float[ndarray, " steps"],
    moment: Float[ndarray, " steps"],
    left: Bool[ndarray, " steps"],
    body: Body,
    manner: Manner,
    generator: np.random.Generator,
) -> tuple[Float[ndarray, "steps 2"], Float[ndarray, " steps"]]:
    """Where the ball of each foot is planted, and in which direction the foot points."""
    froude = np.interp(moment, journey.times, rhythm.froude)
    share, side = running(froude), np.where(left, 1, -1)
    place = journey.path.at(distance)
    jitter = manner.restlessness * generator.normal(0, [0.007, 0.005, 0.020], (len(left), 3))
    spread = 0.20 - 0.085 * step(froude / 0.25)
    spread = ((1 - share) * spread + share * 0.055) * manner.width * body.leg
    sideways = side * spread / 2 - _lean_shift(place.curvature, journey.speed(moment), body)
    sideways = sideways + body.size * jitter[:, 1]
    yaw = place.heading + side * manner.toe_out * (1 - 0.5 * share) + jitter[:, 2]
    over = BODY_OVER[0] + share * (BODY_OVER[1] - BODY_OVER[0])
    ahead, leftwards = directions(place.heading)
    under = place.position + sideways[:, None] * leftwards + body.size * jitter[:, :1] * ahead
    return under + (1 - over)[:, None] * body.ball_ahead * directions(yaw)[0], yaw


def _lean_shift(
    curvature: Float[ndarray, " places"], speed: Float[ndarray, " places"], body: Body
) -> Float[ndarray, " places"]:
    """How far the hips are inside of the feet in a curve, metres; positive to the left."""
    return LEAN * curvature * speed**2 / GRAVITY * body.leg


def directions(
    heading: Float[ndarray, " places"],
) -> tuple[Float[ndarray, "places 2"], Float[ndarray, "places 2"]]:
    """Unit vectors (x, z) ahead and to the left of a heading."""
    ahead = np.stack([np.sin(heading), np.cos(heading)], axis=-1)
    return ahead, np.stack([ahead[:, 1], -ahead[:, 0]], axis=-1)
