"""How feet stand: contacts by height alone, how far they slide, how deep they sink.

Contacts that are found by speed (``motion.contacts``) cannot slide: a foot that slides is none.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from posecast.errors import ConfigError
from posecast.motion.contacts import SPEED_GAP, foot_speeds

NEAR = 0.02
"""Leg lengths above where it stands that a foot on the floor may be: 1.6 cm of an adult.

On the validation clips of ``bandai-locomotion`` that walk: below 0.015 contacts fall to pieces (at
0.01 one in eleven is shorter than 0.3 of a cycle, from 0.015 to 0.02 one in seventy), above 0.02
the foot that swings through counts as well. At 0.02 a contact lasts half a cycle.
"""

STANDS = 0.05
"""Quantile of the heights of a joint over a clip that is taken for where it stands."""

SHORTEST = 0.1
"""Seconds: what is near the floor for less is no contact."""


class Stance(NamedTuple):
    """How high the joints of a foot that stands are above the floor, leg lengths.

    Args:
        toe: where the toes begin.
        ankle: of the ankle.
    """

    toe: float = 0.0
    ankle: float = 0.0


class Sliding(NamedTuple):
    """What feet do while they are on the floor; NaN where they never are.

    Args:
        share: of frames and feet on the floor.
        path_cm: way on the floor in a contact, mean over contacts.
        straight_cm: from where a contact begins to where it ends, mean over contacts.
        fast: share of the frames of contacts in which the foot moves over the floor faster than
            0.205 leg lengths a second (``motion.contacts.SPEED_GAP``).
    """

    share: float
    path_cm: float
    straight_cm: float
    fast: float


def floor_contacts(
    toes: Float[Tensor, "frames 2 3"],
    *,
    fps: float,
    leg: float,
    near: float = NEAR,
    floor: float | None = None,
) -> Bool[Tensor, "frames 2"]:
    """Frames in which the left foot and the right foot are on the floor, however they move.

    Args:
        toes: world positions, metres.
        leg: length of a leg, metres.
        near: leg lengths above where it stands.
        floor: height at which toes stand, metres; ``None``: each foot's own, a low quantile of its
            height over the clip.

    Raises:
        ConfigError: ``near`` is not positive.
    """
    if not near > 0:
        raise ConfigError(f"near is {near}; expected a positive number of leg lengths")
    height = toes[..., 1].double()
    stands = height.quantile(STANDS, dim=0) if floor is None else height.new_tensor(floor)
    low = height <= stands + near * leg
    contacts = torch.zeros_like(low)
    for foot in (0, 1):
        for first, after in _runs(low[:, foot]):
            contacts[first:after, foot] = after - first >= SHORTEST * fps - 1e-9
    return contacts


def sliding(
    toes: Float[Tensor, "frames 2 3"],
    contacts: Bool[Tensor, "frames 2"],
    *,
    fps: float,
    leg: float,
) -> Sliding:
    """How far feet slide in contacts. See ``Sliding``.

    Args:
        toes: world positions, metres.
        contacts: such as ``floor_contacts`` finds.
        leg: length of a leg, metres.
    """
    floor = toes.double() * toes.new_tensor((1.0, 0.0, 1.0)).double()
    ways: list[Tensor] = []
    straight: list[Tensor] = []
    for foot in (0, 1):
        for first, after in _runs(contacts[:, foot]):
            piece = floor[first:after, foot]
            ways.append(piece.diff(dim=0).norm(dim=-1).sum())
            straight.append((piece[-1] - piece[0]).norm())
    fast = foot_speeds(floor, fps)[contacts] > SPEED_GAP * leg
    return Sliding(
        float(contacts.double().mean()), 100 * _mean(ways), 100 * _mean(straight), _mean(fast)
    )


def depths(
    toes: Float[Tensor, "frames 2 3"],
    ankles: Float[Tensor, "frames 2 3"],
    *,
    leg: float,
    stance: Stance,
    floor: float = 0.0,
) -> Float[Tensor, "frames 2"]:
    """Centimetres that each foot is in the floor: the more of what its toe and its ankle are below
    where they are when it stands; 0 above.

    Args:
        toes, ankles: world positions, metres.
        leg: length of a leg, metres.
        stance: of feet that stand.
        floor: height of the floor, metres.
    """
    toe = floor + stance.toe * leg - toes[..., 1].double()
    ankle = floor + stance.ankle * leg - ankles[..., 1].double()
    return 100 * torch.maximum(toe, ankle).clamp_min(0)


def stance_of(
    feet: Iterable[tuple[Float[Tensor, "frames 2 3"], Float[Tensor, "frames 2 3"], float]],
) -> Stance:
    """How low feet stand in some clips whose floor is at height 0.

    Of each foot of each clip the low quantile ``STANDS`` of its heights is where it stands; of
    these the same quantile again, so that who stands on tiptoe, or one bad clip, does not count.

    Args:
        feet: toes, ankles (world positions, metres) and leg length of each clip.
    """
    rows = [
        torch.stack([toes[..., 1], ankles[..., 1]]).double().quantile(STANDS, dim=1) / leg
        for toes, ankles, leg in feet
    ]
    toe, ankle = torch.cat(rows, dim=-1).quantile(STANDS, dim=-1).tolist()
    return Stance(toe, ankle)


def _runs(contact: Bool[Tensor, "frames"]) -> list[tuple[int, int]]:
    """First frame of each run of true ones, and the frame after its last."""
    padded = torch.nn.functional.pad(contact.int(), (1, 1)).diff()
    firsts, afters = (padded == 1).nonzero()[:, 0], (padded == -1).nonzero()[:, 0]
    return list(zip(firsts.tolist(), afters.tolist(), strict=True))


def _mean(values: Sequence[Tensor] | Tensor) -> float:
    """NaN of nothing."""
    return float(torch.stack(list(values)).double().mean()) if len(values) else math.nan
