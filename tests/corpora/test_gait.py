"""The walker's parts: smooth signals, paths by arc length, speeds along them, rhythm."""

from __future__ import annotations

import numpy as np
import pytest

from posecast.corpora.gait.pace import Change, Program, planning_times, travel
from posecast.corpora.gait.path import PATHS, Path, draw_path
from posecast.corpora.gait.rhythm import duty, running, step_rate
from posecast.corpora.gait.signals import Sampled, State, Wobble, ease, glide, smooth_cover, step

U = np.linspace(0, 1, 20001)


@pytest.fixture
def numbers() -> np.random.Generator:
    return np.random.default_rng(7)


@pytest.mark.parametrize(
    ("start", "end"),
    [
        (State(0.0), State(1.0)),
        (State(-1.0, -2.2), State(0.4)),
        (State(0.3, 1.0, -4.0), State(0.1, -0.5, 2.0)),
    ],
)
def test_easing_meets_both_states(start, end):
    value = ease(U, start, end)
    rate = np.gradient(value, U, edge_order=2)
    acceleration = np.gradient(rate, U, edge_order=2)
    np.testing.assert_allclose([value[0], value[-1]], [start.value, end.value], atol=1e-12)
    np.testing.assert_allclose([rate[0], rate[-1]], [start.rate, end.rate], atol=1e-5)
    ends = [start.acceleration, end.acceleration]
    np.testing.assert_allclose(acceleration[[2, -3]], ends, atol=0.02)


@pytest.mark.parametrize("ramps", [(0.14, 0.16), (0.3, 0.3), (0.5, 0.5), (0.14, 0.10)])
def test_a_glide_starts_and_ends_at_rest_and_never_turns_back(ramps):
    value = glide(U, *ramps)
    rate = np.gradient(value, U)
    assert value[0] == 0
    assert value[-1] == pytest.approx(1)
    assert rate.min() >= 0
    assert rate[0] < 1e-3
    assert rate[-1] < 1e-3
    assert rate.max() == pytest.approx(1 / (1 - sum(ramps) / 2), rel=1e-4)


def test_a_step_is_flat_outside():
    assert step(np.array([-3.0, 0.0, 1.0, 4.0])).tolist() == [0, 0, 1, 1]


def test_a_smooth_cover_is_nowhere_below(numbers):
    values = np.cumsum(numbers.normal(size=400))
    cover = smooth_cover(values, 9)
    assert (cover >= values - 1e-12).all()
    assert np.abs(np.diff(cover, 2)).max() < 0.5 * np.abs(np.diff(values, 2)).max()
    assert cover.max() == pytest.approx(values.max())


def test_a_sampled_curve_goes_through_its_samples_and_reproduces_parabolas():
    at = np.arange(40) / 8 - 1
    curve = Sampled(-1.0, 8, np.stack([at**2, 3 * at - 1], axis=-1))
    inside = np.linspace(-0.8, 3.6, 97)
    expected = np.stack([inside**2, 3 * inside - 1], axis=-1)
    np.testing.assert_allclose(curve(inside), expected, atol=1e-12)
    np.testing.assert_array_equal(curve(np.array([-9.0, 99.0])), curve.values[[0, -1]])


def test_a_wobble_has_unit_variance(numbers):
    at = np.linspace(0, 4000, 20000)
    wobble = Wobble.draw(numbers, 0.05, 0.4)
    assert wobble(at).std() == pytest.approx(1, rel=0.05)
    assert abs(wobble(at).mean()) < 0.05


@pytest.fixture(params=PATHS)
def path(request: pytest.FixtureRequest, numbers: np.random.Generator) -> Path:
    return draw_path(request.param, numbers, before=5.0, ahead=30.0, scale=2.0)


def test_a_path_is_measured_by_its_arc_length(path):
    at = np.arange(-500, 3000) / 100
    place = path.at(at)
    np.testing.assert_allclose(path.at(np.zeros(1)).position, 0, atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(np.diff(place.position, axis=0), axis=-1), 0.01, 1e-3)
    ways = np.diff(place.position, axis=0) * 100
    middle = (place.heading[1:] + place.heading[:-1]) / 2
    np.testing.assert_allclose(ways, np.stack([np.sin(middle), np.cos(middle)], -1), atol=1e-3)
    np.testing.assert_allclose(np.diff(place.heading) * 100, place.curvature[1:], atol=0.05)


def test_kinds_of_paths_turn_as_their_names_say(numbers):
    turned = {}
    for kind in PATHS:
        place = draw_path(kind, numbers, before=5, ahead=30, scale=2.0).at(np.linspace(0, 30, 3001))
        turned[kind] = (np.ptp(place.heading), np.abs(place.curvature).max())
    assert len(turned) == 6
    assert turned["straight"][0] < 0.5
    assert turned["eight"][0] > 4
    assert turned["corners"][1] > 1.0 > 2 * turned["wandering"][1]


def test_a_program_rests_where_its_speed_is_zero():
    program = Program(0.0, (Change(1.0, 1.0, 1.4), Change(5.0, 1.5, 0.0), Change(8.0, 1.0, 2.0)))
    assert program.rests() == [(-np.inf, 1.0), (6.5, 8.0)]
    speed = program.speed(np.array([0.0, 1.0, 3.0, 6.5, 7.0, 8.0, 9.0, 50.0]))
    np.testing.assert_allclose(speed, [0, 0, 1.4, 0, 0, 0, 2.0, 2.0], atol=1e-12)


def test_distance_is_the_integral_of_speed_and_bends_are_slow(numbers):
    path = draw_path("corners", numbers, before=6, ahead=30, scale=2.0)
    times = planning_times(10.0, 3.0)
    calm = Wobble(np.zeros(5), np.zeros(5))
    journey = travel(path, Program(1.3), times, restlessness=calm, sideways=0.9)
    at = np.linspace(0, 10, 5001)
    distance, speed = journey.distance(at), journey.speed(at)
    assert distance[0] == pytest.approx(0, abs=1e-9)
    np.testing.assert_allclose(np.gradient(distance, at)[1:-1], speed[1:-1], atol=0.03)
    assert speed.max() == pytest.approx(1.3, rel=0.02)
    sideways = speed**2 * np.abs(path.at(distance).curvature)
    assert sideways.max() < 1.0


def test_faster_is_quicker_steps_less_time_on_the_floor_and_at_last_running():
    froude = np.linspace(0.1, 1.5, 141)
    assert (np.diff(step_rate(froude)) > 0).all()
    assert (np.diff(duty(froude)) <= 0).all()
    assert running(np.array([0.5, 0.75])).tolist() == [0, 1]
    assert duty(np.array([0.5]))[0] > 0.55
    assert duty(np.array([0.9]))[0] < 0.45
