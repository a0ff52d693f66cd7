"""Gaussian low-pass of equally spaced samples, with ends that neither shrink nor show a seam."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from posecast.errors import ConfigError

_REACH = 4.0
"""The kernel ends here, in sigmas: beyond it are 6e-5 of its weight."""


def smooth(
    values: Float[Tensor, "samples *channels"], sigma: float, *, closed: bool = False
) -> Float[Tensor, "samples *channels"]:
    """Gaussian low-pass along the first axis.

    Open: beyond an end the samples go on mirrored in the end point (oddly), so the end stays where
    it is, a straight line stays straight up to its ends, and, where there are 8 sigma of samples or
    more, no value leaves their range. Closed: after the last sample comes the first one again, and
    the filter knows no seam.

    Args:
        values: of one sample or more; any unit.
        sigma: standard deviation in samples, 0 or more. Up to 1/8 nothing changes.
        closed: whether the samples go round.

    Raises:
        ConfigError: ``sigma`` is negative or not finite.

    Source: Pavllo et al. 2019 smooth with a kernel of 4 sigma to both sides. Their samples are
    mirrored about the end, also those of closed curves, which shrinks ends and kinks the seam.
    """
    if not 0 <= sigma < float("inf"):
        raise ConfigError(f"sigma is {sigma}: expected a number of samples, 0 or more")
    reach = kernel_reach(sigma)
    if reach == 0:
        return values
    steps = torch.arange(reach + 1, dtype=values.dtype, device=values.device)
    weights = torch.exp(-0.5 * (steps / sigma) ** 2)
    weights = weights / (2 * weights.sum() - weights[0])
    longer = lengthen(values, reach, closed=closed)
    count = len(values)
    smoothed = weights[0] * longer[reach : reach + count]
    for step in range(1, reach + 1):
        before, after = longer[reach - step :][:count], longer[reach + step :][:count]
        smoothed = smoothed + weights[step] * (before + after)
    return smoothed


def kernel_reach(sigma: float) -> int:
    """How many samples to either side ``smooth`` looks."""
    return int(_REACH * sigma + 0.5)


def lengthen(
    values: Float[Tensor, "samples *channels"], by: int, *, closed: bool = False
) -> Float[Tensor, "longer *channels"]:
    """The samples with ``by`` more at both ends: mirrored in the end points, or going round.

    Any ``by`` will do: mirrored twice, the samples go on by the way from the first to the last.
    """
    places = torch.arange(-by, len(values) + by, device=values.device)
    if closed or len(values) == 1:
        return values[places % len(values)]
    last = len(values) - 1
    rounds, place = places.div(2 * last, rounding_mode="floor"), places % (2 * last)
    channels = (-1, *(1,) * (values.ndim - 1))
    back = (place > last).reshape(channels)
    inside = values[torch.where(place > last, 2 * last - place, place)]
    way = 2 * (values[-1] - values[0]) * rounds.reshape(channels)
    return torch.where(back, 2 * values[-1] - inside, inside) + way
