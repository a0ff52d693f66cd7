"""Two-bone inverse kinematics of a leg whose toe is to be somewhere else: hip and root stay."""

from __future__ import annotations

import math
from typing import NamedTuple

import torch
from jaxtyping import Bool, Float
from torch import Tensor
from torch.nn.functional import normalize

from posecast.geometry import quaternion

REACH = 0.995
"""Share of its length to which a leg is stretched; farther only where it already was."""

_TIPTOE = math.radians(170)
"""Widest angle at the ankle between leg and foot; wider only where it already was."""

_HINGE = 0.02
"""Weight of the usual axis of a knee against that of its bend: what a bend of 1 degree has."""

_ROUNDING = 1e-9
"""Metres."""


class Leg(NamedTuple):
    """Where the joints of a leg are, in the world, metres.

    Args:
        hip: where the thigh begins.
        knee: where the shin begins.
        ankle: where the shin ends.
        toe: where the toes begin; the ankle where a foot has no joint.
        hinge: axis about which the knee usually bends, of any length; see ``usual_hinge``.
    """

    hip: Float[Tensor, "frames 3"]
    knee: Float[Tensor, "frames 3"]
    ankle: Float[Tensor, "frames 3"]
    toe: Float[Tensor, "frames 3"]
    hinge: Float[Tensor, "frames 3"]

    @property
    def stretch(self) -> Float[Tensor, "frames"]:
        """How far from the hip the ankle may be, metres."""
        length = _apart(self.hip, self.knee) + _apart(self.knee, self.ankle)
        return torch.maximum(REACH * length, _apart(self.hip, self.ankle))

    @property
    def reach(self) -> Float[Tensor, "frames"]:
        """How far from the hip the toe may be, metres; no turn of the foot changes it.

        Source: the law of cosines at the ankle.
        """
        leg, foot = self.stretch, _apart(self.ankle, self.toe)
        farthest = (leg**2 + foot**2 - 2 * leg * foot * math.cos(_TIPTOE)).sqrt()
        return torch.maximum(farthest, _apart(self.hip, self.toe))


class Turns(NamedTuple):
    """Rotations in the world, each before those of the joints above it.

    Args:
        hip: of all that is below the hip.
        knee: of all that is below the knee.
        foot: of the foot, instead of the other two: nothing else turns it.
    """

    hip: Float[Tensor, "frames 4"]
    knee: Float[Tensor, "frames 4"]
    foot: Float[Tensor, "frames 4"]


def usual_hinge(
    hip_rotations: Float[Tensor, "frames 4"],
    hip: Float[Tensor, "frames 3"],
    knee: Float[Tensor, "frames 3"],
    ankle: Float[Tensor, "frames 3"],
    toe: Float[Tensor, "frames 3"],
) -> Float[Tensor, "frames 3"]:
    """About which axis, in the world, the knee usually bends: the mean over a clip, as seen from
    the thigh, each frame as much as it bends. A knee that never bends does so towards the toes.

    Args:
        hip_rotations: of the hip joint in the world; positions in metres.
    """
    thigh, shin = normalize(knee - hip, dim=-1), normalize(ankle - knee, dim=-1)
    foot = normalize(toe - ankle, dim=-1)
    axes = torch.linalg.cross(thigh, shin) + 1e-6 * torch.linalg.cross(foot, thigh)
    mean = quaternion.rotate(quaternion.conjugate(hip_rotations), axes).mean(0)
    return quaternion.rotate(hip_rotations, normalize(mean, dim=-1).expand_as(axes))


def reachable(
    leg: Leg, start: Float[Tensor, "frames 3"], wanted: Float[Tensor, "frames 3"]
) -> Float[Tensor, "frames"]:
    """Share, 0 to 1, of the way from a place to another at which the toe is still in reach.

    Args:
        start: in reach; world, metres.
        wanted: world, metres.
    """
    place, way = start - leg.hip, wanted - start
    a, b = (way * way).sum(-1), (place * way).sum(-1)
    c = (place * place).sum(-1) - leg.reach**2
    # The larger root of |place + share * way| = reach; c is not positive, as the start is in reach.
    share = (-b + (b * b - a * c).clamp(min=0).sqrt()) / a.clamp(min=torch.finfo(a.dtype).tiny)
    return torch.where(is_reachable(leg, wanted), torch.ones_like(share), share.clamp(0, 1))


