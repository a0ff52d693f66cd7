"""Paths: arc length, tangents and curvatures, tracks, extension, nearest places."""

import math

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.interpolate import CubicSpline

from posecast.errors import ConfigError
from posecast.motion import Path, path_scale
from posecast.motion.curve import smooth_curve
from posecast.motion.places import bearing, heading

RADIUS = 2.0


def circle(count, *, radius=RADIUS, turn=1.0):
    """Way points on a circle about the origin, to the left for a positive turn."""
    angles = turn * 2 * math.pi * torch.arange(count, dtype=torch.float64) / count
    # Heading +z at (-radius, 0): the left hand, towards +x, is inside.
    return radius * torch.stack([-angles.cos(), angles.sin()], dim=-1)


def wander(count, generator):
    """Uneven way points, some near each other, some far."""
    steps = torch.randn(count, 2, generator=generator, dtype=torch.float64)
    return (steps * torch.rand(count, 1, generator=generator, dtype=torch.float64)).cumsum(0)


def spline(waypoints, kind):
    points = waypoints.numpy()
    if kind == "periodic":
        points = np.concatenate([points, points[:1]])
    chords = np.linalg.norm(np.diff(points, axis=0), axis=-1)
    knots = np.concatenate([[0.0], np.cumsum(chords)])
    return CubicSpline(knots, points, bc_type=kind), knots


@pytest.mark.parametrize("closed", [False, True])
@pytest.mark.parametrize("count", [3, 4, 25])
def test_the_smooth_curve_is_the_cubic_spline_of_scipy(count, closed, generator):
    waypoints = wander(count, generator)
    reference, knots = spline(waypoints, "periodic" if closed else "natural")
    curve = smooth_curve(waypoints, closed=closed, spacing=0.05)
    ends = [*curve.knots.tolist(), len(curve.samples) - 1][: len(knots)]
    at = np.interp(np.arange(len(curve.samples)), ends, knots)
    torch.testing.assert_close(curve.samples, torch.from_numpy(reference(at)), rtol=0, atol=1e-12)


def test_a_smooth_curve_may_begin_in_a_given_direction(generator):
    waypoints = wander(6, generator)
    direction = heading(torch.tensor(0.7, dtype=torch.float64))
    _, knots = spline(waypoints, "natural")
    ends = ((1, direction.numpy()), (2, np.zeros(2)))
    reference = CubicSpline(knots, waypoints.numpy(), bc_type=ends)
    curve = smooth_curve(waypoints, closed=False, spacing=0.05, direction=direction)
    at = np.interp(np.arange(len(curve.samples)), curve.knots.numpy(), knots)
    torch.testing.assert_close(curve.samples, torch.from_numpy(reference(at)), rtol=0, atol=1e-12)


@pytest.mark.parametrize("closed", [False, True])
def test_points_lie_at_equal_arc_lengths_of_the_curve(closed, generator):
    waypoints = wander(8, generator)
    path = Path.through(waypoints, closed=closed, spacing=0.05)
    reference, knots = spline(waypoints, "periodic" if closed else "natural")

    def arc(end):
        return quad(lambda u: np.linalg.norm(reference(u, 1)), 0, end, limit=400, points=knots)[0]

    assert path.length == pytest.approx(arc(knots[-1]), rel=1e-5)
    for mark, knot in zip(path.marks.tolist(), knots.tolist(), strict=closed is False):
        assert mark == pytest.approx(arc(knot), abs=1e-4)
    torch.testing.assert_close(path.at(path.marks).position, waypoints, rtol=0, atol=5e-3)
    assert path.spacing <= 0.05


def test_a_whole_number_of_segments_fits_a_path_of_that_length():
    path = Path.through(torch.tensor([[0.0, 0.0], [0.0, 3.0]]), spacing=0.1)
    assert len(path.points) == 31
    assert path.spacing == pytest.approx(0.1)
    assert Path.through(torch.tensor([[0.0, 0.0], [0.0, 3.0]]), spacing=7.0).spacing == 3.0


@pytest.mark.parametrize("turn", [1.0, -1.0])
@pytest.mark.parametrize("smoothing", [0.0, 0.056, 0.5])
def test_a_circle_has_the_curvature_of_its_radius_everywhere_and_at_its_seam(turn, smoothing):
    path = Path.through(circle(96, turn=turn), closed=True, smoothing=smoothing)
    assert path.length == pytest.approx(2 * math.pi * RADIUS, rel=1e-6)
    expected = torch.full_like(path.curvatures, turn / RADIUS)
    # What is left is the spline, which is no circle between its way points.
    torch.testing.assert_close(path.curvatures, expected, rtol=2e-3, atol=0)
    radial = path.points / path.points.norm(dim=-1, keepdim=True)
    left = torch.stack([path.tangents[:, 1], -path.tangents[:, 0]], dim=-1)
    torch.testing.assert_close(left, -turn * radial, rtol=0, atol=1e-4)


