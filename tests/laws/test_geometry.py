"""Quaternion laws in float64, against SciPy and RoMa, at the identity, half turns and ``-q``."""

from __future__ import annotations

import math

import numpy as np
import pytest
import roma
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation, Slerp
from torch import Tensor

from posecast.geometry import quaternion

PI = math.pi


def hard_rotations() -> Tensor:
    """Rotations (N, 4) where formulas go wrong, each with both signs."""
    axes = torch.tensor(
        [[1.0, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1], [-3, 0.2, 1], [0, -1, 1]],
        dtype=torch.float64,
    )
    axes = axes / axes.norm(dim=-1, keepdim=True)
    angles = [0.0, 1e-300, 1e-12, 1e-8, 1e-5, 1e-3, 0.1, PI / 2, 2.0, 3.0]
    angles += [PI - 1e-3, PI - 1e-8, PI - 1e-12, PI, PI + 1e-9]
    half = torch.tensor(angles, dtype=torch.float64)[:, None, None] / 2
    turned = torch.cat([half.cos().expand(-1, len(axes), 1), half.sin() * axes], dim=-1)
    turned = turned.reshape(-1, 4)
    return torch.cat([turned, -turned])


def random_rotations(count: int, generator: torch.Generator) -> Tensor:
    q = torch.randn(count, 4, dtype=torch.float64, generator=generator)
    return q / q.norm(dim=-1, keepdim=True)


@pytest.fixture
def rotations(generator) -> Tensor:
    found = torch.cat([hard_rotations(), random_rotations(200, generator)])
    assert found.shape == (380, 4)
    return found


def to_scipy(q: Tensor) -> Rotation:
    return Rotation.from_quat(q.numpy()[..., [1, 2, 3, 0]])


def xyzw(q: Tensor) -> Tensor:
    return torch.roll(q, -1, dims=-1)


def same_rotation(a: Tensor, b: Tensor, tolerance: float = 1e-14) -> None:
    sign = torch.where((a * b).sum(-1, keepdim=True) < 0, -1.0, 1.0)
    torch.testing.assert_close(a, sign * b, atol=tolerance, rtol=0)


def test_the_product_is_that_of_scipy_and_roma(rotations, generator):
    other = rotations[torch.randperm(len(rotations), generator=generator)]
    ours = quaternion.product(rotations, other)
    same_rotation(ours, torch.roll(roma.quat_product(xyzw(rotations), xyzw(other)), 1, -1))
    scipy = torch.from_numpy((to_scipy(rotations) * to_scipy(other)).as_quat())
    same_rotation(ours, torch.roll(scipy, 1, -1))


def test_rotations_form_a_group(rotations, generator):
    a = rotations
    b, c = (a[torch.randperm(len(a), generator=generator)] for _ in range(2))
    one = quaternion.identity(len(a), like=a)
    product = quaternion.product
    torch.testing.assert_close(product(product(a, b), c), product(a, product(b, c)))
    torch.testing.assert_close(product(a, one), a, atol=0, rtol=0)
    torch.testing.assert_close(product(one, a), a, atol=0, rtol=0)
    torch.testing.assert_close(product(a, quaternion.inverse(a)), one)
    torch.testing.assert_close(
        quaternion.conjugate(product(a, b)),
        product(quaternion.conjugate(b), quaternion.conjugate(a)),
    )


def test_the_inverse_undoes_a_product_with_any_length(generator):
    q = 7 * torch.randn(50, 4, dtype=torch.float64, generator=generator)
    torch.testing.assert_close(
        quaternion.product(quaternion.inverse(q), q), quaternion.identity(50, like=q)
    )


def test_rotating_is_that_of_scipy_and_follows_the_product(rotations, generator):
    v = torch.randn(len(rotations), 3, dtype=torch.float64, generator=generator)
    ours = quaternion.rotate(rotations, v)
    torch.testing.assert_close(ours, torch.from_numpy(to_scipy(rotations).apply(v.numpy())))
    torch.testing.assert_close(ours, quaternion.rotate(-rotations, v))
    other = rotations.flip(0)
    torch.testing.assert_close(
        quaternion.rotate(quaternion.product(rotations, other), v),
        quaternion.rotate(rotations, quaternion.rotate(other, v)),
    )


def test_a_quarter_turn_about_y_brings_z_to_x():
    q = quaternion.about_axis(
        torch.tensor([0.0, 2.0, 0.0], dtype=torch.float64),
        torch.tensor(PI / 2, dtype=torch.float64),
    )
    z = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64)
    torch.testing.assert_close(
        quaternion.rotate(q, z), torch.tensor([1.0, 0.0, 0.0], dtype=torch.float64)
    )


