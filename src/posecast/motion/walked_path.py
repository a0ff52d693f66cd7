"""The path that somebody walked, from the root track of a clip."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from posecast.errors import ConfigError, DataError
from posecast.motion.clip import Clip
from posecast.motion.path import Path
from posecast.motion.path_checks import check_finite
from posecast.motion.path_scale import SMOOTHING, SPACING
from posecast.motion.smoothing import smooth

LOW_PASS = 0.45
"""Seconds: sigma at which hips hardly sway any more, at 1.8 steps a second by 8 % of what they did,
and turns are still where they were."""

_LEAST = 1e-3
"""Metres: a root that stays within this of its first place stands still."""


def path_of(
    clip: Clip,
    *,
    low_pass: float = LOW_PASS,
    spacing: float = SPACING,
    smoothing: float = SMOOTHING,
) -> Path:
    """The path of a clip's first root over the floor; ``marks`` are its arc lengths by frame.

    So a track of the clip becomes one of the path: ``path.with_scalar("speed",
    clip.tracks["speed"], at=path.marks)``.

    Args:
        clip: of somebody who goes somewhere.
        low_pass: sigma in seconds of the Gaussian that takes hip sway out of the root's track; what
            it takes out passes it once more, and is given back, so that turns are hardly cut. 0
            keeps the sway.
        spacing, smoothing: see ``Path.through``; ``path_scale`` has them for a body.

    Raises:
        DataError: the root stands still, or has a place that is not finite.
        ConfigError: a negative ``low_pass``; see ``Path.through``.
    """
    if not 0 <= low_pass < float("inf"):
        raise ConfigError(f"low_pass is {low_pass}: expected 0 seconds or more")
    name = clip.name or "clip"
    places = _root_places(clip)
    check_finite(name, places, kind="root position")
    if (places - places[:1]).norm(dim=-1).max() < _LEAST:
        root = clip.skeleton.names[clip.skeleton.roots[0]]
        raise DataError(
            name,
            f"root {root!r} stands still, expected one that goes somewhere; if it is above one "
            "that does, fold it away with drop_joints",
        )
    sigma = low_pass * clip.fps
    steady = smooth(places, sigma)
    steady = steady + smooth(places - steady, sigma)
    return Path.along(steady, spacing=spacing, smoothing=smoothing, name=name)


def _root_places(clip: Clip) -> Float[Tensor, "frames 2"]:
    """Where the first root is, (x, z)."""
    root = clip.skeleton.roots[0]
    moved = clip.translations_local
    own = clip.offsets[root] if moved is None else moved[:, root]
    return (clip.root_positions + own).double()[:, torch.tensor([0, 2])]
