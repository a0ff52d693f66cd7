"""Two-bone limbs reach what is within reach, bend the right way, and stay finite elsewhere."""

from __future__ import annotations

import pytest
import torch
from torch import Tensor

from posecast.geometry import quaternion
from posecast.skeleton.inverse_kinematics import TwoBone, two_bone

THIGH = torch.tensor([0.02, -0.42, 0.01], dtype=torch.float64)
SHANK = torch.tensor([-0.01, -0.40, -0.03], dtype=torch.float64)
FORWARD = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64)
LENGTH = float(THIGH.norm() + SHANK.norm())


def solve(start: Tensor, target: Tensor, bend: Tensor) -> TwoBone:
    """A human leg."""
    return two_bone(start, target, bend, upper_offset=THIGH, lower_offset=SHANK, rest_bend=FORWARD)


@pytest.fixture
def hips(generator: torch.Generator) -> Tensor:
    return torch.randn(200, 3, dtype=torch.float64, generator=generator)


@pytest.fixture
def ways(generator: torch.Generator) -> Tensor:
    """Unit directions from hip to ankle."""
    drawn = torch.randn(200, 3, dtype=torch.float64, generator=generator)
    return drawn / drawn.norm(dim=-1, keepdim=True)


@pytest.fixture
def bends(generator: torch.Generator) -> Tensor:
    return torch.randn(200, 3, dtype=torch.float64, generator=generator)


@pytest.mark.parametrize("share", [0.05, 0.3, 0.8, 0.999])
def test_the_rotations_bring_the_end_to_a_target_within_reach(share, hips, ways, bends):
    ankles = hips + share * LENGTH * ways
    limb = solve(hips, ankles, bends)
    knees = hips + quaternion.rotate(limb.upper, THIGH.expand_as(hips))
    ends = knees + quaternion.rotate(limb.lower, SHANK.expand_as(hips))
    torch.testing.assert_close(knees, limb.middle)
    torch.testing.assert_close(ends, ankles, rtol=0, atol=1e-9)
    torch.testing.assert_close(limb.end, ankles, rtol=0, atol=1e-9)


def test_a_target_out_of_reach_is_pointed_at(hips, ways, bends):
    limb = solve(hips, hips + 3 * LENGTH * ways, bends)
    torch.testing.assert_close(limb.end, hips + LENGTH * ways, rtol=0, atol=1e-5)


def test_the_knee_points_where_it_should(hips, ways, bends):
    limb = solve(hips, hips + 0.8 * LENGTH * ways, bends)
    aside = limb.middle - hips
    aside = aside - (aside * ways).sum(-1, keepdim=True) * ways
    wanted = bends - (bends * ways).sum(-1, keepdim=True) * ways
    cosine = torch.cosine_similarity(aside, wanted, dim=-1)
    assert len(cosine) == 200
    torch.testing.assert_close(cosine, torch.ones_like(cosine))


def test_a_straight_rest_pose_bends_about_one_hinge(hips, ways, bends):
    thigh = torch.tensor([0.0, -0.4, 0.0], dtype=torch.float64)
    limb = two_bone(
        hips,
        hips + 0.6 * ways,
        bends,
        upper_offset=thigh,
        lower_offset=thigh,
        rest_bend=FORWARD,
    )
    knee = quaternion.product(quaternion.conjugate(limb.upper), limb.lower)
    knee = knee * torch.sign(knee[:, :1])
    assert knee[:, 2:].abs().max() < 1e-12
    assert knee[:, 1].min() > 0, "knees bend backwards about +x, heels towards the seat"


def test_the_rest_pose_needs_no_rotation():
    limb = solve(torch.zeros(1, 3, dtype=torch.float64), (THIGH + SHANK)[None], FORWARD[None])
    rest = quaternion.identity(1, like=limb.upper)
    assert quaternion.angle(limb.upper, rest).max() < 0.05
    assert quaternion.angle(limb.lower, rest).max() < 0.05


@pytest.mark.parametrize(
    ("target", "bend"),
    [
        ((0.0, -2.0, 0.0), (0.0, 0.0, 1.0)),
        ((0.0, -LENGTH, 0.0), (0.0, 0.0, 1.0)),
        ((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)),
        ((0.0, -0.5, 0.0), (0.0, -1.0, 0.0)),
        ((0.0, -0.5, 0.0), (0.0, 0.0, 0.0)),
    ],
    ids=["beyond reach", "full stretch", "no distance", "bend along the limb", "no bend"],
)
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_values_and_gradients_are_finite_at_the_hard_spots(target, bend, dtype):
    inputs = [
        torch.tensor([values], dtype=dtype, requires_grad=True)
        for values in ((0.0, 0.0, 0.0), target, bend)
    ]
    limb = two_bone(
        *inputs,
        upper_offset=THIGH.to(dtype),
        lower_offset=SHANK.to(dtype),
        rest_bend=FORWARD.to(dtype),
    )
    gradients = torch.autograd.grad(sum(part.sum() for part in limb), inputs)
    for values in (*limb, *gradients):
        assert torch.isfinite(values).all()
    torch.testing.assert_close(limb.upper.norm(dim=-1), torch.ones(1, dtype=dtype))


def test_the_gradient_is_that_of_finite_differences(hips, ways, bends):
    assert torch.autograd.gradcheck(
        solve,
        tuple(tensor[:5].clone().requires_grad_() for tensor in (hips, hips + 0.4 * ways, bends)),
    )
