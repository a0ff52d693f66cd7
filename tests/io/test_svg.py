"""Paths from SVG drawings: seen from above, as drawn, with all transforms."""

import math
import sys

import pytest
import torch

from posecast.errors import ConfigError, DataError
from posecast.io import read_path, read_waypoints

pytest.importorskip("svgpathtools")

HEAD = '<?xml version="1.0"?>\n<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 9 9">'


@pytest.fixture
def draw(tmp_path):
    """Write a drawing with some content and return the file."""

    def writer(content):
        file = tmp_path / "drawn.svg"
        file.write_text(f"{HEAD}{content}</svg>", encoding="utf-8")
        return file

    return writer


def numbers(*rows):
    return torch.tensor(rows, dtype=torch.float64)


def test_a_drawing_is_the_floor_seen_from_above_in_centimetres(draw):
    file = draw('<path d="M 0 0 L 0 200 H 300 l -50 -50"/>')
    waypoints = read_waypoints(file)
    torch.testing.assert_close(waypoints.points, numbers([0, 0], [0, 2], [3, 2], [2.5, 1.5]))
    path = read_path(file)
    assert path.length == pytest.approx(5 + math.hypot(0.5, 0.5))
    torch.testing.assert_close(path.tangents[0], numbers(0, 1))
    # Down the page is +z, to the right is +x: from +z to +x is a turn to the left.
    assert float(path.curvatures[: len(path.points) // 2 + 1].sum()) > 0
    assert read_path(file, unit=1.0).length == pytest.approx(100 * path.length)


@pytest.mark.parametrize(
    "curve",
    [
        '<path d="M -100 0 A 100 100 0 0 0 100 0 A 100 100 0 0 0 -100 0 Z"/>',
        '<g transform="rotate(135)"><path d="M 0 -100 a 100 100 0 1 0 .001 0 z"/></g>',
        '<g transform="translate(0 0)"><g transform="scale(2 -1)"><path transform="scale(.5 1)"'
        ' d="M -100 0 A 100 100 0 0 1 100 0 A 100 100 0 0 1 -100 0"/></g></g>',
        '<path transform="matrix(0.1 1 -1 0.1 0 0) scale(0.995037)"'
        ' d="M -100 0 A 100 100 0 0 0 100 0 A 100 100 0 0 0 -100 0 Z"/>',
    ],
)
def test_arcs_keep_their_shape_and_sense_under_any_transform(draw, curve):
    path = read_path(draw(curve))
    assert path.closed
    assert path.length == pytest.approx(2 * math.pi, rel=1e-5)
    torch.testing.assert_close(
        path.points.norm(dim=-1), torch.ones(len(path.points)).double(), rtol=0, atol=2e-5
    )
    torch.testing.assert_close(
        path.curvatures, torch.ones(len(path.points)).double(), rtol=0, atol=5e-3
    )


def test_an_arc_bulges_to_the_same_side_of_its_chord_under_a_skewed_turn(draw):
    # The diagonal of the matrix is of mixed sign although it does not mirror.
    arc = '<path d="M -100 0 A 100 100 0 0 0 100 0"/>'
    skewed = read_path(draw(f'<g transform="matrix(0.1 1 -1 -0.1 0 0)">{arc}</g>'))
    assert float(skewed.distance_to(numbers(-1.0, -0.1))) < 1e-3  # of (0, 100)
    assert float(skewed.distance_to(numbers(1.0, 0.1))) > 0.8  # of (0, -100)


def test_transforms_of_groups_act_from_the_outermost_to_the_element(draw):
    file = draw(
        '<g transform="translate(100 0)"><g transform="rotate(90)">'
        '<path transform="translate(10,20) scale(2)" d="M0 0 L 50 0"/></g></g>'
    )
    # (50, 0) -> (100, 0) -> (110, 20) -> a quarter turn from x to y: (-20, 110) -> (80, 110)
    torch.testing.assert_close(
        read_waypoints(file).points, numbers([0.8, 0.1], [0.8, 1.1]), rtol=0, atol=1e-12
    )


def test_curves_are_those_of_bezier(draw):
    file = draw('<path d="M 0 0 C 0 100 100 200 300 100 S 400 0 500 0 Q 600 0 600 -100"/>')
    path = read_path(file)
    torch.testing.assert_close(
        path.at(path.marks).position, numbers([0, 0], [3, 1], [5, 0], [6, -1]), rtol=0, atol=1e-3
    )
    u = torch.linspace(0, 1, 20_001).double()[:, None]
    a, b, c, d = numbers([0, 0], [0, 1], [1, 2], [3, 1])
    bezier = (1 - u) ** 3 * a + 3 * u * (1 - u) ** 2 * b + 3 * u**2 * (1 - u) * c + u**3 * d
    length = bezier.diff(dim=0).norm(dim=-1).sum()
    torch.testing.assert_close(path.marks[1], length, rtol=1e-5, atol=0)
    assert float(path.distance_to(bezier).max()) < 1e-4


def test_the_first_path_that_is_drawn_is_meant_or_the_element_of_an_id(draw):
    file = draw(
        '<title>a path</title><defs><path d="M0 0L9 9" id="hidden"/></defs><!-- no -->'
        '<rect id="page" width="100" height="50"/><circle id="round" cx="5" r="100"/>'
        '<g><path id="first" d="M0 0 L 100 0"/></g><path id="second" d="M0 0 L 0 300"/>'
        '<polyline id="bent" points="0,0 100,0 100,100"/><line id="line" x2="70" y2="0"/>'
        '<polygon id="three" points="0 0 100 0 0 100"/><ellipse id="e" rx="100" ry="100"/>'
    )
    assert read_path(file).length == pytest.approx(1.0)
    assert read_path(file, id="second").length == pytest.approx(3.0)
    assert read_path(file, id="bent").length == pytest.approx(2.0)
    assert read_path(file, id="line").length == pytest.approx(0.7)
    assert read_path(file, id="page").length == pytest.approx(3.0)
    assert read_path(file, id="page").closed
    assert read_path(file, id="round").length == pytest.approx(2 * math.pi, rel=1e-5)
    assert read_path(file, id="e").length == pytest.approx(2 * math.pi, rel=1e-5)
    assert read_waypoints(file, id="three").points.shape == (3, 2)
    with pytest.raises(DataError, match="no line has the id 'frist'; did you mean 'first'"):
        read_path(file, id="frist")


def test_a_drawing_can_be_closed_opened_and_joined_anew(draw):
    bend = draw('<path d="M 0 0 C 0 100 100 100 100 0"/>')
    drawn = read_path(bend)
    assert not drawn.closed
    closed = read_path(bend, closed=True)
    assert closed.closed
    assert closed.length == pytest.approx(drawn.length + 1.0, rel=1e-5)
    assert read_path(bend, straight=True).length == pytest.approx(1.0)
    square = draw('<path d="M 0 0 H 100 V 100 H 0 Z"/>')
    assert read_path(square).length == pytest.approx(4.0)
    assert len(read_path(square).marks) == 4
    opened = read_path(square, closed=False)
    assert not opened.closed
    torch.testing.assert_close(opened.marks, numbers(0, 1, 2, 3, 4))
    # Almost the circle around it.
    assert read_path(square, straight=False).length == pytest.approx(math.pi * 2**0.5, rel=0.02)


def test_nodes_drawn_twice_are_one(draw):
    file = draw('<path d="M 0 0 L 0 0 L 0 100 C 0 100 0 100 0 100 L 100 100"/>')
    torch.testing.assert_close(read_waypoints(file).points, numbers([0, 0], [0, 1], [1, 1]))


FAULTS = {
    '<path d="M 0 0 L 1"/>': ": <path> cannot be read (Invalid path string: command 'L' expects 2",
    '<path id="p" d="M 0 0 L 1 x 2"/>': ": <path id='p'> cannot be read (a letter or sign that",
    '<path d=""/>': ": <path> leads nowhere, expected a line; draw one",
    '<path d="M 5 5"/>': ": <path> leads nowhere",
    '<path d="M 5 5 L 5 5"/>': ": <path> leads nowhere",
    '<path d="M 0 0 L 9 9 M 1 1 L 2 2"/>': ": <path> consists of several lines, expected one; br",
    '<path transform="turn(3)" d="M 0 0 L 9 9"/>': ": <path> has the transform 'turn(3)' (",
    '<path transform="scale(1 2 3)" d="M 0 0 L 9 9"/>': ": <path> has the transform 'scale(1 2 3)",
    '<g style="transform: scale(2)"><path d="M 0 0 L 9 9"/></g>': ": <g> is transformed by its st",
    "<g/>": ": no <path>, found nothing that is a line; draw one, or name another with id=",
    '<rect id="a"/><line/>': ": no <path>, found <rect id='a'>, <line>; draw one, or name another",
    '<path d="M 0 0 L 1e400 9"/>': ": <path> cannot be read (a number that is not finite); draw",
    '<path d="M 0 0 C 0 9 9 9 1e400 9"/>': ": <path> cannot be read (",
    '<path transform="scale(1e400)" d="M 0 0 L 9 9"/>': ": <path> has the transform 'scale(1e",
    '<path d="M 0 0 L 9e9 9"/>': ": 9e+07 m long, which is 8e+09 points 0.0113 m apart",
    '<path d="M 0 0 L 9 9">': ", line 2: no SVG: mismatched tag",
}


@pytest.mark.parametrize(("content", "message"), FAULTS.items())
def test_faults_of_a_drawing_are_named(draw, content, message):
    file = draw(content)
    with pytest.raises(DataError) as caught:
        read_path(file)
    assert str(caught.value).startswith(f"{file}{message}")


def test_a_file_that_is_no_drawing_is_refused(tmp_path):
    file = tmp_path / "page.svg"
    file.write_text("<html/>")
    with pytest.raises(DataError, match="begins with <html>, expected <svg>"):
        read_path(file)


def test_without_the_extra_the_error_names_it(draw, monkeypatch):
    file = draw('<path d="M 0 0 L 9 9"/>')
    monkeypatch.setitem(sys.modules, "svgpathtools", None)
    with pytest.raises(ConfigError, match=r"reading SVG needs svgpathtools, .* posecast\[svg\]"):
        read_path(file)
