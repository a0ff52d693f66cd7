"""Legs that are turned so that their toe is somewhere else."""

from __future__ import annotations

import math

import pytest
import torch
from torch import Tensor
from torch.testing import assert_close

from posecast.geometry import quaternion
from posecast.motion.leg_reach import Leg, Turns, reach, reachable, usual_hinge

THIGH, SHIN = 0.42, 0.40
LEFT = torch.tensor((1.0, 0.0, 0.0), dtype=torch.float64)


def standing(bend: Tensor, hinge: Tensor = LEFT, axis: Tensor = LEFT) -> Leg:
    """Legs that face +z, whose shins are turned backwards by an angle about an axis."""
    down = bend.new_tensor((0.0, -1.0, 0.0)).expand(len(bend), 3)
    hip = bend.new_tensor((0.1, 0.9, 0.3)).expand(len(bend), 3)
    knee = hip + THIGH * down
    ankle = knee + SHIN * quaternion.rotate(quaternion.about_axis(axis, bend), down)
    toe = ankle + bend.new_tensor((0.0, -0.07, 0.12))
    return Leg(hip, knee, ankle, toe, hinge.expand(len(bend), 3))


def turned(leg: Leg, turns: Turns) -> Leg:
    """Where the joints are afterwards."""
    knee = leg.hip + quaternion.rotate(turns.hip, leg.knee - leg.hip)
    shin = quaternion.product(turns.hip, turns.knee)
    ankle = knee + quaternion.rotate(shin, leg.ankle - leg.knee)
    toe = ankle + quaternion.rotate(turns.foot, leg.toe - leg.ankle)
    return Leg(leg.hip, knee, ankle, toe, leg.hinge)


def bends(leg: Leg, axis: Tensor = LEFT) -> Tensor:
    """Degrees by which knees bend about an axis; positive: the shin goes backwards."""
    thigh, shin = leg.knee - leg.hip, leg.ankle - leg.knee
    sine = (torch.linalg.cross(thigh, shin) * axis).sum(-1)
    return torch.rad2deg(torch.atan2(sine, (thigh * shin).sum(-1)))


def test_toes_are_where_they_are_wanted(generator: torch.Generator) -> None:
    leg = standing(torch.linspace(0.3, 2.0, 200, dtype=torch.float64))
    way = 0.06 * torch.randn(200, 3, generator=generator, dtype=torch.float64)
    share = reachable(leg, leg.toe, leg.toe + way)
    assert (share > 0.5).all()
    wanted = leg.toe + share[:, None] * way
    turns = reach(leg, wanted)
    after = turned(leg, turns)
    assert_close(after.toe, wanted, atol=1e-9, rtol=0)
    still = quaternion.angle(turns.foot, quaternion.identity(200, like=way)) < 1e-7
    assert still.double().mean() > 0.8
    assert ((after.ankle - after.hip).norm(dim=-1) <= leg.stretch + 1e-9).all()
    assert (bends(after) > 0).all()


def test_a_toe_that_stays_turns_nothing() -> None:
    bend = torch.linspace(0.0, 2.0, 100, dtype=torch.float64)
    leg = standing(bend, hinge=LEFT + 0.5)
    for turn in reach(leg, leg.toe):
        assert quaternion.angle(turn, quaternion.identity(100, like=turn)).max() < 1e-6


def test_a_knee_bends_in_the_plane_of_its_bend_whatever_is_usual() -> None:
    """The plane of 30 degrees counts for 25 times as much as the usual hinge, 60 degrees off."""
    axis = torch.tensor((math.cos(0.5), 0.0, math.sin(0.5)), dtype=torch.float64)
    usual = torch.tensor((math.cos(0.5 - 1.05), 0.0, math.sin(0.5 - 1.05)), dtype=torch.float64)
    leg = standing(torch.full((1,), 0.52, dtype=torch.float64), hinge=usual, axis=axis)
    up = leg.toe + leg.toe.new_tensor((0.0, 0.05, 0.0))
    after = turned(leg, reach(leg, up))
    normal = torch.linalg.cross(after.knee - after.hip, after.ankle - after.knee)
    assert torch.cosine_similarity(normal, axis[None]) > math.cos(math.radians(3))
    assert bends(after, axis) > 40