def test_a_closed_path_does_not_care_where_it_begins(generator):
    waypoints = circle(12) * (1 + torch.rand(12, 1, generator=generator, dtype=torch.float64))
    path = Path.through(waypoints, closed=True).with_scalar("speed", 1.0)
    shifted = Path.through(waypoints.roll(-5, 0), closed=True)
    assert shifted.length == pytest.approx(path.length, rel=1e-9)
    distance = torch.linspace(-3.0, 30.0, 500, dtype=torch.float64)
    one, other = path.at(distance + path.marks[5]), shifted.at(distance)
    # Its points lie elsewhere on the curve: at most half a spacing of curving from one to the next.
    torch.testing.assert_close(one.position, other.position, rtol=0, atol=1e-4)
    torch.testing.assert_close(one.tangent, other.tangent, rtol=0, atol=1e-3)
    torch.testing.assert_close(one.curvature, other.curvature, rtol=0, atol=2e-2)


def test_lengths_scale_with_way_points_spacing_and_smoothing(generator):
    waypoints = wander(9, generator)
    path = Path.through(waypoints, spacing=0.01, smoothing=0.05)
    larger = Path.through(3 * waypoints, spacing=0.03, smoothing=0.15)
    torch.testing.assert_close(larger.points, 3 * path.points)
    torch.testing.assert_close(larger.tangents, path.tangents)
    torch.testing.assert_close(larger.curvatures, path.curvatures / 3, rtol=1e-6, atol=1e-7)


