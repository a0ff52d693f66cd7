"""Pictures: every kind is written whole, has the frames it should, and shows what it should."""

from __future__ import annotations

import stat
import subprocess
import sys

import numpy as np
import pytest
from PIL import Image

from posecast.errors import ConfigError, DataError
from posecast.viewer import draw
from posecast.viewer.encode import _ffmpeg, gif_rate, mp4_rate, write_gif
from posecast.viewer.figure import COLORS
from posecast.viewer.plots import error_over_horizon


def _has(picture: Image.Image, color: str) -> bool:
    """Whether some pixel has nearly this color."""
    wanted = [int(color[place : place + 2], 16) for place in (1, 3, 5)]
    distance = np.abs(np.asarray(picture.convert("RGB")).astype(int) - wanted).max(axis=-1)
    return bool((distance <= 12).any())


def test_a_gif_has_a_frame_for_every_frame_of_the_clip_and_its_speed(stand, tmp_path):
    draw([stand(frames=12, fps=25.0)], tmp_path / "a.gif")
    with Image.open(tmp_path / "a.gif") as picture:
        assert picture.n_frames == 12
        assert picture.info["duration"] == 40
        assert picture.info["loop"] == 0
    assert [file.name for file in tmp_path.iterdir()] == ["a.gif"]


def test_a_fast_clip_becomes_a_gif_of_the_same_duration(stand, tmp_path):
    draw([stand(frames=61, fps=120.0)], tmp_path / "a.gif")
    with Image.open(tmp_path / "a.gif") as picture:
        assert (picture.n_frames, picture.info["duration"]) == (13, 40)


@pytest.mark.parametrize(
    ("fps", "gif", "mp4"),
    [
        (25.0, 25.0, 25.0),
        (20.0, 20.0, 20.0),
        (30.0, 25.0, 30.0),
        (50.0, 25.0, 50.0),
        (120.0, 25.0, 60.0),
    ],
)
def test_moving_pictures_play_at_true_speed(fps, gif, mp4):
    assert gif_rate(fps) == gif
    assert mp4_rate(fps) == mp4


