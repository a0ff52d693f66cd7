"""Times of a protocol in milliseconds, and the frames they fall on."""

from __future__ import annotations

import math
from fractions import Fraction
from typing import NamedTuple

from posecast.errors import ConfigError
from posecast.evaluation.scores import Milliseconds


class Frames(NamedTuple):
    """A protocol's times as numbers of frames: of the prefix, and of each horizon after it."""

    prefix: int
    horizons: tuple[int, ...]


def frame_of(ms: Milliseconds, fps: float, what: str = "time") -> int:
    """The number of frames in a time.

    Args:
        ms: milliseconds; may be rounded to a hundredth.
        fps: frames per second.
        what: names the time in messages.

    Raises:
        ConfigError: it does not fall on a frame; the message says which times near it do.
    """
    frames = ms * fps / 1000
    nearest = round(frames)
    if nearest >= 1 and abs(nearest * 1000 / fps - ms) <= 0.01:
        return nearest
    below = max(math.floor(frames), 1)
    near = " or ".join(f"{count * 1000 / fps:.6g} ms" for count in (below, below + 1))
    raise ConfigError(
        f"{what}: {ms:g} ms is {frames:.4g} frames at {fps:g} fps and does not fall on a frame; "
        f"{near} would{_whole_ms(fps)}"
    )


def _whole_ms(fps: float) -> str:
    """Advice on the whole milliseconds that fall on frames, where there are such below a second."""
    step = (1000 / Fraction(fps).limit_denominator(1001)).numerator
    return f" (at this rate every {step} ms falls on one)" if step <= 1000 else ""
