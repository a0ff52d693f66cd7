"""The codec: motion to features and back, root channels, signs, statistics."""

from __future__ import annotations

import pytest
import torch

from posecast.errors import ConfigError, SkeletonError
from posecast.geometry import quaternion
from posecast.motion import Motion
from posecast.representation import (
    REPRESENTATIONS,
    Codec,
    Quaternion,
    Statistics,
    build_representation,
)
from posecast.skeleton import Skeleton

SKELETON = Skeleton(("hips", "spine", "head"), (-1, 0, 1))


@pytest.fixture
def motion(generator):
    """Two smooth motions of nine frames, with a travelling root."""
    speed = torch.randn(2, 1, 3, 3, generator=generator, dtype=torch.float64)
    start = torch.randn(2, 1, 3, 3, generator=generator, dtype=torch.float64)
    time = torch.arange(9, dtype=torch.float64)[:, None, None] / 10
    return Motion(
        rotations_local=quaternion.exp(start + speed * time),
        root_positions=torch.randn(2, 9, 3, generator=generator, dtype=torch.float64),
        offsets=torch.randn(2, 3, 3, generator=generator, dtype=torch.float64),
    )


def same_rotations(left, right):
    return quaternion.angle(left, right).max() < 1e-7


def test_features_are_joints_then_root_channels(motion):
    codec = Codec(SKELETON, Quaternion(), root="displacement")
    features = codec.encode(motion)
    assert (codec.joint_features, codec.root_dim, codec.feature_dim) == (12, 3, 15)
    assert features.shape == (2, 9, 15)
    joints, root, _ = codec.split(features)
    assert joints.shape == (2, 9, 3, 4)
    assert root.shape == (2, 9, 3)
    torch.testing.assert_close(codec.merge(joints, root), features)
    torch.testing.assert_close(features[..., 4:8], joints[:, :, 1])


def test_without_root_channels_there_are_only_joints(motion):
    codec = Codec(SKELETON, Quaternion())
    features = codec.encode(motion)
    assert features.shape == (2, 9, 12)
    assert codec.split(features).root.shape == (2, 9, 0)


def test_the_height_is_absolute_and_the_rest_is_differences(motion):
    root = Codec(SKELETON, Quaternion(), root="displacement").encode(motion)[..., 12:]
    positions = motion.root_positions
    torch.testing.assert_close(root[..., 1], positions[..., 1])
    torch.testing.assert_close(root[:, 4, 0], positions[:, 4, 0] - positions[:, 3, 0])
    torch.testing.assert_close(root[:, 4, 2], positions[:, 4, 2] - positions[:, 3, 2])


def test_the_first_displacement_repeats_the_second_and_a_single_frame_stands_still(motion):
    codec = Codec(SKELETON, Quaternion(), root="displacement")
    root = codec.split(codec.encode(motion)).root
    torch.testing.assert_close(root[:, 0, [0, 2]], root[:, 1, [0, 2]])
    single = Motion(motion.rotations_local[:, :1], motion.root_positions[:, :1], motion.offsets)
    only = codec.split(codec.encode(single)).root
    assert (only[..., [0, 2]] == 0).all()


def test_decoding_continues_from_the_anchor(motion):
    codec = Codec(SKELETON, Quaternion(), root="displacement")
    later = codec.encode(motion)[:, 4:]
    again = codec.decode(later, offsets=motion.offsets, anchor=motion.root_positions[:, 3])
    torch.testing.assert_close(again.root_positions, motion.root_positions[:, 4:])
    assert same_rotations(again.rotations_local, motion.rotations_local[:, 4:])
    assert again.offsets is motion.offsets


def test_without_root_channels_the_root_is_held_at_the_anchor(motion):
    codec = Codec(SKELETON, Quaternion())
    anchor = motion.root_positions[:, 3]
    again = codec.decode(codec.encode(motion), offsets=motion.offsets, anchor=anchor)
    assert again.root_positions.shape == (2, 9, 3)
    assert (again.root_positions == anchor[:, None]).all()


