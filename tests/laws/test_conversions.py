"""Matrices, axis-angle vectors and six numbers: round trips, SciPy, RoMa, gradients."""

from __future__ import annotations

import math

import pytest
import roma
import torch
from scipy.spatial.transform import Rotation
from torch import Tensor

from posecast.geometry import (
    axis_angle_to_quaternion,
    matrix_to_ortho6d,
    matrix_to_quaternion,
    nearest_rotation,
    ortho6d_to_matrix,
    ortho6d_to_quaternion,
    quaternion,
    quaternion_to_axis_angle,
    quaternion_to_matrix,
    quaternion_to_ortho6d,
)

PI = math.pi
ROUND_TRIPS = {
    "axis_angle": (quaternion_to_axis_angle, axis_angle_to_quaternion),
    "matrix": (quaternion_to_matrix, matrix_to_quaternion),
    "ortho6d": (quaternion_to_ortho6d, ortho6d_to_quaternion),
}


@pytest.fixture
def rotations(generator) -> Tensor:
    """Random rotations, and all sizes of turn up to the half turn about special axes."""
    q = torch.randn(200, 4, dtype=torch.float64, generator=generator)
    axes = torch.cat([torch.eye(3), torch.tensor([[1.0, 1, 1], [0, 1, -1], [5, 0, -2]])]).double()
    axes = axes / axes.norm(dim=-1, keepdim=True)
    angles = [0.0, 1e-12, 1e-7, 1e-3, PI / 2, 3.0, PI - 1e-3, PI - 1e-7, PI - 1e-12, PI]
    vectors = torch.tensor(angles, dtype=torch.float64)[:, None, None] * axes
    found = torch.cat([quaternion.normalize(q), quaternion.exp(vectors.reshape(-1, 3))])
    assert found.shape == (260, 4)
    return torch.cat([found, -found])


def to_scipy(q: Tensor) -> Rotation:
    return Rotation.from_quat(q.numpy()[..., [1, 2, 3, 0]])


@pytest.mark.parametrize("kind", ROUND_TRIPS)
def test_there_and_back_is_the_same_rotation(kind, rotations):
    there, back = ROUND_TRIPS[kind]
    assert quaternion.angle(back(there(rotations)), rotations).max() < 1e-14
    same = there(rotations) - there(-rotations)
    away = quaternion.log(rotations).norm(dim=-1) < PI - 1e-9
    assert same[away].abs().max() < 1e-15


@pytest.mark.parametrize("kind", ROUND_TRIPS)
def test_there_and_back_has_the_gradient_of_the_identity(kind, rotations):
    there, back = ROUND_TRIPS[kind]
    q = rotations.clone().requires_grad_()
    weights = torch.linspace(-1, 1, q.numel(), dtype=q.dtype).reshape(q.shape)
    result = back(there(quaternion.normalize(q)))
    sign = torch.where((result * rotations).sum(-1, keepdim=True) < 0, -1.0, 1.0)
    (sign * result * weights).sum().backward()
    tangent = weights - (weights * rotations).sum(-1, keepdim=True) * rotations
    torch.testing.assert_close(q.grad, tangent, atol=1e-9, rtol=1e-9)


def test_matrices_are_those_of_scipy_and_roma(rotations):
    ours = quaternion_to_matrix(rotations)
    torch.testing.assert_close(ours, torch.from_numpy(to_scipy(rotations).as_matrix()))
    torch.testing.assert_close(ours, roma.unitquat_to_rotmat(rotations.roll(-1, -1)))


def test_a_matrix_rotates_columns_like_its_quaternion(rotations, generator):
    v = torch.randn(len(rotations), 3, dtype=torch.float64, generator=generator)
    turned = (quaternion_to_matrix(rotations) @ v[..., None])[..., 0]
    torch.testing.assert_close(turned, quaternion.rotate(rotations, v))


def test_quaternions_of_matrices_are_those_of_roma_with_w_not_negative(rotations):
    matrix = quaternion_to_matrix(rotations)
    ours = matrix_to_quaternion(matrix)
    assert (ours[:, 0] >= 0).all()
    theirs = roma.rotmat_to_unitquat(matrix).roll(1, -1)
    assert quaternion.angle(ours, theirs).max() < 1e-14


def test_axis_angle_vectors_are_those_of_scipy(rotations):
    away = quaternion.log(rotations).norm(dim=-1) < PI - 1e-9
    ours = quaternion_to_axis_angle(rotations[away])
    torch.testing.assert_close(ours, torch.from_numpy(to_scipy(rotations[away]).as_rotvec()))


def test_six_numbers_are_the_first_column_then_the_second(rotations):
    matrix = quaternion_to_matrix(rotations)
    six = quaternion_to_ortho6d(rotations)
    torch.testing.assert_close(six[:, :3], matrix[:, :, 0], atol=0, rtol=0)
    torch.testing.assert_close(six[:, 3:], matrix[:, :, 1], atol=0, rtol=0)
    torch.testing.assert_close(matrix_to_ortho6d(matrix), six, atol=0, rtol=0)


def test_six_numbers_become_orthonormal_like_in_roma(generator):
    six = torch.randn(200, 6, dtype=torch.float64, generator=generator)
    ours = ortho6d_to_matrix(six)
    theirs = roma.special_gramschmidt(six.reshape(200, 2, 3).mT)
    torch.testing.assert_close(ours, theirs)
    torch.testing.assert_close(ours.mT @ ours, torch.eye(3).double().expand(200, 3, 3))


