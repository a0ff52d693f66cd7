"""Whether a long walk goes on as it began: scores minute by minute, and whether it freezes."""

from __future__ import annotations

import math
from typing import NamedTuple

import torch

from posecast.errors import ConfigError
from posecast.evaluation.following import Followed
from posecast.evaluation.footing import NEAR
from posecast.evaluation.walked import Walked
from posecast.evaluation.walks import Reference, WalkScores, score_walk
from posecast.motion import Clip


class Steadiness(NamedTuple):
    """Whether a long walk goes on as it began.

    Args:
        minutes: scores of one span after the other.
        frozen: share of the seconds in which joints move, relative to the root and to where the
            body faces, at less than a tenth of their mean speed in the first span.
    """

    minutes: tuple[WalkScores, ...]
    frozen: float


FROZEN = 0.1
"""Share of the mean speed of the first span's joints below which a second counts as frozen."""

_STILL = 1e-3
"""Leg lengths a second, at which nothing moves, however it began."""


def steadiness(
    clip: Clip,
    course: Followed,
    *,
    reference: Reference | None = None,
    span: float = 60.0,
    near: float = NEAR,
) -> Steadiness:
    """Score a long walk span by span; what is left at the end and shorter than half a span is not.

    Args:
        clip, course, reference, near: see ``score_walk``.
        span: seconds.

    Raises:
        ConfigError: the walk is shorter than half a span.
    """
    frames = round(span * clip.fps)
    firsts = [first for first in range(0, clip.frames, frames) if clip.frames - first >= frames / 2]
    if not frames or not firsts:
        raise ConfigError(
            f"a walk of {clip.duration:.3g} s in spans of {span:g} s; expected half a span at least"
        )
    minutes = tuple(
        score_walk(
            clip.cut(first, min(first + frames, clip.frames)),
            course,
            reference=reference,
            start=first / clip.fps,
            near=near,
        )
        for first in firsts
    )
    return Steadiness(minutes, _frozen(clip, frames))


def _frozen(clip: Clip, first: int) -> float:
    """Share of seconds frozen, against the mean speed of the first frames."""
    moved = Walked.of(clip).features.reshape(clip.frames, -1, 3).diff(dim=0) * clip.fps
    speed = moved.norm(dim=-1).mean(-1)
    if not len(speed):
        return math.nan
    seconds = torch.stack([piece.mean() for piece in speed.split(max(1, round(clip.fps)))])
    least = max(FROZEN * float(speed[:first].mean()), _STILL)
    return float((seconds <= least).double().mean())