@pytest.mark.parametrize("noise", [1e-12, 1e-4])
def test_a_straight_knee_bends_as_it_usually_does(noise: float) -> None:
    """However the noise lies: sideways or backwards."""
    around = torch.linspace(0, 2 * math.pi, 12, dtype=torch.float64)
    axes = torch.stack([around.cos(), 0 * around, around.sin()], dim=-1)
    leg = standing(torch.full((12,), noise, dtype=torch.float64), axis=axes)
    up = leg.toe + leg.toe.new_tensor((0.0, 0.02, 0.0))
    after = turned(leg, reach(leg, up))
    assert_close(after.toe, up, atol=1e-6, rtol=0)
    assert (bends(after) > 20).all()
    assert ((after.knee - after.hip)[:, 0].abs() < 0.01).all()


def test_a_knee_stays_on_its_side_unless_it_is_straight_within_a_degree() -> None:
    leg = standing(torch.tensor((-0.15, -0.01), dtype=torch.float64))
    after = bends(turned(leg, reach(leg, leg.toe + leg.toe.new_tensor((0.0, 0.02, 0.0)))))
    assert after[0] < -20
    assert after[1] > 20


def test_the_heel_rises_where_the_leg_is_too_short_for_the_foot_to_stay() -> None:
    leg = standing(torch.full((1,), 0.3, dtype=torch.float64))
    wanted = leg.toe + leg.toe.new_tensor((0.0, 0.0, -0.25))
    turns = reach(leg, wanted)
    after = turned(leg, turns)
    assert_close(after.toe, wanted, atol=1e-9, rtol=0)
    assert (after.ankle - after.hip).norm() == pytest.approx(0.995 * (THIGH + SHIN))
    assert (after.ankle - after.toe)[0, 1] > (leg.ankle - leg.toe)[0, 1] + 0.03
    # As little as will do: about the horizontal axis.
    assert turns.foot[0, 2:].abs().max() < 1e-9


def test_what_is_out_of_reach_is_reached_in_part() -> None:
    leg = standing(torch.full((3,), 0.3, dtype=torch.float64))
    far = leg.toe + leg.toe.new_tensor(((0.0, 0.0, -2.0), (0.0, -3.0, 0.0), (0.0, 0.01, 0.0)))
    share = reachable(leg, leg.toe, far)
    assert (share[:2] > 0).all()
    assert (share[:2] < 0.4).all()
    assert share[2] == 1
    place = leg.toe + share[:, None] * (far - leg.toe)
    assert_close((place - leg.hip).norm(dim=-1)[:2], leg.reach[:2])
    assert_close(turned(leg, reach(leg, place)).toe, place, atol=1e-6, rtol=0)


def test_the_usual_hinge_turns_with_the_thigh() -> None:
    """Two frames that bend, the second with all of it turned; then one that is straight."""
    leg = standing(torch.tensor([0.8, 0.8, 0.0], dtype=torch.float64))
    about = torch.tensor([[0.0, 1.0, 0.0]] * 3, dtype=torch.float64)
    turn = quaternion.about_axis(about, torch.tensor([0.0, 1.3, 2.0], dtype=torch.float64))
    hip, knee, ankle, toe = (quaternion.rotate(turn, place) for place in leg[:4])
    assert_close(
        usual_hinge(turn, hip, knee, ankle, toe),
        quaternion.rotate(turn, LEFT.expand(3, 3)),
        atol=1e-5,
        rtol=0,
    )
    straight = standing(torch.zeros(4, dtype=torch.float64))
    still = quaternion.identity(4, like=straight.hip)
    assert_close(usual_hinge(still, *straight[:4]), LEFT.expand(4, 3))
