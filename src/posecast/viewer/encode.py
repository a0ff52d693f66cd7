"""Moving pictures: frames to GIF with Pillow, to MP4 with ffmpeg."""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import suppress
from itertools import chain
from pathlib import Path
from typing import Any

from posecast.errors import ConfigError
from posecast.io.atomic import atomic_write
from posecast.viewer.canvas import Pixels, optional

GIF_RATE = 25.0
MP4_RATE = 60.0
_GIF_TICK = 100.0  # a GIF counts in hundredths of a second


def gif_rate(fps: float) -> float:
    """Frames a second at which a GIF of a clip plays at its true speed.

    That of the clip where it is at most 25 and a frame lasts a whole number of hundredths of a
    second; 25 otherwise.
    """
    ticks = _GIF_TICK / fps
    return fps if fps <= GIF_RATE and abs(ticks - round(ticks)) < 1e-6 else GIF_RATE


def mp4_rate(fps: float) -> float:
    """Frames a second of a film of a clip: that of the clip, halved until it is at most 60."""
    while fps > MP4_RATE:
        fps /= 2
    return fps


def write_gif(frames: Iterator[Pixels], path: Path, fps: float, colors: Sequence[str]) -> None:
    """Write frames as a GIF that repeats, whole or not at all.

    Args:
        frames: at least one, all of the same size.
        path: the file.
        fps: from ``gif_rate``.
        colors: what is drawn with, as ``#1f6fb4``, at most 16 of them; what rests does not
            flicker, because all frames share these and their blends with white.
    """
    image: Any = optional("PIL.Image")
    shared = image.new("P", (1, 1))
    shared.putpalette(_blends_with_white(colors))
    pictures = (
        image.fromarray(frame).quantize(palette=shared, dither=image.Dither.NONE)
        for frame in frames
    )
    first = next(pictures)
    with atomic_write(path) as temporary:
        first.save(
            temporary,
            format="GIF",
            save_all=True,
            append_images=pictures,
            duration=round(1000 / fps),
            loop=0,
            disposal=1,
        )


def write_mp4(frames: Iterator[Pixels], path: Path, fps: float) -> None:
    """Write frames as H.264, whole or not at all.

    Args:
        frames: at least one, all of the same size, even in both directions.
        path: the file.
        fps: frames a second.

    Raises:
        ConfigError: there is no ffmpeg, or it cannot write H.264.
    """
    program = _ffmpeg()
    first = next(frames)
    height, width = first.shape[:2]
    command = [
        *(program, "-y", "-loglevel", "error"),
        *("-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}", "-r", f"{fps:g}"),
        *("-i", "-", "-an", "-c:v", "libx264", "-pix_fmt", "yuv420p", "-crf", "20"),
        *("-movflags", "+faststart", "-f", "mp4"),
    ]
    with atomic_write(path) as temporary, tempfile.TemporaryFile() as messages:
        with subprocess.Popen(
            [*command, str(temporary)], stdin=subprocess.PIPE, stdout=messages, stderr=messages
        ) as process:
            try:
                _feed(process, chain([first], frames))
            except BaseException:
                process.kill()
                raise
        if process.returncode != 0:
            messages.seek(0)
            said = messages.read().decode(errors="replace").strip().splitlines()
            raise ConfigError(
                f"{path}: {program} failed ({said[-1] if said else 'no message'}); "
                "a .gif needs no ffmpeg"
            )


def _feed(process: subprocess.Popen[bytes], frames: Iterator[Pixels]) -> None:
    """Hand frames to a program until it has all, or ends before; then it is told that is all."""
    pipe: Any = process.stdin
    try:
        for frame in frames:
            pipe.write(frame.tobytes())
    except BrokenPipeError:
        pass  # it gave up; its exit status and messages say why
    finally:
        with suppress(BrokenPipeError):
            pipe.close()


def _blends_with_white(colors: Sequence[str], steps: int = 15) -> list[int]:
    """White, then each color from full to light; red, green, blue in turn."""
    palette = [255, 255, 255]
    for color in colors:
        full = [int(color[place : place + 2], 16) for place in (1, 3, 5)]
        for step in range(steps):
            blend = [round(part + (255 - part) * step / steps) for part in full]
            if min(blend) < 248:  # or Pillow takes what is nearly white for white
                palette += blend
    return palette


def _ffmpeg() -> str:
    """The ffmpeg of the system, else the one that comes with imageio-ffmpeg."""
    found = shutil.which("ffmpeg")
    if found is not None:
        return found
    try:
        packaged: Any = optional("imageio_ffmpeg")
        return str(packaged.get_ffmpeg_exe())
    except (ConfigError, RuntimeError):
        raise ConfigError(
            "an .mp4 needs ffmpeg, which was not found; install it, or pip install "
            "posecast[video], or write a .gif, which needs neither"
        ) from None
