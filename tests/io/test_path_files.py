"""Paths from CSV and JSON: what they say is kept, and what is wrong is named."""

import json
import math
from pathlib import Path as FilePath

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from posecast.errors import ConfigError, DataError
from posecast.io import read_path, read_waypoints

EXAMPLES = FilePath(__file__).parents[2] / "examples"


@pytest.fixture
def write(tmp_path):
    """Write a text and return the file."""

    def writer(text, name="path.csv"):
        file = tmp_path / name
        file.write_text(text, encoding="utf-8")
        return file

    return writer


def numbers(*rows):
    return torch.tensor(rows, dtype=torch.float64)


def test_the_example_is_a_figure_eight_that_begins_at_the_origin_heading_forward():
    path = read_path(EXAMPLES / "figure_eight.csv")
    assert len(path.marks) == 13
    assert 19 < path.length < 20
    assert not path.closed
    torch.testing.assert_close(path.points[0], torch.zeros(2).double())
    assert float(path.tangents[0, 1]) > 0.999
    # Gentle enough to walk, and it turns both ways by three quarters of a circle or so.
    assert float(path.curvatures.abs().max()) < 1.1
    turns = path.curvatures * path.spacing
    assert math.degrees(float(turns.clamp(min=0).sum())) == pytest.approx(270, abs=25)
    assert math.degrees(float(turns.clamp(max=0).sum())) == pytest.approx(-230, abs=25)
    crossing = torch.tensor([0.0, 1.5])
    for near in (1.5, 11.5):
        place = path.at(path.nearest(crossing, near=torch.tensor(near)))
        assert float((place.position - crossing).norm()) < 0.05


@pytest.mark.parametrize(
    "text",
    [
        "0,0\n0,2\n1.5,3\n",
        "x,z\n0,0\n0,2\n1.5,3",
        "z,x\n0,0\n2,0\n3,1.5\n",
        "# drawn by hand\n\n X , Z \r\n 0, 0\r\n0 ,2.0\r\n\r\n# half way\r\n1.5e0,3\r\n",
        '\ufeff"x","z"\n"0","0"\n0,2\n1.5,3\n',
    ],
)
def test_csv_with_or_without_names_of_columns_is_read_alike(write, text):
    waypoints = read_waypoints(write(text))
    torch.testing.assert_close(waypoints.points, numbers([0, 0], [0, 2], [1.5, 3]))
    assert waypoints.times is None
    assert waypoints.facing is None
    assert not waypoints.closed


def test_what_rows_ask_for_is_kept_with_gaps_where_they_do_not(write):
    file = write("x,z,t,facing,speed\n0,0,0,90,\n0,2,,,1.5\n0,4,3.5,-90,0.5\n")
    waypoints = read_waypoints(file)
    torch.testing.assert_close(waypoints.times, numbers(0, math.nan, 3.5), equal_nan=True)
    torch.testing.assert_close(waypoints.speed, numbers(math.nan, 1.5, 0.5), equal_nan=True)
    # Degrees from +z towards +x: at 90 the body faces +x.
    torch.testing.assert_close(
        waypoints.facing, numbers([1, 0], [math.nan] * 2, [-1, 0]), equal_nan=True
    )
    path = read_path(file)
    torch.testing.assert_close(path.marks, numbers(0, 2, 4))
    speed = path.scalar("speed", numbers(0, 2, 3, 4))
    # A way point lies between two points of the path: its speed is right to a segment's change.
    torch.testing.assert_close(speed, numbers(1.5, 1.5, 1, 0.5), rtol=0, atol=0.5 * path.spacing)
    assert set(path.directions) == {"facing"}
    assert len(waypoints.times) == len(path.marks)


def test_a_unit_scales_places_and_nothing_else(write):
    file = write("x,z,speed\n0,0,1.5\n0,200,1.5\n")
    path = read_path(file, unit=0.01)
    assert path.length == pytest.approx(2.0)
    assert float(path.scalars["speed"].max()) == 1.5
    with pytest.raises(ConfigError, match="unit is 0: expected a positive number of metres"):
        read_path(file, unit=0)


