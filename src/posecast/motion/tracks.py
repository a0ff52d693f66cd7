"""Tracks: values a frame beside the pose, and what turning and mirroring make of them.

Names that more than one module speaks of are here. Other tracks are kept as they are.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import torch
from jaxtyping import Float
from torch import Tensor

CONTACTS = "contacts"
"""(..., frames, 2): the left foot, then the right foot, touches the floor."""

PHASE = "phase"
"""(..., frames): place in the walk cycle, radians; a period later it is the same place."""

FACING = "facing"
"""(..., frames, 2): unit vector (x, z) on the floor, where the body faces."""

PATH = "path"
"""(..., frames, 2): place (x, z) on the floor, metres, such as a point of the path followed."""

MOVEMENT = "movement"
"""(..., frames, 2): unit vector (x, z) on the floor, along the path."""

SPEED = "speed"
"""(..., frames): along the path, m/s."""

LONGITUDINAL = "longitudinal"
"""(..., frames): how far the root is ahead of its place on the path, along ``movement``, metres."""

LATERAL = "lateral"
"""(..., frames): how far the root is to the left of its place on the path, metres."""

WALKING = "walking"
"""(..., frames): the phase means something; it does not while standing."""

STEP_RATE = "step_rate"
"""(..., frames): radians of phase a second; a step is pi."""

DISTANCE = "distance"
"""(..., frames): metres along the path."""

HEIGHT = "height"
"""(..., frames): of the root in the world, metres."""

STYLE = "style"
"""(..., frames, styles): 1 for the style of the walk among zeros."""

LENGTHS = frozenset({PATH, DISTANCE, SPEED, LONGITUDINAL, LATERAL, HEIGHT})
"""Those that grow with the body."""

_DIRECTIONS = (FACING, PATH, MOVEMENT)


def turned(tracks: Mapping[str, Tensor], angle: Tensor | float) -> dict[str, Tensor]:
    """Tracks of a motion that was turned about the vertical.

    Args:
        tracks: by name.
        angle: radians, positive from +z towards +x: one for all, or one a motion of a batch.
    """
    return {
        name: turned_on_floor(values, angle) if name in _DIRECTIONS else values
        for name, values in tracks.items()
    }


def turned_on_floor(
    values: Float[Tensor, "*batch frames 2"], angle: Tensor | float
) -> Float[Tensor, "*batch frames 2"]:
    """Places or directions (x, z) turned about the origin by ``angle``: see ``turned``."""
    about = torch.as_tensor(angle, dtype=values.dtype, device=values.device)
    sine, cosine = about.sin()[..., None], about.cos()[..., None]
    x, z = values.unbind(-1)
    return torch.stack([cosine * x + sine * z, cosine * z - sine * x], dim=-1)


def mirrored(tracks: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """Tracks of a motion that was reflected in the plane x = 0, left and right exchanged."""
    found = dict(tracks)
    if CONTACTS in found:
        found[CONTACTS] = found[CONTACTS].flip(-1)
    if PHASE in found:
        found[PHASE] = as_written(found[PHASE], found[PHASE] + math.pi)
    if LATERAL in found:
        found[LATERAL] = -found[LATERAL]
    for name in _DIRECTIONS:
        if name in found:
            found[name] = found[name] * found[name].new_tensor((-1.0, 1.0))
    return found


def as_written(before: Tensor, angles: Tensor) -> Tensor:
    """Angles in [0, 2 pi) if they were there before; as they are if they count turns."""
    wrapped = bool(((before >= 0) & (before < 2 * math.pi)).all())
    return torch.remainder(angles, 2 * math.pi) if wrapped else angles


def left_of(direction: Float[Tensor, "*batch 2"]) -> Float[Tensor, "*batch 2"]:
    """The direction (x, z) a quarter turn to the left: +x for who moves towards +z."""
    x, z = direction.unbind(-1)
    return torch.stack([z, -x], dim=-1)