def test_tangents_turn_along_with_the_way_points(generator):
    waypoints = wander(9, generator)
    angle = 1.1
    turn = torch.tensor([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    path, turned = Path.through(waypoints), Path.through(waypoints @ turn.double())
    torch.testing.assert_close(turned.points, path.points @ turn.double(), rtol=0, atol=1e-9)
    torch.testing.assert_close(turned.tangents, path.tangents @ turn.double(), rtol=0, atol=1e-6)
    torch.testing.assert_close(turned.curvatures, path.curvatures, rtol=0, atol=1e-5)


def test_a_corner_of_straight_lines_turns_by_its_angle_within_the_reach_of_the_filter():
    corner = torch.tensor([[0.0, 0.0], [0.0, 3.0], [3.0, 3.0]])
    path = Path.through(corner, straight=True, smoothing=0.05)
    assert float(path.curvatures.sum() * path.spacing) == pytest.approx(math.pi / 2, abs=1e-9)
    near = (path.distances - 3.0).abs() <= 4 * 0.05 + 2 * path.spacing
    assert path.curvatures[~near].abs().max() < 1e-9
    # Smoothed, the corner leads towards (P, 1 - P), P being the normal distribution: at P = 1/2 it
    # turns fastest, by 2 P'.
    peak = 2 / (0.05 * math.sqrt(2 * math.pi))
    assert float(path.curvatures.max()) == pytest.approx(peak, rel=0.01)
    torch.testing.assert_close(path.tangents[[0, -1]], torch.eye(2).double().flip(0))


def test_a_path_that_turns_back_on_the_spot_is_finite():
    there_and_back = torch.tensor([[0.0, 0.0], [0.0, 1.0], [0.0, 0.0], [0.0, 1.0]])
    path = Path.through(there_and_back, straight=True, spacing=0.05, smoothing=0.1)
    assert torch.isfinite(path.curvatures).all()
    torch.testing.assert_close(path.tangents.norm(dim=-1), torch.ones(61).double())
    assert float(path.curvatures.abs().max()) == pytest.approx(math.pi / path.spacing, rel=1e-6)
    assert torch.isfinite(path.nearest(torch.tensor([0.0, 0.5])))


def test_an_open_path_goes_straight_on_beyond_its_ends(generator):
    path = Path.through(wander(9, generator)).with_scalar("speed", 1.5)
    first, last = path.at(torch.tensor(-2.0)), path.at(torch.tensor(path.length + 0.7))
    torch.testing.assert_close(first.position, path.points[0] - 2 * path.tangents[0])
    torch.testing.assert_close(last.position, path.points[-1] + 0.7 * path.tangents[-1])
    torch.testing.assert_close(last.tangent, path.tangents[-1])
    torch.testing.assert_close(first.curvature, torch.zeros(()).double(), rtol=0, atol=1e-9)
    assert float(path.scalar("speed", torch.tensor(99.0))) == 1.5


def test_a_closed_path_goes_round(generator):
    path = Path.through(circle(12), closed=True)
    path = path.with_scalar("speed", path.distances.sin()).with_direction("facing", path.tangents)
    distance = torch.linspace(0, path.length, 77, dtype=torch.float64)
    once, thrice = distance - path.length, distance + 2 * path.length
    for read in (
        lambda d: path.at(d).position,
        lambda d: path.at(d).tangent,
        lambda d: path.scalar("speed", d),
        lambda d: path.direction("facing", d),
    ):
        torch.testing.assert_close(read(once), read(distance), rtol=0, atol=1e-9)
        torch.testing.assert_close(read(thrice), read(distance), rtol=0, atol=1e-9)


def test_places_keep_the_shape_of_the_distances_and_their_unit_tangents(generator):
    path = Path.through(wander(5, generator))
    distance = path.length * torch.rand(3, 0 + 4, generator=generator)
    place = path.at(distance)
    assert place.position.shape == (3, 4, 2)
    assert place.curvature.shape == (3, 4)
    assert place.position.dtype == torch.float64
    torch.testing.assert_close(place.tangent.norm(dim=-1), torch.ones(3, 4).double())
    assert path.at(torch.zeros(0)).position.shape == (0, 2)


def test_a_recorded_track_has_the_arc_lengths_of_its_frames_as_marks():
    stops = torch.tensor([[0.0, 0.0], [0.0, 0.0], [0.0, 1.0], [0.0, 1.0], [1.0, 1.0]])
    path = Path.along(stops, spacing=0.1)
    torch.testing.assert_close(path.marks, torch.tensor([0.0, 0.0, 1.0, 1.0, 2.0]).double())
    torch.testing.assert_close(path.at(path.marks).position, stops.double(), rtol=0, atol=1e-9)
    track = path.with_scalar("speed", torch.tensor([0.0, 1.0, 1.0, 0.0, 3.0]), at=path.marks)
    assert float(track.scalar("speed", torch.tensor(0.5))) == pytest.approx(1.0)
    assert float(track.scalar("speed", torch.tensor(1.5))) == pytest.approx(1.5)


def test_the_published_constants_are_those_of_the_published_body():
    spacing, smoothing, least_speed = path_scale(14.6492 * 0.05644)
    assert spacing == pytest.approx(0.2 * 0.05644, rel=1e-4)
    assert smoothing == pytest.approx(5 * spacing)
    assert least_speed == pytest.approx(0.1 * 0.05644 * 30, rel=1e-4)
    child = path_scale(0.4)
    assert child.spacing / spacing == pytest.approx(0.4 / (14.6492 * 0.05644), rel=1e-4)
    with pytest.raises(ConfigError, match=r"leg_length is 0\.0: expected a positive number"):
        path_scale(0.0)


@settings(deadline=None, max_examples=60)
@given(
    st.lists(st.tuples(st.floats(-5, 5), st.floats(-5, 5)), min_size=3, max_size=8),
    st.booleans(),
    st.booleans(),
)
def test_any_way_points_give_a_path_of_finite_places_through_them(points, closed, straight):
    waypoints = torch.tensor(points, dtype=torch.float64)
    steps = (waypoints.roll(-1, 0) - waypoints).norm(dim=-1)
    if bool((steps < 1e-3).any()):
        waypoints = waypoints + torch.tensor([[0.01, 0.0]]) * torch.arange(len(points))[:, None]
        if bool(((waypoints.roll(-1, 0) - waypoints).norm(dim=-1) < 1e-3).any()):
            return
    path = Path.through(waypoints, closed=closed, straight=straight, spacing=0.05)
    chords = (path.points[1:] - path.points[:-1]).norm(dim=-1)
    assert chords.max() <= path.spacing * (1 + 1e-9)
    assert torch.isfinite(path.curvatures).all()
    assert len(path.marks) == len(points)
    assert (path.marks.diff() > 0).all()
    assert path.distance_to(waypoints).max() <= path.spacing / 2 + 1e-9
    torch.testing.assert_close(
        bearing(heading(bearing(path.tangents))), bearing(path.tangents), rtol=0, atol=1e-12
    )
