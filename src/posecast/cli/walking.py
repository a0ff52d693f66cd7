"""What ``posecast walk`` does: a drawn path becomes a clip of somebody who walks along it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import torch

from posecast.config import did_you_mean
from posecast.errors import ConfigError
from posecast.export import Stepper
from posecast.export.stepper import check_mode
from posecast.generation import Course, GaitTable, Walk, arriving, pace_by_hand, walked_clip
from posecast.io.path_files import read_waypoints
from posecast.motion import Clip, find_feet, leg_length, path_scale
from posecast.system import System

WORTHWHILE = 1000
"""Frames from which on a faster step is worth the seconds that it takes to make it."""


@dataclass(frozen=True)
class Wishes:
    """How somebody is to walk.

    Args:
        speed: m/s on straight stretches; ``None``: the middle of what the walker knows.
        arrive: ``"SECONDS@POINT"`` each: when to be at which way point, counted from 1.
        facing: degrees from the path's direction towards the left hand; ``None``: along it.
        style: name of a style; ``None``: the first one, where there are several.
        seconds: how long to walk; ``None``: to the end of the path.
        mode: ``exact`` or ``fast``, see ``posecast.export.Stepper``.
    """

    speed: float | None = None
    arrive: Sequence[str] = ()
    facing: float | None = None
    style: str | None = None
    seconds: float | None = None
    mode: str = "exact"


def walk_along(system: System, file: Path, wishes: Wishes) -> tuple[Clip, Course]:
    """Walk along the path in a file.

    Returns:
        The clip, and the course it follows: the path, its pace and its times.

    Raises:
        ConfigError: a checkpoint that does not walk, or a wish it cannot grant.
        DataError: a file that holds no path, or times that nobody keeps.
    """
    gait = gait_of(system)
    style = style_number(system, wishes.style)
    offsets = torch.tensor(system.offsets, dtype=torch.float64)
    leg = leg_length(system.skeleton, offsets, find_feet(system.skeleton, offsets))
    scale = path_scale(leg)
    waypoints = read_waypoints(file)
    path = waypoints.path(spacing=scale.spacing, smoothing=scale.smoothing, name=file)
    facing = None if wishes.facing is None else math.radians(wishes.facing)
    course = pace_by_hand(path, gait, speed=wishes.speed, style=style, facing=facing)
    times = [math.nan] * len(path.marks) if waypoints.times is None else waypoints.times.tolist()
    for wish in wishes.arrive:
        place, seconds = _arrival(wish, len(times))
        times[place] = seconds
    marks = path.marks.tolist()
    wanted = {mark: time for mark, time in zip(marks, times, strict=False) if not math.isnan(time)}
    course = arriving(course, gait, wanted, style=style)
    walk = Walk(
        system.forecaster,
        course,
        gait,
        offsets,
        system.fps,
        style=style,
        stepper=_stepper(system, wishes, course),
    )
    return walked_clip(walk, wishes.seconds, name=file.stem), course


def gait_of(system: System) -> GaitTable:
    """How a system walks.

    Raises:
        ConfigError: it does not.
    """
    if system.gait is None:
        raise ConfigError(
            f"{system.recipe.name} does not walk along paths; take a checkpoint of a locomotion "
            "recipe (posecast recipes lists them)"
        )
    return system.gait


def style_number(system: System, name: str | None, *, option: str = "--style") -> int:
    """The number of a style by its name; ``None`` is the first.

    Args:
        option: what errors call the place where the name was given.

    Raises:
        ConfigError: the walker has no such style.
    """
    controls = system.forecaster.codec.controls
    styles = () if controls is None else controls.styles
    if name is None:
        return 0
    if not styles:
        raise ConfigError(f"{option} {name}: this walker has no styles; leave it out")
    if name not in styles:
        raise ConfigError(f"{option} {name}: unknown; {did_you_mean(name, styles)}")
    return styles.index(name)


def _stepper(system: System, wishes: Wishes, course: Course) -> Stepper | None:
    """What steps in the network's place; ``None`` where making it takes longer than it saves."""
    check_mode(wishes.mode)
    seconds = course.duration if wishes.seconds is None else wishes.seconds
    if wishes.mode == "exact" and seconds * system.fps < WORTHWHILE:
        return None
    return Stepper(system.forecaster, cast("Any", wishes.mode))


def _arrival(wish: str, waypoints: int) -> tuple[int, float]:
    """Which way point, from 0, and when: ``12.5@3`` is the third after 12.5 s."""
    seconds, at, place = wish.partition("@")
    try:
        found = int(place) - 1, float(seconds)
    except ValueError:
        found = None
    if not at or found is None:
        raise ConfigError(
            f"--arrive {wish}: expected SECONDS@POINT, such as 12.5@3 for the third way point"
        )
    if not 0 <= found[0] < waypoints:
        raise ConfigError(f"--arrive {wish}: the path has {waypoints} way points, counted from 1")
    return found
