"""Eight paths that walkers are compared on, made from way points, as large as the body asks for."""

from __future__ import annotations

import math

import torch
from jaxtyping import Float
from torch import Tensor

from posecast.generation.annotate import pace_by_hand
from posecast.generation.course import Course
from posecast.generation.gait_table import GaitTable
from posecast.motion.path import Path
from posecast.motion.path_scale import ADULT_LEG, path_scale

WALKING_SPEED = 1.1
"""m/s on straight stretches, of an adult."""

SECONDS = 15.0
"""For one path, of an adult at that speed; longer where curves slow the pace down."""


def walking_speed(leg: float) -> float:
    """The speed at which a body walks as an adult does at ``WALKING_SPEED``, m/s.

    Args:
        leg: hip to ankle along the bones, metres.

    Source: equal Froude numbers; Alexander 1989.
    """
    return WALKING_SPEED * math.sqrt(leg / ADULT_LEG)


def eight_paths(leg: float = ADULT_LEG) -> dict[str, Path]:
    """Straight, S, circles, figure eight, square, zigzag and spiral, by name; all of one length.

    They begin at the origin, most of them towards +z, and are open: a circle ends where it begins
    but for a tenth. An adult's are 16.5 m long, others' in proportion to their legs.

    Args:
        leg: hip to ankle along the bones, metres.

    Raises:
        ConfigError: ``leg`` is not a positive number.
    """
    shapes = {
        "straight": torch.tensor([[0.0, 0.0], [0.0, 1.0], [0.0, 2.0]]),
        "gentle-s": _turning([(1.0, 1 / 3), (-1.0, 1 / 3)]),
        "circle-left": _turning([(1.0, 1.8)]),
        "circle-right": _turning([(-1.0, 1.8)]),
        "figure-eight": _eight(),
        "rounded-square": _square(corner=0.4, side=1.0),
        "zigzag": torch.tensor([[place % 2 * 1.0, float(place)] for place in range(7)]),
        "spiral": _spiral(first=1.0, last=0.4, turns=1.75),
    }
    return {name: _drawn(shape, leg, straight=name == "zigzag") for name, shape in shapes.items()}


def round_eight(leg: float = ADULT_LEG) -> Path:
    """The figure eight as a closed path, for walks of minutes."""
    return _drawn(_eight()[:-1], leg, closed=True)


def eight_courses(
    table: GaitTable, leg: float = ADULT_LEG, *, speed: float | None = None, style: int = 0
) -> dict[str, Course]:
    """The eight paths with a pace by hand (``pace_by_hand``), facing along them.

    Args:
        table: how the walker walks.
        leg: hip to ankle along the bones, metres.
        speed: m/s on straight stretches; ``None``: ``walking_speed``.
        style: row of the table.

    Raises:
        ConfigError: see ``eight_paths`` and ``pace_by_hand``.
    """
    wanted = walking_speed(leg) if speed is None else speed
    return {
        name: pace_by_hand(path, table, speed=wanted, style=style)
        for name, path in eight_paths(leg).items()
    }


def _drawn(
    shape: Float[Tensor, "waypoints 2"], leg: float, *, straight: bool = False, closed: bool = False
) -> Path:
    """A path of the length that all have through way points of any size."""
    scale, shape = path_scale(leg), shape.double()
    draft = Path.through(shape, straight=straight, closed=closed, spacing=0.01)
    longer = WALKING_SPEED * SECONDS * leg / ADULT_LEG / draft.length
    return Path.through(
        shape * longer,
        straight=straight,
        closed=closed,
        spacing=scale.spacing,
        smoothing=scale.smoothing,
    )


def _turning(arcs: list[tuple[float, float]]) -> Float[Tensor, "waypoints 2"]:
    """Arcs one after the other from the origin towards +z, a way point every eighth of a half turn.

    Args:
        arcs: (curvature, positive towards the left hand; how far to turn, in half turns) of each.
    """
    x, z, bearing = 0.0, 0.0, 0.0
    points = [(x, z)]
    for curvature, half_turns in arcs:
        steps = max(2, round(8 * half_turns))
        turn = math.copysign(math.pi * half_turns / steps, curvature)
        chord = 2 * math.sin(abs(turn) / 2) / abs(curvature)
        for _ in range(steps):
            middle = bearing + turn / 2
            x, z = x + chord * math.sin(middle), z + chord * math.cos(middle)
            bearing += turn
            points.append((x, z))
    return torch.tensor(points)


def _eight() -> Float[Tensor, "waypoints 2"]:
    """Once around both loops, the first on the left, which cross at a right angle at the origin.

    Source: the lemniscate of Gerono.
    """
    angle = torch.linspace(0, 2 * math.pi, 25, dtype=torch.float64)
    return torch.stack([angle.sin(), (2 * angle).sin() / 2], dim=-1)


def _square(*, corner: float, side: float) -> Float[Tensor, "waypoints 2"]:
    """Once around a square to the left, from the middle of a side, quarter circles for corners.

    Args:
        corner: radius of the corners.
        side: straight stretch between two corners.
    """
    x, z, bearing = 0.0, 0.0, 0.0
    points = [(x, z)]

    def go(way: float, towards: float) -> None:
        nonlocal x, z
        x, z = x + way * math.sin(towards), z + way * math.cos(towards)
        points.append((x, z))

    chord = 2 * corner * math.sin(math.pi / 12)
    for _ in range(4):
        go(side / 2, bearing)
        for third in range(3):
            go(chord, bearing + math.pi / 12 + third * math.pi / 6)
        bearing += math.pi / 2
        go(side / 2, bearing)
    return torch.tensor(points)


def _spiral(*, first: float, last: float, turns: float) -> Float[Tensor, "waypoints 2"]:
    """Inwards to the left, from the origin.

    Args:
        first, last: radii.
        turns: whole ones between them.
    """
    share = torch.linspace(0, 1, round(12 * turns) + 1, dtype=torch.float64)
    radius, angle = first + (last - first) * share, 2 * math.pi * turns * share
    around = torch.stack([-radius * angle.cos(), radius * angle.sin()], dim=-1)
    return around - around[0]
