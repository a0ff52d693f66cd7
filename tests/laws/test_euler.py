"""Euler angles: twelve orders against SciPy, gimbal lock, gradients, and the H3.6M triple."""

from __future__ import annotations

import itertools
import math

import pytest
import torch
from scipy.spatial.transform import Rotation
from torch import Tensor

from posecast.errors import ConfigError
from posecast.geometry import euler, quaternion
from posecast.geometry.euler import ORDERS, euler_to_quaternion, h36m_euler, quaternion_to_euler

PI = math.pi
PROPER = [order for order in ORDERS if order[0] == order[2]]


def to_scipy(q: Tensor) -> Rotation:
    return Rotation.from_quat(q.numpy()[..., [1, 2, 3, 0]])


def random_rotations(count: int, generator: torch.Generator) -> Tensor:
    return quaternion.normalize(torch.randn(count, 4, dtype=torch.float64, generator=generator))


def poles(order: str) -> tuple[float, float]:
    """The middle angles of gimbal lock."""
    return (0.0, PI) if order in PROPER else (-PI / 2, PI / 2)


def near_lock(order: str) -> Tensor:
    """Angles on and around both poles: the middle one a little inside, the others all around."""
    low, high = poles(order)
    distances = [0.0, 1e-16, 1e-12, 1e-9, 1e-7, 1e-5, 1e-3]
    middles = [low + d for d in distances] + [high - d for d in distances]
    outer = [-3.0, -1.2, 0.0, 0.5, 2.5]
    return torch.tensor(
        [[a, b, c] for a, b, c in itertools.product(outer, middles, outer)], dtype=torch.float64
    )


def test_there_are_twelve_orders():
    assert len(set(ORDERS)) == 12
    assert len(PROPER) == 6
    assert {len(order) for order in ORDERS} == {3}


@pytest.mark.parametrize("order", ORDERS)
def test_angles_are_those_of_scipys_intrinsic_rotations(order, generator):
    q = random_rotations(500, generator)
    expected = torch.from_numpy(to_scipy(q).as_euler(order.upper()))
    torch.testing.assert_close(quaternion_to_euler(q, order), expected, atol=1e-12, rtol=0)


@pytest.mark.parametrize("order", ORDERS)
def test_rotations_are_those_of_scipys_intrinsic_angles(order, generator):
    angles = 3 * torch.randn(500, 3, dtype=torch.float64, generator=generator)
    expected = Rotation.from_euler(order.upper(), angles.numpy())
    ours = to_scipy(euler_to_quaternion(angles, order))
    assert (ours * expected.inv()).magnitude().max() < 1e-14


def test_zyx_means_z_then_y_then_x_of_a_frame_that_turns_along():
    angles = torch.tensor([0.3, -0.4, 0.9], dtype=torch.float64)
    axes = torch.eye(3, dtype=torch.float64)
    about_z, about_y, about_x = (
        quaternion.exp(angle * axes[k]) for angle, k in zip(angles, (2, 1, 0), strict=True)
    )
    expected = quaternion.product(quaternion.product(about_z, about_y), about_x)
    torch.testing.assert_close(euler_to_quaternion(angles, "zyx"), expected)


@pytest.mark.parametrize("order", ORDERS)
def test_angles_inside_their_ranges_come_back_as_they_were(order, generator):
    angles = torch.rand(500, 3, dtype=torch.float64, generator=generator)
    low, high = poles(order)
    angles[:, 0] = (angles[:, 0] - 0.5) * 6.2
    angles[:, 1] = low + 0.01 + angles[:, 1] * (high - low - 0.02)
    angles[:, 2] = (angles[:, 2] - 0.5) * 6.2
    back = quaternion_to_euler(euler_to_quaternion(angles, order), order)
    torch.testing.assert_close(back, angles, atol=1e-12, rtol=0)


@pytest.mark.parametrize("order", ORDERS)
def test_at_and_around_gimbal_lock_the_angles_still_compose_to_the_rotation(order):
    angles = near_lock(order)
    assert len(angles) == 350
    q = euler_to_quaternion(angles, order)
    back = euler_to_quaternion(quaternion_to_euler(q, order), order)
    assert quaternion.angle(q, back).max() < 1e-14


