"""A pace by hand: slower in curves, and at way points in time."""

from __future__ import annotations

import math

import pytest
import torch

from posecast.errors import ConfigError, DataError
from posecast.generation import arriving, pace_by_hand
from posecast.generation.annotate import CALM
from posecast.motion.path import Path
from posecast.motion.tracks import FACING, SPEED, STEP_RATE


@pytest.mark.parametrize("path", ["bend", "circle"])
def test_a_pace_asks_for_no_more_acceleration_than_is_usual(path, request, table):
    path = request.getfixturevalue(path)
    course = pace_by_hand(path, table, speed=2.4)
    speed = course.path.scalars[SPEED]
    gain = speed.square().diff() / (2 * path.spacing)
    assert gain.abs().max() <= CALM * 1.0 + 1e-6
    if path.closed:
        assert abs(speed[0] ** 2 - speed[-1] ** 2) / (2 * path.spacing) <= CALM * 1.0 + 1e-6
    sideways = speed.square() * path.curvatures.abs()
    slowest = speed <= 0.5 + 1e-9
    assert (sideways <= CALM * 2.0 + 1e-6)[~slowest].all()


def test_a_runner_slows_before_a_corner_and_not_only_in_it(bend, table):
    speed = pace_by_hand(bend, table, speed=2.4).path.scalars[SPEED]
    corner, ahead = (round(place / bend.spacing) for place in (4.0, 3.0))
    assert speed[corner] < speed[ahead] < 2.4 - 0.1
    assert speed[corner] == pytest.approx(0.5, abs=0.05)
    even = pace_by_hand(bend, table, speed=2.4, slow_in_curves=False).path.scalars[SPEED]
    torch.testing.assert_close(even, torch.full_like(even, 2.4))


def test_step_rates_are_those_of_the_speed_and_style(bend, table):
    for style, rate in enumerate((4 + 2 * 1.3, 5 + 3 * 1.3)):
        course = pace_by_hand(bend, table, speed=1.3, style=style, slow_in_curves=False)
        expected = torch.full_like(bend.distances, rate)
        torch.testing.assert_close(course.path.scalars[STEP_RATE], expected)


def test_a_slow_walker_keeps_the_length_of_a_step_down_to_standing(table):
    slow = torch.tensor([0.25, 0.5, 2.5, 5.0]).double()
    rates = table.step_rate(slow)
    assert rates.tolist() == pytest.approx([2.5, 5.0, 9.0, 18.0])
    assert table.step_rate(torch.zeros(1).double()).item() == 0


def test_the_body_faces_along_the_path_or_to_its_side(bend, table):
    along = pace_by_hand(bend, table).path.directions[FACING]
    torch.testing.assert_close(along, bend.tangents)
    left = pace_by_hand(bend, table, facing=math.pi / 2).path.directions[FACING]
    torch.testing.assert_close(left[10], torch.tensor([1.0, 0.0]).double())
    own = bend.with_direction(FACING, torch.tensor([[0.0, -1.0]]).double())
    with pytest.raises(ConfigError, match="the path says its facing itself"):
        pace_by_hand(own, table, facing=0.0)
    kept = pace_by_hand(own, table).path.directions[FACING]
    torch.testing.assert_close(kept, own.directions[FACING])


def test_a_speed_that_the_path_has_is_kept_where_curves_allow_it(bend, table):
    own = bend.with_scalar(SPEED, 0.5 + bend.distances / 10)
    with pytest.raises(ConfigError, match="the path says its speed itself"):
        pace_by_hand(own, table, speed=1.0)
    speed = pace_by_hand(own, table).path.scalars[SPEED]
    torch.testing.assert_close(speed[:100], own.scalars[SPEED][:100])


@pytest.mark.parametrize("speed", [0.0, -1.0, math.inf, math.nan])
def test_a_speed_that_is_none_is_refused(bend, table, speed):
    with pytest.raises(ConfigError, match="expected a positive number of metres a second"):
        pace_by_hand(bend, table, speed=speed)


@pytest.mark.parametrize(
    "wanted",
    [{4.0: 4.0}, {2.0: 2.5, 4.0: 4.0, 8.0: 9.5}, {0.0: 0.0, 8.0: 6.0}, {1.0: 2.0, 7.0: 6.0}],
)
def test_places_are_reached_at_their_times_and_speeds_follow(bend, table, wanted):
    course = pace_by_hand(bend, table, speed=1.0, slow_in_curves=False)
    found = arriving(course, table, wanted)
    places = torch.tensor(list(wanted)).double()
    torch.testing.assert_close(found.arrival(places), torch.tensor(list(wanted.values())).double())
    torch.testing.assert_close(found.distance(torch.tensor(list(wanted.values())).double()), places)
    time, speed = found.path.scalars["time"], found.path.scalars[SPEED]
    measured = bend.spacing / time.diff()
    torch.testing.assert_close(measured, (speed[1:] + speed[:-1]) / 2, rtol=2e-3, atol=0)
    torch.testing.assert_close(found.path.scalars[STEP_RATE], table.step_rate(speed))


@pytest.mark.parametrize(
    ("wanted", "message"),
    [
        ({4.0: 3.0, 6.0: 2.0}, "do not ascend; later places are reached later"),
        ({4.0: 3.0, 6.0: 3.0}, "do not ascend"),
        ({4.0: 0.0}, "do not ascend"),
        ({9.0: 3.0}, "at 9 m, but the path is 8 m long"),
        ({-1.0: 3.0}, "name a place on it"),
        ({4.0: math.nan}, "expected seconds after the start"),
        ({4.0: -2.0}, "expected seconds after the start"),
        ({0.0: 2.0}, "expected seconds after the start"),
        ({4.0: 1.0}, r"m/s would be needed .* this walker knows up to 2\.5 m/s"),
    ],
)
def test_times_that_nobody_keeps_are_refused(bend, table, wanted, message):
    course = pace_by_hand(bend, table, speed=1.0)
    with pytest.raises(DataError, match=message):
        arriving(course, table, wanted)


def test_no_times_change_nothing(bend, table):
    course = pace_by_hand(bend, table, speed=1.0)
    assert arriving(course, table, {0.0: 0.0}) is course


def test_a_path_that_crosses_itself_has_a_pace_all_along(table):
    eight = torch.tensor([[0, 0], [2, 2], [0, 4], [-2, 6], [0, 8], [2, 6], [0, 4], [-2, 2]])
    path = Path.through(eight.double(), spacing=0.02)
    course = pace_by_hand(path, table, speed=1.4)
    assert (course.path.scalars[SPEED] >= 0.5 - 1e-9).all()
    assert course.duration > path.length / 1.4
