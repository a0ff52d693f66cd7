"""Laws that hold for every representation, near the hard spots of rotations."""

from __future__ import annotations

import math

import pytest
import torch

from posecast.errors import ConfigError
from posecast.geometry import quaternion
from posecast.motion import Motion
from posecast.representation import (
    REPRESENTATIONS,
    AxisAngle,
    Codec,
    DualQuaternion,
    Euler,
    Matrix,
    Ortho6d,
    Positions,
    Quaternion,
    build_representation,
)
from posecast.skeleton import Skeleton
from posecast.skeleton.kinematics import joint_positions, local_to_root

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


# Numbers a joint as in Andreou et al. 2022, section 5 (models.md 8.2), and the three not in it.
WIDTHS = {
    "positions": 3,
    "euler": 3,
    "axis_angle": 3,
    "matrix": 9,
    "quaternion": 4,
    "ortho6d": 6,
    "dual_quaternion": 8,
    "quaternion+positions": 7,
    "ortho6d+positions": 9,
    "quaternion+offsets": 7,
    "ortho6d+offsets": 9,
}


OTHER_OPTIONS = {"dual_quaternion, axes of the body": DualQuaternion(SKELETON, axes="body")}


@pytest.fixture(params=[*REPRESENTATIONS, *OTHER_OPTIONS])
def representation(request):
    if request.param in OTHER_OPTIONS:
        return OTHER_OPTIONS[request.param]
    return build_representation(request.param, SKELETON)


def places(rotations, offsets):
    """Joints from the first root, by forward kinematics."""
    found = joint_positions(SKELETON, rotations, offsets, None)
    return found - found[..., :1, :]


def test_every_representation_has_the_width_of_the_paper():
    found = {kind: build_representation(kind, SKELETON).joint_dim for kind in REPRESENTATIONS}
    assert found == WIDTHS


def test_decoding_what_was_encoded_gives_the_same_pose(representation, generator):
    rotations = poses(generator)
    assert len(rotations) == 76
    features = representation.encode(rotations, OFFSETS)
    assert features.shape == (76, len(SKELETON), representation.joint_dim)
    again = representation.decode(features, OFFSETS)
    torch.testing.assert_close(
        places(again, OFFSETS), places(rotations, OFFSETS), atol=1e-7, rtol=0
    )
    if "rotations" in representation.states:
        torch.testing.assert_close(
            quaternion.angle(again, rotations), torch.zeros(76, 5).double(), atol=1e-7, rtol=0
        )


@pytest.mark.parametrize(
    "order", ["xyz", "xzy", "yxz", "yzx", "zxy", "zyx", "xyx", "xzx", "yxy", "yzy", "zxz", "zyz"]
)
def test_euler_angles_of_any_order_are_a_representation(order, generator):
    euler = build_representation("euler", SKELETON, order=order)
    rotations = poses(generator)
    again = euler.decode(euler.encode(rotations, OFFSETS), OFFSETS)
    torch.testing.assert_close(
        quaternion.angle(again, rotations), torch.zeros(76, 5).double(), atol=1e-7, rtol=0
    )


def test_what_a_network_puts_out_is_one_pose_however_it_is_read(representation, generator):
    # Rotations and translations together put the joints where the positions are stated to be.
    shape = (50, len(SKELETON), representation.joint_dim)
    outputs = torch.randn(shape, generator=generator, dtype=torch.float64)
    features = representation.project(outputs)
    moved = representation.translations(features, OFFSETS)
    assert (moved is None) == ("translations" not in representation.states)
    stated = representation.positions(features)
    assert (stated is None) == ("positions" not in representation.states)
    if stated is not None:
        found = joint_positions(SKELETON, representation.decode(features, OFFSETS), moved, None)
        torch.testing.assert_close(found, stated, atol=1e-9, rtol=0)


def test_of_an_encoded_pose_bones_are_those_of_the_body(representation, generator):
    rotations = poses(generator)
    moved = representation.translations(representation.encode(rotations, OFFSETS), OFFSETS)
    if moved is not None:
        lengths = moved.norm(dim=-1)
        torch.testing.assert_close(lengths, OFFSETS.norm(dim=-1).expand_as(lengths))


