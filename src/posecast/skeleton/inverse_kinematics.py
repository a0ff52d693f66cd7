"""Analytic inverse kinematics: a two-bone limb whose end reaches a target."""

from __future__ import annotations

from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from posecast.geometry import conversions, quaternion

NEARLY_STRAIGHT = 1e-6
"""How close a limb may come to full stretch or full fold, as a share of its length."""


class TwoBone(NamedTuple):
    """A solved limb: world rotations of its two joints and where they put its middle and end.

    ``end`` is the target wherever the target is within reach, and the nearest point of the limb's
    reach on the line towards it elsewhere.
    """

    upper: Float[Tensor, "*batch 4"]
    lower: Float[Tensor, "*batch 4"]
    middle: Float[Tensor, "*batch 3"]
    end: Float[Tensor, "*batch 3"]


def two_bone(
    start: Float[Tensor, "*batch 3"],
    target: Float[Tensor, "*batch 3"],
    bend: Float[Tensor, "*batch 3"],
    *,
    upper_offset: Float[Tensor, "*#batch 3"],
    lower_offset: Float[Tensor, "*#batch 3"],
    rest_bend: Float[Tensor, "*#batch 3"],
) -> TwoBone:
    """Rotations of hip and knee (or shoulder and elbow) that bring ankle (or hand) to a target.

    The middle joint lies in the plane of start, target and ``bend``, on the side that ``bend``
    points to. Twist is fixed by that plane: both bones turn about one hinge. Where ``bend`` is
    parallel to the limb, or start and target coincide, some plane is chosen and all results stay
    finite; so do the gradients, at full stretch and beyond too.

    Args:
        start: world position of the upper joint (hip, shoulder), metres.
        target: world position that the end (ankle, hand) should reach, metres.
        bend: world direction that the middle joint (knee, elbow) points to; any length but zero.
        upper_offset: rest translation from the upper to the middle joint, metres.
        lower_offset: rest translation from the middle joint to the end, metres.
        rest_bend: direction, in the rest pose, that the middle joint points to when it bends.

    Source: law of cosines for the angle between the upper bone and the line to the target.
    """
    shape = torch.broadcast_shapes(
        *(tensor.shape for tensor in (start, target, bend, upper_offset, lower_offset, rest_bend))
    )
    upper_offset, lower_offset = upper_offset.expand(shape), lower_offset.expand(shape)
    rest_bend = rest_bend.expand(shape)
    first, second = _length(upper_offset), _length(lower_offset)
    longest = (first + second) * (1 - NEARLY_STRAIGHT)
    shortest = (first - second).abs() + (first + second) * NEARLY_STRAIGHT
    line = target - start
    reach = _length(line).clamp_min(torch.finfo(line.dtype).tiny)
    distance = torch.minimum(torch.maximum(reach, shortest), longest)
    along, across = _frame(line, bend)

    cosine = (first**2 + distance**2 - second**2) / (2 * first * distance)
    sine = (1 - cosine**2).clamp_min(NEARLY_STRAIGHT**2).sqrt()
    middle = start + first * (cosine * along + sine * across)
    end = start + distance * along

    hinge = torch.linalg.cross(along, across)
    rest_hinge = torch.linalg.cross(*_frame(upper_offset, rest_bend))
    upper = _turn(upper_offset, rest_hinge, middle - start, hinge)
    lower = _turn(lower_offset, rest_hinge, end - middle, hinge)
    return TwoBone(upper, lower, middle, end)


def _length(vector: Float[Tensor, "*batch 3"]) -> Float[Tensor, "*batch 1"]:
    """Euclidean length, with a finite gradient at zero."""
    squared = (vector * vector).sum(-1, keepdim=True)
    return squared.clamp_min(torch.finfo(vector.dtype).tiny).sqrt()


def _unit(
    vector: Float[Tensor, "*batch 3"], fallback: Float[Tensor, "*batch 3"]
) -> Float[Tensor, "*batch 3"]:
    """The vector at length one, or ``fallback`` where it is too short to have a direction."""
    short = (vector * vector).sum(-1, keepdim=True) < NEARLY_STRAIGHT**2
    safe = torch.where(short, fallback, vector)
    return safe / _length(safe)


def _frame(
    line: Float[Tensor, "*batch 3"], side: Float[Tensor, "*batch 3"]
) -> tuple[Float[Tensor, "*batch 3"], Float[Tensor, "*batch 3"]]:
    """Unit vectors along ``line`` and, square to it, towards ``side``."""
    down = torch.zeros_like(line)
    down[..., 1] = -1
    along = _unit(line, down)
    flattest = torch.nn.functional.one_hot(along.detach().abs().argmin(-1), 3).to(line.dtype)
    spare = flattest - (flattest * along).sum(-1, keepdim=True) * along
    across = _unit(side, spare)
    return along, _unit(across - (across * along).sum(-1, keepdim=True) * along, spare)


def _turn(
    rest: Float[Tensor, "*batch 3"],
    rest_hinge: Float[Tensor, "*batch 3"],
    bone: Float[Tensor, "*batch 3"],
    hinge: Float[Tensor, "*batch 3"],
) -> Float[Tensor, "*batch 4"]:
    """Rotation that takes ``rest`` exactly to the direction of ``bone``, and hinge to hinge."""
    before = conversions.ortho6d_to_quaternion(torch.cat([rest, rest_hinge], dim=-1))
    after = conversions.ortho6d_to_quaternion(torch.cat([bone, hinge], dim=-1))
    return quaternion.product(after, quaternion.conjugate(before))
