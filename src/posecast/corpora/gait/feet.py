"""Feet over time: planted and rolling from heel to toe, or swinging to the next place."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from posecast.corpora.gait.body import Body
from posecast.corpora.gait.footfalls import Footfalls, directions
from posecast.corpora.gait.manner import Manner
from posecast.corpora.gait.signals import State, ease, glide, step

PUSH_RATE = 1.5
"""How fast the heel rises at lift-off, against rising evenly; it keeps that pace into the swing."""

TOES_RELAX = 0.75
"""Share of the swing after which the toes are straight again."""


TOES_UP = 0.92
"""Share of the swing after which the foot is pitched as it will touch down."""


class Foot(NamedTuple):
    """One foot over time.

    Args:
        ankle: world position, metres.
        yaw: direction, radians from +z towards +x.
        pitch: toes up, radians; negative: heel up.
        bend: toes up against the foot, radians.
        planted: the ball of the foot stays where it is, flat on the floor.
        standing: the foot touches the floor at all: planted, or rolling over its heel.
    """

    ankle: Float[ndarray, "times 3"]
    yaw: Float[ndarray, " times"]
    pitch: Float[ndarray, " times"]
    bend: Float[ndarray, " times"]
    planted: Bool[ndarray, " times"]
    standing: Bool[ndarray, " times"]


def move_foot(
    times: Float[ndarray, " times"],
    footfalls: Footfalls,
    body: Body,
    manner: Manner,
    *,
    left: bool,
) -> Foot:
    """Pose of the left or the right foot at some times."""
    mine = np.flatnonzero(footfalls.left == left)
    place = np.searchsorted(footfalls.touchdown[mine], times, side="right") - 1
    place = np.maximum(place, 0)
    here, there = mine[place], mine[np.minimum(place + 1, len(mine) - 1)]

    landed, lifted = footfalls.touchdown[here], footfalls.liftoff[here]
    standing = times <= lifted
    swing = footfalls.touchdown[there] - lifted
    u = (times - lifted) / swing
    pitch, bend = _roll(times, u, footfalls, here, there)
    weight = np.where(standing, 0.0, glide(u, 0.14, 0.16 - 0.06 * footfalls.running[there]))
    yaw = footfalls.yaw[here] + step(u) * (footfalls.yaw[there] - footfalls.yaw[here])

    ball, ball_depth, heel, heel_depth = _sole(pitch, body)
    on_heel = standing & (pitch > 0)
    ahead, leftwards = directions(yaw)
    over_ball = footfalls.ball[here] - ball[:, None] * ahead
    pivot = np.where(standing, here, there)
    length = body.ball_ahead + body.heel_behind
    heel_spot = footfalls.ball[pivot] - length * directions(footfalls.yaw[pivot])[0]
    over_heel = heel_spot - heel[:, None] * ahead
    weight = np.where(on_heel, 1.0, weight)
    bump = np.where(standing, 0.0, 64 * np.clip(u * (1 - u), 0, 1) ** 3)
    outwards = (1 if left else -1) * 0.012 * body.size * bump
    floor_plan = over_ball + weight[:, None] * (over_heel - over_ball)
    floor_plan = floor_plan + outwards[:, None] * leftwards

    toe_depth = ball_depth - body.toe_ahead * np.sin(pitch + bend)
    softness = 0.028 * body.size * bump
    swinging = _soft_maximum(_soft_maximum(ball_depth, toe_depth, softness), heel_depth, softness)
    swinging = swinging + _clearance(u, footfalls, here, there, body, manner)
    resting = np.where(on_heel, heel_depth, ball_depth)
    height = np.where(standing, resting, swinging)
    return Foot(
        ankle=np.stack([floor_plan[:, 0], height, floor_plan[:, 1]], axis=-1),
        yaw=yaw,
        pitch=pitch,
        bend=bend,
        planted=standing & (times >= footfalls.planted[here]),
        standing=standing & (times >= landed),
    )


def _roll(
    times: Float[ndarray, " times"],
    u: Float[ndarray, " times"],
    footfalls: Footfalls,
    here: Int[ndarray, " times"],
    there: Int[ndarray, " times"],
) -> tuple[Float[ndarray, " times"], Float[ndarray, " times"]]:
    """Pitch of the foot and bend of its toes: heel down, flat, heel up, swing, toes up."""
    landed, lifted = footfalls.touchdown[here], footfalls.liftoff[here]
    rise, push = lifted - footfalls.rising[here], footfalls.push[here]
    rocking = (times - landed) / (footfalls.planted[here] - landed)
    down = footfalls.strike[here] * (1 - step(rocking))
    rising = (times - footfalls.rising[here]) / rise
    heel_up = ease(rising, State(0.0), State(push, PUSH_RATE * push))
    swing = footfalls.touchdown[there] - lifted
    rate = PUSH_RATE * push * swing / rise
    carried = ease(u / TOES_UP, State(-push, -rate * TOES_UP), State(footfalls.strike[there]))
    relaxing = ease(u / TOES_RELAX, State(push, rate * TOES_RELAX), State(0.0))
    standing = times <= lifted
    pitch = np.where(standing, down - heel_up, carried)
    return pitch, np.where(standing, heel_up, relaxing)


def _sole(
    pitch: Float[ndarray, " times"], body: Body
) -> tuple[
    Float[ndarray, " times"],
    Float[ndarray, " times"],
    Float[ndarray, " times"],
    Float[ndarray, " times"],
]:
    """How far ahead of and how deep below the ankle the ball and the heel reach, metres."""
    sine, cosine = np.sin(pitch), np.cos(pitch)
    drop = body.ankle_height - body.ball_height
    ball = body.ball_ahead * cosine + drop * sine
    ball_depth = body.ball_height + drop * cosine - body.ball_ahead * sine
    heel = body.ankle_height * sine - body.heel_behind * cosine
    heel_depth = body.ankle_height * cosine + body.heel_behind * sine
    return ball, ball_depth, heel, heel_depth


def _clearance(
    u: Float[ndarray, " times"],
    footfalls: Footfalls,
    here: Int[ndarray, " times"],
    there: Int[ndarray, " times"],
    body: Body,
    manner: Manner,
) -> Float[ndarray, " times"]:
    """Lowest point of the swinging foot above the floor, metres; a runner's heel comes up high."""
    u = np.clip(u, 0, 1)
    stride = np.linalg.norm(footfalls.ball[there] - footfalls.ball[here], axis=-1) / body.leg
    share = (footfalls.running[here] + footfalls.running[there]) / 2
    walk = 0.013 * body.leg * manner.lift * np.clip(stride, 0.4, 1.5)
    run = 0.085 * body.leg * np.clip(stride - 0.8, 0, 2.4) * manner.lift**0.5
    low = 64 * (u * (1 - u)) ** 3
    high = u**3 * (1 - u) ** 2.5 / ((6 / 11) ** 3 * (5 / 11) ** 2.5)
    return (1 - share) * walk * low + share * run * high


def _soft_maximum(
    a: Float[ndarray, " times"], b: Float[ndarray, " times"], softness: Float[ndarray, " times"]
) -> Float[ndarray, " times"]:
    """The larger of two, rounded off where they are closer than ``softness``; never below it."""
    return (a + b + np.sqrt((a - b) ** 2 + softness**2)) / 2
