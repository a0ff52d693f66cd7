"""Tracks along a path, and paths that are led on while they are walked."""

import math
from functools import partial

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from posecast.errors import ConfigError, DataError
from posecast.motion import Path
from posecast.motion.places import bearing, heading
from posecast.motion.smoothing import smooth

number = partial(torch.tensor, dtype=torch.float64)

LINE = number([[0.0, 0.0], [0.0, 4.0]])


@pytest.fixture
def line():
    """Four metres along +z, 41 points."""
    return Path.through(LINE, spacing=0.1)


@pytest.fixture
def loop():
    """Four sides of a metre, closed, 40 points."""
    square = number([[0.0, 0.0], [0.0, 1.0], [1.0, 1.0], [1.0, 0.0]])
    return Path.through(square, closed=True, straight=True, spacing=0.1)


def slerp(start, end, fraction):
    """Spherical interpolation by the sine formula, of unit vectors less than half a turn apart."""
    angle = torch.arccos((start * end).sum().clamp(-1, 1))
    return ((1 - fraction) * angle).sin() / angle.sin() * start + (
        fraction * angle
    ).sin() / angle.sin() * end


def test_numbers_given_at_arc_lengths_are_linear_between_and_held_beyond(line):
    at = number([1.0, 2.0, 3.0])
    path = line.with_scalar("speed", number([1.0, 3.0, 2.0]), at=at)
    asked = number([0.0, 1.0, 1.25, 2.0, 2.5, 3.5, 4.0, 9.0])
    expected = number([1.0, 1.0, 1.5, 3.0, 2.5, 2.0, 2.0, 2.0])
    torch.testing.assert_close(path.scalar("speed", asked), expected)
    assert "speed" not in line.scalars


def test_one_number_is_for_the_whole_path_and_one_a_point_stands_at_its_point(line):
    constant = line.with_scalar("speed", 1.4).with_scalar("step_rate", number([9.0]))
    assert float(constant.scalar("speed", number(2.22))) == 1.4
    assert float(constant.scalar("step_rate", number(2.22))) == 9.0
    each = line.with_scalar("speed", line.distances**2)
    torch.testing.assert_close(each.scalar("speed", line.distances), line.distances**2)


def test_numbers_go_round_a_closed_path(loop):
    path = loop.with_scalar("speed", number([1.0, 3.0]), at=number([1.0, 3.0]))
    asked = number([0.0, 1.0, 2.0, 3.0, 3.5, 3.95, 4.5])
    expected = number([2.0, 1.0, 2.0, 3.0, 2.5, 2.05, 1.5])
    torch.testing.assert_close(path.scalar("speed", asked), expected)


def test_smoothing_a_track_of_a_closed_path_leaves_no_kink_at_the_seam(loop):
    values = (loop.distances < 1.0).double()
    smoothed = loop.with_scalar("speed", values, smoothing=0.2).scalars["speed"]
    later = loop.with_scalar("speed", values.roll(17), smoothing=0.2).scalars["speed"]
    torch.testing.assert_close(later, smoothed.roll(17), rtol=0, atol=1e-12)
    torch.testing.assert_close(smoothed, smooth(values, 2.0, closed=True))


def test_directions_turn_evenly_the_shorter_way_round(line):
    start, end = heading(number([3.0, -2.5]))
    path = line.with_direction("facing", torch.stack([start, end]), at=number([1.0, 3.0]))
    for fraction in (0.0, 0.2, 0.5, 0.9, 1.0):
        found = path.direction("facing", number(1.0 + 2 * fraction))
        expected = slerp(start, end, number(fraction))
        torch.testing.assert_close(found, expected, rtol=0, atol=1e-12)


def test_directions_between_points_are_those_of_spherical_interpolation(generator):
    angles = 2.5 * torch.randn(41, generator=generator, dtype=torch.float64).cumsum(0) / 3
    path = Path.through(LINE, spacing=0.1).with_direction("facing", 7 * heading(angles))
    asked = 4 * torch.rand(60, generator=generator, dtype=torch.float64)
    found = path.direction("facing", asked)
    for place, direction in zip(asked / 0.1, found, strict=True):
        before = int(place)
        start, end = heading(angles[before]), heading(angles[before + 1])
        torch.testing.assert_close(direction, slerp(start, end, place - before), rtol=0, atol=1e-9)
    torch.testing.assert_close(found.norm(dim=-1), torch.ones(60).double())


def test_directions_go_round_a_closed_path_the_shorter_way_across_the_seam(loop):
    values = heading(number([-0.4, 0.4, 2.0]))
    path = loop.with_direction("facing", values, at=number([0.5, 1.5, 3.5]))
    found = bearing(path.direction("facing", number([0.0, 4.0, 3.9])))
    # From 2.0 at 3.5 m down to -0.4 at 4.5 m.
    torch.testing.assert_close(found, number([0.8, 0.8, 1.04]), rtol=0, atol=1e-9)