def test_json_holds_pairs_or_objects_and_says_how_they_are_joined(write):
    points = [[0, 0], {"x": 0, "z": 2, "t": 1.5, "facing": None}, {"z": 2, "x": 2, "speed": 1}]
    content = {"points": points, "closed": True, "straight": True}
    waypoints = read_waypoints(write(json.dumps(content), "p.json"))
    assert (waypoints.closed, waypoints.straight) == (True, True)
    torch.testing.assert_close(waypoints.points, numbers([0, 0], [0, 2], [2, 2]))
    torch.testing.assert_close(waypoints.times, numbers(math.nan, 1.5, math.nan), equal_nan=True)
    assert waypoints.facing is None
    path = read_path(write(json.dumps(content), "p.json"))
    assert path.length == pytest.approx(4 + math.sqrt(8))
    opened = read_path(write(json.dumps(content), "p.json"), closed=False, straight=False)
    assert not opened.closed
    assert float(opened.curvatures.abs().max()) < 5  # no corner


def test_rows_that_come_back_to_the_first_are_closed_unless_the_last_asks_for_its_own(write):
    square = "x,z{}\n0,0{}\n0,2,\n2,2,\n0,0{}\n"
    closed = read_waypoints(write(square.format(",t", ",0", ",")))
    assert closed.closed
    assert len(closed.points) == 3
    timed = write(square.format(",t", ",0", ",9.5"))
    arrives = read_waypoints(timed)
    assert not arrives.closed
    torch.testing.assert_close(arrives.times[[0, 3]], numbers(0, 9.5))
    with pytest.raises(DataError) as caught:
        read_waypoints(timed, closed=True)
    assert str(caught.value) == (
        f"{timed}, line 5: repeats the first way point of a closed path but has its own t; leave "
        "it out, or pass closed=False for a path that ends there"
    )
    opened = read_waypoints(write(square.format(",t", ",0", ",")), closed=False)
    assert (opened.closed, len(opened.points)) == (False, 4)
    assert read_waypoints(write("0,0\n0,2\n2,2\n"), closed=True).closed
    assert not read_waypoints(write("0,0\n0,2\n0,0\n")).closed  # there and back


coordinates = st.floats(-100, 100).map(lambda value: round(value, 3))
rows = st.lists(st.tuples(coordinates, coordinates), min_size=2, max_size=9, unique=True)


@settings(deadline=None, max_examples=40)
@given(rows, st.booleans())
def test_way_points_come_back_as_they_were_written(tmp_path_factory, points, as_json):
    folder = tmp_path_factory.mktemp("paths")
    if as_json:
        file = folder / "p.json"
        file.write_text(json.dumps({"points": [list(point) for point in points]}))
    else:
        file = folder / "p.csv"
        file.write_text("x,z\n" + "".join(f"{x},{z}\n" for x, z in points))
    read = read_waypoints(file)
    torch.testing.assert_close(read.points, numbers(*points), rtol=0, atol=0)
    path = read_path(file, straight=True)
    corners = numbers(*points).diff(dim=0).norm(dim=-1).cumsum(0)
    torch.testing.assert_close(path.marks[1:], corners, rtol=1e-12, atol=1e-9)