def test_turning_about_an_axis_is_the_exponential_of_axis_times_angle(generator):
    axis = torch.randn(40, 3, dtype=torch.float64, generator=generator)
    angle = 4 * torch.randn(40, dtype=torch.float64, generator=generator)
    unit = axis / axis.norm(dim=-1, keepdim=True)
    torch.testing.assert_close(
        quaternion.about_axis(axis, angle), quaternion.exp(unit * angle[:, None])
    )
    nothing = quaternion.about_axis(torch.zeros(40, 3, dtype=torch.float64), angle)
    torch.testing.assert_close(nothing, quaternion.identity(40, like=axis), atol=0, rtol=0)


def test_log_is_that_of_scipy_and_is_undone_by_exp(rotations):
    ours = quaternion.log(rotations)
    torch.testing.assert_close(
        ours.norm(dim=-1), torch.from_numpy(to_scipy(rotations).magnitude()), atol=1e-15, rtol=1e-14
    )
    away = ours.norm(dim=-1) < PI - 1e-10
    assert away.sum() > 250
    torch.testing.assert_close(
        ours[away],
        torch.from_numpy(to_scipy(rotations[away]).as_rotvec()),
        atol=1e-15,
        rtol=1e-12,
    )
    same_rotation(quaternion.exp(ours), rotations)


def test_log_gives_q_and_minus_q_one_vector_at_most_pi_long(rotations):
    vectors = quaternion.log(rotations)
    assert vectors.norm(dim=-1).max() <= PI + 1e-12
    away = vectors.norm(dim=-1) < PI - 1e-10
    torch.testing.assert_close(vectors[away], quaternion.log(-rotations)[away], atol=0, rtol=0)


@given(
    vector=st.tuples(*[st.floats(-20, 20)] * 3),
    exponent=st.integers(-150, 0),
)
@settings(max_examples=300, deadline=None)
def test_exp_is_that_of_scipy_for_vectors_of_every_size(vector, exponent):
    r = np.array(vector) * 2.0**exponent
    q = quaternion.exp(torch.from_numpy(r))
    assert abs(q.norm().item() - 1) < 1e-15 * 4
    same_rotation(q, torch.roll(torch.from_numpy(Rotation.from_rotvec(r).as_quat()), 1, -1))


def test_the_angle_is_that_of_scipy_and_blind_to_signs(rotations, generator):
    other = rotations[torch.randperm(len(rotations), generator=generator)]
    ours = quaternion.angle(rotations, other)
    truth = (to_scipy(rotations).inv() * to_scipy(other)).magnitude()
    torch.testing.assert_close(ours, torch.from_numpy(truth), atol=1e-14, rtol=1e-12)
    torch.testing.assert_close(quaternion.angle(-rotations, other), ours)
    torch.testing.assert_close(quaternion.angle(other, rotations), ours)


def test_a_tiny_angle_is_measured_to_all_its_digits_in_float32():
    tiny = torch.tensor([1e-6, 0.0, 0.0])
    one = quaternion.identity(like=tiny)
    torch.testing.assert_close(
        quaternion.angle(one, quaternion.exp(tiny)), torch.tensor(1e-6), rtol=1e-6, atol=0
    )


@pytest.mark.parametrize("fraction", [0.0, 0.25, 0.5, 1.0])
def test_slerp_is_that_of_scipy_and_goes_the_short_way(generator, fraction):
    a, b = random_rotations(30, generator), random_rotations(30, generator)
    ours = quaternion.slerp(a, b, fraction)
    for k in range(30):
        pair = Rotation.concatenate([to_scipy(a[k]), to_scipy(b[k])])
        truth = torch.from_numpy(Slerp([0, 1], pair)(fraction).as_quat())
        same_rotation(ours[k], torch.roll(truth, 1, -1), 1e-13)
    same_rotation(quaternion.slerp(a, -b, fraction), ours, 1e-13)


def test_slerp_starts_with_the_sign_of_its_start_and_turns_steadily(generator):
    a, b = random_rotations(20, generator)[:, None], random_rotations(20, generator)[:, None]
    fractions = torch.linspace(0, 1, 9, dtype=torch.float64)
    path = quaternion.slerp(a, b, fractions)
    assert path.shape == (20, 9, 4)
    torch.testing.assert_close(path[:, 0], a[:, 0])
    steps = quaternion.angle(path[:, 1:], path[:, :-1])
    torch.testing.assert_close(steps, (quaternion.angle(a, b) / 8).expand(-1, 8))
    assert ((path[:, 1:] * path[:, :-1]).sum(-1) > 0).all()