def test_signs_do_not_depend_on_those_that_came_in(motion, generator):
    codec = Codec(SKELETON, Quaternion())
    signs = torch.randint(0, 2, (2, 9, 3, 1), generator=generator) * 2.0 - 1
    flipped = motion._replace(rotations_local=motion.rotations_local * signs)
    assert not torch.equal(flipped.rotations_local, motion.rotations_local)
    torch.testing.assert_close(codec.encode(flipped), codec.encode(motion))


def test_signs_are_continuous_and_start_with_a_real_part_that_is_not_negative(motion):
    codec = Codec(SKELETON, Quaternion())
    away = motion._replace(rotations_local=-motion.rotations_local)
    joints = codec.split(codec.encode(away)).joints
    assert (joints[:, 0, :, 0] >= 0).all()
    assert ((joints[:, 1:] * joints[:, :-1]).sum(-1) > 0).all()


def test_encoding_changes_neither_its_argument_nor_its_precision(motion):
    codec = Codec(SKELETON, Quaternion(), root="displacement")
    before = motion.map(torch.clone)
    assert codec.encode(motion).dtype == torch.float64
    for part, copy in zip(motion[:3], before[:3], strict=True):
        assert torch.equal(part, copy)
    single = motion.map(torch.Tensor.float)
    assert codec.encode(single).dtype == torch.float32


def test_statistics_agree_with_those_of_all_frames_at_once(motion):
    codec = Codec(SKELETON, Quaternion(), root="displacement")
    features = codec.encode(motion).flatten(0, 1)
    mean, deviation = codec.measure([motion])
    torch.testing.assert_close(mean, features.mean(0))
    torch.testing.assert_close(deviation, features.std(0, correction=0))
    halves = motion.split(1)
    torch.testing.assert_close(codec.measure(halves).scale, deviation)
    variance = codec.measure([motion], divide_by="variance").scale
    torch.testing.assert_close(variance, deviation.square())


def test_a_feature_that_does_not_move_is_not_scaled(motion):
    still = motion._replace(rotations_local=motion.rotations_local[:, :1].expand(-1, 9, -1, -1))
    one = still.split(1)[0]
    assert (Codec(SKELETON, Quaternion()).measure([one]).scale == 1).all()


def test_statistics_of_nothing_are_refused():
    with pytest.raises(ConfigError, match="no frames"):
        Codec(SKELETON, Quaternion()).measure([])


def test_statistics_of_the_wrong_size_are_refused():
    wrong = Statistics(torch.zeros(12), torch.ones(11))
    with pytest.raises(ConfigError, match=r"scale has \(11,\) values; expected 12"):
        Codec(SKELETON, Quaternion(), statistics=wrong)


def test_a_motion_of_another_skeleton_is_refused(motion):
    fewer = Motion(motion.rotations_local[:, :, :2], motion.root_positions, motion.offsets[:, :2])
    with pytest.raises(SkeletonError, match="motion of 2 joints; expected the 3 joints"):
        Codec(SKELETON, Quaternion()).encode(fewer)


# The root is not written: the two joints above and below the middle one are roots of a forest.
LIMBS = Skeleton(("hips", "left", "right", "foot", "toe"), (-1, 0, 0, 1, 3))


def of_limbs(kind, generator, joints=(1, 2, 3), root="none"):
    speed, start = torch.randn(2, 2, 1, 5, 3, generator=generator, dtype=torch.float64)
    time = torch.arange(6, dtype=torch.float64)[:, None, None] / 10
    motion = Motion(
        quaternion.exp(start + speed * time),
        torch.randn(2, 6, 3, generator=generator, dtype=torch.float64),
        torch.randn(2, 5, 3, generator=generator, dtype=torch.float64),
    )
    written = LIMBS.select(joints)
    return Codec(LIMBS, build_representation(kind, written), root=root, joints=joints), motion


