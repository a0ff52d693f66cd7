"""What a skeleton knows about its tree, and how it finds left and right by name."""

from __future__ import annotations

import pytest

from posecast.errors import SkeletonError
from posecast.skeleton import Skeleton


@pytest.fixture
def forest() -> Skeleton:
    """Two trees: a body with two arms, and a prop with one joint below its root."""
    return Skeleton(
        names=("Hips", "Spine", "LeftArm", "RightArm", "LeftHand", "Prop", "Tip"),
        parents=(-1, 0, 1, 1, 2, -1, 5),
    )


def test_levels_group_the_joints_of_all_trees_by_depth(forest):
    assert forest.roots == (0, 5)
    assert forest.depths == (0, 1, 2, 2, 3, 0, 1)
    assert forest.levels == ((0, 5), (1, 6), (2, 3), (4,))
    assert len(forest) == 7


def test_children_are_listed_in_order_and_leaves_have_none(forest):
    assert forest.children == ((1,), (2, 3), (4,), (), (), (6,), ())


def test_ancestors_go_from_the_parent_up_to_the_root(forest):
    assert forest.ancestors(4) == (2, 1, 0)
    assert forest.ancestors(0) == ()
    assert forest.ancestors(6) == (5,)


def test_a_joint_is_found_by_name(forest):
    assert forest.index("LeftHand") == 4
    with pytest.raises(SkeletonError, match=r"no joint is called 'lefthand'.*LeftHand"):
        forest.index("lefthand")


def test_a_selected_joint_hangs_from_its_nearest_ancestor_that_stays(forest):
    chosen = forest.select([4, 0, 3])
    assert chosen.names == ("Hips", "RightArm", "LeftHand")
    assert chosen.parents == (-1, 0, 0)


def test_a_selection_without_the_root_is_a_forest(forest):
    chosen = forest.select([2, 3, 4, 6])
    assert chosen.parents == (-1, -1, 0, -1)
    assert chosen.roots == (0, 1, 3)


def test_selecting_everything_changes_nothing(forest):
    assert forest.select(range(len(forest))) == forest


@pytest.mark.parametrize("joints", [[7], [-1, 2], [0, 100]])
def test_a_joint_that_does_not_exist_cannot_be_selected(forest, joints):
    with pytest.raises(SkeletonError, match="this skeleton has 0 to 6"):
        forest.select(joints)


def test_an_empty_selection_is_refused(forest):
    with pytest.raises(SkeletonError, match="at least one joint"):
        forest.select([])


@pytest.mark.parametrize(
    ("names", "parents", "message"),
    [
        (("a", "b"), (-1, 1), "a parent must come before its children"),
        (("a", "b"), (-1, -2), "a parent must come before its children"),
        (("a", "b"), (1, -1), "a parent must come before its children"),
        (("a", "b"), (-1,), "2 joint names but 1 parents"),
        ((), (), "at least one joint"),
        (("a", "b", "a"), (-1, 0, 0), r"found more than once: \['a'\]"),
    ],
)
def test_what_is_not_a_forest_of_named_joints_is_refused(names, parents, message):
    with pytest.raises(SkeletonError, match=message):
        Skeleton(names, parents)


def flat(*names: str) -> Skeleton:
    """A root with the named joints side by side below it."""
    return Skeleton(("Root", *names), (-1, *(0 for _ in names)))


PAIRS = [
    ("LeftFoot", "RightFoot"),
    ("lhip", "rhip"),
    ("Shoulder_L", "Shoulder_R"),
    ("L_Wrist_End", "R_Wrist_End"),
    ("LHipJoint", "RHipJoint"),
    ("LHIP", "RHIP"),
    ("lfemur", "rfemur"),
    ("lCollar", "rCollar"),
    ("leftEye", "rightEye"),
    ("l_hip", "r_hip"),
    ("hand.l", "hand.r"),
    ("thumb_l_01", "thumb_r_01"),
    ("Bip01 L Hand", "Bip01 R Hand"),
    ("handL", "handR"),
    ("LEFT_KNEE", "RIGHT_KNEE"),
    ("mixamorig:LeftUpLeg", "mixamorig:RightUpLeg"),
    ("LeftHand_LeftThumb", "RightHand_RightThumb"),
    ("LThumb", "RThumb"),
]


@pytest.mark.parametrize(("left", "right"), PAIRS)
def test_left_and_right_are_matched_by_name_in_either_order(left, right):
    assert flat(left, right).left_right_pairs == ((1, 2),)
    assert flat(right, left).left_right_pairs == ((2, 1),)


def test_all_spellings_together_give_each_joint_one_partner():
    assert len(PAIRS) == 18
    skeleton = flat(*(name for pair in PAIRS for name in pair))
    named = {
        (skeleton.names[left], skeleton.names[right]) for left, right in skeleton.left_right_pairs
    }
    assert named == set(PAIRS)
    assert len(skeleton.left_right_pairs) == len(PAIRS)


def test_words_that_merely_begin_with_l_have_no_side():
    middle = ("lowerback", "lowerneck", "LowerBack", "Spine", "Neck", "Lumbar", "L5", "cleft")
    skeleton = flat(*middle, "upperback", "rowerneck_end", "Rib")
    assert skeleton.left_right_pairs == ()
    assert skeleton.mirror_permutation == tuple(range(len(skeleton)))


def test_a_left_joint_without_a_twin_stays_alone():
    assert flat("LeftFoot", "RightHand").left_right_pairs == ()


def test_mirroring_the_joints_twice_gives_each_its_own_place(forest):
    assert forest.mirror_permutation == (0, 1, 3, 2, 4, 5, 6)
    swapped = forest.mirror_permutation
    assert tuple(swapped[joint] for joint in swapped) == tuple(range(len(forest)))
