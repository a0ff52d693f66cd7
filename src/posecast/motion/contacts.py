"""Which foot touches the floor: slow and low, with hysteresis and cooldown."""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float
from torch import Tensor

SPEED_GAP = 0.1 * 30 / 14.65
"""Leg lengths a second that count as faster than standing, or than the other foot.

Source: Pavllo et al. 2020, whose code compares with 0.1 units a frame at 30 frames a second, on a
body with legs of 14.65 units.
"""

COOLDOWN = 0.1
"""Seconds after a change in which there is no other: 3 frames at 30 frames a second, as there."""

_BASELINE = 1 / 30
"""Seconds: speeds are means over about so long, whatever the frame rate."""

_LEAVE = 2.0
"""A contact ends at so many times the speed at which it begins."""

NEAR = 0.08
"""Leg lengths above where it stands that a foot in contact may be."""

_LEVEL = 0.1
"""Quantile of the heights of a slow foot that is taken for where it stands."""


def find_contacts(
    feet: Float[Tensor, "frames 2 3"], *, fps: float | int, leg: float, near: float = NEAR
) -> Bool[Tensor, "frames 2"]:
    """Frames in which the left foot and the right foot stand on a level floor.

    A contact begins where a foot is slower than ``SPEED_GAP`` and no higher than ``near`` above
    where it stands, and ends at twice that speed or higher up; after either nothing changes for
    ``COOLDOWN``.

    Args:
        feet: world positions of the joint of each foot that stays while it stands, metres.
        fps: frames a second.
        leg: length of a leg, metres.
        near: leg lengths; infinite where the floor is not level, so that speed alone decides.
    """
    speed = foot_speeds(feet, fps) / leg
    slow = speed < SPEED_GAP
    height = feet[..., 1].double()
    levels: list[Tensor] = []
    for foot in (0, 1):
        standing = height[slow[:, foot], foot]
        levels.append(standing.quantile(_LEVEL) if len(standing) else height[:, foot].min())
    low = height <= torch.stack(levels) + near * leg
    begins, stays = slow & low, (speed < _LEAVE * SPEED_GAP) & low
    states = [_held(begins[:, foot], stays[:, foot], COOLDOWN * fps) for foot in (0, 1)]
    return torch.stack(states, dim=-1)


def foot_speeds(feet: Float[Tensor, "frames 2 3"], fps: float | int) -> Float[Tensor, "frames 2"]:
    """Speed of each foot about each frame, m/s; see ``foot_velocities``."""
    return foot_velocities(feet, fps).norm(dim=-1)


def foot_velocities(
    feet: Float[Tensor, "frames 2 3"], fps: float | int
) -> Float[Tensor, "frames 2 3"]:
    """Velocity of each foot about each frame, m/s: from a baseline before to one after it."""
    last = len(feet) - 1
    reach = max(1, round(_BASELINE * fps))
    frames = torch.arange(last + 1)
    before, after = (frames - reach).clamp(min=0), (frames + reach).clamp(max=last)
    way = (feet[after] - feet[before]).double()
    return way * fps / (after - before).clamp(min=1)[:, None, None]


def _held(
    begins: Bool[Tensor, "frames"], stays: Bool[Tensor, "frames"], cooldown: float
) -> Bool[Tensor, "frames"]:
    """True from where it begins to where it no longer stays, at least a cooldown each."""
    state, free = bool(begins[0]), 0.0
    states: list[bool] = []
    for frame, (begin, stay) in enumerate(zip(begins.tolist(), stays.tolist(), strict=True)):
        if frame >= free and state != (stay if state else begin):
            state, free = not state, frame + cooldown
        states.append(state)
    return torch.tensor(states)
