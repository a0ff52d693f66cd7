"""Where a line of equally spaced points leads and how it turns, once it is smoothed."""

from __future__ import annotations

from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from posecast.motion.places import bearing, wrapped
from posecast.motion.smoothing import kernel_reach, lengthen, smooth

_STILL = 1e-9
"""Share of the spacing: a smoothed segment that is shorter leads nowhere."""


class Bending(NamedTuple):
    """Direction and turning of a line at its points.

    Args:
        bearings: of the tangents, radians from +z towards +x.
        curvatures: 1/m, positive towards the left hand: towards +x when heading +z.
    """

    bearings: Float[Tensor, " points"]
    curvatures: Float[Tensor, " points"]


def bending(
    points: Float[Tensor, "points 2"], *, spacing: float, closed: bool, smoothing: float
) -> Bending:
    """Tangents and curvatures of a line after a Gaussian, at each of its points.

    A point's tangent is halfway between the directions of the segments before and after it; its
    curvature is the angle between these over the spacing of the line itself, so that a circle's is
    right although the Gaussian shrinks circles. An open line goes on straight at its ends.

    Args:
        points: (x, z), metres; at least two.
        spacing: arc length from point to point.
        closed: whether the last is joined to the first.
        smoothing: sigma of the Gaussian, metres along the line.

    Source: Pavllo et al. 2019, section 3.7; there at the segments, in radians a segment.
    """
    sigma = smoothing / spacing
    reach = kernel_reach(sigma) + 1
    smoothed = smooth(lengthen(points, reach, closed=closed), sigma)
    steps = smoothed[reach - 1 : reach + len(points) + 1].diff(dim=0)
    # A segment without a length, where a line turns back on the spot, leads where the one before
    # it does.
    order = torch.arange(len(steps), device=points.device)
    leads = torch.where(steps.norm(dim=-1) > _STILL * spacing, order, 0).cummax(0).values
    bearings = bearing(steps[leads])
    turns = wrapped(bearings.diff())
    return Bending(bearings[:-1] + turns / 2, turns / spacing)
