"""NPSS: how alike the spectra of predicted and true motion are."""

from __future__ import annotations

from typing import Literal

import torch
from jaxtyping import Float
from torch import Tensor

Power = Literal["real", "full"]
TINY = 1e-12  # what the published code adds to totals, so that motionless features do no harm


def npss(
    predicted: Float[Tensor, "batch frames features"],
    target: Float[Tensor, "batch frames features"],
    *,
    power: Power = "real",
) -> Float[Tensor, "batch"]:
    """Normalized power spectrum similarity as a value a window, the mean of which is the score.

    For every window i and feature j, the power at all frequencies of the discrete Fourier transform
    is divided by its total. The distance e_ij of two such spectra is the sum of the differences of
    their running sums (earth mover's); its weight w_ij is the total power of the truth. The score
    is sum w_ij e_ij / sum w_ij over all N windows, so window i gets N sum_j w_ij e_ij / sum w_ij.

    The mean over time is not removed and has most of the weight. A prediction that rests has all
    its power there, so all predictions that rest score alike, whatever their pose.

    Args:
        predicted: features over time.
        target: the truth.
        power: ``real``: the square of the real part, as both public implementations compute it;
            ``full``: the squared magnitude, as the paper says.

    Returns:
        Zero where no feature of any true window differs from zero; nothing for an empty batch.

    Source: Gopalakrishnan et al. 2019, "A neural temporal model for human motion prediction"; the
    small number added to all totals where a true one is zero is that of Andreou et al. 2022 (code).
    """
    if target.numel() == 0:  # which the transform refuses
        return target.new_zeros(len(target))
    found, true = (_power(values, power) for values in (predicted, target))
    weight = true.sum(1)
    tiny = TINY if bool((weight == 0).any()) else 0.0
    distance = (_running_share(found, tiny) - _running_share(true, tiny)).abs().sum(1)
    return len(weight) * (weight * distance).sum(1) / weight.sum().clamp_min(TINY)


def _power(
    values: Float[Tensor, "batch frames features"], power: Power
) -> Float[Tensor, "batch frames features"]:
    spectrum = torch.fft.fft(values, dim=1)
    return spectrum.real.square() if power == "real" else spectrum.abs().square()


def _running_share(
    spectrum: Float[Tensor, "batch frames features"], tiny: float
) -> Float[Tensor, "batch frames features"]:
    """Share of the power at frequencies up to each; zero throughout where there is no power."""
    total = spectrum.sum(1, keepdim=True) + tiny
    return torch.cumsum(spectrum / torch.where(total > 0, total, 1.0), dim=1)
