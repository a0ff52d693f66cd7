"""Courses: when each place of a path is reached, and the other way round."""

from __future__ import annotations

import pytest
import torch

from posecast.errors import ConfigError
from posecast.generation import Course, timed
from posecast.motion.tracks import FACING, SPEED, STEP_RATE


def paced(path, speed):
    path = path.with_scalar(SPEED, speed).with_scalar(STEP_RATE, 6.0)
    return timed(path.with_direction(FACING, path.tangents))


def test_at_an_even_pace_time_is_distance_over_speed(bend):
    course = paced(bend, 1.6)
    times = torch.linspace(-2, 7, 40).double()
    torch.testing.assert_close(course.distance(times), 1.6 * times)
    assert course.duration == pytest.approx(bend.length / 1.6)


def test_times_agree_with_a_fine_sum_over_a_changing_pace(bend):
    speed = 1 + 0.5 * torch.sin(bend.distances)
    course = paced(bend, speed)
    fine = torch.linspace(0, bend.length, 400_001).double()
    spans = (fine[1:] - fine[:-1]) / (1 + 0.5 * torch.sin((fine[1:] + fine[:-1]) / 2))
    assert course.duration == pytest.approx(spans.sum().item(), rel=3e-5)


@pytest.mark.parametrize("path", ["bend", "circle"])
def test_arrivals_and_distances_undo_each_other(path, request):
    path = request.getfixturevalue(path)
    course = paced(path, 0.6 + 0.3 * torch.cos(path.distances))
    places = torch.linspace(0, path.length - 0.05, 57).double()
    torch.testing.assert_close(course.distance(course.arrival(places)), places)


def test_a_closed_course_goes_round_and_round(circle):
    course = paced(circle, 1 + 0.2 * torch.sin(circle.distances / circle.length * 2 * torch.pi))
    early = torch.linspace(0, course.duration, 31).double()[:-1]
    for laps in (-1, 1, 3):
        torch.testing.assert_close(
            course.distance(early + laps * course.duration),
            course.distance(early) + laps * circle.length,
        )
    seam = course.duration + torch.tensor([-1e-6, 1e-6], dtype=torch.float64)
    before, after = course.distance(seam).tolist()
    assert after - before == pytest.approx(2e-6, rel=1e-3)


def test_a_path_without_a_pace_is_refused(bend):
    with pytest.raises(ConfigError, match="no speed and no step_rate and no time and no facing"):
        Course(bend)
    with pytest.raises(ConfigError, match="no track 'speed'"):
        timed(bend)


def test_time_must_go_on(bend):
    course = paced(bend, 1.0)
    still = course.path.with_scalar("time", course.path.scalars["time"].clamp(max=3))
    with pytest.raises(ConfigError, match="time stands still"):
        Course(still)
