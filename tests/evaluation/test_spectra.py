"""Spectra of motions that are not aligned: what they see, and what they do not."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor

from posecast.evaluation.spectra import (
    in_body_frame,
    power_ratio,
    spectrum_distance,
    spectrum_of,
)

FPS = 30.0


def swing(rate: float, *, size: float = 1.0, phase: float = 0.0, frames: int = 300) -> Tensor:
    """One feature that swings ``rate`` times a second."""
    time = torch.arange(frames).double() / FPS
    return (size * torch.sin(2 * math.pi * rate * time + phase))[:, None]


def spectrum(*motions: Tensor):
    found = spectrum_of(motions, fps=FPS)
    assert found is not None
    return found


@pytest.mark.parametrize("phase", [0.0, 1.0, 2.5])
def test_when_a_movement_begins_does_not_matter(phase: float) -> None:
    found, true = spectrum(swing(2.0, phase=phase)), spectrum(swing(2.0))
    assert spectrum_distance(found, true) < 1e-3
    assert power_ratio(found, true) == pytest.approx(1, abs=1e-3)


@pytest.mark.parametrize(("rate", "distance"), [(3.0, 1.0), (1.5, 0.5), (2.0, 0.0)])
def test_quicker_or_slower_movements_are_so_many_hertz_away(rate: float, distance: float) -> None:
    found = spectrum_distance(spectrum(swing(rate)), spectrum(swing(2.0)))
    assert found == pytest.approx(distance, abs=0.02)


def test_the_frame_rate_does_not_change_hertz() -> None:
    found, true = (spectrum_of([swing(rate)], fps=2 * FPS) for rate in (2.0, 1.0))
    assert found is not None
    assert true is not None
    assert spectrum_distance(found, true) == pytest.approx(2.0, abs=0.05)


def test_half_as_large_is_a_quarter_of_the_power_and_no_distance() -> None:
    found, true = spectrum(swing(2.0, size=0.5)), spectrum(swing(2.0))
    assert power_ratio(found, true) == pytest.approx(0.25)
    assert spectrum_distance(found, true) < 1e-9


def test_poses_do_not_count() -> None:
    found, true = spectrum(swing(2.0) + 5), spectrum(swing(2.0))
    assert spectrum_distance(found, true) < 1e-9
    assert power_ratio(found, true) == pytest.approx(1)


def test_features_count_by_their_true_power() -> None:
    """Of two, one wrong by 1 Hz that has a fifth of the power."""
    true = spectrum(torch.cat([swing(2.0, size=2.0), swing(2.0)], dim=-1))
    found = spectrum(torch.cat([swing(2.0), swing(3.0, size=7.0)], dim=-1))
    assert spectrum_distance(found, true) == pytest.approx(0.2, abs=0.01)


def test_what_never_moves_is_farther_away_than_any_movement() -> None:
    still, true = spectrum(torch.zeros(300, 1).double()), spectrum(swing(2.0))
    assert spectrum_distance(still, true) > spectrum_distance(spectrum(swing(14.0)), true)
    assert power_ratio(still, true) == 0


def test_all_windows_of_all_motions_are_in_the_mean() -> None:
    found = spectrum(swing(2.0, frames=60), swing(2.0, size=3.0, frames=60))
    assert power_ratio(found, spectrum(swing(2.0, frames=60))) == pytest.approx(5)


def test_motions_shorter_than_a_window_have_no_spectrum() -> None:
    assert spectrum_of([swing(2.0, frames=59)], fps=FPS) is None
    assert spectrum_of([swing(2.0, frames=60)], fps=FPS) is not None


def test_in_the_body_frame_left_is_left_and_ahead_is_ahead() -> None:
    """Facing +x, ahead is +x and the left hand is towards -z."""
    positions = torch.tensor([[[1.0, 2.0, 3.0], [1.5, 2.25, 3.0], [1.0, 2.0, 2.0]]]).double()
    found = in_body_frame(positions, torch.tensor([[1.0, 0.0]]).double())
    expected = torch.tensor([[[0, 0, 0], [0, 0.25, 0.5], [1.0, 0, 0]]]).double()
    torch.testing.assert_close(found, expected)


def test_facing_ahead_the_axes_stay(generator: torch.Generator) -> None:
    positions = torch.randn(4, 3, 3, generator=generator).double()
    found = in_body_frame(positions, torch.tensor([[0.0, 1.0]]).double().expand(4, 2), root=1)
    torch.testing.assert_close(found, positions - positions[:, 1:2])