@pytest.mark.parametrize("order", ORDERS)
def test_at_gimbal_lock_the_last_angle_is_zero(order):
    angles = torch.tensor([[0.7, pole, -1.1] for pole in poles(order)], dtype=torch.float64)
    q = euler_to_quaternion(angles, order)
    found = quaternion_to_euler(torch.cat([q, -q]), order)
    assert found[:, 2].abs().max() < 1e-15


@pytest.mark.parametrize("order", ORDERS)
def test_angles_do_not_depend_on_the_sign_of_the_quaternion(order, generator):
    q = torch.cat([random_rotations(100, generator), euler_to_quaternion(near_lock(order), order)])
    turned = quaternion_to_euler(q, order) - quaternion_to_euler(-q, order)
    whole_turns = 2 * PI * torch.round(turned / (2 * PI))
    torch.testing.assert_close(turned, whole_turns, atol=1e-12, rtol=0)


@pytest.mark.parametrize("order", ORDERS)
def test_angles_stay_in_their_ranges(order, generator):
    q = torch.cat([random_rotations(1000, generator), euler_to_quaternion(near_lock(order), order)])
    angles = quaternion_to_euler(q, order)
    low, high = poles(order)
    slack = 1e-12
    assert angles.abs().max() <= PI + slack
    assert angles[:, 1].min() >= low - slack
    assert angles[:, 1].max() <= high + slack


@pytest.mark.parametrize("margin", [0.0, 1e-6])
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("order", ORDERS)
def test_gradients_are_finite_at_gimbal_lock_identity_and_half_turn(order, dtype, margin):
    half_turns = torch.eye(4, dtype=torch.float64)
    q = torch.cat([euler_to_quaternion(near_lock(order), order), half_turns, -half_turns])
    root = math.sqrt(0.5)
    exact = torch.tensor([[root, 0, root, 0], [0.5, 0.5, 0.5, 0.5], [0.5, -0.5, 0.5, 0.5]])
    q = torch.cat([q, exact.double()]).to(dtype).requires_grad_()
    angles = quaternion_to_euler(q, order, margin=margin)
    assert angles.isfinite().all()
    angles.sum().backward()
    assert q.grad.isfinite().all()
    if margin:
        assert q.grad.abs().max() <= 4 * math.sqrt(2 / margin)


@pytest.mark.parametrize("order", ORDERS)
def test_the_margin_changes_no_angle_outside_its_cap(order, generator):
    q = random_rotations(500, generator)
    torch.testing.assert_close(
        quaternion_to_euler(q, order, margin=1e-6), quaternion_to_euler(q, order), atol=0, rtol=0
    )


def test_the_margin_keeps_the_sine_of_the_middle_angle_below_one():
    angles = torch.tensor([[0.4, PI / 2, 0.0], [0.4, -PI / 2, 0.0]], dtype=torch.float64)
    margin = 1e-4
    middle = quaternion_to_euler(euler_to_quaternion(angles), margin=margin)[:, 1]
    expected = torch.tensor([1 - margin, margin - 1], dtype=torch.float64)
    torch.testing.assert_close(middle.sin(), expected, atol=1e-8, rtol=0)


@pytest.mark.parametrize("order", ORDERS)
def test_gradients_agree_with_finite_differences(order, generator):
    angles = torch.randn(8, 3, dtype=torch.float64, generator=generator).requires_grad_()
    assert torch.autograd.gradcheck(lambda x: euler_to_quaternion(x, order), (angles,))
    q = torch.randn(8, 4, dtype=torch.float64, generator=generator).requires_grad_()
    to_angles = lambda x: quaternion_to_euler(quaternion.normalize(x), order)  # noqa: E731
    assert torch.autograd.gradcheck(to_angles, (q,))


