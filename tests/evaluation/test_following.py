"""What a course asks and a walk does: distances, arrivals, facing and speed with known answers."""

from __future__ import annotations

import math

import pytest
import torch

from posecast.evaluation.following import (
    SLACK,
    Followed,
    arrival_errors,
    path_distances,
    speed_errors,
)
from posecast.evaluation.walks import score_walk
from posecast.generation import Course
from posecast.generation.courses import eight_courses, eight_paths
from posecast.motion import Path, analyse_gait

FPS = 30.0


def way(course: Course, *, late: float = 0.0, seconds: float | None = None) -> torch.Tensor:
    """(x, z) of a root on its course, some seconds late."""
    length = course.duration + SLACK if seconds is None else seconds
    times = torch.arange(math.floor(length * FPS) + 1).double() / FPS
    return course.path.at(course.distance(times - late)).position


def test_a_course_is_what_scores_follow(straight, make_course) -> None:
    assert isinstance(make_course(straight), Followed)


@pytest.mark.parametrize("beside", [0.3, -0.3])
def test_the_root_is_as_far_off_the_path_as_it_is_beside_it(
    make_statue, make_course, straight, beside
) -> None:
    scores = score_walk(make_statue(beside=beside), make_course(straight))
    assert scores.path_mean == pytest.approx(0.3, abs=1e-9)
    assert scores.path_max == pytest.approx(0.3, abs=1e-9)


def test_the_path_is_off_on_the_floor_whatever_the_height(
    make_statue, make_course, straight
) -> None:
    assert score_walk(make_statue(height=0.5), make_course(straight)).path_max < 1e-9


def test_mean_and_maximum_are_of_single_frames(make_statue, make_course, straight) -> None:
    """Beside the path by 0 to 0.6 m, evenly."""
    clip = make_statue(frames=301)
    clip.root_positions[:, 0] = torch.linspace(0, 0.6, 301).double()
    scores = score_walk(clip, make_course(straight))
    assert scores.path_mean == pytest.approx(0.3, abs=1e-6)
    assert scores.path_max == pytest.approx(0.6, abs=1e-6)


def test_at_a_crossing_the_other_branch_is_no_help(make_course) -> None:
    """Where the branches cross, a root 0.5 m aside of its own is on the other one."""
    course = make_course(eight_paths()["figure-eight"])
    crossing = torch.tensor([course.path.length / 2]).double()
    place = course.path.at(crossing)
    aside = place.position + 0.5 * torch.stack([place.tangent[:, 1], -place.tangent[:, 0]], -1)
    assert float(course.path.distance_to(aside)) < 0.05
    found = path_distances(aside, course.path, near=crossing, reach=2.0)
    assert float(found) == pytest.approx(0.5, abs=0.02)


@pytest.mark.parametrize("late", [0.4, -0.4, 0.0])
@pytest.mark.parametrize("name", ["straight", "figure-eight", "zigzag", "spiral"])
def test_who_is_late_is_late_at_every_way_point(make_course, name, late) -> None:
    """Lateness is signed; the figure eight crosses itself and ends where it begins."""
    course = make_course(eight_paths()[name], speed=1.1)
    errors = arrival_errors(way(course, late=late), course, fps=FPS)
    assert len(errors) == len(course.path.marks) - 1
    torch.testing.assert_close(errors, torch.full_like(errors, late), atol=0.02, rtol=0)


def test_arrivals_between_two_frames_are_timed_within_a_frame(make_course, straight) -> None:
    course = make_course(straight, speed=1.0)
    errors = arrival_errors(way(course, late=0.41), course, fps=FPS)
    torch.testing.assert_close(errors, torch.full_like(errors, 0.41), atol=1e-6, rtol=0)


def test_who_is_far_too_late_is_as_late_as_is_looked_for(make_course, straight) -> None:
    course = make_course(straight, speed=1.0)
    errors = arrival_errors(way(course, late=5.0), course, fps=FPS)
    assert float(errors.max()) == pytest.approx(SLACK, abs=0.05)


def test_of_a_part_of_a_walk_only_way_points_on_its_part_count(make_course, straight) -> None:
    """From 6 s to 16 s, at 0.5 m/s: way points at 4 m and 6 m; that at 8 m may be passed later."""
    course = make_course(straight, speed=0.5)
    part = way(course, late=0.2)[180:481]
    errors = arrival_errors(part, course, fps=FPS, start=6.0)
    torch.testing.assert_close(errors, torch.full((2,), 0.2).double(), atol=1e-6, rtol=0)


def test_on_a_closed_path_every_lap_has_its_arrivals(make_course) -> None:
    angles = torch.arange(12).double() * (torch.pi / 6)
    ring = Path.through(2 * torch.stack([angles.sin(), angles.cos()], -1), closed=True)
    course = make_course(ring, speed=1.0)
    root = way(course, late=0.3, seconds=2.52 * course.duration + SLACK)
    errors = arrival_errors(root, course, fps=FPS)
    assert len(errors) == 30  # of two laps 24, of half a one 7, but for the start
    torch.testing.assert_close(errors, torch.full_like(errors, 0.3), atol=0.02, rtol=0)


def test_scores_have_the_mean_and_the_largest_lateness_without_its_sign(
    make_statue, make_course, straight
) -> None:
    course = make_course(straight)
    early = score_walk(make_statue(frames=400, ahead=0.25), course)
    assert early.arrival_mean == pytest.approx(0.25, abs=1e-6)
    assert early.arrival_max == pytest.approx(0.25, abs=1e-6)
    slow = score_walk(make_statue(frames=400, speed=0.9), course)
    lateness = torch.tensor([2.0, 4.0, 6.0, 8.0, 10.0]) * (1 / 0.9 - 1)
    assert slow.arrival_mean == pytest.approx(float(lateness.mean()), abs=1e-6)
    assert slow.arrival_max == pytest.approx(float(lateness.max()), abs=1e-6)


@pytest.mark.parametrize(("turned", "asked", "error"), [(30, 0, 30), (-30, 0, 30), (30, 30, 0)])
def test_who_faces_aside_has_an_error_of_so_many_degrees(
    make_statue, make_course, straight, turned, asked, error
) -> None:
    course = make_course(straight, facing=float(asked))
    found = score_walk(make_statue(turned=float(turned)), course).facing
    assert found == pytest.approx(error, abs=1e-6)


def test_facing_backwards_is_half_a_turn(make_statue, make_course, straight) -> None:
    found = score_walk(make_statue(turned=180.0), make_course(straight)).facing
    assert found == pytest.approx(180, abs=1e-4)


@pytest.mark.parametrize(("speed", "error"), [(1.3, 0.3), (0.8, 0.2), (1.0, 0.0)])
def test_who_is_too_fast_or_too_slow_is_off_by_so_much(
    make_statue, make_course, straight, speed, error
) -> None:
    clip, course = make_statue(speed=speed, frames=200), make_course(straight)
    assert score_walk(clip, course).speed == pytest.approx(error, abs=1e-6)
    errors = speed_errors(analyse_gait(clip), course, torch.arange(200).double() / FPS)
    assert float(errors.max()) == pytest.approx(error, abs=1e-6)


def test_a_generated_walk_on_its_own_path_is_near_it(walk_table) -> None:
    """Every one of the eight, a root exactly where it is to be."""
    for course in eight_courses(walk_table).values():
        root = way(course, seconds=course.duration)
        times = torch.arange(len(root)).double() / FPS
        near = course.distance(times)
        assert float(path_distances(root, course.path, near=near, reach=2.0).max()) < 1e-6
