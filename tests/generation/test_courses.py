"""The eight paths that walkers are compared on."""

from __future__ import annotations

import math

import pytest
import torch

from posecast.errors import ConfigError
from posecast.generation import GaitTable
from posecast.generation.courses import (
    SECONDS,
    WALKING_SPEED,
    eight_courses,
    eight_paths,
    round_eight,
    walking_speed,
)
from posecast.motion.path_scale import ADULT_LEG


def turned(name: str) -> float:
    """Radians that a path turns to the left from its start to its end."""
    path = eight_paths()[name]
    return float(path.curvatures.sum()) * path.spacing


def test_there_are_eight_of_one_length() -> None:
    paths = eight_paths()
    assert len(paths) == 8
    for path in paths.values():
        assert path.length == pytest.approx(WALKING_SPEED * SECONDS, rel=2e-3)
        assert not path.closed
        assert path.points[0].tolist() == [0, 0]
        assert len(path.marks) >= 3


def test_left_turns_left_and_right_turns_right() -> None:
    """By 1.8 half turns; an S, an eight and a zigzag come out as they went in."""
    assert turned("circle-left") == pytest.approx(1.8 * math.pi, abs=0.3)
    assert turned("circle-right") == pytest.approx(-1.8 * math.pi, abs=0.3)
    assert turned("rounded-square") == pytest.approx(2 * math.pi, abs=0.2)
    assert turned("spiral") == pytest.approx(3.5 * math.pi, abs=0.3)
    assert turned("straight") == pytest.approx(0, abs=1e-9)
    for name in ("gentle-s", "figure-eight"):
        assert turned(name) == pytest.approx(0, abs=0.1)
    left = eight_paths()["circle-left"].points
    assert float(left[:, 0].max()) > 5  # +x is the left hand of who walks towards +z
    assert float(left[:, 0].min()) > -0.2


def test_paths_are_what_they_are_called() -> None:
    paths = eight_paths()
    bends = {name: float(path.curvatures.abs().max()) for name, path in paths.items()}
    assert bends["gentle-s"] < 0.2 < bends["circle-left"] < 0.5
    assert bends["zigzag"] > 10
    assert 1 < bends["rounded-square"] < 2
    ends = {name: float(path.points[-1].norm()) for name, path in paths.items()}
    assert max(ends["figure-eight"], ends["rounded-square"]) < 0.05
    radius = 1 / paths["spiral"].curvatures[[200, -200]]
    assert float(radius[0] / radius[1]) > 1.8


def test_the_figure_eight_crosses_itself_in_the_middle() -> None:
    path = eight_paths()["figure-eight"]
    middle = path.at(torch.tensor([path.length / 2]).double())
    assert float(middle.position.norm()) < 0.02
    assert float((middle.tangent[0] * path.tangents[0]).sum().abs()) < 0.1


def test_round_the_eight_is_closed_and_as_long() -> None:
    path = round_eight()
    assert path.closed
    assert path.length == pytest.approx(WALKING_SPEED * SECONDS, rel=2e-3)


def test_other_bodies_have_their_own() -> None:
    """Half a leg, half the way, at the speed at which it walks as an adult does."""
    small, adult = (eight_paths(leg) for leg in (ADULT_LEG / 2, ADULT_LEG))
    for name, path in small.items():
        assert path.length == pytest.approx(adult[name].length / 2, rel=2e-3)
        assert path.spacing == pytest.approx(adult[name].spacing / 2, rel=2e-3)
        assert path.smoothing == pytest.approx(adult[name].smoothing / 2)
        torch.testing.assert_close(path.marks, adult[name].marks / 2, rtol=0.01, atol=0.02)
    assert walking_speed(ADULT_LEG) == WALKING_SPEED
    assert walking_speed(ADULT_LEG / 4) == pytest.approx(WALKING_SPEED / 2)


def test_courses_last_about_fifteen_seconds(table: GaitTable) -> None:
    courses = eight_courses(table)
    assert list(courses) == list(eight_paths())
    for course in courses.values():
        assert 14.9 < course.duration < 21
        assert float(course.path.scalars["speed"].max()) <= WALKING_SPEED + 1e-9
    assert courses["straight"].duration == pytest.approx(SECONDS, rel=2e-3)
    slower = eight_courses(table, speed=0.55)["straight"]
    assert slower.duration == pytest.approx(2 * SECONDS, rel=2e-3)


def test_a_leg_has_a_length() -> None:
    with pytest.raises(ConfigError, match="expected a positive number of metres"):
        eight_paths(0.0)
