"""What is refused about paths, and in which words."""

import pytest
import torch

from posecast.errors import ConfigError, DataError
from posecast.motion import Path
from posecast.motion.checks import check_path
from posecast.motion.path_checks import check_waypoints

NAN, INF = float("nan"), float("inf")


def waypoints(*points):
    return torch.tensor(points, dtype=torch.float64).reshape(-1, 2)


@pytest.mark.parametrize(
    ("points", "closed", "message"),
    [
        ([], False, "path: 0 way points, expected at least 2 for a path; add where it leads"),
        ([(0, 1)], False, "path: 1 way point, expected at least 2 for a path"),
        ([(0, 1), (0, 2)], True, "path: 2 way points, expected at least 3 for a closed path"),
        (
            [(0, 1), (2, NAN), (3, 3)],
            False,
            "path: way point 2 of 3 is (x, z) = (2, nan), expected finite numbers; mend it or "
            "leave it out",
        ),
        ([(-INF, 1), (2, 2)], False, "path: way point 1 of 2 is (x, z) = (-inf, 1)"),
        (
            [(0, 1), (2, 2.5), (2, 2.5), (4, 4)],
            False,
            "path: way points 2 and 3 of 4 are both at (x, z) = (2, 2.5), expected neighbours to "
            "differ; leave out one of them",
        ),
        (
            [(0, 1), (2, 2.5), (3, 0), (0, 1)],
            True,
            "path: way points 4 and 1 of 4 are both at (x, z) = (0, 1), expected neighbours to "
            "differ; a closed path comes back to its first way point by itself: leave out the last",
        ),
        (
            [(0, 0), (0, 1e6)],
            False,
            "path: 1e+06 m long, which is 8.9e+07 points 0.0113 m apart, expected at most 1e+06; "
            "is the unit right? If so, space them wider",
        ),
    ],
)
@pytest.mark.parametrize("straight", [False, True])
def test_way_points_without_a_path_through_them_are_named(points, closed, message, straight):
    with pytest.raises(DataError) as caught:
        Path.through(waypoints(*points), closed=closed, straight=straight)
    assert message in str(caught.value)


def test_the_first_way_point_may_come_again_and_a_path_may_cross_itself():
    path = Path.through(waypoints((0, 0), (1, 1), (0, 2), (0, 0)))
    assert len(path.marks) == 4
    assert float(path.distance_to(torch.zeros(2))) < 1e-9


def test_a_path_is_called_what_its_drawer_calls_it():
    with pytest.raises(DataError, match=r"^drawn\.csv, line 7: way points 1 and 2 of 2 are both"):
        check_waypoints("drawn.csv", waypoints((1, 1), (1, 1)), lines=[3, 7])
    with pytest.raises(DataError, match=r"^drawn\.csv: 1 way point"):
        Path.through(waypoints((1, 1)), name="drawn.csv")


@pytest.mark.parametrize("spacing", [0.0, -1.0, NAN, INF])
def test_a_spacing_that_is_none_is_refused(spacing):
    line = waypoints((0, 0), (0, 1))
    with pytest.raises(ConfigError, match=r"spacing is .*: expected a positive number of metres"):
        Path.through(line, spacing=spacing)
    with pytest.raises(ConfigError, match="spacing is"):
        Path.along(line, spacing=spacing)


def test_a_smoothing_that_is_none_is_refused():
    with pytest.raises(ConfigError, match=r"smoothing is -0\.1: expected 0 metres or more"):
        Path.through(waypoints((0, 0), (0, 1)), smoothing=-0.1)


def test_a_track_that_never_moves_or_is_nowhere_is_refused():
    with pytest.raises(DataError, match=r"^root: never moves, expected a track that leads some"):
        Path.along(waypoints((1, 1), (1, 1), (1, 1)), name="root")
    with pytest.raises(DataError, match=r"^root: position 2 of 2 is"):
        Path.along(waypoints((1, 1), (NAN, 1)), name="root")


def test_points_and_tracks_that_are_not_finite_are_refused():
    line = waypoints((0, 0), (0, 1))
    with pytest.raises(DataError, match="path: point 2 of 2 is"):
        Path(waypoints((0, 0), (0, NAN)), 1.0)
    with pytest.raises(DataError, match="track 'speed' of a path: value 1 is not finite"):
        Path(line, 1.0, scalars={"speed": torch.tensor([1.0, NAN]).double()})


def test_a_path_is_refused_only_where_one_asks_for_a_longer_or_wider_one():
    path = Path.through(waypoints((0, 0), (0, 3), (3, 3)), straight=True)
    check_path("p.csv", path)
    check_path("p.csv", path, least_length=5.9, least_radius=0.05)
    with pytest.raises(DataError) as caught:
        check_path("p.csv", path, least_length=7.0)
    assert str(caught.value) == "p.csv: 6 m long, expected at least 7 m; lead it farther"
    with pytest.raises(DataError) as caught:
        check_path("p.csv", path, least_radius=0.5)
    assert str(caught.value) == (
        "p.csv: turns with a radius of 0.0709 m at (x, z) = (0, 3), 3 m from its start, near way "
        "point 2 of 3; expected at least 0.5 m: widen the bend there"
    )
    with pytest.raises(ConfigError, match="least_radius is -1: expected 0 metres or more"):
        check_path("p.csv", path, least_radius=-1)
