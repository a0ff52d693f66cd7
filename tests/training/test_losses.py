"""Laws of the losses, near the hard spots, in float64."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from posecast.errors import ConfigError
from posecast.geometry import quaternion
from posecast.geometry.euler import euler_to_quaternion
from posecast.representation import Codec
from posecast.representation.rotations import Quaternion
from posecast.training.losses import (
    LOSSES,
    Comparison,
    Objective,
    euler_l1,
    position,
    quaternion_dot,
    root_l1,
)

HARD_ANGLES = {
    "identity": (0.0, 0.0, 0.0),
    "gimbal lock": (0.3, math.pi / 2, 0.0),
    "other gimbal lock": (0.0, -math.pi / 2, 1.0),
    "half turn": (math.pi, 0.0, 0.0),
    "half turn about x": (0.0, 0.0, math.pi),
}


def rotations(generator, *shape):
    drawn = torch.randn(*shape, 4, dtype=torch.float64, generator=generator)
    return quaternion.normalize(drawn)


@pytest.fixture
def comparison(tiny, generator):
    """Random windows of 2 x 3 frames, with root channels; prediction and truth differ."""
    codec = Codec(tiny.SKELETON, Quaternion(), root="displacement")
    joints = len(tiny.SKELETON)
    features = [
        codec.merge(
            rotations(generator, 2, 3, joints),
            torch.randn(2, 3, 3, dtype=torch.float64, generator=generator),
        )
        for _ in range(2)
    ]
    return Comparison(
        codec=codec,
        predicted=features[0].requires_grad_(),
        raw=torch.randn(2, 3, joints, 4, dtype=torch.float64, generator=generator).requires_grad_(),
        target=features[1],
        offsets=tiny.OFFSETS.double().expand(2, -1, -1),
    )


def test_there_are_five_losses():
    assert set(LOSSES) == {"euler", "quaternion", "penalty", "position", "root"}


@pytest.mark.parametrize("name", LOSSES)
def test_a_loss_is_zero_when_everything_is_right(name, comparison):
    raw = comparison.codec.split(comparison.target).joints
    right = replace(comparison, predicted=comparison.target, raw=raw)
    assert LOSSES[name](right).item() == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize("name", LOSSES)
def test_a_loss_is_positive_and_has_a_gradient_when_something_is_wrong(name, comparison):
    loss = LOSSES[name](comparison)
    assert loss > 0.1
    loss.backward()
    source = comparison.raw if name == "penalty" else comparison.predicted
    assert source.grad.abs().max() > 1e-3


@pytest.mark.parametrize("spot", HARD_ANGLES)
@pytest.mark.parametrize("name", ["euler", "quaternion", "position"])
@pytest.mark.parametrize("equal", [True, False])
def test_gradients_are_finite_at_hard_spots(name, spot, equal, comparison, tiny):
    hard = euler_to_quaternion(torch.tensor(HARD_ANGLES[spot], dtype=torch.float64))
    joints = hard.expand(2, 3, len(tiny.SKELETON), 4)
    root = torch.zeros(2, 3, 3, dtype=torch.float64)
    predicted = comparison.codec.merge(joints, root).requires_grad_()
    target = predicted.detach() if equal else comparison.target
    loss = LOSSES[name](replace(comparison, predicted=predicted, target=target))
    loss.backward()
    assert loss.isfinite()
    assert predicted.grad.isfinite().all()


@pytest.mark.parametrize("name", ["euler", "position"])
def test_angles_and_positions_do_not_change_with_the_sign_of_a_quaternion(name, comparison):
    codec = comparison.codec
    joints, root = codec.split(comparison.predicted)
    signs = torch.tensor([1.0, -1, -1, 1, -1], dtype=torch.float64)[:, None]
    flipped = replace(comparison, predicted=codec.merge(joints * signs, root))
    assert LOSSES[name](flipped).item() == pytest.approx(LOSSES[name](comparison).item(), rel=1e-12)


def test_opposite_quaternions_are_two_apart(generator):
    q = rotations(generator, 3, 5)
    assert quaternion_dot(q, -q).item() == pytest.approx(2)


@pytest.mark.parametrize("order", ["zyx", "xyz", "yzx"])
def test_the_euler_loss_agrees_with_scipy(order, generator):
    p, q = rotations(generator, 2, 50, 5)
    angles = [
        Rotation.from_quat(x.reshape(-1, 4).numpy(), scalar_first=True).as_euler(order.upper())
        for x in (p, q)
    ]
    difference = (angles[0] - angles[1] + np.pi) % (2 * np.pi) - np.pi
    found = euler_l1(p, q, order=order).item()
    assert found == pytest.approx(np.abs(difference).mean(), abs=1e-9)


def test_angles_are_compared_the_short_way_round():
    near, beyond = torch.tensor([[math.pi - 0.1, 0, 0], [0.1 - math.pi, 0, 0]]).double()
    loss = euler_l1(euler_to_quaternion(near)[None], euler_to_quaternion(beyond)[None])
    assert loss.item() == pytest.approx(0.2 / 3)


def test_the_position_loss_is_the_mean_length_of_the_chords(tiny):
    still = quaternion.identity(1, len(tiny.SKELETON), like=torch.zeros(1, dtype=torch.float64))
    moved = still.clone()
    moved[0, 1] = euler_to_quaternion(torch.tensor([0.4, 0, 0], dtype=torch.float64), "zyx")
    offsets = tiny.OFFSETS.double()
    # The spine turns about z: its three children move on circles in the plane of x and y.
    chords = 2 * math.sin(0.2) * offsets[2:, :2].norm(dim=-1)
    loss = position(moved, still, skeleton=tiny.SKELETON, offsets=offsets)
    assert loss.item() == pytest.approx(chords.sum().item() / 5)


def test_the_position_loss_does_not_change_when_both_are_turned(tiny, generator):
    p, q = rotations(generator, 2, 7, len(tiny.SKELETON))
    turn = rotations(generator)
    turned = [torch.cat([quaternion.product(turn, x[:, :1]), x[:, 1:]], dim=1) for x in (p, q)]
    body = {"skeleton": tiny.SKELETON, "offsets": tiny.OFFSETS.double()}
    assert position(*turned, **body).item() == pytest.approx(position(p, q, **body).item())


def test_the_penalty_looks_at_squared_lengths_of_raw_outputs(comparison):
    raw = 2 * comparison.codec.split(comparison.target).joints
    assert LOSSES["penalty"](replace(comparison, raw=raw)).item() == pytest.approx(9)


def test_the_root_loss_is_in_meters():
    assert root_l1(torch.tensor([[1.0, 2, 3]]), torch.tensor([[1.0, 2.5, 2]])).item() == 0.5


def test_an_objective_is_the_weighted_sum_of_its_terms(comparison):
    loss = Objective({"euler": 2.0, "penalty": 0.01}, order="xyz")(replace(comparison, order="xyz"))
    assert set(loss.terms) == {"euler", "penalty"}
    expected = 2 * loss.terms["euler"] + 0.01 * loss.terms["penalty"]
    torch.testing.assert_close(loss.total, expected)
    assert loss.terms["euler"] != LOSSES["euler"](comparison)  # in the other order of angles


@pytest.mark.parametrize(
    ("terms", "said"),
    [
        ({"eular": 1.0}, "unknown loss 'eular'; did you mean 'euler'"),
        ({}, "needs a term"),
        ({"euler": 0.0}, "weight 0.0"),
    ],
)
def test_a_wrong_objective_says_what_is_wrong(terms, said):
    with pytest.raises(ConfigError, match=said):
        Objective(terms)


def test_an_objective_refuses_root_channels_that_nothing_would_train(tiny):
    moving = Codec(tiny.SKELETON, Quaternion(), root="displacement")
    held = Codec(tiny.SKELETON, Quaternion())
    with pytest.raises(ConfigError, match=r"add root: 1\.0"):
        Objective({"euler": 1.0}).check(moving)
    with pytest.raises(ConfigError, match="leave the loss out"):
        Objective({"euler": 1.0, "root": 1.0}).check(held)
    Objective({"euler": 1.0, "root": 1.0}).check(moving)
    Objective({"euler": 1.0}).check(held)