def test_slerp_between_equal_rotations_stays_there(rotations):
    torch.testing.assert_close(quaternion.slerp(rotations, rotations, 0.3), rotations)
    same_rotation(quaternion.slerp(rotations, -rotations, 0.3), rotations)


def test_a_power_turns_by_a_multiple_of_the_angle(generator):
    q = random_rotations(30, generator)
    same_rotation(quaternion.power(q, 2.0), quaternion.product(q, q), 1e-13)
    same_rotation(quaternion.power(q, -1.0), quaternion.conjugate(q), 1e-13)
    half = quaternion.power(q, 0.5)
    same_rotation(quaternion.product(half, half), q, 1e-13)


def flip_at_random(rotations: Tensor, generator: torch.Generator) -> Tensor:
    signs = torch.randint(0, 2, rotations.shape[:-1], generator=generator) * 2 - 1
    return rotations * signs[..., None]


@pytest.mark.parametrize("dim", [-3, 0, 1])
def test_unrolling_restores_signs_that_were_flipped_at_random(generator, dim):
    steps = 0.3 * torch.randn(2, 50, 3, 3, dtype=torch.float64, generator=generator)
    smooth = quaternion.exp(torch.cumsum(steps, dim=1) / 3)
    frames = {-3: 1, 0: 0, 1: 1}[dim]
    smooth = smooth.transpose(0, 1) if frames == 0 else smooth
    flipped = flip_at_random(smooth, generator)
    assert ((flipped * smooth).sum(-1) < 0).any()
    unrolled = quaternion.unroll(flipped, dim=dim)
    agreement = (unrolled.narrow(frames, 1, 49) * unrolled.narrow(frames, 0, 49)).sum(-1)
    assert (agreement >= 0).all()
    first = flipped.narrow(frames, 0, 1)
    torch.testing.assert_close(unrolled.narrow(frames, 0, 1), first, atol=0, rtol=0)
    same_rotation(unrolled, smooth, 0)


def test_unrolling_agrees_with_a_loop_over_frames(generator):
    q = random_rotations(60 * 4, generator).reshape(60, 4, 4)
    expected = [q[0]]
    for frame in q[1:]:
        flip = (frame * expected[-1]).sum(-1, keepdim=True) < 0
        expected.append(torch.where(flip, -frame, frame))
    torch.testing.assert_close(quaternion.unroll(q), torch.stack(expected), atol=0, rtol=0)


@pytest.mark.parametrize("frames", [0, 1])
def test_unrolling_fewer_than_two_frames_changes_nothing(frames):
    q = torch.full((frames, 2, 4), -0.5)
    torch.testing.assert_close(quaternion.unroll(q), q, atol=0, rtol=0)


def test_the_shortest_arc_brings_one_direction_onto_the_other(generator):
    a, b = (torch.randn(100, 3, dtype=torch.float64, generator=generator) for _ in range(2))
    q = quaternion.between(a, b)
    torch.testing.assert_close(
        quaternion.rotate(q, a / a.norm(dim=-1, keepdim=True)), b / b.norm(dim=-1, keepdim=True)
    )
    cosine = torch.nn.functional.cosine_similarity(a, b, dim=-1)
    turned = quaternion.angle(q, quaternion.identity(100, like=q))
    torch.testing.assert_close(turned, torch.acos(cosine))


@pytest.mark.parametrize("tilt", [0.0, 1e-12, 1e-7, 1e-4])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_shortest_arc_is_exact_for_parallel_and_opposite_directions(generator, tilt, sign):
    a = torch.randn(60, 3, dtype=torch.float64, generator=generator)
    a[:3] = torch.eye(3, dtype=torch.float64)
    aside = torch.linalg.cross(a, a.roll(1, -1))
    b = sign * (a + tilt * aside / aside.norm(dim=-1, keepdim=True) * a.norm(dim=-1, keepdim=True))
    q = quaternion.between(2 * a, b)
    torch.testing.assert_close(q.norm(dim=-1), torch.ones(60, dtype=torch.float64))
    torch.testing.assert_close(
        quaternion.rotate(q, a / a.norm(dim=-1, keepdim=True)),
        b / b.norm(dim=-1, keepdim=True),
        atol=1e-13,
        rtol=0,
    )