@settings(deadline=None)
@given(st.lists(st.floats(-10, 10), min_size=1, max_size=6), st.booleans())
def test_a_turned_facing_is_the_facing_turned(angles, closed):
    square = number([[0.0, 0.0], [0.0, 1.0], [1.0, 1.0], [1.0, 0.0]])
    path = Path.through(square, closed=closed, spacing=0.1)
    given_at = torch.linspace(0.1, 2.9, len(angles))
    bearings = number(angles)
    near_half_turn = (bearings.diff().abs() % (2 * math.pi) - math.pi).abs() < 1e-6
    across = abs(abs(angles[0] - angles[-1]) % (2 * math.pi) - math.pi) < 1e-6
    if bool(near_half_turn.any()) or across:
        return  # both ways round are as long, and rounding decides
    one = path.with_direction("facing", heading(bearings), at=given_at)
    other = path.with_direction("facing", heading(bearings + 1.0), at=given_at)
    difference = bearing(other.directions["facing"]) - bearing(one.directions["facing"]) - 1.0
    torch.testing.assert_close(difference.cos(), torch.ones_like(difference), rtol=0, atol=1e-9)


@pytest.mark.parametrize("straight", [False, True])
def test_a_path_led_on_is_behind_the_joint_what_it_was(straight, generator):
    waypoints = torch.randn(6, 2, generator=generator, dtype=torch.float64).cumsum(0)
    path = Path.through(waypoints).with_scalar("speed", 1 + waypoints[:, 0].abs().cumsum(0)[:1])
    path = path.with_direction("facing", path.tangents)
    more = waypoints[-1] + torch.randn(4, 2, generator=generator, dtype=torch.float64).cumsum(0)
    longer = path.extend(more, straight=straight)
    count = len(path.points)
    assert longer.spacing == path.spacing
    assert len(longer.marks) == 10
    torch.testing.assert_close(longer.points[:count], path.points, rtol=0, atol=0)
    torch.testing.assert_close(longer.marks[:6], path.marks, rtol=0, atol=0)
    torch.testing.assert_close(longer.scalars["speed"][:count], path.scalars["speed"])
    torch.testing.assert_close(longer.directions["facing"][:count], path.directions["facing"])
    # The filter of the tangents looks four sigma ahead, and half a segment more.
    seen = path.distances < path.length - 4 * path.smoothing - 2 * path.spacing
    torch.testing.assert_close(longer.tangents[:count][seen], path.tangents[seen])
    torch.testing.assert_close(
        longer.curvatures[:count][seen], path.curvatures[seen], rtol=0, atol=1e-6
    )


@pytest.mark.parametrize("straight", [False, True])
def test_a_path_led_on_passes_its_new_way_points_in_equal_segments(straight, generator):
    path = Path.through(torch.randn(5, 2, generator=generator).cumsum(0), spacing=0.02)
    for _ in range(3):
        end = path.points[-1]
        more = end + torch.randn(2, 2, generator=generator, dtype=torch.float64).cumsum(0)
        path = path.extend(more, straight=straight)
        torch.testing.assert_close(path.at(path.marks[-2:]).position, more, rtol=0, atol=2e-2)
        assert 0 <= path.length - float(path.marks[-1]) <= path.spacing
    chords = (path.points[1:] - path.points[:-1]).norm(dim=-1)
    assert chords.max() <= path.spacing * (1 + 1e-9)
    corners = 6 if straight else 0
    assert int((chords < 0.99 * path.spacing).sum()) <= corners + 2


def test_a_smooth_path_is_led_on_without_a_corner(generator):
    path = Path.through(number([[0.0, 0.0], [0.0, 2.0], [1.0, 3.0]]), smoothing=0.0)
    longer = path.extend(number([[1.0, 5.0], [-1.0, 5.0]]))
    joint = slice(len(path.points) - 3, len(path.points) + 3)
    turns = longer.curvatures[joint] * longer.spacing
    assert turns.abs().max() < 0.1
    corner = path.extend(number([[1.0, 5.0], [-1.0, 5.0]]), straight=True)
    assert (corner.curvatures[joint] * corner.spacing).abs().max() > 0.5


def test_a_closed_path_cannot_be_led_on(loop):
    with pytest.raises(ConfigError, match="a closed path has no end to lead on from; draw it open"):
        loop.extend(number([[3.0, 3.0]]))


def test_faults_of_tracks_are_named(line):
    two = number([1.0, 2.0])
    for message, fault in {
        "track 'speed' of a path: 2 values for 41 places; give one for each point, or at=": (
            lambda: line.with_scalar("speed", two)
        ),
        "track 'speed' of a path: 2 values for 3 places": (
            lambda: line.with_scalar("speed", two, at=number([0.0, 1.0, 2.0]))
        ),
        "track 'speed' of a path: value 1 is not finite; mend it or leave it out": (
            lambda: line.with_scalar("speed", two / number([1.0, 0.0]), at=two)
        ),
        "value 1 is at 4.5 m, expected 0 to 4 m, the length of the path": (
            lambda: line.with_scalar("speed", two, at=number([0.0, 4.5]))
        ),
        "value 1 is at 1 m, before value 0 at 2 m; sort them by arc length": (
            lambda: line.with_scalar("speed", two, at=two.flip(0))
        ),
        "track 'facing' of a path: value 0 is (0, 0), expected a vector that points somewhere": (
            lambda: line.with_direction("facing", torch.zeros(1, 2))
        ),
    }.items():
        with pytest.raises(DataError) as caught:
            fault()
        assert message in str(caught.value)


def test_a_track_that_is_not_there_is_named_with_those_that_are(line):
    path = line.with_scalar("speed", 1.0).with_direction("facing", number([[1.0, 0.0]]))
    with pytest.raises(ConfigError, match=r"no track 'sped'; did you mean 'speed'\? known: speed"):
        path.scalar("sped", number(0.0))
    with pytest.raises(ConfigError, match="no track 'speed'; known: facing"):
        path.direction("speed", number(0.0))
