"""Laws that hold for every representation, near the hard spots of rotations."""

from __future__ import annotations

import math

import pytest
import torch

from posecast.errors import ConfigError
from posecast.geometry import quaternion
from posecast.representation import REPRESENTATIONS, Quaternion, build_representation
from posecast.skeleton import Skeleton

SKELETON = Skeleton(("hips", "spine", "head", "left", "right"), (-1, 0, 1, 1, 1))
OFFSETS = torch.tensor(
    [[0, 0, 0], [0, 0.5, 0], [0, 0.3, 0], [0.2, 0.1, 0], [-0.2, 0.1, 0]], dtype=torch.float64
)


def poses(generator):
    """Random poses, and ones at and near the identity, half turns and gimbal lock, and their -q."""
    random = quaternion.normalize(
        torch.randn(20, len(SKELETON), 4, generator=generator, dtype=torch.float64)
    )
    angles = [0.0, 1e-9, 1e-4, math.pi / 2, math.pi - 1e-7, math.pi]
    axes = torch.eye(3, dtype=torch.float64)
    special = torch.stack([quaternion.exp(angle * axis) for angle in angles for axis in axes])
    special = special[:, None].expand(-1, len(SKELETON), -1)
    found = torch.cat([random, special])
    return torch.cat([found, -found])


@pytest.fixture(params=REPRESENTATIONS)
def representation(request):
    return build_representation(request.param, SKELETON)


def test_there_is_a_representation_to_test():
    assert len(REPRESENTATIONS) >= 1


def test_decoding_what_was_encoded_gives_the_same_rotations(representation, generator):
    rotations = poses(generator)
    assert len(rotations) == 76
    features = representation.encode(rotations, OFFSETS)
    assert features.shape == (76, len(SKELETON), representation.joint_dim)
    again = representation.decode(features, OFFSETS)
    torch.testing.assert_close(
        quaternion.angle(again, rotations), torch.zeros(76, 5).double(), atol=1e-7, rtol=0
    )


def test_projecting_changes_nothing_twice(representation, generator):
    shape = (50, len(SKELETON), representation.joint_dim)
    outputs = torch.randn(shape, generator=generator, dtype=torch.float64)
    once = representation.project(outputs)
    torch.testing.assert_close(representation.project(once), once, atol=1e-12, rtol=0)


def test_projecting_leaves_valid_features_alone(representation, generator):
    features = representation.encode(poses(generator), OFFSETS)
    torch.testing.assert_close(representation.project(features), features, atol=1e-12, rtol=0)


def test_composing_with_the_identity_changes_nothing(representation, generator):
    features = representation.encode(poses(generator), OFFSETS)
    neutral = representation.identity(features)
    torch.testing.assert_close(representation.compose(neutral, features), features)


def test_valid_features_are_not_penalized(representation, generator):
    features = representation.encode(poses(generator), OFFSETS)
    assert representation.penalty(features) < 1e-20


def test_invalid_outputs_are_projected_to_valid_ones(representation, generator):
    shape = (50, len(SKELETON), representation.joint_dim)
    outputs = 3 * torch.randn(shape, generator=generator, dtype=torch.float64)
    assert representation.penalty(representation.project(outputs)) < 1e-20


@pytest.mark.parametrize("scale", [0.0, 1e-30, 1.0, 1e6])
def test_gradients_are_finite_even_where_the_network_puts_out_nothing(
    representation, scale, generator
):
    shape = (4, len(SKELETON), representation.joint_dim)
    raw = scale * torch.randn(shape, generator=generator, dtype=torch.float64)
    raw.requires_grad_()
    base = representation.encode(poses(generator)[:4], OFFSETS)
    result = representation.project(representation.compose(raw, base))
    decoded = representation.decode(result, OFFSETS)
    (gradient,) = torch.autograd.grad(decoded.sum() + representation.penalty(raw), raw)
    assert gradient.isfinite().all()


def test_a_quaternion_delta_turns_as_seen_from_the_parent():
    # A quarter turn about x, then the delta: a quarter turn about the parent's y, not one's own.
    base = quaternion.exp(torch.tensor([math.pi / 2, 0, 0], dtype=torch.float64))
    delta = quaternion.exp(torch.tensor([0, math.pi / 2, 0], dtype=torch.float64))
    both = Quaternion().compose(delta[None, None], base[None, None])[0, 0]
    moved = quaternion.rotate(both, torch.tensor([0, 1, 0], dtype=torch.float64))
    # y goes to z under the base, and from z to x under the delta.
    torch.testing.assert_close(moved, torch.tensor([1.0, 0, 0], dtype=torch.float64))


def test_a_quaternion_delta_is_not_scaled_before_it_is_applied():
    base = quaternion.identity(1, 1, like=torch.zeros(0))
    composed = Quaternion().compose(3 * base, base)
    torch.testing.assert_close(composed, 3 * base)
    torch.testing.assert_close(Quaternion().project(composed), base)


def test_the_quaternion_penalty_is_of_squared_lengths():
    raw = torch.tensor([[[2.0, 0, 0, 0], [0, 1, 0, 0]]])
    # (4 - 1)^2 and 0, averaged over joints; of lengths it would be (2 - 1)^2 / 2.
    assert Quaternion().penalty(raw) == 4.5


def test_an_unknown_representation_is_refused_with_those_there_are():
    with pytest.raises(ConfigError, match=r"'quaternions' is not known; .* quaternion"):
        build_representation("quaternions", SKELETON)