def is_reachable(leg: Leg, wanted: Float[Tensor, "frames 3"]) -> Bool[Tensor, "frames"]:
    """Whether the leg is long enough for the toe to be there, but for rounding."""
    return _apart(leg.hip, wanted) <= leg.reach + _ROUNDING


def reach(leg: Leg, wanted: Float[Tensor, "frames 3"]) -> Turns:
    """Turn a leg so that its toe is where it is wanted; the knee stays in the plane of its bend.

    The foot keeps its rotation in the world, unless the leg is too short for that: then it turns
    about the toe, as little as will do, and the heel rises.

    Args:
        wanted: world positions of the toe within ``reachable``, metres.

    Source: the law of cosines, for the angle at the knee and for that at the toe.
    """
    foot = leg.ankle - leg.toe
    turned = _turned_towards(foot, leg.hip - wanted, leg.stretch)
    target = wanted + turned - leg.hip
    thigh, shin = leg.knee - leg.hip, leg.ankle - leg.knee
    bend = _bend(thigh, shin, target.norm(dim=-1), leg.hinge)
    swing = quaternion.between(thigh + quaternion.rotate(bend, shin), target)
    return Turns(swing, bend, quaternion.between(foot, turned))


def _turned_towards(
    foot: Float[Tensor, "frames 3"],
    hip: Float[Tensor, "frames 3"],
    stretch: Float[Tensor, "frames"],
) -> Float[Tensor, "frames 3"]:
    """From the toe to the ankle, turned towards the hip until the ankle is no farther from it than
    ``stretch``; the hip, too, as seen from the toe, metres."""
    length, far = foot.norm(dim=-1), hip.norm(dim=-1)
    towards = normalize(hip, dim=-1)
    aside = normalize(foot - (foot * towards).sum(-1, keepdim=True) * towards, dim=-1)
    tiny = torch.finfo(far.dtype).tiny
    cosine = (length**2 + far**2 - stretch**2) / (2 * length * far).clamp(min=tiny)
    angle = torch.acos(cosine.clamp(-1, 1))[..., None]
    turned = length[..., None] * (towards * angle.cos() + aside * angle.sin())
    too_far = _apart(foot, hip) > stretch
    return torch.where(too_far[..., None], turned, foot)


def _bend(
    thigh: Float[Tensor, "frames 3"],
    shin: Float[Tensor, "frames 3"],
    distance: Float[Tensor, "frames"],
    hinge: Float[Tensor, "frames 3"],
) -> Float[Tensor, "frames 4"]:
    """Turn of the shin in the world that brings the ankle to a distance from the hip.

    It is about the normal of the plane of both bones, so the knee stays on its side; in a leg that
    is straight within a degree, whose plane is noise, about the usual hinge.

    Args:
        distance: metres.
        hinge: of any length.
    """
    upper, lower = thigh.norm(dim=-1), shin.norm(dim=-1)
    along, below = normalize(thigh, dim=-1), normalize(shin, dim=-1)
    normal = torch.linalg.cross(along, below)
    across = hinge - (hinge * along).sum(-1, keepdim=True) * along
    axis = normalize(normal + _HINGE * across, dim=-1)
    sine, cosine = (axis * normal).sum(-1), (along * below).sum(-1)
    angle = torch.atan2(sine, cosine)
    # What of the shin lies along the axis does not turn; the rest has this length.
    turning = torch.hypot(sine, cosine)
    wanted = (distance**2 - upper**2 - lower**2) / (2 * upper * lower)
    bent = torch.acos((wanted / turning).clamp(-1, 1))
    return quaternion.about_axis(axis, bent - angle)


def _apart(
    one: Float[Tensor, "frames 3"], other: Float[Tensor, "frames 3"]
) -> Float[Tensor, "frames"]:
    return (one - other).norm(dim=-1)
