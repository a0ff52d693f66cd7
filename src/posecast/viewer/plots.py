"""Plots of evaluation results."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from os import PathLike
from typing import TYPE_CHECKING

from posecast.errors import ConfigError
from posecast.evaluation.metrics import METRICS
from posecast.evaluation.scores import Milliseconds
from posecast.viewer.canvas import new_figure, save_png

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Distinguishable without color vision: the order is that of lightness too (Wong 2011).
_COLORS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000")
_UPON, _LETTER = 690, 8  # pixels: of the plot across, of a letter beside it
_MARKERS = ("o", "s", "^", "D", "v", "P", "X")


def error_over_horizon(
    curves: Mapping[str, Sequence[tuple[Milliseconds, float]]],
    path: str | PathLike[str],
    *,
    metric: str,
    title: str = "",
) -> None:
    """Plot the error of several systems over the horizon, as PNG.

    Args:
        curves: name of a system -> (horizon in milliseconds, value); the first is drawn boldest.
        path: the file.
        metric: name in ``METRICS``; says what the values are and their unit.
        title: above the plot.

    Raises:
        ConfigError: no curve, one without points, an unknown metric, or matplotlib is missing.
        DataError: the file cannot be written.
    """
    if not curves or not all(curves.values()):
        raise ConfigError("nothing to plot: give at least one curve, each with a point")
    if metric not in METRICS:
        raise ConfigError(f"unknown metric {metric!r}; known: {', '.join(METRICS)}")
    figure = new_figure(760, 460)
    axes = figure.add_axes((0.1, 0.12, 0.87, 0.78))
    for place, (name, points) in enumerate(curves.items()):
        times, values = zip(*sorted(points), strict=True)
        axes.plot(
            times,
            values,
            label=name,
            color=_COLORS[place % len(_COLORS)],
            marker=_MARKERS[place % len(_MARKERS)],
            markersize=4.5,
            linewidth=2.4 if place == 0 else 1.4,
            zorder=3 if place == 0 else 2,
        )
    axes.set_xlabel("horizon (ms)")
    axes.set_ylabel(f"{METRICS[metric].title} ({METRICS[metric].unit})")
    axes.set_xlim(left=0)
    axes.set_ylim(bottom=0)
    _tidy(axes)
    axes.legend(frameon=False)
    axes.set_title(title or "Error over the horizon", size=11)
    save_png(figure, path)


def convergence(
    curves: Mapping[str, Sequence[Sequence[tuple[int, float]]]],
    path: str | PathLike[str],
    *,
    what: str,
) -> None:
    """Plot how several systems got better in training, as PNG: means over runs, and their ranges.

    Args:
        curves: name of a system -> for each run (updates, value).
        path: the file.
        what: is measured; beside the upright axis.

    Raises:
        ConfigError: no curve, one without points, or matplotlib is missing.
        DataError: the file cannot be written.
    """
    if not curves or not all(runs and all(runs) for runs in curves.values()):
        raise ConfigError("nothing to plot: give at least one curve, each with a point")
    figure = new_figure(1000, 500)
    axes = figure.add_axes((0.08, 0.12, 0.6, 0.8))
    for place, (name, runs) in enumerate(curves.items()):
        shared = sorted(set.intersection(*({update for update, _ in run} for run in runs)))
        values = [[dict(run)[update] for run in runs] for update in shared]
        color = _COLORS[place % len(_COLORS)]
        axes.plot(
            shared,
            [sum(each) / len(each) for each in values],
            label=name,
            color=color,
            marker=_MARKERS[place % len(_MARKERS)],
            markersize=4,
            linewidth=1.6,
            linestyle="-" if place < len(_COLORS) else "--",
        )
        if len(runs) > 1:
            low, high = ([pick(each) for each in values] for pick in (min, max))
            axes.fill_between(shared, low, high, color=color, alpha=0.12, linewidth=0)
    axes.set_xlabel("updates")
    axes.set_ylabel(what)
    _tidy(axes)
    axes.legend(frameon=False, loc="upper left", bbox_to_anchor=(1.02, 1.0), fontsize=9)
    axes.set_title("Convergence", size=11)
    save_png(figure, path)


def lines(
    curves: Mapping[str, Sequence[tuple[float, float]]],
    path: str | PathLike[str],
    *,
    across: str,
    upright: str,
    title: str,
    levels: Mapping[str, float] | None = None,
) -> None:
    """Plot plain lines, as PNG.

    Args:
        curves: name -> (place across, value).
        path: the file.
        across: what the axis below says, with its unit.
        upright: what the axis at the left says, with its unit.
        title: above the plot.
        levels: name -> value that holds everywhere; drawn dashed, its name beside it.

    Raises:
        ConfigError: no curve, one without points, or matplotlib is missing.
        DataError: the file cannot be written.
    """
    if not curves or not all(curves.values()):
        raise ConfigError("nothing to plot: give at least one curve, each with a point")
    beside = 60 + _LETTER * max(map(len, (*curves, *(levels or {}))))
    width = 80 + _UPON + beside
    figure = new_figure(width, 480)
    axes = figure.add_axes((80 / width, 0.12, _UPON / width, 0.8))
    for place, (name, points) in enumerate(curves.items()):
        places, values = zip(*points, strict=True)
        marker = _MARKERS[place % len(_MARKERS)] if len(points) <= 40 else None
        axes.plot(
            places,
            values,
            label=name,
            color=_COLORS[place % len(_COLORS)],
            marker=marker,
            markersize=4.5,
            linewidth=1.4,
            linestyle=("-", ":", "-.")[place // len(_COLORS) % 3],
        )
    for name, value in (levels or {}).items():
        axes.axhline(value, color="#555555", linestyle="--", linewidth=1.0, zorder=1)
        axes.annotate(name, (1.01, value), xycoords=("axes fraction", "data"), size=9, va="center")
    axes.set_xlabel(across)
    axes.set_ylabel(upright)
    axes.set_ylim(bottom=0)
    _tidy(axes)
    axes.legend(frameon=False, loc="upper left", bbox_to_anchor=(1.02, 0.9), fontsize=9)
    axes.set_title(title, size=11)
    save_png(figure, path)


def _tidy(axes: Axes) -> None:
    """A pale grid behind the lines, and no box around them."""
    axes.grid(color="#e3e3e3", linewidth=0.8)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
