"""Pictures of clips: strips of stills (PNG) and moving pictures (GIF, MP4), without a display."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from posecast.errors import ConfigError
from posecast.motion.clip import Clip
from posecast.viewer.canvas import Pixels, new_figure, optional, pixels, save_png
from posecast.viewer.encode import gif_rate, mp4_rate, write_gif, write_mp4
from posecast.viewer.scene import (
    Bounds,
    Camera,
    Figure,
    View,
    facing,
    figure_of,
    frame_bounds,
    grid_lines,
    grid_step,
    look,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Progress = Callable[[int, int], None]

# Left limbs warm, right limbs cool; the same lightness order in grey.
COLORS: Mapping[str, Mapping[str, str]] = {
    "truth": {"left": "#8c8c8c", "middle": "#6a6a6a", "right": "#3f3f3f"},
    "forecast": {"left": "#e8743b", "middle": "#7a3f8f", "right": "#1f6fb4"},
}
_GRID, _SHADOW, _NOTE, _TEXT = "#c9d1d9", "#d9d9d9", "#808080", "#000000"
_AZIMUTH = 0.7  # radians from the direction the body faces: from the front, off to its left
_ELEVATION = 0.2
_TITLE, _FOOT = 46, 20  # pixels above and below the panels
_ROW_TITLE = 24  # pixels at the left of a strip
_LETTER = 8.0  # pixels of a letter of a title, a wide one
_MOST_ABREAST = 4  # panels in a row of a moving picture
_PANEL = 400  # height of a panel in pixels; of a strip's, half
_NARROWEST, _WIDEST = 0.55, 2.2  # width of a panel over its height


def draw(
    clips: Sequence[Clip],
    path: str | PathLike[str],
    *,
    titles: Sequence[str] | None = None,
    split_frame: int | None = None,
    first_is_truth: bool = True,
    camera: Camera = "auto",
    stills: int = 8,
    progress: Progress | None = None,
) -> None:
    """Draw clips side by side: a strip of stills (.png) or a moving picture (.gif, .mp4).

    One camera sees all clips at one scale, upright, and nothing ever leaves the frame. Times are
    in milliseconds, from ``split_frame`` if there is one. Of several clips the first is the truth,
    in grey; the others, or a single one, are colored from ``split_frame`` on if there is one, and
    stand on the floor of the first. A clip that ends before the longest rests in its last pose.

    Args:
        clips: any skeletons and frame rates.
        path: the file; its extension says which kind of picture.
        titles: one a clip; their names by default.
        split_frame: the first forecast frame, counted at the first clip's rate.
        first_is_truth: false for several clips of one kind, all of which are colored.
        camera: ``fixed``; ``follow`` moves along with each body over the floor; ``auto`` follows
            a body that travels far, and every body in a strip.
        stills: how many poses a strip shows, evenly in time.
        progress: called with (frames drawn, frames in all) of a moving picture.

    Raises:
        ConfigError: no clips, an unknown extension, or what draws is not installed.
        DataError: a clip has positions that are not numbers, or the file cannot be written.
    """
    target = Path(path)
    _check(clips, target, titles, stills)
    if target.suffix.lower() == ".png" and camera == "auto":
        camera = "follow"  # the poses of a strip stand side by side anyway
    figures = [figure_of(clip, camera) for clip in clips]
    names = titles if titles is not None else [clip.name for clip in clips]
    split = None
    if split_frame is not None:
        split = split_frame / clips[0].fps
        # They share a past, so they share a floor: a forecast that sinks is seen to sink.
        figures = [replace(figure, floor=figures[0].floor) for figure in figures]
    truths = 1 if first_is_truth and len(clips) > 1 else 0
    stage = Stage(figures, look(facing(clips[0]) + _AZIMUTH, _ELEVATION), names, split, truths)
    _WRITERS[target.suffix.lower()](stage, target, stills, progress or _ignore)


def _ignore(done: int, total: int) -> None:
    """Show no progress."""


class Stage:
    """Clips, a view of them, and the frame that holds all of it.

    Args:
        figures: one a clip.
        view: the camera.
        titles: one a clip.
        split: seconds at which the forecast begins; ``None``: there is no such time.
        truths: how many of the first are true throughout, and grey.
    """

    def __init__(
        self,
        figures: Sequence[Figure],
        view: View,
        titles: Sequence[str],
        split: float | None,
        truths: int = 0,
    ) -> None:
        self.figures = tuple(figures)
        self.view = view
        self.titles = tuple(titles)
        self.split = split
        self.truths = truths
        self.bounds = _widened(frame_bounds(figures, view))
        self.duration = max(figure.duration for figure in figures)
        self.reach = float(np.hypot(self.bounds.width, self.bounds.height))

    def palette(self, index: int, time: float) -> Mapping[str, str]:
        """Colors of a clip at a time."""
        known = self.split is not None and time < self.split - 1e-6
        return COLORS["truth" if index < self.truths or known else "forecast"]

    def clock(self, time: float) -> str:
        """The time in milliseconds, from the split if there is one."""
        if self.split is None:
            return f"{1000 * time:.0f} ms"
        return f"{1000 * (time - self.split):+.0f} ms"


class Panel:
    """One body on its piece of floor; the same collections are moved from frame to frame.

    Args:
        stage: what it is a view of.
        index: which of the clips.
        axes: where it is drawn; they are emptied of ticks and take the stage's bounds.
    """

    def __init__(self, stage: Stage, index: int, axes: Axes) -> None:
        self.stage, self.index, self.axes = stage, index, axes
        self.figure = stage.figures[index]
        collection = optional("matplotlib.collections").LineCollection
        self.grid = collection([], colors=_GRID, linewidths=0.8)
        self.shadow = collection([], colors=_SHADOW, linewidths=2.5, capstyle="round")
        self.body = collection([], capstyle="round", joinstyle="round")
        for layer in (self.grid, self.shadow, self.body):
            layer.set_transform(axes.transData)
            axes.add_collection(layer, autolim=False)
        bounds = stage.bounds
        axes.set_xlim(bounds.left, bounds.right)
        axes.set_ylim(bounds.bottom, bounds.top)
        axes.set_aspect("equal", adjustable="box")
        axes.set_axis_off()

    def show(self, time: float) -> None:
        """Move everything to a time in seconds."""
        view, bones = self.stage.view, self.figure.bones
        pose = self.figure.pose(time)
        lines = pose.lines(bones)
        far_first = np.argsort((lines @ view.toward).mean(axis=1), kind="stable")
        palette = self.stage.palette(self.index, time)
        self.grid.set_segments(view.flat(grid_lines(pose.center, self.stage.reach)))
        self.shadow.set_segments(view.flat(pose.shadow(bones)))
        self.body.set_segments(view.flat(lines)[far_first])
        self.body.set_color([palette[self.figure.sides[bone]] for bone in far_first])
        self.body.set_linewidth([1.4 if self.figure.fine[bone] else 3.2 for bone in far_first])


def _check(clips: Sequence[Clip], path: Path, titles: Sequence[str] | None, stills: int) -> None:
    if not clips:
        raise ConfigError("nothing to draw: give at least one clip")
    if path.suffix.lower() not in _WRITERS:
        raise ConfigError(
            f"{path}: cannot draw a {path.suffix or 'file without an extension'}; "
            f"expected one of {', '.join(_WRITERS)}"
        )
    if titles is not None and len(titles) != len(clips):
        raise ConfigError(f"{len(titles)} titles for {len(clips)} clips; give one each")
    if stills < 1:
        raise ConfigError(f"a strip of {stills} stills; expected at least 1")


def _widened(bounds: Bounds) -> Bounds:
    """The same frame with room at the sides or above, so that a panel is no thin strip."""
    across = max(0.0, _NARROWEST * bounds.height - bounds.width) / 2
    above = max(0.0, bounds.width / _WIDEST - bounds.height)
    return Bounds(bounds.left - across, bounds.right + across, bounds.bottom, bounds.top + above)


def _panels(
    stage: Stage, rows: int, columns: int, *, height: int, left: int = 0
) -> tuple[Any, list[Any]]:
    """A figure with a grid of axes that have exactly the shape of the stage's frame.

    Args:
        height: pixels of a panel.
        left: pixels kept free at the left.
    """
    width = round(height * stage.bounds.width / stage.bounds.height)
    # Films want even sides.
    total_width = 2 * ((left + columns * width + 1) // 2)
    total_height = 2 * ((rows * height + _TITLE + _FOOT + 1) // 2)
    figure = new_figure(total_width, total_height)
    axes = [
        figure.add_axes(
            (
                (left + column * width) / total_width,
                (_FOOT + (rows - 1 - row) * height) / total_height,
                width / total_width,
                height / total_height,
            )
        )
        for row in range(rows)
        for column in range(columns)
    ]
    note = f"grid {grid_step(stage.reach):g} m"
    figure.text(0.5, 6 / total_height, note, ha="center", size=7.5, color=_NOTE)
    return figure, axes


def _strip(stage: Stage, path: Path, stills: int, progress: Progress) -> None:
    """Poses evenly in time, a row for each clip."""
    figure, axes = _panels(stage, len(stage.figures), stills, height=_PANEL // 2, left=_ROW_TITLE)
    times = np.linspace(0.0, stage.duration, stills) if stills > 1 else np.zeros(1)
    for place, cell in enumerate(axes):
        row, column = divmod(place, stills)
        Panel(stage, row, cell).show(float(times[column]))
        if row == 0:
            cell.set_title(stage.clock(float(times[column])), size=9, pad=4)
    for title, cell in zip(stage.titles, axes[::stills], strict=True):
        box = cell.get_position()
        middle = (box.y0 + box.y1) / 2
        text = _shortened(title, _PANEL // 2)
        figure.text(
            box.x0 / 2,
            middle,
            text,
            rotation=90,
            size=9,
            ha="center",
            va="center",
            parse_math=False,
        )
    save_png(figure, path)


def _frames(stage: Stage, fps: float, progress: Progress) -> Iterator[Pixels]:
    """All frames of a moving picture, one at a time."""
    count = len(stage.figures)
    rows = -(-count // _MOST_ABREAST)
    columns = -(-count // rows)
    figure, axes = _panels(stage, rows, columns, height=_PANEL)
    for empty in axes[count:]:
        empty.set_visible(False)
    panels = [Panel(stage, index, cell) for index, cell in enumerate(axes[:count])]
    for place, (panel, title) in enumerate(zip(panels, stage.titles, strict=True)):
        panel.axes.set_title(
            _shortened(title, panel.axes.bbox.width),
            size=10,
            pad=3 if place < columns else -14,  # below the first row, inside the panel
            parse_math=False,
        )
    top = 1 - 6 / figure.bbox.height
    clock = figure.text(0.5, top, "", ha="center", va="top", size=10, family="monospace")
    count = frame_count(stage.duration, fps)
    for frame in range(count):
        time = frame / fps
        clock.set_text(stage.clock(time))
        for panel in panels:
            panel.show(time)
        yield pixels(figure)
        progress(frame + 1, count)


def _shortened(title: str, room: float) -> str:
    """A title that fits into so many pixels; its end is the part that tells clips apart."""
    letters = max(int(room / _LETTER), 4)
    return title if len(title) <= letters else "…" + title[1 - letters :]


def frame_count(duration: float, fps: float) -> int:
    """Frames of a moving picture: one at 0 and one for every 1/fps that fits."""
    return int(np.floor(duration * fps + 1e-6)) + 1


def _gif(stage: Stage, path: Path, stills: int, progress: Progress) -> None:
    fps = gif_rate(stage.figures[0].fps)
    drawn = [color for palette in COLORS.values() for color in palette.values()]
    write_gif(_frames(stage, fps, progress), path, fps, [*drawn, _GRID, _SHADOW, _NOTE, _TEXT])


def _mp4(stage: Stage, path: Path, stills: int, progress: Progress) -> None:
    fps = mp4_rate(stage.figures[0].fps)
    write_mp4(_frames(stage, fps, progress), path, fps)


_WRITERS: Mapping[str, Callable[[Stage, Path, int, Progress], None]] = {
    ".png": _strip,
    ".gif": _gif,
    ".mp4": _mp4,
}