CSV_FAULTS = {
    "": ": is empty, expected way points as comma-separated x and z; copy it again",
    "x,z\n": ": 0 way points, expected at least 2 for a path; add where it leads",
    "0,0\n": ": 1 way point, expected at least 2",
    "0,0\n0,0\n": ", line 2: way points 1 and 2 of 2 are both at (x, z) = (0, 0)",
    "x,z\n0,0\n# gap\n1,1\n1,1\n": ", line 5: way points 2 and 3 of 3 are both at",
    "0,0\n0,abc\n": ", line 2: z is 'abc', expected a finite number; mend it",
    "0,0\n0,\n": ", line 2: z is '', expected a finite number",
    "0,0\n0,nan\n": ", line 2: z is 'nan', expected a finite number",
    "0,0\n-inf,1\n": ", line 2: x is '-inf', expected a finite number",
    "0,0\n0,1,2\n": ", line 2: 3 fields, expected 2 (x,z); separate numbers by commas and write",
    "0;0\n0;1\n": ", line 1: unknown column '0;0'; known: facing, speed, t, x, z",
    "0,0,0\n0,1,1\n": (
        ", line 1: 3 fields and no line that names them, expected x,z; begin the file with a line "
        "such as x,z,t,facing,speed"
    ),
    "x,y\n0,0\n0,1\n": ", line 1: unknown column 'y'; way points lie on the floor, at x and z",
    "x,z,face\n0,0,0\n0,1,1\n": ", line 1: unknown column 'face'; did you mean 'facing'?",
    "x,t\n0,0\n0,1\n": ", line 1: no column 'z' among x,t; add it",
    "x,z,x\n0,0,0\n": ", line 1: column 'x' is there twice; leave one out",
    "x,z,t\n0,0,0\n0,1,2\n0,2,2\n": (
        ", line 4: arrival time t is 2 s, expected later than 2 s, the one before; mend it"
    ),
    "x,z,t\n0,0,3\n0,1,\n0,2,2\n": ", line 4: arrival time t is 2 s, expected later than 3 s",
    "x,z,t\n0,0,-1\n0,1,2\n": ", line 2: arrival time t is -1 s, expected 0 or later; mend it",
    "x,z,speed\n0,0,1\n0,1,-2\n": ", line 3: speed is -2 m/s, expected 0 or more; mend it",
    "0,0\n0,1e9\n": ": 1e+09 m long, which is 8.9e+10 points 0.0113 m apart",
}

JSON_FAULTS = {
    '{"points": [[0,0],\n[0 1]]}': ", line 2: no JSON: Expecting ',' delimiter in column 4; mend",
    "[[0,0],[0,1]]": ': expected an object like {"points": [[0, 0], [0, 2.5]]}',
    '{"point": []}': ': expected an object like {"points"',
    '{"points": [[0,0],[0,1]], "close": true}': ": unknown key 'close'; did you mean 'closed'?",
    '{"points": [[0,0],[0,1]], "closed": 1}': ": closed is 1, expected true or false",
    '{"points": [[0,0],[0,1,2]]}': ': points[1]: [0, 1, 2], expected [x, z] or {"x": 0, "z": 2.5}',
    '{"points": [[0,0],[0,"1"]]}': ': points[1]: z is "1", expected a finite number; mend it',
    '{"points": [[0,0],[0,NaN]]}': ": points[1]: z is NaN, expected a finite number",
    '{"points": [[0,0],[0,1e999]]}': ": points[1]: z is Infinity, expected a finite number",
    '{"points": [[0,0],[0,true]]}': ": points[1]: z is true, expected a finite number",
    '{"points": [[0,0],{"x":0,"y":1}]}': ": points[1]: unknown key 'y'; way points lie on",
    '{"points": [[0,0],{"x":0}]}': ": points[1]: no 'z'; add it",
    '{"points": [[0,0],{"x":0,"z":null}]}': ": points[1]: z is null, expected a finite number",
    '{"points": [{"x":0,"z":0,"t":1},{"x":0,"z":1,"t":0}]}': (
        ": points[1]: arrival time t is 0 s, expected later than 1 s"
    ),
    '{"points": [[0,0],[0,0]]}': ": way points 1 and 2 of 2 are both at",
    "[" * 100_000: ": no JSON that can be read",
    '{"points": [[0,0],[0,1' + "0" * 400 + "]]}": ": points[1]: z is 1000",
}


@pytest.mark.parametrize(
    ("extension", "text", "message"),
    [
        *((".csv", text, message) for text, message in CSV_FAULTS.items()),
        *((".json", text, message) for text, message in JSON_FAULTS.items()),
    ],
)
def test_faults_are_named_with_file_and_place(write, extension, text, message):
    file = write(text, f"faulty{extension}")
    with pytest.raises(DataError) as caught:
        read_path(file)
    assert str(caught.value).startswith(f"{file}{message}")


def test_files_that_are_none_or_of_another_kind_are_refused(tmp_path, write):
    with pytest.raises(DataError, match=r"no\.csv: there is no such file; check the path"):
        read_path(tmp_path / "no.csv")
    with pytest.raises(DataError, match=r"'\.txt', expected a path as \.csv, \.json, \.svg; conv"):
        read_path(write("0,0\n0,1", "p.txt"))
    with pytest.raises(ConfigError, match=r"id='a' names an element of an SVG; leave it out"):
        read_path(write("0,0\n0,1"), id="a")
