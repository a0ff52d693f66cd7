"""NPSS against a slow reference and cases computed by hand."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from posecast.evaluation import npss


def slow_npss(predicted, target, full=False):
    """Loops over windows, features and frequencies (protocols.md, "NPSS, precisely")."""
    total, weights = 0.0, 0.0
    windows, frames, features = target.shape

    def powers(signal):
        found = []
        for f in range(frames):
            z = sum(signal[t] * np.exp(-2j * np.pi * f * t / frames) for t in range(frames))
            found.append(abs(z) ** 2 if full else z.real**2)
        return np.array(found)

    sums = [[powers(target[i, :, j]) for j in range(features)] for i in range(windows)]
    tiny = 1e-12 if any(p.sum() == 0 for row in sums for p in row) else 0.0
    for i in range(windows):
        for j in range(features):
            true, guess = sums[i][j], powers(predicted[i, :, j])
            distance = np.abs(
                np.cumsum(guess / (guess.sum() + tiny)) - np.cumsum(true / (true.sum() + tiny))
            ).sum()
            total += true.sum() * distance
            weights += true.sum()
    return total / weights


@pytest.mark.parametrize("full", [False, True])
@pytest.mark.parametrize("motionless", [False, True])
def test_npss_agrees_with_a_slow_reference(full, motionless, generator):
    target = torch.randn(3, 12, 4, dtype=torch.float64, generator=generator)
    predicted = target + 0.5 * torch.randn(3, 12, 4, dtype=torch.float64, generator=generator)
    if motionless:
        target[:, :, 0] = 0
        predicted[:, :, 0] = 0
    found = npss(predicted, target, power="full" if full else "real")
    assert found.shape == (3,)
    expected = slow_npss(predicted.numpy(), target.numpy(), full)
    assert found.mean().item() == pytest.approx(expected, rel=1e-9)


def test_the_two_powers_differ(generator):
    target, predicted = torch.randn(2, 3, 20, 4, dtype=torch.float64, generator=generator)
    assert npss(predicted, target).mean() != npss(predicted, target, power="full").mean()


def test_equal_motion_scores_zero(generator):
    target = torch.randn(3, 12, 4, dtype=torch.float64, generator=generator)
    for power in ("real", "full"):
        assert npss(target, target, power=power).tolist() == [0.0, 0.0, 0.0]


def test_all_power_at_the_wrong_frequency_scores_the_distance_between_them():
    time = torch.arange(8, dtype=torch.float64)
    slow, fast = (torch.cos(2 * torch.pi * turns * time / 8)[None, :, None] for turns in (1, 3))
    # Of eight frequencies, 1 and 7 have half of the slow power each, 3 and 5 half of the fast:
    # the running sums differ by a half at 1 and 2, and at 5 and 6.
    assert npss(fast, slow).item() == pytest.approx(2.0)
    assert npss(slow, fast).item() == pytest.approx(2.0)


def test_the_real_part_is_blind_to_a_sine():
    time = torch.arange(8, dtype=torch.float64)
    sine = torch.sin(2 * torch.pi * time / 8)[None, :, None]
    still = torch.ones(1, 8, 1, dtype=torch.float64)
    mixed = still + sine
    # The sine is all imaginary: to the real part the mixture rests.
    assert npss(still, mixed).item() == pytest.approx(0, abs=1e-12)
    # With full power its share, 16 + 16 of 64 + 32, is at 1 and 7: off by a third from 0 to 0,
    # by a sixth from 1 to 6.
    assert npss(still, mixed, power="full").item() == pytest.approx(1 / 3 + 6 / 6)


def test_predictions_that_rest_score_alike_whatever_their_pose(generator):
    target = torch.randn(3, 12, 4, dtype=torch.float64, generator=generator)
    one, other = (torch.full_like(target, pose) for pose in (0.3, -7.0))
    torch.testing.assert_close(npss(one, target), npss(other, target))
    assert npss(one, target).mean() > 0.5


def test_a_feature_counts_as_much_as_the_truth_has_power_in_it(generator):
    target = torch.randn(2, 12, 2, dtype=torch.float64, generator=generator)
    target[:, :, 1] *= 1e-4
    wrong = target.clone()
    wrong[:, :, 1] = wrong[:, :, 1].flip(1) * 5
    assert npss(wrong, target).mean() < 1e-5


@pytest.mark.parametrize("motionless", [False, True])
def test_a_prediction_without_any_power_has_a_value(motionless, generator):
    target = torch.randn(2, 12, 3, dtype=torch.float64, generator=generator)
    if motionless:
        target[..., 0] = 0
    values = npss(torch.zeros_like(target), target)
    # Nothing in any share: off by the running sum of the truth itself.
    spectrum = torch.fft.fft(target, dim=1).real.square()
    share = spectrum.sum(1)
    running = torch.cumsum(spectrum / share.clamp_min(1e-12)[:, None], dim=1).sum(1)
    assert values.mean().item() == pytest.approx(((share * running).sum() / share.sum()).item())


def test_a_truth_without_any_power_scores_zero():
    still = torch.zeros(2, 12, 3, dtype=torch.float64)
    assert npss(still + 1, still).tolist() == [0.0, 0.0]


def test_no_windows_have_no_values():
    none = torch.zeros(0, 8, 3, dtype=torch.float64)
    assert npss(none, none).shape == (0,)
