"""Matplotlib without a display: figures that know no global state, and their pixels."""

from __future__ import annotations

import importlib
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from posecast.errors import ConfigError
from posecast.io.atomic import atomic_write

if TYPE_CHECKING:
    from matplotlib.figure import Figure

DPI = 100

Pixels = npt.NDArray[np.uint8]


def optional(module: str) -> Any:
    """A module of the extra ``video``, imported when a picture is asked for and not before.

    Raises:
        ConfigError: it is not installed.
    """
    try:
        return importlib.import_module(module)
    except ImportError:
        raise ConfigError(
            f"drawing needs {module.partition('.')[0]}, which is not installed; "
            "pip install posecast[video]"
        ) from None


def new_figure(width: int, height: int) -> Figure:
    """An empty figure of a size in pixels, with a canvas of its own."""
    figure: Figure = optional("matplotlib.figure").Figure(
        figsize=(width / DPI, height / DPI), dpi=DPI
    )
    optional("matplotlib.backends.backend_agg").FigureCanvasAgg(figure)
    return figure


def pixels(figure: Figure) -> Pixels:
    """The figure as it is now, (height, width, 3)."""
    canvas: Any = figure.canvas
    with _known_fonts():
        canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3].copy()


@contextmanager
def _known_fonts() -> Iterator[None]:
    """A title in a script that no font here has becomes boxes, without a warning for each."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", r"Glyph .* missing from font")
        yield


def save_png(figure: Figure, path: str | PathLike[str]) -> None:
    """Write the figure as PNG, whole or not at all."""
    with atomic_write(path) as temporary, _known_fonts():
        figure.savefig(temporary, format="png", dpi=DPI)
