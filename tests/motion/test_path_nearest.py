"""The nearest place of a path, on one branch or on all, against a slow search."""

import math
from itertools import pairwise

import pytest
import torch

from posecast.motion import Path


def nearest_slowly(path, position):
    """Distance and arc length, segment by segment, from the foot of the perpendicular."""
    points = path.points.tolist()
    if path.closed:
        points.append(points[0])
    best = (math.inf, 0.0)
    for order, ((ax, az), (bx, bz)) in enumerate(pairwise(points)):
        along = math.hypot(bx - ax, bz - az)
        foot = ((position[0] - ax) * (bx - ax) + (position[1] - az) * (bz - az)) / along
        foot = min(max(foot, 0.0), along)
        x, z = ax + foot / along * (bx - ax), az + foot / along * (bz - az)
        gap = math.hypot(position[0] - x, position[1] - z)
        best = min(best, (gap, (order + foot / along) * path.spacing))
    return best


def figure_eight():
    """Once through both loops; the branches cross at the origin."""
    turn = torch.linspace(0.3, 2 * math.pi - 0.3, 60, dtype=torch.float64)
    return Path.through(torch.stack([2 * turn.cos(), 1.5 * (2 * turn).sin()], dim=-1))


@pytest.mark.parametrize("closed", [False, True])
def test_nearest_places_are_those_of_a_slow_search(closed, generator):
    waypoints = torch.randn(7, 2, generator=generator, dtype=torch.float64)
    path = Path.through(waypoints, closed=closed, spacing=0.05)
    positions = 2 * torch.randn(40, 2, generator=generator, dtype=torch.float64)
    expected = torch.tensor([nearest_slowly(path, at) for at in positions.tolist()]).double()
    torch.testing.assert_close(path.distance_to(positions), expected[:, 0], rtol=0, atol=1e-6)
    places = path.at(path.nearest(positions)).position
    torch.testing.assert_close((places - positions).norm(dim=-1), expected[:, 0], rtol=0, atol=1e-6)
    assert ((path.nearest(positions) - expected[:, 1]).abs() < 1e-5).float().mean() > 0.95


def test_a_place_of_the_path_is_nearest_to_itself(generator):
    path = Path.through(torch.randn(7, 2, generator=generator).cumsum(0), spacing=0.03)
    distance = path.length * torch.rand(200, generator=generator, dtype=torch.float64)
    position = path.at(distance).position
    assert path.distance_to(position).max() < 1e-12
    torch.testing.assert_close(path.nearest(position, near=distance), distance, rtol=0, atol=1e-9)


def test_positions_may_have_any_batch_axes(generator):
    path = figure_eight()
    positions = torch.randn(3, 5, 2, generator=generator, dtype=torch.float64)
    assert path.nearest(positions).shape == (3, 5)
    assert path.distance_to(positions[0, 0]).shape == ()
    assert path.distance_to(positions[:0]).shape == (0, 5)
    torch.testing.assert_close(path.nearest(positions)[1, 2], path.nearest(positions[1, 2]))


def test_many_positions_are_taken_in_batches_with_the_same_result(generator):
    path = figure_eight()
    positions = torch.randn(700, 2, generator=generator, dtype=torch.float64)
    assert len(positions) * len(path.points) > 2 * (1 << 17)
    together = path.nearest(positions)
    torch.testing.assert_close(together[::70], path.nearest(positions[::70]), rtol=0, atol=0)
    near = path.nearest(positions, near=together)
    torch.testing.assert_close(near, together, rtol=0, atol=1e-12)


def test_who_comes_to_a_crossing_stays_on_their_own_branch():
    path = figure_eight()
    first, second = _crossings(path)
    assert second - first > 3.0
    # Walk through the crossing, always a little off the path, towards the other branch.
    for crossing in (first, second):
        place = crossing - 0.2
        other = path.at(torch.tensor(first + second - crossing)).tangent
        for _ in range(20):
            place = place + 0.02
            position = path.at(torch.tensor(place)).position + 0.03 * other
            found = float(path.nearest(position, near=torch.tensor(place)))
            assert abs(found - place) < 0.1
    assert float(path.distance_to(torch.zeros(2))) < 1e-3


def _crossings(path):
    """Arc lengths at which the path comes through the origin."""
    away = path.points.norm(dim=-1)
    dips = (away[1:-1] < away[:-2]) & (away[1:-1] <= away[2:]) & (away[1:-1] < 0.02)
    places = (dips.nonzero()[:, 0] + 1).double() * path.spacing
    assert len(places) == 2
    return places.tolist()


def test_laps_of_a_closed_path_are_counted_on():
    angles = torch.arange(24, dtype=torch.float64) * 2 * math.pi / 24
    path = Path.through(torch.stack([angles.sin(), angles.cos()], dim=-1), closed=True)
    walked = torch.linspace(0, 2.5 * path.length, 40, dtype=torch.float64)
    position = 1.1 * path.at(walked).position
    torch.testing.assert_close(
        path.nearest(position, near=walked + 0.05), walked, rtol=0, atol=1e-2
    )
    assert path.nearest(position).max() <= path.length


def test_a_hint_of_wider_reach_looks_farther():
    path = Path.through(torch.tensor([[0.0, 0.0], [0.0, 5.0]]), spacing=0.01)
    position, near = torch.tensor([0.3, 4.0]), torch.tensor(1.0)
    assert float(path.nearest(position, near=near)) == pytest.approx(1.41, abs=0.011)
    assert float(path.nearest(position, near=near, reach=2.0)) == pytest.approx(3.01, abs=0.011)
    assert float(path.nearest(position, near=near, reach=4.0)) == pytest.approx(4.0)
