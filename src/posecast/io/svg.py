"""The curve of a path in an SVG drawing, as fine samples in the units of the drawing."""

from __future__ import annotations

import importlib
import math
import re
from collections.abc import Iterator
from itertools import pairwise
from os import PathLike
from typing import Any, NamedTuple
from xml.etree import ElementTree

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from posecast.config import did_you_mean
from posecast.errors import ConfigError, DataError
from posecast.io.files import read_text_bytes

FINENESS = 0.002
"""Metres: about how far samples of curves are apart. Between them the arc of a circle of radius
0.1 m leaves its chord by 5 micrometres."""

_MOST_SAMPLES = 4096
"""Of one curve."""

_CONTAINERS = ("svg", "g", "a", "switch")
"""Elements whose content is drawn where it stands."""

_SHOWN = 40
"""Characters of what was found that a message shows."""

_UNREADABLE = (ValueError, TypeError, AssertionError, ArithmeticError, LookupError)
"""How svgpathtools says that it cannot read something."""

_PATH_DATA = re.compile(r"[MmZzLlHhVvCcSsQqTtAaEe0-9\s,.+-]*")


class Drawing(NamedTuple):
    """One continuous line of a drawing.

    Args:
        samples: (x, z), metres; x is x of the drawing and z its y, which goes down the page.
        nodes: which samples are ends of its pieces, the first and last among them.
    """

    samples: Float[ndarray, "samples 2"]
    nodes: list[int]


def read_svg(file: str | PathLike[str], *, unit: float, id: str | None = None) -> Drawing:
    """Read a line of a drawing, with the transforms of the element and of all groups around it.

    Page size and ``viewBox`` say how large it is shown, not what a unit is; they are not read.

    Args:
        file: an SVG file.
        unit: metres in a unit of the drawing's coordinates.
        id: of the element: a path, line, polyline, polygon, rect, circle or ellipse. ``None``: the
            first path in the file.

    Raises:
        DataError: no SVG, no such element, a line of several pieces, or one that cannot be read.
        ConfigError: svgpathtools is not installed.
    """
    svgpathtools = _svgpathtools()
    shape = _chosen(file, list(_shapes(file, svgpathtools)), id)
    try:
        data = svgpathtools.CONVERSIONS[shape.kind](shape.element)
        if not _PATH_DATA.fullmatch(data):
            raise ValueError("a letter or sign that path data do not have")
        segments = list(svgpathtools.parse_path(data))
        with np.errstate(over="ignore", invalid="ignore"):
            pieces = [_samples(segment, unit * shape.matrix) for segment in segments]
        if not all(np.isfinite(piece).all() for piece in pieces):
            raise ValueError("a number that is not finite")
    except _UNREADABLE as error:
        reason = " ".join(str(error).split())[: 2 * _SHOWN] or type(error).__name__
        raise DataError(file, f"{shape.name} cannot be read ({reason}); draw it anew") from None
    for before, after in pairwise(segments):
        if before.end != after.start:
            raise DataError(
                file,
                f"{shape.name} consists of several lines, expected one; break it apart and name "
                "one of them with id=",
            )
    pieces = [piece for piece in pieces if (piece != piece[0]).any()]
    if not pieces:
        raise DataError(file, f"{shape.name} leads nowhere, expected a line; draw one")
    samples = np.concatenate([pieces[0][:1], *(piece[1:] for piece in pieces)])
    return Drawing(samples, [0, *np.cumsum([len(piece) - 1 for piece in pieces]).tolist()])


def _svgpathtools() -> Any:
    try:
        return importlib.import_module("svgpathtools")
    except ImportError:
        raise ConfigError(
            "reading SVG needs svgpathtools, which is not installed; pip install posecast[svg]"
        ) from None


