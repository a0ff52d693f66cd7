"""The low-pass filters against SciPy, and what they promise at the ends and on curves."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from scipy.ndimage import gaussian_filter1d
from torch.testing import assert_close

from posecast.motion.low_pass import gaussian, low_pass


@pytest.mark.parametrize("frames", [1, 2, 7, 40, 200])
@pytest.mark.parametrize("sigma", [0.7, 5.0, 12.3])
def test_with_even_ends_it_is_the_filter_of_scipy(
    frames: int, sigma: float, generator: torch.Generator
) -> None:
    """Also where the kernel is many times as long as the values."""
    values = torch.randn(frames, 3, generator=generator, dtype=torch.float64)
    expected = gaussian_filter1d(values.numpy(), sigma, axis=0, mode="reflect", truncate=4.0)
    assert_close(gaussian(values, sigma, ends="even"), torch.from_numpy(expected))


@pytest.mark.parametrize("frames", [1, 2, 7, 40])
def test_odd_ends_are_half_turns_about_the_end_values(
    frames: int, generator: torch.Generator
) -> None:
    values = torch.randn(frames, generator=generator, dtype=torch.float64)
    longer = values.numpy()
    while len(longer) < 300:  # NumPy goes no further than the values reach
        width = max(len(longer) - 1, 1)
        mode = {"mode": "reflect", "reflect_type": "odd"} if len(longer) > 1 else {"mode": "edge"}
        longer = np.pad(longer, width, **mode)
    middle = (len(longer) - frames) // 2
    expected = gaussian_filter1d(longer, 6.0)[middle : middle + frames]
    assert_close(gaussian(values, 6.0), torch.from_numpy(expected))


def test_a_line_stays_a_line_up_to_its_ends() -> None:
    line = torch.linspace(-3, 5, 30, dtype=torch.float64)[:, None] * torch.tensor([[1.0, -0.3]])
    for smooth in (gaussian(line, 9.0), low_pass(line, 9.0)):
        assert_close(smooth, line, atol=1e-12, rtol=0)


@pytest.mark.parametrize("sigma", [4.0, 9.0])
def test_a_circle_shrinks_by_the_square_of_what_a_gaussian_takes(sigma: float) -> None:
    turn = 0.04
    angle = turn * torch.arange(400, dtype=torch.float64)
    circle = torch.stack([angle.cos(), angle.sin()], dim=-1)
    lost = 1 - math.exp(-((turn * sigma) ** 2) / 2)
    inner = slice(100, 300)
    radius = gaussian(circle, sigma)[inner].norm(dim=-1)
    assert_close(radius, torch.full_like(radius, 1 - lost), atol=1e-4, rtol=0)
    radius = low_pass(circle, sigma)[inner].norm(dim=-1)
    assert_close(radius, torch.full_like(radius, 1 - lost**2), atol=1e-4, rtol=0)


def test_an_oscillation_is_left_with_the_stated_share() -> None:
    period, sigma = 30.0, 12.0
    wave = torch.sin(2 * math.pi / period * torch.arange(600, dtype=torch.float64))
    passed = math.exp(-2 * math.pi**2 * sigma**2 / period**2)
    share = 1 - (1 - passed) ** 2
    assert 0.05 < share < 0.1
    inner = slice(150, 450)
    assert_close(low_pass(wave, sigma)[inner], share * wave[inner], atol=1e-4, rtol=0)
