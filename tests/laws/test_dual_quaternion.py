"""Laws of dual quaternions in float64, near the identity, half turns and pure translations."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest
import torch

from posecast.geometry import dual_quaternion as dual
from posecast.geometry import quaternion


def motions(generator):
    """Rigid motions where formulas go wrong and at random, each with both signs."""
    angles = torch.tensor(
        [0, 1e-300, 1e-12, 1e-8, 1e-5, 1e-3, 0.1, math.pi / 2, 3.0, math.pi - 1e-8, math.pi]
    ).double()
    axes = torch.nn.functional.normalize(
        torch.tensor([[1.0, 0, 0], [0, 1, 0], [1, 1, 1], [-3, 0.2, 1]]).double(), dim=-1
    )
    hard = quaternion.exp((angles[:, None, None] * axes).reshape(-1, 3))
    random = quaternion.normalize(torch.randn(60, 4, dtype=torch.float64, generator=generator))
    turns = torch.cat([hard, random])
    moved = torch.randn(len(turns), 3, dtype=torch.float64, generator=generator)
    moved[::5] = 0
    found = dual.from_rotation_translation(turns, moved)
    assert len(found) == 104
    return torch.cat([found, -found])


@pytest.fixture
def some(generator):
    return motions(generator)


def pairs(some, generator):
    return some, some[torch.randperm(len(some), generator=generator)]


def same(a, b, tolerance=1e-12):
    sign = torch.where((a[..., :4] * b[..., :4]).sum(-1, keepdim=True) < 0, -1.0, 1.0)
    torch.testing.assert_close(a, sign * b, atol=tolerance, rtol=0)


def test_they_are_a_group(some, generator):
    a, b = pairs(some, generator)
    c = b.flip(0)
    one = dual.identity(len(a), like=a)
    torch.testing.assert_close(
        dual.product(dual.product(a, b), c), dual.product(a, dual.product(b, c))
    )
    torch.testing.assert_close(dual.product(one, a), a)
    torch.testing.assert_close(dual.product(a, one), a)
    torch.testing.assert_close(dual.product(a, dual.inverse(a)), one)
    torch.testing.assert_close(dual.product(dual.inverse(a), a), one)


def test_a_product_is_that_of_the_matrices(some, generator):
    a, b = pairs(some, generator)
    torch.testing.assert_close(
        dual.to_matrix(dual.product(a, b)), dual.to_matrix(a) @ dual.to_matrix(b)
    )
    same(dual.from_matrix(dual.to_matrix(a)), a)


def test_a_point_is_turned_then_moved(some, generator):
    point = torch.randn(len(some), 3, dtype=torch.float64, generator=generator)
    moved = quaternion.rotate(dual.rotation(some), point) + dual.translation(some)
    torch.testing.assert_close(dual.transform(some, point), moved)
    homogeneous = torch.cat([point, torch.ones(len(point), 1).double()], dim=-1)
    by_matrix = (dual.to_matrix(some) @ homogeneous[..., None])[..., :3, 0]
    torch.testing.assert_close(dual.transform(some, point), by_matrix)
    # q p q', with both conjugates, p = 1 + eps (0, point)
    written = dual.identity(len(some), like=some)
    written[:, 5:] = point
    both = dual.product(dual.product(some, written), dual.combined_conjugate(some))
    torch.testing.assert_close(both[:, 5:], moved)


def test_both_signs_are_one_motion(some):
    torch.testing.assert_close(dual.to_matrix(-some), dual.to_matrix(some))
    torch.testing.assert_close(dual.translation(-some), dual.translation(some))


def test_building_and_taking_apart_are_inverse(some):
    again = dual.from_rotation_translation(dual.rotation(some), dual.translation(some))
    torch.testing.assert_close(again, some)


def test_conjugates_are_what_their_names_say(some, generator):
    a, b = pairs(some, generator)
    torch.testing.assert_close(dual.conjugate(a), dual.inverse(a))
    torch.testing.assert_close(
        dual.conjugate(dual.product(a, b)), dual.product(dual.conjugate(b), dual.conjugate(a))
    )
    torch.testing.assert_close(
        dual.dual_conjugate(dual.product(a, b)),
        dual.product(dual.dual_conjugate(a), dual.dual_conjugate(b)),
    )
    torch.testing.assert_close(
        dual.combined_conjugate(a), dual.conjugate(dual.dual_conjugate(a)), rtol=0, atol=0
    )


def test_the_inverse_of_any_is_its_inverse(generator):
    any_ = torch.randn(50, 8, dtype=torch.float64, generator=generator)
    one = dual.identity(50, like=any_)
    torch.testing.assert_close(dual.product(any_, dual.inverse(any_)), one)


def test_the_norm_is_a_dual_number_that_multiplies(generator):
    a, b = torch.randn(2, 50, 8, dtype=torch.float64, generator=generator)
    one, other, both = dual.norm(a), dual.norm(b), dual.norm(dual.product(a, b))
    torch.testing.assert_close(both.real, one.real * other.real)
    torch.testing.assert_close(both.dual, one.real * other.dual + one.dual * other.real)
    nothing = dual.norm(torch.zeros(8, dtype=torch.float64))
    assert (nothing.real, nothing.dual) == (0, 0)


def test_normalizing_takes_both_steps():
    raw = torch.tensor([0.0, 2, 0, 0, 3, 4, 5, 6], dtype=torch.float64)
    # Halved, then without the part along the real part, which is 4 / 2 of the second.
    expected = torch.tensor([0.0, 1, 0, 0, 1.5, 0, 2.5, 3], dtype=torch.float64)
    torch.testing.assert_close(dual.normalize(raw), expected)


def test_what_is_normalized_is_unit_and_stays(generator):
    raw = torch.randn(50, 8, dtype=torch.float64, generator=generator)
    unit = dual.normalize(raw)
    size = dual.norm(unit)
    torch.testing.assert_close(size.real, torch.ones(50).double())
    torch.testing.assert_close(size.dual, torch.zeros(50).double(), atol=1e-15, rtol=0)
    torch.testing.assert_close(dual.normalize(unit), unit, atol=1e-15, rtol=0)


@pytest.mark.parametrize("scale", [0.0, 1e-30])
def test_a_vanishing_real_part_becomes_no_turn_and_has_a_finite_gradient(scale):
    raw = scale * torch.ones(8, dtype=torch.float64)
    raw = (raw + torch.tensor([0.0, 0, 0, 0, 1, 2, 3, 4]).double()).requires_grad_()
    unit = dual.normalize(raw)
    torch.testing.assert_close(unit, torch.tensor([1.0, 0, 0, 0, 0, 2, 3, 4]).double())
    (gradient,) = torch.autograd.grad(unit.sum(), raw)
    assert gradient.isfinite().all()


@pytest.mark.parametrize("dtype", [torch.float16, torch.bfloat16, torch.float32])
@pytest.mark.parametrize("size", [0.0, 1e-10, 1e-5])
def test_normalizing_in_low_precision_is_finite(dtype, size):
    raw = torch.tensor([size] * 4 + [1.0, 2, 3, 4], dtype=dtype, requires_grad=True)
    unit = dual.normalize(raw)
    assert unit.isfinite().all()
    unit.sum().backward()
    assert raw.grad.isfinite().all()


def test_log_and_exp_are_inverse(some):
    twist = dual.log(some)
    assert (twist[:, :3].norm(dim=-1) <= math.pi + 1e-12).all()
    same(dual.exp(twist), some, 1e-9)
    away = some[:, 0].abs() > 1e-6  # at the half turn the sign chooses the axis
    torch.testing.assert_close(dual.log(-some)[away], twist[away], atol=1e-7, rtol=1e-7)


def test_the_exponential_agrees_with_that_of_matrices(generator):
    twist = torch.randn(30, 6, dtype=torch.float64, generator=generator)
    twist[:5] *= 1e-6
    twist[5:8, :3] = 0
    algebra = torch.zeros(30, 4, 4, dtype=torch.float64)
    x, y, z = twist[:, :3].unbind(-1)
    algebra[:, 0, 1], algebra[:, 1, 0] = -z, z
    algebra[:, 0, 2], algebra[:, 2, 0] = y, -y
    algebra[:, 1, 2], algebra[:, 2, 1] = -x, x
    algebra[:, :3, 3] = twist[:, 3:]
    torch.testing.assert_close(dual.to_matrix(dual.exp(twist)), torch.matrix_exp(algebra))


@pytest.mark.parametrize("function", [dual.log, dual.to_matrix, dual.normalize, dual.inverse])
def test_gradients_are_finite_everywhere(function, some):
    leaf = some.clone().requires_grad_()
    (gradient,) = torch.autograd.grad(function(leaf).sum(), leaf)
    assert gradient.isfinite().all()


def test_the_exponential_has_a_finite_gradient_at_no_motion():
    twist = torch.zeros(1, 6, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(dual.exp, twist)


def test_screws_move_at_constant_speed_the_short_way(some, generator):
    a, b = pairs(some, generator)
    near = (a[:, :4] * b[:, :4]).sum(-1).abs() > 1e-3
    a, b = a[near], b[near]
    same(dual.interpolate(a, b, 0.0), a, 1e-9)
    same(dual.interpolate(a, b, 1.0), b, 1e-7)
    steps = [dual.interpolate(a, b, share / 4) for share in range(5)]
    moved = [dual.log(dual.product(dual.conjugate(one), other)) for one, other in pairwise(steps)]
    for each in moved[1:]:
        torch.testing.assert_close(each, moved[0], atol=1e-6, rtol=1e-6)


def test_pure_translations_are_interpolated_along_a_line():
    still = torch.tensor([1.0, 0, 0, 0], dtype=torch.float64)
    ends = [
        dual.from_rotation_translation(still, torch.tensor(place).double())
        for place in ([0.0, 0, 0], [2.0, 4, -6])
    ]
    half = dual.translation(dual.interpolate(*ends, 0.25))
    torch.testing.assert_close(half, torch.tensor([0.5, 1, -1.5], dtype=torch.float64))


def test_unrolling_flips_all_eight_numbers_by_the_real_part(generator):
    time = torch.linspace(0, 8, 60, dtype=torch.float64)[:, None]
    turns = quaternion.exp(time * torch.tensor([0.3, 1.0, 0.2]).double())
    moved = torch.randn(60, 3, dtype=torch.float64, generator=generator)
    smooth = dual.from_rotation_translation(turns, moved)
    flips = torch.where(torch.rand(60, 1, generator=generator) < 0.5, -1.0, 1.0).double()
    flips[0] = 1
    torch.testing.assert_close(dual.unroll(smooth * flips, dim=0), smooth)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_precision_and_batch_axes_are_those_of_the_arguments(dtype):
    one = dual.identity(3, 1, like=torch.zeros(0, dtype=dtype))
    other = dual.identity(1, 4, like=one)
    assert dual.product(one, other).shape == (3, 4, 8)
    assert dual.product(one, other).dtype == dtype
    assert dual.transform(one, torch.zeros(4, 3, dtype=dtype)).shape == (3, 4, 3)


@pytest.mark.parametrize(("dtype", "size"), [(torch.float16, 1e-3), (torch.float32, 1e-20)])
def test_the_norm_of_a_short_real_part_is_its_length(dtype, size):
    found = dual.norm(torch.tensor([size, 0, 0, 0, 3 * size, size, 0, 0], dtype=dtype))
    torch.testing.assert_close(found.real, torch.tensor(size, dtype=dtype))
    torch.testing.assert_close(found.dual, torch.tensor(3 * size, dtype=dtype))
