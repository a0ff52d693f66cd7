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
from posecast.motion import Motion
from posecast.representation import REPRESENTATIONS, Codec, build_representation
from posecast.representation.rotations import Quaternion
from posecast.skeleton import Skeleton
from posecast.training.comparison import Comparison
from posecast.training.losses import (
    LOSSES,
    euler_l1,
    position,
    quaternion_dot,
    root_l1,
)
from posecast.training.objective import Objective

SKELETON = Skeleton(("hips", "spine"), (-1, 0))

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
    drawn = torch.randn(2, 3, joints, 4, dtype=torch.float64, generator=generator)
    return Comparison(
        codec=codec,
        predicted=features[0].requires_grad_(),
        raw=drawn.requires_grad_(),
        emitted=features[0].detach().clone().requires_grad_(),
        target=features[1],
        last=features[1][:, 0],
        offsets=tiny.OFFSETS.double().expand(2, -1, -1),
    )


def compared(kind, tiny, generator, frames=3):
    """Random windows in any representation; prediction and truth differ, bones stretch."""
    codec = Codec(tiny.SKELETON, build_representation(kind, tiny.SKELETON), root="displacement")
    joints, bodies = len(tiny.SKELETON), tiny.OFFSETS.double().expand(2, -1, -1)
    true = codec.encode(
        Motion(
            rotations(generator, 2, frames, joints),
            torch.randn(2, frames, 3, dtype=torch.float64, generator=generator),
            bodies,
        )
    )
    shape = (2, frames, joints, codec.representation.joint_dim)
    raw = torch.randn(shape, dtype=torch.float64, generator=generator).requires_grad_()
    root = torch.randn(2, frames, 3, dtype=torch.float64, generator=generator).requires_grad_()
    return Comparison(
        codec=codec,
        predicted=codec.merge(codec.representation.project(raw), root),
        raw=raw,
        emitted=codec.merge(raw, root),
        target=true,
        last=true[:, 0],
        offsets=bodies,
    )


def fitting(name):
    """Representations that state what a loss needs."""
    made = {kind: build_representation(kind, SKELETON) for kind in REPRESENTATIONS}
    return [kind for kind, each in made.items() if LOSSES[name].needs <= each.states]


ELSEWHERE = ("action", "displacement")
PAIRS = [(name, kind) for name in LOSSES if name not in ELSEWHERE for kind in fitting(name)]


def test_every_loss_is_used_with_every_representation_that_has_what_it_needs():
    assert {name: len(fitting(name)) for name in LOSSES} == {
        "features": 11,
        "per_joint": 11,
        "geodesic": 10,
        "euler": 10,
        "quaternion": 10,
        "quaternion_root": 10,
        "penalty": 8,
        "position": 11,
        "position_fk": 10,
        "offset": 6,
        "bone_length": 6,
        "velocity": 11,
        "root": 11,
        "displacement": 11,
        "action": 11,
    }


@pytest.mark.parametrize(("name", "kind"), PAIRS)
def test_a_loss_is_zero_when_everything_is_right(name, kind, tiny, generator):
    wrong = compared(kind, tiny, generator)
    raw = wrong.codec.split(wrong.target).joints
    right = replace(wrong, predicted=wrong.target, emitted=wrong.target, raw=raw)
    assert LOSSES[name](right).item() == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize(("name", "kind"), PAIRS)
def test_a_loss_is_positive_and_keeps_its_gradient_when_something_is_wrong(
    name, kind, tiny, generator
):
    wrong = compared(kind, tiny, generator)
    raw = wrong.raw
    loss = LOSSES[name](wrong)
    assert loss > 0.05
    roots = wrong.emitted if name == "root" else raw
    if name == "root":
        wrong.emitted.retain_grad()
        assert loss.requires_grad
        return
    loss.backward()
    assert roots.grad.isfinite().all()
    assert roots.grad.abs().max() > 1e-4


@pytest.mark.parametrize(
    ("name", "kind"),
    [pair for pair in PAIRS if pair[0] not in ("features", "per_joint", "penalty", "root")],
)
def test_gradients_are_finite_where_a_network_puts_out_nothing(name, kind, tiny, generator):
    wrong = compared(kind, tiny, generator)
    raw = torch.zeros_like(wrong.raw).requires_grad_()
    root = wrong.codec.split(wrong.target).root
    valid = wrong.codec.merge(wrong.codec.representation.project(raw), root)
    loss = LOSSES[name](replace(wrong, predicted=valid))
    loss.backward()
    assert loss.isfinite()
    assert raw.grad.isfinite().all()


