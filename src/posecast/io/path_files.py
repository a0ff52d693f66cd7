"""Reading paths on the floor from files: way points as CSV or JSON, drawings as SVG."""

from __future__ import annotations

import math
from collections.abc import Sequence
from os import PathLike
from pathlib import Path as FilePath

import torch
from jaxtyping import Float64
from torch import Tensor

from posecast.errors import ConfigError, DataError
from posecast.io.svg import read_svg
from posecast.io.waypoint_text import OPTIONAL, REQUIRED, Row, read_csv, read_json
from posecast.motion import Path, WayPoints
from posecast.motion.curve import polyline
from posecast.motion.path_checks import SAME_PLACE, check_waypoints
from posecast.motion.path_scale import SMOOTHING, SPACING
from posecast.motion.places import heading

_READERS = {".csv": read_csv, ".json": read_json}

_SVG = ".svg"

_CENTIMETRE = 0.01

_UNASKED = math.nan


def read_path(
    file: str | PathLike[str],
    *,
    closed: bool | None = None,
    straight: bool | None = None,
    unit: float | None = None,
    id: str | None = None,
    spacing: float = SPACING,
    smoothing: float = SMOOTHING,
) -> Path:
    """Read a path on the floor, in the format that the extension names.

    It has the tracks ``speed`` and ``facing`` where the file says something about them. Arrival
    times are not part of a path: ``read_waypoints`` has them, in the order of ``path.marks``.

    Args:
        file, closed, straight, unit, id: see ``read_waypoints``.
        spacing, smoothing: see ``Path.through``.

    Raises:
        DataError, ConfigError: see ``read_waypoints`` and ``Path.through``.
    """
    waypoints = read_waypoints(file, closed=closed, straight=straight, unit=unit, id=id)
    return waypoints.path(spacing=spacing, smoothing=smoothing, name=file)


def read_waypoints(
    file: str | PathLike[str],
    *,
    closed: bool | None = None,
    straight: bool | None = None,
    unit: float | None = None,
    id: str | None = None,
) -> WayPoints:
    """Read what a file asks for along a path: ``.csv``, ``.json`` or ``.svg``.

    docs/formats.md shows each. Seen from above, the x of a file goes to the right and its z (of an
    SVG: its y) down the page; up, y, comes out of it.

    Args:
        file: the file.
        closed: whether the last way point is joined to the first; ``None``: as the file says. A
            JSON file does; a drawing is closed where it ends at its start; rows are where the last
            repeats the first and asks for nothing of its own, such as an arrival time.
        straight: whether way points are joined by straight lines; ``None``: as the file says,
            which for a drawing is its own curve, and a smooth curve where nothing is said.
        unit: metres in a unit of the file's coordinates; ``None``: 0.01 for SVG, 1 otherwise.
        id: which element of an SVG; ``None``: the first path.

    Raises:
        DataError: no file of a known extension, or not of its format; way points without a path
            through them; arrival times that do not rise, or a negative speed.
        ConfigError: a unit that is not positive, ``id`` of a file that is no SVG, or SVG without
            the extra ``svg``.
    """
    extension = FilePath(file).suffix.lower()
    if unit is not None and not 0 < unit < math.inf:
        raise ConfigError(f"unit is {unit}: expected a positive number of metres")
    if extension == _SVG:
        return _drawn(file, closed, straight, _CENTIMETRE if unit is None else unit, id)
    if extension not in _READERS:
        raise DataError(
            file,
            f"extension {extension!r}, expected a path as {', '.join((*_READERS, _SVG))}; convert "
            "it first",
        )
    if id is not None:
        raise ConfigError(f"{file}: id={id!r} names an element of an SVG; leave it out")
    table = _READERS[extension](file)
    closed = table.closed if closed is None else closed
    straight = table.straight if straight is None else straight
    return _listed(file, table.rows, closed, bool(straight), 1.0 if unit is None else unit)


def _drawn(
    file: str | PathLike[str],
    closed: bool | None,
    straight: bool | None,
    unit: float,
    id: str | None,
) -> WayPoints:
    """The way points of a drawing are the ends of its pieces."""
    drawing = read_svg(file, unit=unit, id=id)
    samples, nodes = torch.from_numpy(drawing.samples), torch.tensor(drawing.nodes)
    returns = bool(torch.allclose(samples[0], samples[-1], rtol=0, atol=SAME_PLACE))
    closed = returns if closed is None else closed
    if closed and returns:
        nodes = nodes[:-1]
    elif closed:
        samples = torch.cat([samples, samples[:1]])
    if straight is None:
        curve = polyline(samples, nodes)
        return WayPoints(samples[nodes], closed=closed, curve=curve)
    points = samples[nodes]
    check_waypoints(file, points, closed=closed)
    return WayPoints(points, closed=closed, straight=straight)


def _listed(
    file: str | PathLike[str], rows: Sequence[Row], closed: bool | None, straight: bool, unit: float
) -> WayPoints:
    """The way points of a text."""
    repeats = len(rows) > 1 and all(
        abs(rows[0].numbers[axis] - rows[-1].numbers[axis]) * unit < SAME_PLACE for axis in REQUIRED
    )
    own = [key for key in rows[-1].numbers if key in OPTIONAL] if rows else []
    if closed is None:  # Two rows and the first once more: there and back.
        closed = repeats and len(rows) > 3 and not own
    if closed and repeats:
        if own:
            raise _fault(
                file,
                rows[-1],
                f"repeats the first way point of a closed path but has its own {own[0]}; leave it "
                "out, or pass closed=False for a path that ends there",
            )
        rows = rows[:-1]
    points = unit * torch.tensor(
        [[row.numbers["x"], row.numbers["z"]] for row in rows], dtype=torch.float64
    ).reshape(-1, 2)
    lines = [row.line for row in rows]
    check_waypoints(file, points, closed=closed, lines=lines)
    facing = _column(rows, "facing")
    _check_asked(file, rows)
    return WayPoints(
        points,
        times=_column(rows, "t"),
        facing=None if facing is None else heading(facing.deg2rad()),
        speed=_column(rows, "speed"),
        closed=closed,
        straight=straight,
    )


def _column(rows: Sequence[Row], key: str) -> Float64[Tensor, " waypoints"] | None:
    """What each row asks for, or ``None`` where none does."""
    values = [row.numbers.get(key, _UNASKED) for row in rows]
    if all(map(math.isnan, values)):
        return None
    return torch.tensor(values, dtype=torch.float64)


def _check_asked(file: str | PathLike[str], rows: Sequence[Row]) -> None:
    """Refuse what nobody can do: arrive before having started, walk at a negative speed."""
    latest = -math.inf
    for row in rows:
        time, speed = row.numbers.get("t", math.inf), row.numbers.get("speed", 0.0)
        if time < 0 or time <= latest:
            expected = "0 or later" if time < 0 else f"later than {latest:g} s, the one before"
            raise _fault(file, row, f"arrival time t is {time:g} s, expected {expected}; mend it")
        if speed < 0:
            raise _fault(file, row, f"speed is {speed:g} m/s, expected 0 or more; mend it")
        latest = latest if math.isinf(time) else time


def _fault(file: str | PathLike[str], row: Row, message: str) -> DataError:
    return DataError(file, row.place + message, line=row.line)