@pytest.mark.parametrize("kind", sorted(set(REPRESENTATIONS) - {"positions"}))
def test_joints_that_are_not_written_stay_as_they_were(kind, generator):
    codec, motion = of_limbs(kind, generator, root="displacement")
    assert codec.written == Skeleton(("left", "right", "foot"), (-1, -1, 0))
    features = codec.encode(motion)
    assert features.shape[-1] == 3 * codec.representation.joint_dim + 3 == codec.feature_dim
    found = codec.decode(
        features[:, 1:],
        offsets=motion.offsets,
        anchor=motion.root_positions[:, 0],
        held=motion.rotations_local[:, 0],
    )
    wanted = motion.rotations_local[:, 1:].clone()
    wanted[:, :, [0, 4]] = motion.rotations_local[:, :1, [0, 4]]
    assert same_rotations(found.rotations_local, wanted)
    torch.testing.assert_close(found.root_positions, motion.root_positions[:, 1:])
    if found.translations_local is not None:
        unchanged = motion.offsets[:, None].expand(-1, 5, -1, -1)
        torch.testing.assert_close(found.translations_local, unchanged)


def test_joints_that_nobody_holds_are_not_turned(generator):
    codec, motion = of_limbs("quaternion", generator)
    found = codec.decode(codec.encode(motion), offsets=motion.offsets, anchor=torch.zeros(2, 3))
    rest = found.rotations_local[:, :, [0, 4]]
    assert torch.equal(rest, quaternion.identity(2, 6, 2, like=rest))


def test_statistics_are_of_the_joints_that_are_written(generator):
    codec, motion = of_limbs("quaternion", generator)
    assert codec.measure([motion]).mean.shape == (12,)
    with pytest.raises(ConfigError, match="mean has"):
        Codec(
            LIMBS,
            Quaternion(),
            joints=(1, 2, 3),
            statistics=Statistics(torch.zeros(20), torch.ones(20)),
        )


def test_joints_out_of_order_are_refused():
    with pytest.raises(ConfigError, match=r"codec.joints: \[2, 1\]; expected indices in order"):
        Codec(LIMBS, Quaternion(), joints=(2, 1))


def test_the_action_of_a_motion_is_a_one_among_zeros_in_every_frame(motion):
    codec = Codec(SKELETON, Quaternion(), root="displacement", actions=("walk", "sit", "run"))
    features = codec.encode(motion._replace(actions=("run", "walk")))
    assert features.shape == (2, 9, 18)
    assert features[0, :, 15:].tolist() == [[0, 0, 1]] * 9
    assert features[1, :, 15:].tolist() == [[1, 0, 0]] * 9
    parts = codec.split(features)
    torch.testing.assert_close(codec.merge(*parts), features)
    plain = Codec(SKELETON, Quaternion(), root="displacement")
    torch.testing.assert_close(features[..., :15], plain.encode(motion))
    given = {"offsets": motion.offsets, "anchor": motion.root_positions[:, 0]}
    torch.testing.assert_close(
        codec.decode(features, **given).root_positions,
        plain.decode(features[..., :15], **given).root_positions,
    )


@pytest.mark.parametrize(
    ("actions", "message"),
    [
        (("walk", "wlak"), "action 'wlak' is unknown; did you mean 'walk'"),
        (("walk", ""), "no action is given; known: sit, walk"),
        (None, "no action is given; known: sit, walk"),
    ],
)
def test_an_action_that_is_not_listed_is_refused(motion, actions, message):
    codec = Codec(SKELETON, Quaternion(), actions=("walk", "sit"))
    with pytest.raises(ConfigError, match=message):
        codec.encode(motion._replace(actions=actions))


def test_actions_are_not_standardized(motion):
    codec = Codec(SKELETON, Quaternion(), actions=("walk", "sit"))
    for divide_by in ("deviation", "variance"):
        found = codec.measure([motion._replace(actions=("sit", "walk"))], divide_by=divide_by)
        assert (found.mean[-2:].tolist(), found.scale[-2:].tolist()) == ([0, 0], [1, 1])
        assert (found.mean[:-2] != 0).all()
