"""Way points as CSV or JSON: rows of named numbers, each with its place in the file."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Mapping, Sequence
from os import PathLike
from typing import Any, NamedTuple

from posecast.config import did_you_mean
from posecast.errors import DataError
from posecast.io.files import decode_text, read_text_bytes

REQUIRED = ("x", "z")
OPTIONAL = ("t", "facing", "speed")

_SHOWN = 40
"""Characters of what was found that a message shows."""

_ON_FLOOR = (
    "way points lie on the floor, at x and z, with +z towards the viewer of a drawing seen from "
    "above; call y z if it grows that way, else turn its sign"
)


class Row(NamedTuple):
    """One way point of a file.

    Args:
        place: in the file, where that is not its line, such as "points[3]: "; else "".
        line: counted from 1, where it is known.
        numbers: those of ``REQUIRED`` and ``OPTIONAL`` that it has, finite.
    """

    place: str
    line: int | None
    numbers: Mapping[str, float]


class Table(NamedTuple):
    """What a file says; ``closed`` and ``straight`` are ``None`` where it does not."""

    rows: Sequence[Row]
    closed: bool | None = None
    straight: bool | None = None


def read_csv(file: str | PathLike[str]) -> Table:
    """Comma-separated way points, one a line; blank lines and those that begin with # are none.

    The first line may name the columns, in any order: x and z, and t, facing, speed where wanted,
    whose fields may be empty. Without it there are two columns, x and z.

    Raises:
        DataError: columns or a number that are not these; names the line.
    """
    text = decode_text(read_text_bytes(file, "way points as comma-separated x and z"))
    rows: list[Row] = []
    columns: Sequence[str] | None = None
    for line, content in enumerate(text.split("\n"), start=1):
        if not content.strip() or content.lstrip().startswith("#"):
            continue
        fields = _fields(file, content, line)
        if columns is None:
            named = not any(_is_number(field) for field in fields)
            columns = (
                _named_columns(file, fields, line) if named else _two_columns(file, fields, line)
            )
            if named:
                continue
        if len(fields) != len(columns):
            raise DataError(
                file,
                f"{len(fields)} fields, expected {len(columns)} ({','.join(columns)}); separate "
                "numbers by commas and write 1.5, not 1,5",
                line=line,
            )
        numbers = {
            column: _number(file, field, line=line, column=column)
            for column, field in zip(columns, fields, strict=True)
            if field or column in REQUIRED
        }
        rows.append(Row("", line, numbers))
    return Table(rows)


def _fields(file: str | PathLike[str], content: str, line: int) -> list[str]:
    try:
        return [field.strip() for field in next(csv.reader([content]))]
    except csv.Error as error:
        raise DataError(file, f"no comma-separated fields ({error}); mend it", line=line) from None


def _named_columns(file: str | PathLike[str], fields: Sequence[str], line: int) -> Sequence[str]:
    columns = [field.lower()[:_SHOWN] for field in fields]
    for column in columns:
        if column not in (*REQUIRED, *OPTIONAL):
            hint = _ON_FLOOR if column == "y" else did_you_mean(column, (*REQUIRED, *OPTIONAL))
            raise DataError(file, f"unknown column {column!r}; {hint}", line=line)
        if columns.count(column) > 1:
            raise DataError(file, f"column {column!r} is there twice; leave one out", line=line)
    for column in REQUIRED:
        if column not in columns:
            raise DataError(
                file, f"no column {column!r} among {','.join(columns)}; add it", line=line
            )
    return columns


def _two_columns(file: str | PathLike[str], fields: Sequence[str], line: int) -> Sequence[str]:
    if len(fields) != len(REQUIRED):
        raise DataError(
            file,
            f"{len(fields)} fields and no line that names them, expected x,z; begin the file with "
            "a line such as x,z,t,facing,speed",
            line=line,
        )
    return REQUIRED


def _is_number(field: str) -> bool:
    try:
        float(field)
    except ValueError:
        return False
    return field.isascii() and "_" not in field  # Python reads 1_000 and foreign digits, too.


def _number(file: str | PathLike[str], field: str, *, line: int, column: str) -> float:
    if not _is_number(field) or not math.isfinite(float(field)):
        raise DataError(
            file, f"{column} is {field[:_SHOWN]!r}, expected a finite number; mend it", line=line
        )
    return float(field)


def read_json(file: str | PathLike[str]) -> Table:
    """Way points as ``{"points": [[x, z], ...], "closed": false, "straight": false}``.

    A point may be an object with x, z and what else it has of t, facing and speed. Everything but
    ``points`` may be left out.

    Raises:
        DataError: no JSON, or not of this form; names the line or the point.
    """
    text = decode_text(read_text_bytes(file, "way points as JSON"))
    try:
        content = json.loads(text)
    except json.JSONDecodeError as error:
        message = f"no JSON: {error.msg} in column {error.colno}; mend it"
        raise DataError(file, message, line=error.lineno) from None
    except (RecursionError, ValueError) as error:  # too deep, or a number of too many digits
        raise DataError(file, f"no JSON that can be read ({error}); write way points") from None
    if not isinstance(content, dict) or not isinstance(content.get("points"), list):
        raise DataError(file, 'expected an object like {"points": [[0, 0], [0, 2.5]]}')
    for key in content:
        if key not in ("points", "closed", "straight"):
            known = did_you_mean(key, ("points", "closed", "straight"))
            raise DataError(file, f"unknown key {key[:_SHOWN]!r}; {known}")
    rows = [_json_row(file, f"points[{i}]: ", point) for i, point in enumerate(content["points"])]
    return Table(rows, _json_flag(file, content, "closed"), _json_flag(file, content, "straight"))


def _json_row(file: str | PathLike[str], place: str, point: Any) -> Row:
    if isinstance(point, list) and len(point) == len(REQUIRED):
        point = dict(zip(REQUIRED, point, strict=True))
    if not isinstance(point, dict):
        found = json.dumps(point)[:_SHOWN]
        raise DataError(file, f'{place}{found}, expected [x, z] or {{"x": 0, "z": 2.5}}')
    numbers: dict[str, float] = {}
    for key, value in point.items():
        if key not in (*REQUIRED, *OPTIONAL):
            hint = _ON_FLOOR if key == "y" else did_you_mean(key, (*REQUIRED, *OPTIONAL))
            raise DataError(file, f"{place}unknown key {key[:_SHOWN]!r}; {hint}")
        if value is None and key in OPTIONAL:
            continue
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not _finite(value):
            found = json.dumps(value)[:_SHOWN]
            raise DataError(file, f"{place}{key} is {found}, expected a finite number; mend it")
        numbers[key] = float(value)
    for key in REQUIRED:
        if key not in numbers:
            raise DataError(file, f"{place}no {key!r}; add it")
    return Row(place, None, numbers)


def _finite(value: int | float) -> bool:
    try:
        return math.isfinite(value)
    except OverflowError:  # a whole number that no float can be
        return False


def _json_flag(file: str | PathLike[str], content: Mapping[str, Any], key: str) -> bool | None:
    flag = content.get(key)
    if flag is not None and not isinstance(flag, bool):
        raise DataError(file, f"{key} is {json.dumps(flag)[:_SHOWN]}, expected true or false")
    return flag