def test_the_error_of_features_is_standardized_and_looks_at_what_was_not_projected(tiny, generator):
    wrong = compared("quaternion", tiny, generator)
    scale = torch.rand(23, dtype=torch.float64, generator=generator) + 0.5
    expected = (((wrong.emitted - wrong.target) / scale) ** 2).mean()
    torch.testing.assert_close(LOSSES["features"](replace(wrong, scale=scale)), expected)


def test_bones_that_are_a_centimeter_too_long_cost_a_centimeter(tiny, generator):
    wrong = compared("quaternion+offsets", tiny, generator)
    joints, root, _ = wrong.codec.split(wrong.target)
    directions = joints[..., 4:] / joints[..., 4:].norm(dim=-1, keepdim=True).clamp_min(1e-9)
    longer = torch.cat([joints[..., :4], joints[..., 4:] + 0.01 * directions], dim=-1)
    stretched = replace(wrong, predicted=wrong.codec.merge(longer, root))
    # Four of the five joints have a bone; the root has none.
    assert LOSSES["bone_length"](stretched).item() == pytest.approx(0.01 * 4 / 5)
    assert LOSSES["offset"](stretched).item() == pytest.approx(0.01 * 4 / 5)


def test_the_velocity_loss_begins_with_the_last_frame_that_was_given(tiny, generator):
    wrong = compared("positions", tiny, generator, frames=1)
    joints = wrong.codec.split(wrong.predicted).joints
    truth, last = (wrong.codec.split(each).joints for each in (wrong.target, wrong.last[:, None]))
    expected = ((joints - last) - (truth - last)).norm(dim=-1).mean()
    assert LOSSES["velocity"](wrong).item() == pytest.approx(expected.item())


def test_rotations_without_signs_are_compared_on_one_side(tiny, generator):
    right = compared("ortho6d", tiny, generator)
    # Just short of the half turn and just past it: one is given back with the other sign.
    short, beyond = (
        right.codec.representation.encode(
            quaternion.exp(torch.tensor([angle, 0, 0]).double()).expand(2, 3, 5, 4),
            tiny.OFFSETS.double(),
        )
        for angle in (math.pi - 0.01, math.pi + 0.01)
    )
    root = right.codec.split(right.target).root
    near = replace(
        right,
        predicted=right.codec.merge(short, root),
        target=right.codec.merge(beyond, root),
    )
    # Half the angle between them is what the dot product sees.
    assert LOSSES["quaternion"](near).item() == pytest.approx(1 - math.cos(0.01), abs=1e-9)


@pytest.mark.parametrize(
    ("name", "kind", "said"),
    [
        ("euler", "positions", "needs rotations, which representation 'positions' does not have"),
        ("offset", "quaternion", "dual_quaternion, quaternion.positions, ortho6d.positions, quat"),
        ("penalty", "euler", "choose a representation among: matrix, quaternion, ortho6d, dual"),
    ],
)
def test_a_loss_without_what_it_needs_is_refused_with_what_would_fit(name, kind, said, tiny):
    codec = Codec(tiny.SKELETON, build_representation(kind, tiny.SKELETON))
    with pytest.raises(ConfigError, match=said):
        Objective({name: 1.0}).check(codec)


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
    joints, root, _ = codec.split(comparison.predicted)
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


def test_the_error_per_joint_is_a_sum_of_lengths_of_standardized_features(comparison):
    codec = comparison.codec
    scale = torch.full((codec.feature_dim,), 2.0, dtype=torch.float64)
    wrong = codec.split(comparison.target).joints.clone()
    wrong[..., 0, :] += 1.0  # 2 long, 1 of them after division by the scale
    wrong[..., 1, 0] += 3.0
    root = codec.split(comparison.target).root + 7.0
    emitted = codec.merge(wrong, root)
    found = LOSSES["per_joint"](replace(comparison, emitted=emitted, scale=scale))
    assert found.item() == pytest.approx(1 + 1.5)


def test_the_geodesic_loss_is_the_mean_angle_whatever_the_signs(comparison):
    codec = comparison.codec
    true = codec.split(comparison.target).joints
    turn = quaternion.exp(torch.tensor([0.2, 0.0, 0.0], dtype=torch.float64))
    turned = torch.cat([-quaternion.product(turn, true[..., :1, :]), true[..., 1:, :]], dim=-2)
    wrong = replace(comparison, predicted=codec.merge(turned, codec.split(comparison.target).root))
    assert LOSSES["geodesic"](wrong).item() == pytest.approx(0.2 / true.shape[-2])


def test_the_root_loss_is_in_meters():
    assert root_l1(torch.tensor([[1.0, 2, 3]]), torch.tensor([[1.0, 2.5, 2]])).item() == 0.5


