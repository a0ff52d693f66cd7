"""The named skeletons agree with the tables of the papers and data sets they come from."""

from __future__ import annotations

import pytest
import torch

from posecast.errors import SkeletonError
from posecast.skeleton.catalog import named_skeleton, skeleton_names

NAMES = ("cmu-31", "h36m-21", "h36m-32", "smpl-15", "smpl-22", "smpl-24")


def test_the_catalog_holds_exactly_the_skeletons_listed_here():
    assert skeleton_names() == NAMES


@pytest.mark.parametrize("name", NAMES)
def test_a_name_tells_the_number_of_joints(name):
    entry = named_skeleton(name)
    assert len(entry.skeleton) == int(name.rpartition("-")[2])
    assert len(entry.joints) == len(entry.skeleton)
    assert entry.name == name


@pytest.mark.parametrize("name", NAMES)
def test_every_joint_with_a_side_has_a_twin_on_the_other(name):
    skeleton = named_skeleton(name).skeleton
    paired = {joint for pair in skeleton.left_right_pairs for joint in pair}
    middle = [skeleton.names[joint] for joint in range(len(skeleton)) if joint not in paired]
    sides = ("Left", "Right", "LHip", "RHip", "LThumb", "RThumb", "L_", "R_", "l_", "r_")
    assert len(paired) >= 10
    assert [joint for joint in middle if joint.startswith(sides)] == []


@pytest.mark.parametrize("name", NAMES)
def test_a_selection_keeps_the_order_and_the_names_of_its_whole(name):
    entry = named_skeleton(name)
    whole = named_skeleton(entry.whole)
    assert list(entry.joints) == sorted(set(entry.joints))
    assert entry.skeleton.names == tuple(whole.skeleton.names[joint] for joint in entry.joints)


def test_h36m_has_the_parents_of_the_reference_table():
    parents = (-1, 0, 1, 2, 3, 4, 0, 6, 7, 8, 9, 0, 11, 12, 13, 14, 12, 16, 17, 18, 19, 20, 19, 22)
    assert named_skeleton("h36m-32").skeleton.parents == (*parents, 12, 24, 25, 26, 27, 28, 27, 30)


def test_h36m_offsets_are_metres_with_the_right_hand_on_the_negative_x_side():
    entry = named_skeleton("h36m-32")
    offsets, skeleton = entry.offsets(), entry.skeleton
    assert offsets.dtype == torch.float64
    assert offsets[skeleton.index("LeftLeg")].tolist() == pytest.approx([0, -0.442894413, 0])
    assert offsets[skeleton.index("RightUpLeg"), 0].item() == pytest.approx(-0.132948591)
    assert offsets[skeleton.index("LeftToeBase"), 2].item() == pytest.approx(0.162767426)
    assert offsets.norm(dim=-1).sum().item() == pytest.approx(5.577289955)


def test_the_21_joints_of_h36m_are_those_aksan_et_al_predict():
    entry = named_skeleton("h36m-21")
    assert entry.joints == (
        *range(5),
        *range(6, 10),
        *range(11, 15),
        *range(16, 20),
        *range(24, 28),
    )
    assert entry.skeleton.parents == (
        (-1, 0, 1, 2, 3, 0, 5, 6, 7, 0, 9, 10, 11, 10, 13, 14, 15, 10, 17, 18, 19)
    )
    whole = named_skeleton("h36m-32").offsets()
    torch.testing.assert_close(entry.offsets(), whole[list(entry.joints)], rtol=0, atol=0)


def test_cmu_has_the_parents_and_the_unit_of_the_reference_table():
    entry = named_skeleton("cmu-31")
    legs, spine = (-1, 0, 1, 2, 3, 4, 0, 6, 7, 8, 9), (0, 11, 12, 13, 14, 15)
    arms = (13, 17, 18, 19, 20, 21, 20, 13, 24, 25, 26, 27, 28, 27)
    assert entry.skeleton.parents == legs + spine + arms
    thigh = entry.offsets()[entry.skeleton.index("LeftLeg")].norm().item()
    assert thigh == pytest.approx(7.157799 * 0.0254 / 0.45, rel=1e-6)
    assert int((entry.offsets().norm(dim=-1) == 0).sum()) == 11


def test_the_15_smpl_joints_form_the_forest_of_the_structured_prediction_layer():
    entry = named_skeleton("smpl-15")
    assert entry.joints == (1, 2, 3, 4, 5, 6, 9, 12, 13, 14, 15, 16, 17, 18, 19)
    assert entry.skeleton.parents == (-1, -1, -1, 0, 1, 2, 5, 6, 6, 6, 7, 8, 9, 11, 12)


def test_the_22_smpl_joints_are_the_first_22_of_24():
    assert named_skeleton("smpl-22").joints == tuple(range(22))


@pytest.mark.parametrize("name", ["smpl-15", "smpl-22", "smpl-24"])
def test_smpl_skeletons_carry_no_numbers_of_the_body_model(name):
    entry = named_skeleton(name)
    assert entry.rest_offsets is None
    with pytest.raises(SkeletonError, match="bring a template"):
        entry.offsets()


def test_an_unknown_name_is_answered_with_the_nearest_and_all_known_names():
    with pytest.raises(SkeletonError, match=r"did you mean 'h36m-32'.*smpl-24"):
        named_skeleton("h36m_32")
