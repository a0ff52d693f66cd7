"""Inertialization: no jump in place or velocity, a half-life, and nothing left after a while."""

from __future__ import annotations

import pytest
import torch

from posecast.generation.inertia import Offset, Posture, difference, shifted
from posecast.geometry import quaternion

FPS = 1000.0


def moving(seconds: list[float], generator: torch.Generator) -> Posture:
    """A body of three joints that turns and moves, at some times about a switch at 0 s."""
    time = torch.tensor(seconds, dtype=torch.float64)[:, None]
    start = torch.randn(3, 4, generator=generator, dtype=torch.float64)
    turning = torch.randn(3, 3, generator=generator, dtype=torch.float64)
    velocity = torch.randn(3, generator=generator, dtype=torch.float64)
    near = torch.tensor([3.0, 0, 0, 0]).double()
    rotations = quaternion.product(
        quaternion.exp(time[..., None] * turning), quaternion.normalize(start + near)
    )
    return Posture(rotations, time * velocity)


def test_an_offset_is_what_shifts_one_posture_to_the_other(generator):
    first, second = moving([0, 1], generator), moving([0, 1], generator)
    again = shifted(second, difference(first, second))
    assert quaternion.angle(again.rotations_local, first.rotations_local).max() < 1e-9
    torch.testing.assert_close(again.root_position, first.root_position)


def test_at_a_switch_place_and_velocity_go_on(generator):
    step = 1 / FPS
    old, new = moving([-step, 0, step], generator), moving([-step, 0, step], generator)
    offset = Offset.at_switch(
        Posture(*(each[:2] for each in old)), Posture(*(each[:2] for each in new)), fps=FPS
    )
    shown = shifted(
        new, torch.stack([offset.value, offset.value, offset.after(step, half_life=0.1).value])
    )
    assert difference(shown, old)[1].abs().max() < 1e-9
    # Of an acceleration of some 100 m/s^2 there are 0.1 mm after a thousandth of a second.
    assert difference(shown, old)[2].abs().max() < 4e-4
    still = shifted(new, torch.stack([offset.value] * 3))
    assert difference(still, old)[2].abs().max() > 1.5e-3


def test_half_of_an_offset_at_rest_is_gone_after_the_half_life():
    value = torch.ones(2, 3).double()
    later = Offset(value, torch.zeros_like(value)).after(0.3, half_life=0.3)
    torch.testing.assert_close(later.value, value / 2)


def test_many_small_steps_are_one_large_step(generator):
    value, velocity = torch.randn(2, 4, 3, generator=generator, dtype=torch.float64)
    steps = Offset(value, velocity)
    for _ in range(10):
        steps = steps.after(0.02, half_life=0.1)
    whole = Offset(value, velocity).after(0.2, half_life=0.1)
    torch.testing.assert_close(steps.value, whole.value)
    torch.testing.assert_close(steps.velocity, whole.velocity)


def test_the_velocity_of_an_offset_is_how_fast_it_changes(generator):
    value, velocity = torch.randn(2, 4, 3, generator=generator, dtype=torch.float64)
    early, late = (
        Offset(value, velocity).after(seconds, half_life=0.1)
        for seconds in (0.1 - 1e-6, 0.1 + 1e-6)
    )
    between = Offset(value, velocity).after(0.1, half_life=0.1)
    torch.testing.assert_close(
        (late.value - early.value) / 2e-6, between.velocity, rtol=1e-6, atol=1e-6
    )


@pytest.mark.parametrize("half_life", [0.05, 0.1])
def test_after_ten_half_lives_nothing_is_left(half_life):
    value, velocity = torch.ones(2, 3).double(), 5 * torch.ones(2, 3).double()
    left = Offset(value, velocity).after(10 * half_life, half_life=half_life)
    assert left.value.abs().max() < 1e-5