def test_the_action_loss_is_the_mean_square_of_the_numbers_that_stand_for_actions(comparison):
    told = replace(comparison.codec, actions=("walk", "sit"))
    target = torch.cat([comparison.target, torch.tensor([0.0, 1]).expand(2, 3, 2)], dim=-1)
    emitted = torch.cat([comparison.emitted, torch.tensor([0.5, 0.9]).expand(2, 3, 2)], dim=-1)
    wrong = replace(
        comparison,
        codec=told,
        target=target,
        emitted=emitted,
        predicted=emitted,
        last=target[:, 0],
    )
    assert LOSSES["action"](wrong).item() == pytest.approx((0.25 + 0.01) / 2)
    # The others do not see them, but for the error of all features.
    for name in ("euler", "position", "root", "per_joint", "velocity"):
        assert LOSSES[name](wrong).item() == pytest.approx(LOSSES[name](comparison).item())
    whole = (23 * LOSSES["features"](comparison) + 0.26) / 25
    assert LOSSES["features"](wrong).item() == pytest.approx(whole.item())


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


def test_an_order_that_no_loss_measures_in_is_refused():
    with pytest.raises(ConfigError, match="order 'xyz' changes nothing without the loss 'euler'"):
        Objective({"features": 1.0}, order="xyz")
    assert Objective({"euler": 1.0}, order="xyz").order == "xyz"


def along_a_path(tiny, kind="quaternion", shift=(0.0, 0.0, 0.0)):
    """Two standing frames, predicted with the root shifted: ahead, up, to the left."""
    codec = Codec(tiny.SKELETON, build_representation(kind, tiny.SKELETON), root="path_lateral")
    bodies = tiny.OFFSETS.double()[None]
    still = quaternion.identity(1, 2, 5, like=bodies)
    joints = codec.representation.encode(still, bodies[:, None])
    true = codec.merge(joints, torch.zeros(1, 2, 3).double())
    found = codec.merge(joints, torch.tensor(shift).double().expand(1, 2, 3)).requires_grad_()
    return Comparison(codec, found, joints, found, true, true[:, 0], bodies)


@pytest.mark.parametrize("kind", REPRESENTATIONS)
def test_along_a_path_the_height_counts_for_every_joint_and_the_floor_once(kind, tiny):
    shifted = along_a_path(tiny, kind, (0.3, 0.02, -0.4))
    assert LOSSES["position"](shifted).item() == pytest.approx(0.02, rel=1e-6)
    assert LOSSES["displacement"](shifted).item() == pytest.approx(0.5)
    still = along_a_path(tiny, kind)
    loss = LOSSES["position"](still) + LOSSES["displacement"](still)
    loss.backward()
    assert loss.item() == pytest.approx(0, abs=1e-9)
    assert still.predicted.grad.isfinite().all()


def test_an_objective_trains_all_of_a_root_along_a_path_or_refuses(tiny):
    path = Codec(tiny.SKELETON, Quaternion(), root="path")
    Objective({"position": 1.0, "displacement": 1.0}).check(path)
    Objective({"euler": 1.0, "root": 1.0}).check(path)
    with pytest.raises(ConfigError, match="leaves the height of the root untrained"):
        Objective({"euler": 1.0, "displacement": 1.0}).check(path)
    with pytest.raises(ConfigError, match="2 root channels that no loss trains"):
        Objective({"position": 1.0}).check(path)
    with pytest.raises(ConfigError, match="needs a root that follows a path"):
        Objective({"position": 1.0, "root": 1.0, "displacement": 1.0}).check(
            replace(path, root="displacement")
        )


def test_an_objective_refuses_actions_that_nothing_would_train(tiny):
    told = Codec(tiny.SKELETON, Quaternion(), actions=("walk", "sit"))
    with pytest.raises(ConfigError, match=r"add action: 1\.0 \(or features\)"):
        Objective({"euler": 1.0}).check(told)
    with pytest.raises(ConfigError, match=r"list them in codec\.actions"):
        Objective({"euler": 1.0, "action": 1.0}).check(replace(told, actions=()))
    Objective({"euler": 1.0, "action": 1.0}).check(told)
    Objective({"features": 1.0}).check(told)


def test_an_objective_refuses_root_channels_that_nothing_would_train(tiny):
    moving = Codec(tiny.SKELETON, Quaternion(), root="displacement")
    held = Codec(tiny.SKELETON, Quaternion())
    with pytest.raises(ConfigError, match=r"add root: 1\.0"):
        Objective({"euler": 1.0}).check(moving)
    with pytest.raises(ConfigError, match="leave the loss out"):
        Objective({"euler": 1.0, "root": 1.0}).check(held)
    Objective({"euler": 1.0, "root": 1.0}).check(moving)
    Objective({"euler": 1.0}).check(held)
