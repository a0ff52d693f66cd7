"""Feet on the floor: contacts by height, sliding and sinking, with known answers."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest
import torch
from torch import Tensor

from posecast.errors import ConfigError
from posecast.evaluation.footing import (
    NEAR,
    SHORTEST,
    Stance,
    depths,
    floor_contacts,
    sliding,
    stance_of,
)

FPS, LEG = 30.0, 0.8
Steps = Callable[..., Tensor]


@pytest.fixture
def steps() -> Steps:
    """``steps(slide=0.0)``: toes (m) of two feet that stand for 15 frames and swing for 15, in
    turn, for 120; a foot that stands moves ``slide`` metres a frame along x."""

    def make(slide: float = 0.0, up: float = 0.1) -> Tensor:
        toes = torch.zeros(120, 2, 3).double()
        for frame in range(120):
            for foot in (0, 1):
                place = (frame + 15 * foot) % 30
                toes[frame, foot, 1] = 0.02 + (up if place >= 15 else 0.0)
                toes[frame, foot, 0] = slide * min(place, 14)
                toes[frame, foot, 2] = (
                    frame // 30 + (place - 14) / 16 if place > 14 else frame // 30
                )
        return toes

    return make


def test_a_foot_is_on_the_floor_where_it_is_low(steps: Steps) -> None:
    contacts = floor_contacts(steps(), fps=FPS, leg=LEG)
    place = torch.arange(120) % 30
    assert torch.equal(contacts[:, 0], place < 15)
    assert torch.equal(contacts[:, 1], place >= 15)


def test_a_foot_that_slides_is_on_the_floor_all_the_same(steps: Steps) -> None:
    assert torch.equal(
        floor_contacts(steps(0.05), fps=FPS, leg=LEG), floor_contacts(steps(), fps=FPS, leg=LEG)
    )


@pytest.mark.parametrize(("above", "near"), [(0.9, True), (1.1, False)])
def test_how_near_is_in_leg_lengths(steps: Steps, above: float, near: bool) -> None:
    for leg in (0.4, 0.8):
        toes = steps(up=above * NEAR * leg)
        assert bool(floor_contacts(toes, fps=FPS, leg=leg).all()) == near


def test_the_floor_may_be_given(steps: Steps) -> None:
    assert not floor_contacts(steps(), fps=FPS, leg=LEG, floor=-0.1).any()
    assert floor_contacts(steps(), fps=FPS, leg=LEG, floor=0.12).all()
    lifted = steps() + torch.tensor([0.0, 0.3, 0.0])
    assert not floor_contacts(lifted, fps=FPS, leg=LEG, floor=0.02).any()
    assert floor_contacts(lifted, fps=FPS, leg=LEG).any()


def test_what_is_low_for_a_moment_is_no_contact() -> None:
    toes = torch.full((60, 2, 3), 0.3).double()
    toes[10:13, 0, 1] = 0.02
    toes[20:22, 0, 1] = 0.02
    found = floor_contacts(toes, fps=FPS, leg=LEG, floor=0.02)
    assert found.nonzero().tolist() == [[10, 0], [11, 0], [12, 0]]
    assert pytest.approx(3) == SHORTEST * FPS


def test_planted_feet_do_not_slide(steps: Steps) -> None:
    toes = steps()
    found = sliding(toes, floor_contacts(toes, fps=FPS, leg=LEG), fps=FPS, leg=LEG)
    assert found.share == pytest.approx(0.5)
    assert (found.path_cm, found.straight_cm) == (0, 0)


def test_sliding_is_the_way_in_a_contact_in_centimetres(steps: Steps) -> None:
    """14 times from frame to frame 1 mm: 1.4 cm, whatever happens in the air."""
    toes = steps(0.001)
    found = sliding(toes, floor_contacts(toes, fps=FPS, leg=LEG), fps=FPS, leg=LEG)
    assert found.path_cm == pytest.approx(1.4)
    assert found.straight_cm == pytest.approx(1.4)


def test_to_and_fro_is_a_way_but_leads_nowhere() -> None:
    toes = torch.zeros(31, 2, 3).double()
    toes[1::2, :, 2] = 0.01
    found = sliding(toes, torch.ones(31, 2, dtype=torch.bool), fps=FPS, leg=LEG)
    assert found.path_cm == pytest.approx(30)
    assert found.straight_cm == pytest.approx(0)


def test_up_and_down_is_no_sliding() -> None:
    toes = torch.zeros(31, 2, 3).double()
    toes[1::2, :, 1] = 0.01
    found = sliding(toes, torch.ones(31, 2, dtype=torch.bool), fps=FPS, leg=LEG)
    assert (found.path_cm, found.straight_cm, found.fast) == (0, 0, 0)


@pytest.mark.parametrize(("speed", "share"), [(0.20, 0.0), (0.21, 1.0)])
def test_fast_is_more_than_a_fifth_of_a_leg_a_second(speed: float, share: float) -> None:
    toes = torch.zeros(31, 2, 3).double()
    toes[:, :, 2] = (speed * LEG / FPS * torch.arange(31).double())[:, None]
    found = sliding(toes, torch.ones(31, 2, dtype=torch.bool), fps=FPS, leg=LEG)
    assert found.fast == share


def test_feet_that_never_stand_have_nothing_to_slide() -> None:
    found = sliding(
        torch.zeros(31, 2, 3).double(), torch.zeros(31, 2, dtype=torch.bool), fps=FPS, leg=LEG
    )
    assert found.share == 0
    assert all(math.isnan(value) for value in found[1:])


def test_depth_is_what_a_foot_is_below_where_it_stands() -> None:
    """A toe 2 cm too low; an ankle 3 cm too low; one foot too high."""
    stance = Stance(toe=0.05, ankle=0.1)  # 4 cm and 8 cm of a leg of 0.8 m
    toes, ankles = torch.zeros(3, 2, 3).double(), torch.zeros(3, 2, 3).double()
    toes[..., 1], ankles[..., 1] = 0.04, 0.08
    toes[0, 0, 1] = 0.02
    ankles[1, 1, 1] = 0.05
    toes[2, 0, 1], ankles[2, 0, 1] = 0.3, 0.4
    expected = torch.tensor([[2.0, 0.0], [0.0, 3.0], [0.0, 0.0]]).double()
    found = depths(toes, ankles, leg=LEG, stance=stance)
    torch.testing.assert_close(found, expected, atol=1e-9, rtol=0)
    higher = depths(toes + 0.5, ankles + 0.5, leg=LEG, stance=stance, floor=0.5)
    torch.testing.assert_close(higher, expected, atol=1e-9, rtol=0)


def test_where_feet_stand_is_measured_in_leg_lengths(steps: Steps) -> None:
    up = torch.tensor([0.0, 0.06, 0.0])
    small = (steps() * 0.5, (steps() + up) * 0.5, LEG * 0.5)
    found = stance_of([(steps(), steps() + up, LEG), small])
    assert found.toe == pytest.approx(0.02 / LEG)
    assert found.ankle == pytest.approx(0.08 / LEG)


def test_near_must_be_positive(steps: Steps) -> None:
    with pytest.raises(ConfigError, match="expected a positive number of leg lengths"):
        floor_contacts(steps(), fps=FPS, leg=LEG, near=0.0)