@pytest.mark.parametrize("truth", [True, False])
def test_several_clips_of_one_kind_are_all_colored(truth, stand, tmp_path):
    draw([stand(), stand()], tmp_path / "a.png", titles=["1", "2"], first_is_truth=truth)
    with Image.open(tmp_path / "a.png") as picture:
        upper = picture.convert("RGB").crop((0, 0, picture.width, picture.height // 2))
    assert _has(upper, COLORS["forecast"]["left"]) != truth


def test_truth_is_grey_and_the_forecast_is_colored_from_the_split_on(stand, tmp_path):
    draw([stand(), stand()], tmp_path / "a.gif", titles=["truth", "forecast"], split_frame=10)
    with Image.open(tmp_path / "a.gif") as picture:
        assert picture.n_frames == 20
        for frame in (0, 9, 10, 19):
            picture.seek(frame)
            middle, whole = picture.width // 2, picture.convert("RGB")
            bottom = picture.height - 20  # below are words, in grey
            left = whole.crop((0, 50, middle, bottom))
            right = whole.crop((middle, 50, picture.width, bottom))
            for side in ("left", "right"):
                assert _has(left, COLORS["truth"][side])
                assert not _has(left, COLORS["forecast"][side])
                assert _has(right, COLORS["forecast"][side]) == (frame >= 10)
                assert _has(right, COLORS["truth"][side]) == (frame < 10)


def test_a_forecast_that_sinks_is_seen_to_sink_below_a_shared_floor(stand, tmp_path):
    truth, forecast = stand(), stand()
    forecast.root_positions[10:, 1] -= 0.3
    draw([truth, forecast], tmp_path / "a.gif", split_frame=10)
    heads = []
    with Image.open(tmp_path / "a.gif") as picture:
        for frame in (0, 19):
            picture.seek(frame)
            ink = np.asarray(picture.convert("L"))[50:-60] < 150
            halves = np.split(ink[:, : ink.shape[1] // 2 * 2], 2, axis=1)
            heads.append([int(half.any(axis=1).argmax()) for half in halves])
    (known, known_too), (true, guessed) = heads
    assert abs(known - known_too) <= 1
    assert guessed - true > 20


def test_a_single_clip_is_colored_and_its_sides_differ(stand, tmp_path):
    draw([stand()], tmp_path / "a.png", stills=3)
    with Image.open(tmp_path / "a.png") as picture:
        assert len(set(COLORS["forecast"].values())) == 3
        for color in COLORS["forecast"].values():
            assert _has(picture, color)


def test_a_strip_has_a_row_for_each_clip(stand, wander, tmp_path):
    draw([stand()], tmp_path / "one.png")
    draw([stand(), stand(), stand()], tmp_path / "three.png")
    with Image.open(tmp_path / "one.png") as one, Image.open(tmp_path / "three.png") as three:
        assert three.width == one.width
        assert three.height == one.height + 2 * 200
    draw([wander(1)], tmp_path / "few.png", stills=1)
    assert (tmp_path / "few.png").stat().st_size > 1000


def test_an_mp4_has_a_frame_for_every_frame_of_the_clip(wander, tmp_path):
    draw([wander(1, frames=9), wander(2, frames=5)], tmp_path / "a.mp4")
    command = [_ffmpeg(), "-loglevel", "error", "-i", str(tmp_path / "a.mp4")]
    command += ["-f", "rawvideo", "-pix_fmt", "gray", "-vf", "scale=8:8", "-"]
    decoded = subprocess.run(command, capture_output=True, check=True).stdout
    assert len(decoded) == 9 * 64
    assert [file.name for file in tmp_path.iterdir()] == ["a.mp4"]


def test_without_ffmpeg_an_mp4_is_refused_with_what_would_work(stand, tmp_path, monkeypatch):
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(ConfigError, match=r"needs ffmpeg, which was not found.*write a \.gif"):
        draw([stand()], tmp_path / "a.mp4")
    assert list(tmp_path.iterdir()) == []


def test_what_a_failing_ffmpeg_says_is_passed_on(stand, tmp_path, monkeypatch):
    program = tmp_path / "bin" / "ffmpeg"
    program.parent.mkdir()
    program.write_text("#!/bin/sh\necho 'Unknown encoder libx264' >&2\nexit 1\n")
    program.chmod(program.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setenv("PATH", str(program.parent))
    with pytest.raises(ConfigError, match=r"failed \(Unknown encoder libx264\); a .gif needs no"):
        draw([stand()], tmp_path / "a.mp4")
    assert [file.name for file in tmp_path.iterdir()] == ["bin"]


def test_without_matplotlib_drawing_says_what_to_install(stand, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(ConfigError, match=r"matplotlib.*pip install posecast\[video\]"):
        draw([stand()], tmp_path / "a.png")
    assert list(tmp_path.iterdir()) == []


def test_the_viewer_loads_matplotlib_only_when_it_draws():
    code = (
        "import sys, posecast.viewer, posecast.viewer.plots; "
        "sys.exit('matplotlib' in sys.modules or 'PIL' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_drawing_leaves_the_global_state_of_pyplot_alone(tmp_path):
    code = (
        "import pathlib, sys\n"
        "from posecast.corpora.synthetic import make_clip\n"
        "from posecast.viewer import draw\n"
        f"draw([make_clip(0, seconds=1.0)], pathlib.Path({str(tmp_path / 'a.png')!r}), stills=1)\n"
        "sys.exit('matplotlib.pyplot' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_a_film_that_breaks_off_leaves_nothing_behind(tmp_path):
    def frames():
        yield np.zeros((4, 4, 3), dtype=np.uint8)
        raise RuntimeError("broke off")

    with pytest.raises(RuntimeError, match="broke off"):
        write_gif(frames(), tmp_path / "a.gif", 25.0, ["#000000"])
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("a.bmp", {}, r"cannot draw a .bmp; expected one of .png, .gif, .mp4"),
        ("a", {}, "cannot draw a file without an extension"),
        ("a.png", {"titles": ["x", "y"]}, "2 titles for 1 clips"),
        ("a.png", {"stills": 0}, "0 stills; expected at least 1"),
    ],
)
def test_a_picture_that_cannot_be_drawn_is_refused(stand, tmp_path, name, options, message):
    with pytest.raises(ConfigError, match=message):
        draw([stand()], tmp_path / name, **options)


def test_no_clips_and_no_folder_are_refused(stand, tmp_path):
    with pytest.raises(ConfigError, match="at least one clip"):
        draw([], tmp_path / "a.png")
    with pytest.raises(DataError, match="there is no folder"):
        draw([stand()], tmp_path / "none" / "a.png", stills=1)


def test_errors_over_the_horizon_are_plotted_with_units_and_names(tmp_path):
    curves = {"mine": [(400, 0.5), (80, 0.1)], "zero-velocity": [(80, 0.2), (400, 0.8)]}
    error_over_horizon(curves, tmp_path / "a.png", metric="joint_angle")
    with Image.open(tmp_path / "a.png") as picture:
        assert picture.size == (760, 460)
        assert _has(picture, "#0072b2")
        assert _has(picture, "#d55e00")
    with pytest.raises(ConfigError, match="unknown metric 'angle'"):
        error_over_horizon(curves, tmp_path / "b.png", metric="angle")
    with pytest.raises(ConfigError, match="at least one curve"):
        error_over_horizon({"mine": []}, tmp_path / "b.png", metric="euler")
    assert [file.name for file in tmp_path.iterdir()] == ["a.png"]