class _Shape(NamedTuple):
    """An element that is drawn, and where.

    Args:
        matrix: from its coordinates to those of the drawing, applied to (x, y, 1).
    """

    element: ElementTree.Element
    kind: str
    matrix: Float[ndarray, "3 3"]

    @property
    def id(self) -> str:
        return self.element.get("id", "")

    @property
    def name(self) -> str:
        """For messages."""
        kind = self.kind[:_SHOWN]
        return f"<{kind} id={self.id[:_SHOWN]!r}>" if self.id else f"<{kind}>"


def _shapes(file: str | PathLike[str], svgpathtools: Any) -> Iterator[_Shape]:
    """All elements that a line can be made of, in the order of the file."""
    content = read_text_bytes(file, "an SVG drawing")
    try:
        root = ElementTree.fromstring(content)
    except ElementTree.ParseError as error:
        message = f"no SVG: {error}; save the drawing as plain SVG"
        raise DataError(file, message, line=error.position[0]) from None
    if _kind(root) != "svg":
        found = _kind(root)[:_SHOWN]
        raise DataError(file, f"begins with <{found}>, expected <svg>; save it as plain SVG")
    waiting = [_Shape(root, "svg", np.eye(3))]
    while waiting:
        shape = waiting.pop()
        if shape.kind in svgpathtools.CONVERSIONS:
            yield shape
        if shape.kind not in _CONTAINERS:
            continue
        for child in reversed(shape.element):
            inner = _Shape(child, _kind(child), shape.matrix)
            waiting.append(inner._replace(matrix=shape.matrix @ _transform(file, inner)))


def _kind(element: ElementTree.Element) -> str:
    """The name of an element without its namespace; "" of a comment."""
    return element.tag.rpartition("}")[2] if isinstance(element.tag, str) else ""


def _transform(file: str | PathLike[str], shape: _Shape) -> Float[ndarray, "3 3"]:
    """An element's own transform."""
    if "transform" in shape.element.get("style", ""):
        raise DataError(
            file,
            f"{shape.name} is transformed by its style, which is not read; write it as an "
            "attribute transform=",
        )
    try:
        matrix: Float[ndarray, "3 3"] = _svgpathtools().parse_transform(
            shape.element.get("transform"), strict=True
        )
    except _UNREADABLE as error:
        found, reason = shape.element.get("transform", "")[:_SHOWN], str(error)[: 2 * _SHOWN]
        raise DataError(
            file, f"{shape.name} has the transform {found!r} ({reason}); mend it"
        ) from None
    return matrix


def _chosen(file: str | PathLike[str], shapes: list[_Shape], id: str | None) -> _Shape:
    """The first path, or the shape of some id."""
    for shape in shapes:
        if shape.kind == "path" if id is None else shape.id == id:
            return shape
    if id is not None:
        known = did_you_mean(id, {shape.id for shape in shapes if shape.id})
        raise DataError(file, f"no line has the id {id!r}; {known}")
    others = ", ".join(shape.name for shape in shapes[:5]) or "nothing that is a line"
    raise DataError(file, f"no <path>, found {others}; draw one, or name another with id=")


def _samples(segment: Any, matrix: Float[ndarray, "3 3"]) -> Float[ndarray, "samples 2"]:
    """A piece of a line from its start to its end, metres."""
    if type(segment).__name__ == "Line":
        return _sampled(segment, 1, matrix)
    rough = _sampled(segment, 16, matrix)
    length = np.linalg.norm(np.diff(rough, axis=0), axis=-1).sum()
    return _sampled(segment, min(max(math.ceil(length / FINENESS), 16), _MOST_SAMPLES), matrix)


def _sampled(segment: Any, steps: int, matrix: Float[ndarray, "3 3"]) -> Float[ndarray, "n 2"]:
    """Samples at equal steps of a piece's parameter.

    Pieces are transformed sample by sample: an arc is no longer one of the same kind.
    """
    points = np.array([segment.point(step / steps) for step in range(steps + 1)])
    return np.stack([points.real, points.imag], axis=-1) @ matrix[:2, :2].T + matrix[:2, 2]
