"""Power spectra of joint positions, of motions that are not aligned in time.

NPSS compares a prediction with the truth of the same seconds. A walk along a path has none, so mean
spectra of sets are compared, by the same distance.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

WINDOW = 2.0
"""Seconds of motion behind a spectrum: two strides, and steps of half a hertz."""


class Spectrum(NamedTuple):
    """Mean power of some motions.

    Args:
        power: of each feature at each frequency; nothing in it is normalized.
        spacing: from frequency to frequency, Hz; the first is 0.
    """

    power: Float[Tensor, "features frequencies"]
    spacing: float


def in_body_frame(
    positions: Float[Tensor, "frames joints 3"],
    facing: Float[Tensor, "frames 2"],
    *,
    root: int = 0,
) -> Float[Tensor, "frames joints 3"]:
    """Joints relative to the root: to the left, up, and ahead of where the body faces, metres.

    Args:
        positions: in the world, metres.
        facing: unit vectors (x, z).
        root: which joint is the root.
    """
    x, up, z = (positions - positions[:, root, None]).unbind(-1)
    ahead_x, ahead_z = facing[:, None].unbind(-1)
    left, ahead = x * ahead_z - z * ahead_x, x * ahead_x + z * ahead_z
    return torch.stack([left, up, ahead], dim=-1)


def spectrum_of(motions: Sequence[Float[Tensor, "_ features"]], *, fps: float) -> Spectrum | None:
    """Mean power spectrum of windows of ``WINDOW`` seconds that overlap by half.

    From each window the mean is taken, so that poses do not count, only movement; then it goes
    through a Hann window.

    Args:
        motions: features over time, one tensor a motion.
        fps: frames a second.

    Returns:
        ``None`` where no motion is as long as a window.

    Source: Welch 1967.
    """
    size = round(WINDOW * fps)
    windows = [
        motion.double().unfold(0, size, max(1, size // 2))
        for motion in motions
        if len(motion) >= size
    ]
    if not windows:
        return None
    cut = torch.cat(windows)
    cut = (cut - cut.mean(dim=-1, keepdim=True)) * torch.hann_window(size, dtype=torch.float64)
    return Spectrum(torch.fft.rfft(cut).abs().square().mean(0), fps / size)


def spectrum_distance(found: Spectrum, true: Spectrum) -> float:
    """How far apart normalized spectra are, Hz: by so much the power of the one would have to move.

    Of each feature, the power at all frequencies is divided by its total; the distance of two such
    spectra is the sum of the differences of their running sums (earth mover's) times the spacing of
    frequencies. The mean over features is weighted by the true total power. A feature that does not
    move in ``found`` has no running sum at all.

    Source: the distance and the weights are those of NPSS, Gopalakrishnan et al. 2019.
    """
    share, true_share = _running_share(found.power), _running_share(true.power)
    distance = (share - true_share).abs().sum(-1) * true.spacing
    weight = true.power.sum(-1)
    total = float(weight.sum())
    return float((weight * distance).sum()) / total if total > 0 else math.nan


def power_ratio(found: Spectrum, true: Spectrum) -> float:
    """Total power over all features and frequencies, as a multiple of the true one.

    What ``spectrum_distance`` normalizes away: below 1 movements are smaller than true ones.
    """
    total = float(true.power.sum())
    return float(found.power.sum()) / total if total > 0 else math.nan


def _running_share(
    power: Float[Tensor, "features frequencies"],
) -> Float[Tensor, "features frequencies"]:
    total = power.sum(-1, keepdim=True)
    return torch.cumsum(power / torch.where(total > 0, total, 1.0), dim=-1)