@pytest.mark.parametrize("order", ["zyy", "ZYX", "xy", "", "yyx"])
def test_an_unknown_order_is_refused_with_the_list_of_orders(order):
    with pytest.raises(ConfigError, match="expected one of xyz"):
        quaternion_to_euler(torch.ones(4), order)
    with pytest.raises(ConfigError, match="expected one of xyz"):
        euler_to_quaternion(torch.ones(3), order)


def test_batch_axes_may_be_empty_or_many(generator):
    assert quaternion_to_euler(torch.zeros(0, 5, 4)).shape == (0, 5, 3)
    q = random_rotations(24, generator).reshape(2, 3, 4, 4)
    flat = quaternion_to_euler(q.reshape(24, 4))
    torch.testing.assert_close(quaternion_to_euler(q), flat.reshape(2, 3, 4, 3))


def matrix_of(r: Tensor) -> Tensor:
    return torch.from_numpy(Rotation.from_rotvec(r.numpy()).as_matrix())


@pytest.fixture
def exponential_maps(generator) -> Tensor:
    """Random vectors of all lengths up to beyond a full turn."""
    directions = torch.randn(1000, 3, dtype=torch.float64, generator=generator)
    directions = directions / directions.norm(dim=-1, keepdim=True)
    return directions * torch.linspace(1e-3, 7, 1000, dtype=torch.float64)[:, None]


def away_from_lock(r: Tensor) -> Tensor:
    chosen = matrix_of(r)[:, 0, 2].abs() < 0.999
    assert chosen.sum() > 900
    return r[chosen]


def wrapped(difference: Tensor) -> Tensor:
    return (difference - 2 * PI * torch.round(difference / (2 * PI))).abs()


def test_the_h36m_triple_is_zyx_of_the_negated_vector_reversed(exponential_maps):
    r = away_from_lock(exponential_maps)
    expected = quaternion_to_euler(quaternion.exp(-r), "zyx").flip(-1)
    # the original adds 1.2e-7 to the angle: relative at the shortest vector, over cos E2 at lock
    assert wrapped(h36m_euler(r) - expected).max() < 2e-5
    long = r[r.norm(dim=-1) > 0.5]
    assert (
        wrapped(h36m_euler(long) - quaternion_to_euler(quaternion.exp(-long)).flip(-1)).median()
        < 1e-7
    )


def test_the_h36m_triple_is_minus_xyz_of_the_vector(exponential_maps):
    r = away_from_lock(exponential_maps)
    assert wrapped(h36m_euler(r) + quaternion_to_euler(quaternion.exp(r), "xyz")).max() < 2e-5


def test_the_h36m_triple_is_read_off_the_matrix_as_published(exponential_maps, monkeypatch):
    monkeypatch.setattr(euler, "_LEGACY_EPS", 0.0)
    r = away_from_lock(exponential_maps)
    matrix = matrix_of(r)
    e2 = -torch.asin(matrix[:, 0, 2])
    cosine = torch.cos(e2)
    e1 = torch.atan2(matrix[:, 1, 2] / cosine, matrix[:, 2, 2] / cosine)
    e3 = torch.atan2(matrix[:, 0, 1] / cosine, matrix[:, 0, 0] / cosine)
    assert wrapped(h36m_euler(r) - torch.stack([e1, e2, e3], dim=-1)).max() < 1e-11


def test_the_h36m_triple_of_the_zero_vector_is_zero():
    zero = torch.zeros(2, 3, dtype=torch.float64)
    torch.testing.assert_close(h36m_euler(zero), zero, atol=0, rtol=0)


def test_the_h36m_triple_of_a_quarter_turn_about_y_is_the_locked_one(monkeypatch):
    monkeypatch.setattr(euler, "_LEGACY_EPS", 0.0)
    r = torch.tensor([[0.0, PI / 2, 0.0], [0.0, -PI / 2, 0.0]], dtype=torch.float64)
    expected = torch.tensor([[0.0, -PI / 2, 0.0], [PI, PI / 2, 0.0]], dtype=torch.float64)
    found = h36m_euler(r)
    torch.testing.assert_close(found[:, 1:], expected[:, 1:], atol=1e-7, rtol=0)
    assert wrapped(2 * found[:, 0]).max() < 1e-12
