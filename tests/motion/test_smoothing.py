"""Gaussian smoothing against SciPy, and what it must leave alone."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter1d

from posecast.errors import ConfigError
from posecast.motion.smoothing import kernel_reach, lengthen, smooth


@pytest.mark.parametrize("count", [1, 2, 7, 300])
@pytest.mark.parametrize("sigma", [0.3, 1.0, 5.0, 40.0])
def test_a_closed_track_is_smoothed_as_by_scipy_with_wrapping_ends(count, sigma, generator):
    values = torch.randn(count, 2, generator=generator, dtype=torch.float64)
    expected = gaussian_filter1d(values.numpy(), sigma, axis=0, mode="wrap")
    torch.testing.assert_close(
        smooth(values, sigma, closed=True), torch.from_numpy(expected), rtol=0, atol=1e-13
    )


@pytest.mark.parametrize("count", [2, 3, 7, 300])
@pytest.mark.parametrize("sigma", [0.3, 1.0, 5.0, 40.0])
def test_an_open_track_is_smoothed_as_by_scipy_once_numpy_has_mirrored_its_ends(
    count, sigma, generator
):
    values = torch.randn(count, 2, generator=generator, dtype=torch.float64)
    reach = kernel_reach(sigma)
    padded = np.pad(values.numpy(), [(reach, reach), (0, 0)], mode="reflect", reflect_type="odd")
    torch.testing.assert_close(lengthen(values, reach), torch.from_numpy(padded))
    expected = gaussian_filter1d(padded, sigma, axis=0)[reach : reach + count]
    torch.testing.assert_close(
        smooth(values, sigma), torch.from_numpy(expected), rtol=0, atol=1e-12
    )


@pytest.mark.parametrize("sigma", [1.0, 5.0, 50.0])
def test_a_straight_line_stays_straight_up_to_its_ends(sigma):
    line = torch.linspace(-1, 3, 40, dtype=torch.float64)[:, None] * torch.tensor([1.0, -0.3])
    torch.testing.assert_close(smooth(line.double(), sigma), line.double(), rtol=0, atol=1e-13)


@settings(deadline=None)
@given(
    st.lists(st.floats(-1e3, 1e3), min_size=1, max_size=60),
    st.floats(0, 7),
    st.booleans(),
)
def test_smoothed_values_stay_within_the_range_of_the_samples(values, sigma, closed):
    samples = torch.tensor(values, dtype=torch.float64)
    smoothed = smooth(samples, sigma, closed=closed)
    assert smoothed.shape == samples.shape
    if closed or len(values) > 2 * kernel_reach(sigma):
        assert smoothed.min() >= samples.min() - 1e-9
        assert smoothed.max() <= samples.max() + 1e-9
    if not closed:
        torch.testing.assert_close(smoothed[[0, -1]], samples[[0, -1]], rtol=1e-12, atol=1e-9)


def test_a_sigma_of_nothing_changes_nothing_and_its_argument_is_never_changed(generator):
    values = torch.randn(9, generator=generator, dtype=torch.float64)
    before = values.clone()
    torch.testing.assert_close(smooth(values, 0.0), before, rtol=0, atol=0)
    assert not torch.equal(smooth(values, 2.0), before)
    torch.testing.assert_close(values, before, rtol=0, atol=0)


@pytest.mark.parametrize("sigma", [-1.0, float("nan"), float("inf")])
def test_a_sigma_that_is_none_is_refused(sigma):
    with pytest.raises(ConfigError, match=r"sigma is .*expected a number of samples, 0 or more"):
        smooth(torch.zeros(3), sigma)