def test_a_vector_without_direction_turns_nothing():
    zero, x = torch.zeros(3), torch.tensor([1.0, 0.0, 0.0])
    for pair in ((zero, x), (x, zero), (zero, zero)):
        torch.testing.assert_close(quaternion.between(*pair), quaternion.identity(like=x))


def test_normalizing_gives_unit_length_and_keeps_direction(generator):
    q = torch.randn(20, 4, dtype=torch.float64, generator=generator) * 1e3
    unit = quaternion.normalize(q)
    torch.testing.assert_close(unit.norm(dim=-1), torch.ones(20, dtype=torch.float64))
    torch.testing.assert_close(unit * q.norm(dim=-1, keepdim=True), q)
    zero = torch.zeros(3, 4)
    torch.testing.assert_close(quaternion.normalize(zero), quaternion.identity(3, like=zero))


def on_sphere(q: Tensor) -> Tensor:
    return quaternion.normalize(q)


GRADIENTS = {
    "log": lambda q: quaternion.log(on_sphere(q)),
    "power": lambda q: quaternion.power(on_sphere(q), 0.3),
    "slerp": lambda q: quaternion.slerp(on_sphere(q), on_sphere(q.roll(1, 0)), 0.3),
    "rotate": lambda q: quaternion.rotate(on_sphere(q), q[..., 1:]),
    "inverse": lambda q: quaternion.inverse(q),
    "angle": lambda q: quaternion.angle(on_sphere(q), on_sphere(q.roll(1, 0))),
    "unroll": lambda q: quaternion.unroll(q, dim=0),
    "exp": lambda q: quaternion.exp(q[..., 1:]),
    "between": lambda q: quaternion.between(q[..., 1:], q[..., :3]),
    "about_axis": lambda q: quaternion.about_axis(q[..., 1:], q[..., 0]),
}


@pytest.mark.parametrize("name", GRADIENTS)
def test_gradients_agree_with_finite_differences(name, generator):
    q = torch.randn(6, 4, dtype=torch.float64, generator=generator).requires_grad_()
    assert torch.autograd.gradcheck(GRADIENTS[name], (q,))


def test_the_gradients_of_exp_and_log_at_the_identity_are_one_half_and_two():
    zero = torch.zeros(3, dtype=torch.float64)
    jacobian = torch.autograd.functional.jacobian(quaternion.exp, zero)
    expected = torch.cat([torch.zeros(1, 3), 0.5 * torch.eye(3)]).double()
    torch.testing.assert_close(jacobian, expected)
    one = quaternion.identity(like=zero)
    jacobian = torch.autograd.functional.jacobian(quaternion.log, one)
    torch.testing.assert_close(jacobian[:, 1:], 2 * torch.eye(3, dtype=torch.float64))


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("name", GRADIENTS)
def test_gradients_are_finite_at_identity_half_turn_and_zero(name, dtype):
    hard = torch.cat([hard_rotations(), torch.zeros(2, 4, dtype=torch.float64)]).to(dtype)
    if name == "inverse":
        hard = hard[:-2]
    hard = torch.cat([hard, hard]).requires_grad_()
    result = GRADIENTS[name](hard)
    assert result.isfinite().all()
    result.sum().backward()
    assert hard.grad.isfinite().all()


@pytest.mark.parametrize("dtype", [torch.float16, torch.bfloat16, torch.float32])
def test_the_type_of_the_input_is_kept(dtype):
    q = quaternion.identity(3, like=torch.zeros(1, dtype=dtype))
    results = [
        quaternion.product(q, q),
        quaternion.rotate(q, q[..., 1:]),
        quaternion.log(q),
        quaternion.exp(q[..., 1:]),
        quaternion.slerp(q, q, 0.5),
        quaternion.angle(q, q),
        quaternion.unroll(q, dim=0),
        quaternion.between(q[..., :3], q[..., 1:]),
    ]
    assert [result.dtype for result in results] == [dtype] * 8
    assert all(result.isfinite().all() for result in results)


@pytest.mark.parametrize("dtype", [torch.float16, torch.bfloat16, torch.float32, torch.float64])
@pytest.mark.parametrize("length", [0.0, 1e-4, 1e-2, 300.0])
def test_normalizing_any_length_is_unit_in_every_type(dtype, length):
    stretched = (length * torch.tensor([[0.5, -0.5, 0.5, 0.5]])).to(dtype)
    unit = quaternion.normalize(stretched)
    expected = [[0.5, -0.5, 0.5, 0.5]] if length else [[1.0, 0, 0, 0]]
    assert unit.dtype == dtype
    torch.testing.assert_close(unit, torch.tensor(expected, dtype=dtype), atol=1e-2, rtol=0)
