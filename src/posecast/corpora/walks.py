"""Corpora of walks: every clip with its gait as tracks, and its style as one among zeros."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import torch
from torch import Tensor

from posecast.errors import ConfigError
from posecast.motion import Clip, Corpus
from posecast.motion.gait import with_gait
from posecast.motion.proportions import reproportion
from posecast.motion.tracks import STYLE


def with_walks(corpus: Corpus, styles: Sequence[str] = ()) -> Corpus:
    """The corpus with what a steered network is told, as tracks, all clips on one body.

    Heights and lengths of steps are those of a body, and nobody tells the network which: clips of
    other bodies get that of the first training clip (``motion.reproportion``).

    Args:
        corpus: of a skeleton with two feet.
        styles: values of the label ``style``; none: no track of it.

    Raises:
        SkeletonError: no feet are found.
        ConfigError: a clip of another style.
    """
    body = corpus.clips[corpus.splits["train"][0]].offsets if corpus.splits.get("train") else None
    return replace(
        corpus, clips=[_told(with_gait(_on(clip, body)), styles) for clip in corpus.clips]
    )


def _on(clip: Clip, body: Tensor | None) -> Clip:
    """The clip on a body; ``None``: on its own."""
    if body is None or torch.equal(clip.offsets, body):
        return clip
    return reproportion(clip, body, body="the walker's")


def _told(clip: Clip, styles: Sequence[str]) -> Clip:
    if not styles:
        return clip
    style = clip.labels.get("style", "")
    if style not in styles:
        raise ConfigError(
            f"clip {clip.name!r} is of style {style!r}, which codec.controls.styles does not name; "
            f"it names {', '.join(styles)}"
        )
    hot = torch.eye(len(styles))[styles.index(style)].to(clip.root_positions)
    return replace(clip, tracks={**clip.tracks, STYLE: hot.expand(clip.frames, -1)})
