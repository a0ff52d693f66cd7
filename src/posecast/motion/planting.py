"""How a toe has to move to stay in one place while its foot stands, as far as its leg reaches."""

from __future__ import annotations

from typing import NamedTuple

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from posecast.motion.easing import eased
from posecast.motion.leg_reach import Leg, is_reachable, reachable
from posecast.motion.standing import Stand, median_place

STILL = 1e-4
"""Metres: a foot that slides less while it stands, or is less below the floor, stays as it is.

It is more than what rounding in a file makes, so that pinning what is pinned changes nothing.
"""


class Short(NamedTuple):
    """A contact in some frames of which the foot is not held: its leg is too short for that.

    Args:
        stand: foot and frames.
        left_cm: largest distance of the toe from where it should stand.
    """

    stand: Stand
    left_cm: float


class Planting(NamedTuple):
    """What becomes of one toe.

    Args:
        toe: world positions, metres; just those that were where nothing changes.
        short: contacts through which it is not held to the end.
    """

    toe: Float[Tensor, "frames 3"]
    short: tuple[Short, ...]


def planted(
    leg: Leg,
    stands: list[Stand],
    *,
    floor: Float[Tensor, ""],
    ease: float,
    least: int,
) -> Planting:
    """Hold a toe, in each contact, at the median of its places there, and never below the floor.

    Where the leg does not reach the contact ends for the toe; if then fewer frames are left than a
    foot stands at least it is left as it was.

    Args:
        stands: contacts of this foot, in order of time.
        floor: lowest height of the toe, metres.
        ease: frames before and after a contact through which the toe goes over to where it was.
        least: frames of a contact.
    """
    toe = _lifted(leg, floor)
    move = torch.zeros_like(toe)
    held: list[Stand] = []
    short: dict[Stand, int] = {}
    for stand in stands:
        home = _home(toe, stand)
        way = _way(toe, stand, home)
        kept = _around(home, stand, is_reachable(leg, toe + way))
        if kept != stand:
            short[stand] = home
        if kept.last - kept.first + 1 < least:
            continue
        held.append(kept)
        if way[kept.frames].norm(dim=-1).max() > STILL:
            move[kept.frames] = way[kept.frames]
    move = eased(move, [(kept.first, kept.last) for kept in held], ease)
    after = toe + reachable(leg, toe, toe + move)[:, None] * move
    left = {stand: _way(after, stand, home) for stand, home in short.items()}
    return Planting(
        after,
        tuple(Short(stand, 100 * float(way.norm(dim=-1).max())) for stand, way in left.items()),
    )


def _lifted(leg: Leg, floor: Float[Tensor, ""]) -> Float[Tensor, "frames 3"]:
    """Where the toe is, or above that on the floor, as far as the leg reaches."""
    below = floor - leg.toe[:, 1]
    lift = torch.zeros_like(leg.toe)
    lift[:, 1] = torch.where(below > STILL, below, torch.zeros_like(below))
    return leg.toe + reachable(leg, leg.toe, leg.toe + lift)[:, None] * lift


def _home(toe: Float[Tensor, "frames 3"], stand: Stand) -> int:
    """The frame of a contact from whose place the toe has the least way to all others.

    A place where it was is one that the leg reaches, then at least.
    """
    return stand.first + median_place(toe[stand.frames][:, [0, 2]])


def _way(toe: Float[Tensor, "frames 3"], stand: Stand, home: int) -> Float[Tensor, "frames 3"]:
    """Way on the floor to where the toe is in a frame; none outside of the contact."""
    way = torch.zeros_like(toe)
    way[stand.frames] = toe[home] - toe[stand.frames]
    way[:, 1] = 0
    return way


def _around(home: int, stand: Stand, within: Bool[Tensor, "frames"]) -> Stand:
    """The frames of a contact before and after one of them in which something holds throughout."""
    first = last = home
    while first > stand.first and within[first - 1]:
        first -= 1
    while last < stand.last and within[last + 1]:
        last += 1
    return stand._replace(first=first, last=last)