@pytest.mark.parametrize(
    "six",
    [
        [0.0, 0, 0, 0, 0, 0],
        [0.0, 0, 0, 0, 1, 0],
        [1.0, 0, 0, 0, 0, 0],
        [1.0, 2, 3, 2, 4, 6],
        [1.0, 2, 3, -1, -2, -3],
        [1e-30, 0, 0, 0, 1e-30, 0],
        [0.1, 0.7, 0.3, 1e6, 7e6, 3e6],
    ],
)
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_degenerate_six_numbers_still_give_a_rotation_and_a_finite_gradient(six, dtype):
    columns = torch.tensor(six, dtype=dtype, requires_grad=True)
    matrix = ortho6d_to_matrix(columns)
    tolerance = 1e-5 if dtype is torch.float32 else 1e-7
    torch.testing.assert_close(
        matrix.mT @ matrix, torch.eye(3, dtype=dtype), atol=tolerance, rtol=0
    )
    assert torch.linalg.det(matrix) > 0.99
    ortho6d_to_quaternion(columns).sum().backward()
    assert columns.grad.isfinite().all()


def test_the_nearest_rotation_is_that_of_roma(generator):
    matrix = torch.randn(300, 3, 3, dtype=torch.float64, generator=generator)
    assert (torch.linalg.det(matrix) < 0).sum() > 100
    ours = nearest_rotation(matrix)
    torch.testing.assert_close(ours, roma.special_procrustes(matrix), atol=1e-11, rtol=0)
    torch.testing.assert_close(torch.linalg.det(ours), torch.ones(300, dtype=torch.float64))


def test_no_other_rotation_is_nearer(generator):
    matrix = torch.randn(50, 1, 3, 3, dtype=torch.float64, generator=generator)
    best = (matrix - nearest_rotation(matrix)).square().sum((-1, -2))
    others = quaternion.normalize(torch.randn(50, 400, 4, dtype=torch.float64, generator=generator))
    distances = (matrix - quaternion_to_matrix(others)).square().sum((-1, -2))
    assert (distances >= best).all()


def test_projecting_a_rotation_changes_nothing(rotations):
    matrix = quaternion_to_matrix(rotations)
    torch.testing.assert_close(nearest_rotation(matrix), matrix, atol=1e-14, rtol=0)


def test_the_gradient_of_the_projection_agrees_with_finite_differences(generator, rotations):
    matrix = torch.randn(5, 3, 3, dtype=torch.float64, generator=generator)
    at_rotations = quaternion_to_matrix(rotations[:5])
    for values in (matrix, at_rotations, 3 * at_rotations):
        assert torch.autograd.gradcheck(nearest_rotation, (values.clone().requires_grad_(),))


@pytest.mark.parametrize("scale", [0.0, 1e-30, 1.0])
def test_the_gradient_of_the_projection_is_finite_where_it_is_ambiguous(scale):
    ambiguous = torch.stack(
        [
            torch.zeros(3, 3),
            torch.diag(torch.tensor([1.0, 0.0, 0.0])),
            torch.diag(torch.tensor([1.0, 1.0, -1.0])),
            -torch.eye(3),
        ]
    )
    matrix = (scale * ambiguous).requires_grad_()
    rotation = nearest_rotation(matrix)
    torch.testing.assert_close(torch.linalg.det(rotation), torch.ones(4))
    (rotation * torch.arange(9.0).reshape(3, 3)).sum().backward()
    assert matrix.grad.isfinite().all()


def test_gradients_agree_with_finite_differences(generator):
    q = torch.randn(6, 4, dtype=torch.float64, generator=generator).requires_grad_()
    six = torch.randn(6, 6, dtype=torch.float64, generator=generator).requires_grad_()
    gradcheck = torch.autograd.gradcheck
    assert gradcheck(lambda x: quaternion_to_matrix(quaternion.normalize(x)), (q,))
    assert gradcheck(
        lambda x: matrix_to_quaternion(quaternion_to_matrix(quaternion.normalize(x))), (q,)
    )
    assert gradcheck(ortho6d_to_matrix, (six,))
    assert gradcheck(ortho6d_to_quaternion, (six,))


def test_batch_axes_may_be_empty_or_many(rotations):
    q = rotations[:24].reshape(2, 3, 4, 4)
    for there, back in ROUND_TRIPS.values():
        values = there(q)
        assert back(values).shape == (2, 3, 4, 4)
        assert back(there(q[:0])).shape == (0, 3, 4, 4)
    assert nearest_rotation(quaternion_to_matrix(q[:0])).shape == (0, 3, 4, 3, 3)


def test_a_matrix_that_is_not_finite_spoils_no_other(rotations):
    matrices = quaternion_to_matrix(rotations[:3]).clone()
    matrices[1, 0, 0] = torch.inf
    found = nearest_rotation(matrices)
    assert found[1].isnan().all()
    torch.testing.assert_close(found[::2], matrices[::2])


@pytest.mark.parametrize("dtype", [torch.float16, torch.bfloat16])
def test_the_nearest_rotation_of_half_precision_is_computed_in_single(rotations, dtype):
    matrices = quaternion_to_matrix(rotations).to(dtype)
    found = nearest_rotation(matrices)
    assert found.dtype == dtype
    torch.testing.assert_close(found, matrices, atol=2e-2, rtol=0)