def test_making_features_continuous_changes_no_pose(representation, generator):
    rotations = poses(generator)[None]
    features = representation.encode(rotations, OFFSETS)
    smooth = representation.continuous(features)
    torch.testing.assert_close(
        places(representation.decode(smooth, OFFSETS), OFFSETS), places(rotations, OFFSETS)
    )
    torch.testing.assert_close(representation.continuous(smooth), smooth, atol=0, rtol=0)


@pytest.mark.parametrize("kind", ["quaternion", "dual_quaternion", "quaternion+offsets"])
def test_signs_are_continuous_and_do_not_depend_on_those_of_the_motion(kind, generator):
    codec = Codec(SKELETON, build_representation(kind, SKELETON))
    axis = torch.randn(1, 1, 5, 3, generator=generator, dtype=torch.float64)
    time = torch.linspace(0, 9, 200, dtype=torch.float64)[None, :, None, None]
    turning = quaternion.exp(time * axis)
    flipped = turning * torch.where(torch.rand(1, 200, 5, 1, generator=generator) < 0.5, -1.0, 1.0)
    still = torch.zeros(1, 200, 3, dtype=torch.float64)
    features = [
        codec.split(codec.encode(Motion(each, still, OFFSETS[None]))).joints
        for each in (turning, flipped)
    ]
    torch.testing.assert_close(features[1], features[0])
    real = features[1][..., :4]
    assert (real[:, 0, 0, 0] >= 0).all()
    assert ((real[:, 1:] * real[:, :-1]).sum(-1) > 0).all()


def test_all_joints_of_a_body_that_turns_change_sign_with_its_root(generator):
    """Facing either way, a bent body has one form in dual quaternions and its negative."""
    bent = quaternion.normalize(
        quaternion.identity(1, 1, 5, like=OFFSETS)
        + 0.2 * torch.randn(1, 1, 5, 4, generator=generator, dtype=torch.float64)
    )
    codec = Codec(SKELETON, DualQuaternion(SKELETON))
    forms = []
    for angle in (math.pi - 1e-6, math.pi + 1e-6):
        turned = bent.clone()
        about = quaternion.exp(torch.tensor([0.0, angle, 0.0], dtype=torch.float64))
        turned[..., 0, :] = about
        still = torch.zeros(1, 1, 3, dtype=torch.float64)
        forms.append(codec.encode(Motion(turned, still, OFFSETS[None])))
    torch.testing.assert_close(forms[1], -forms[0], atol=1e-5, rtol=0)


def test_a_dual_quaternion_says_where_a_joint_is_and_how_it_is_turned(generator):
    rotations = poses(generator)
    dual = DualQuaternion(SKELETON).encode(rotations, OFFSETS)
    torch.testing.assert_close(dual[..., :4], local_to_root(SKELETON, rotations))
    assert (dual[..., 0, 4:] == 0).all()  # the root is where it is
    twice = 2 * quaternion.product(dual[..., 4:], quaternion.conjugate(dual[..., :4]))
    torch.testing.assert_close(twice[..., 1:], places(rotations, OFFSETS))
    torch.testing.assert_close(twice[..., 0], torch.zeros(76, 5).double(), atol=1e-12, rtol=0)


def test_in_the_axes_of_the_body_only_the_root_of_a_body_that_turns_changes(generator):
    dual = DualQuaternion(SKELETON, axes="body")
    rotations = poses(generator)
    turned = rotations.clone()
    turned[:, 0] = rotations.flip(0)[:, 0]
    features = dual.encode(turned, OFFSETS)
    torch.testing.assert_close(features[:, 1:], dual.encode(rotations, OFFSETS)[:, 1:])
    torch.testing.assert_close(dual.positions(features), places(turned, OFFSETS))


def test_an_error_of_a_dual_quaternion_is_not_handed_down(generator):
    dual = DualQuaternion(SKELETON)
    features = dual.encode(poses(generator)[:1], OFFSETS)
    turned = features.clone()
    spin = dual.identity(features[:, 1])
    spin[..., :4] = quaternion.exp(torch.tensor([0.3, 0.0, 0.0], dtype=torch.float64))
    turned[:, 1] = dual.compose(spin, features[:, 1])
    before, after = dual.positions(features), dual.positions(turned)
    assert (before[:, 1] - after[:, 1]).norm() > 1e-3
    assert torch.equal(before[:, 2:], after[:, 2:])


