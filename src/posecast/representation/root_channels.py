"""Root channels: how the root's place is written as numbers a frame, and read back."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

import torch
from jaxtyping import Float
from torch import Tensor

from posecast.errors import ConfigError
from posecast.motion import Motion
from posecast.motion.tracks import LATERAL, LONGITUDINAL, MOVEMENT, PATH, left_of

RootChannels = Literal["none", "displacement", "path", "path_lateral"]
ROOT_CHANNELS: dict[str, int] = {"none": 0, "displacement": 3, "path": 2, "path_lateral": 3}
"""Number of channels of each kind; see ``Codec.root``."""


def root_tracks(kind: RootChannels) -> tuple[str, ...]:
    """Names of the tracks that channels of a kind are written from, beside the root's height."""
    tracks: dict[str, tuple[str, ...]] = {
        "path": (LONGITUDINAL,),
        "path_lateral": (LONGITUDINAL, LATERAL),
    }
    return tracks.get(kind, ())


def write_root(kind: RootChannels, motion: Motion) -> Float[Tensor, "batch frames channels"]:
    """Root channels of a motion, in metres.

    The displacement of the first frame, whose predecessor is not known, repeats that of the
    second; a single frame stands still.

    Raises:
        ConfigError: a track is needed that the motion has not.
    """
    root = motion.root_positions
    if kind == "none":
        return root[..., :0]
    height = root[..., 1]
    if kind == "displacement":
        steps = root.diff(dim=1)
        first = steps[:, :1] if root.shape[1] > 1 else torch.zeros_like(root)
        steps = torch.cat([first, steps], dim=1)
        return torch.stack([steps[..., 0], height, steps[..., 2]], dim=-1)
    tracks, names = motion.tracks or {}, root_tracks(kind)
    missing = [name for name in names if name not in tracks]
    if missing:
        raise ConfigError(
            f"codec.root: {kind!r} is written from the tracks {', '.join(names)}; the motion lacks "
            f"{', '.join(missing)}: analyse its gait first (motion.gait)"
        )
    ahead, *left = (tracks[name].to(root) for name in names)
    return torch.stack([ahead, height, *left], dim=-1)


def place_root(
    kind: RootChannels,
    channels: Float[Tensor, "batch frames channels"],
    anchor: Float[Tensor, "batch 3"],
    tracks: Mapping[str, Float[Tensor, "batch frames ..."]] | None = None,
) -> Float[Tensor, "batch frames 3"]:
    """World positions of the root, metres.

    Args:
        kind: of the channels.
        channels: of frames that follow a known one.
        anchor: the root's position in that frame.
        tracks: of these frames, for a root that is relative to a path: places ``path`` and
            directions ``movement``. ``None``: it stays above its anchor.
    """
    if kind == "none":
        return anchor[:, None].expand(-1, channels.shape[1], -1)
    if kind == "displacement":
        travelled = anchor[:, None] + channels.cumsum(dim=1)
        return torch.stack([travelled[..., 0], channels[..., 1], travelled[..., 2]], dim=-1)
    floor = anchor[:, None, [0, 2]].expand(-1, channels.shape[1], -1)
    if tracks is not None:
        movement = tracks[MOVEMENT].to(channels)
        floor = tracks[PATH].to(channels) + channels[..., :1] * movement
        if kind == "path_lateral":
            floor = floor + channels[..., 2:] * left_of(movement)
    return torch.stack([floor[..., 0], channels[..., 1], floor[..., 1]], dim=-1)
