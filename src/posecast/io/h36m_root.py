"""The root of H3.6M recordings: its stored increments integrated, its floor found and leveled."""

from __future__ import annotations

from typing import NamedTuple

import torch
from jaxtyping import Float, Int
from torch import Tensor

from posecast.geometry import quaternion

_CONTACT_SPEED = 0.15
"""A foot joint slower than this (m/s) is taken to stand on the floor."""
_FLOOR_NOISE = 0.03
"""How far (m) standing joints scatter about the floor; farther ones count less and less."""
_TILT_EXPECTED = 0.2
"""How far (rad) the pelvis of a first frame usually leans."""


class RootTrack(NamedTuple):
    """Where the root is and how it is turned, frame by frame.

    Args:
        positions: metres.
        rotations: unit quaternions (w, x, y, z).
    """

    positions: Float[Tensor, "frames 3"]
    rotations: Float[Tensor, "frames 4"]


def integrate_root(
    increments: Float[Tensor, "frames 3"], turns: Float[Tensor, "frames 4"]
) -> RootTrack:
    """Sum up frame-to-frame increments of the root, given in its own frame.

    The first frame starts from the origin without rotation: what comes out is relative to the
    pelvis of the first frame.

    Args:
        increments: translation since the frame before, in the frame of the root there, metres.
        turns: rotation since the frame before; each multiplies from the right.
    """
    rotations = quaternion.normalize(_running_product(turns))
    earlier = torch.cat([quaternion.identity(1, like=rotations), rotations[:-1]])
    return RootTrack(quaternion.rotate(earlier, increments).cumsum(0), rotations)


def level_root(
    track: RootTrack,
    feet: Float[Tensor, "frames feet 3"],
    kinds: Int[Tensor, "feet"],
    fps: float,
) -> RootTrack:
    """Turn and lift a recording so that the floor its feet stand on is the plane y = 0.

    The files do not say where up is. The floor is estimated from joints of the feet while they
    stand still; recordings that stay on one spot determine it badly and keep, in part, the lean of
    the pelvis in their first frame. The heading of the first frame stays.

    Args:
        track: the root before, with y roughly up.
        feet: positions of foot joints in the same frame, metres.
        kinds: for each foot joint a number from 0, equal for joints (left and right) that are
            equally high above the floor when standing.
        fps: frames per second.
    """
    up = _floor_normal(feet, kinds, fps)
    turn = quaternion.between(up, up.new_tensor([0.0, 1.0, 0.0]))
    heights = quaternion.rotate(turn, feet)[..., 1].amin(-1)
    floor = torch.zeros_like(up)
    floor[1] = torch.quantile(heights, 0.01)
    start = quaternion.rotate(turn, track.positions[0])
    floor[0], floor[2] = start[0], start[2]
    return RootTrack(
        quaternion.rotate(turn, track.positions) - floor,
        quaternion.product(turn, track.rotations),
    )


def _running_product(rotations: Float[Tensor, "frames 4"]) -> Float[Tensor, "frames 4"]:
    """Products q0, q0 q1, q0 q1 q2, ... in log2(frames) passes (Hillis and Steele's scan)."""
    reach = 1
    while reach < len(rotations):
        longer = quaternion.product(rotations[:-reach], rotations[reach:])
        rotations = torch.cat([rotations[:reach], longer])
        reach *= 2
    return rotations


def _floor_normal(
    feet: Float[Tensor, "frames feet 3"], kinds: Int[Tensor, "feet"], fps: float
) -> Float[Tensor, "3"]:
    """Upward normal of the plane on which standing feet lie.

    Fits y = a x + b z + (height of the kind of joint) by iteratively reweighted least squares
    with Cauchy weights, whose width shrinks so that the first guess does not decide; a and b are
    held back by what is expected of a pelvis.
    """
    up = feet.new_tensor([0.0, 1.0, 0.0])
    if len(feet) < 3:
        return up
    (velocity,) = torch.gradient(feet, spacing=1 / fps, dim=0)
    standing = velocity.norm(dim=-1) < _CONTACT_SPEED
    points = feet[standing]
    if len(points) < 10:
        return up
    kind = torch.nn.functional.one_hot(kinds.expand(standing.shape)[standing])
    design = torch.cat([points[:, [0, 2]], kind.to(points.dtype)], dim=-1)
    holding = torch.full_like(design[0], 1e-9)  # keeps the system regular where a kind is missing
    holding[:2] = (_FLOOR_NOISE / _TILT_EXPECTED) ** 2
    plane = torch.zeros_like(design[0])
    plane[2:] = torch.quantile(points[:, 1], 0.3)
    for step in range(15):
        width = max(_FLOOR_NOISE, 0.4 * 0.7**step)
        residual = points[:, 1] - design @ plane
        weight = 1 / (1 + (residual / width) ** 2)
        weighted = design * (weight / weight.sum())[:, None]
        normal = weighted.T @ design + holding.diag()
        plane = torch.linalg.solve(normal, weighted.T @ points[:, 1])
    return torch.nn.functional.normalize(torch.stack([-plane[0], up[1], -plane[1]]), dim=0)