def test_positions_state_no_rotations_and_fit_some():
    positions = Positions(SKELETON)
    assert "rotations" not in positions.states
    quarter = quaternion.exp(torch.tensor([0.0, 0.0, math.pi / 2], dtype=torch.float64))
    rotations = quaternion.identity(1, 5, like=OFFSETS)
    rotations[:, 1] = quarter  # the spine bends: everything above it lies down
    fitted = positions.decode(positions.encode(rotations, OFFSETS), OFFSETS)
    torch.testing.assert_close(
        quaternion.angle(fitted, rotations), torch.zeros(1, 5).double(), atol=1e-9, rtol=0
    )


def test_a_dual_quaternion_has_both_steps_of_normalization_as_its_projection():
    raw = torch.tensor([[[2.0, 0, 0, 0, 6.0, 4.0, 0, 0]]], dtype=torch.float64)
    # 1 and 3, 2, 0, 0 after the division; the part along the real part, 3, is taken out.
    expected = torch.tensor([[[1.0, 0, 0, 0, 0, 2, 0, 0]]], dtype=torch.float64)
    one = DualQuaternion(Skeleton(("hips",), (-1,)))
    torch.testing.assert_close(one.project(raw), expected)
    # (4 - 1)^2 + (2 * 6)^2 of eq. 16
    assert one.penalty(raw) == 9 + 144


def test_what_every_representation_states():
    made = {kind: build_representation(kind, SKELETON) for kind in REPRESENTATIONS}
    assert {kind for kind, each in made.items() if "rotations" not in each.states} == {"positions"}
    assert {kind for kind, each in made.items() if "translations" in each.states} == {
        "positions",
        "dual_quaternion",
        "quaternion+positions",
        "ortho6d+positions",
        "quaternion+offsets",
        "ortho6d+offsets",
    }


@pytest.mark.parametrize("raw", [0.0, 1.0])
@pytest.mark.parametrize("representation", [Ortho6d(), Matrix()])
def test_degenerate_columns_become_a_rotation(representation, raw):
    """Zeros, and columns that are all parallel: the result is a rotation, stated and finite."""
    features = torch.full((2, 5, representation.joint_dim), raw, dtype=torch.float64)
    valid = representation.project(features)
    assert representation.penalty(valid) < 1e-20
    lengths = representation.decode(valid, OFFSETS).norm(dim=-1)
    torch.testing.assert_close(lengths, torch.ones_like(lengths))


def test_bones_of_zero_length_turn_nothing(generator):
    body = OFFSETS.clone()
    body[2:] = 0
    positions = Positions(SKELETON)
    fitted = positions.decode(positions.encode(poses(generator), body), body)
    still = quaternion.identity(76, 4, like=fitted)
    torch.testing.assert_close(fitted[:, 1:], still)
    codec = Codec(SKELETON, DualQuaternion(SKELETON))
    found = codec.representation.translations(
        codec.representation.encode(poses(generator), body), body
    )
    torch.testing.assert_close(found.norm(dim=-1)[:, 2:], torch.zeros(76, 3).double())


def test_a_turn_composed_with_a_turn_is_the_product_of_both(generator):
    rotations = poses(generator)
    first, second = rotations[:20], rotations[20:40]
    expected = quaternion.product(first, second)
    for each in (Quaternion(), AxisAngle(), Matrix(), Ortho6d()):
        both = each.compose(each.encode(first, OFFSETS), each.encode(second, OFFSETS))
        torch.testing.assert_close(
            quaternion.angle(each.decode(both, OFFSETS), expected),
            torch.zeros(20, 5).double(),
            atol=1e-7,
            rtol=0,
        )
    angles = torch.randn(20, 5, 3, generator=generator, dtype=torch.float64)
    torch.testing.assert_close(Euler().compose(angles, angles), 2 * angles)


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
    same = representation.compose(neutral, features)
    if representation == AxisAngle():  # pi about an axis and pi about its opposite are one turn
        same, features = (representation.decode(each, OFFSETS) for each in (same, features))
        assert (quaternion.angle(same, features) < 1e-7).all()
        return
    torch.testing.assert_close(same, features, atol=1e-12, rtol=1e-7)


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
