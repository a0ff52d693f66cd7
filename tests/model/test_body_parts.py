"""Which joints are torso, arms and legs: by name and tree, or as told."""

from __future__ import annotations

import pytest

from posecast.errors import ConfigError
from posecast.model import BodyParts
from posecast.skeleton import Skeleton
from posecast.skeleton.catalog import named_skeleton

SMALL = Skeleton(
    ("hips", "left_arm", "right_arm", "left_leg", "right_leg", "tail"), (-1, 0, 0, 0, 0, 0)
)
TOLD = {
    "torso": ["hips", "tail"],
    "left_arm": ["left_arm"],
    "right_arm": ["right_arm"],
    "left_leg": ["left_leg"],
    "right_leg": ["right_leg"],
}


def named(skeleton, joints):
    return [skeleton.names[joint] for joint in joints]


@pytest.mark.parametrize(
    ("name", "torso", "left_arm", "right_leg"),
    [
        (
            "h36m-21",
            "Hips Spine Spine1 Neck Head",
            "LeftShoulder LeftArm LeftForeArm LeftHand",
            "RightUpLeg RightLeg RightFoot RightToeBase",
        ),
        (
            "h36m-32",
            "Hips Spine Spine1 Neck Head HeadSite",
            "LeftShoulder LeftArm LeftForeArm LeftHand LeftHandThumb LeftHandThumbSite L_Wrist_End "
            "L_Wrist_EndSite",
            "RightUpLeg RightLeg RightFoot RightToeBase RightToeBaseSite",
        ),
        (
            "cmu-31",
            "Hips LowerBack Spine Spine1 Neck Neck1 Head",
            "LeftShoulder LeftArm LeftForeArm LeftHand LeftFingerBase LeftHandIndex1 LThumb",
            "RHipJoint RightUpLeg RightLeg RightFoot RightToeBase",
        ),
        # A forest: no pelvis.
        (
            "smpl-15",
            "spine1 spine2 spine3 neck head",
            "l_collar l_shoulder l_elbow",
            "r_hip r_knee",
        ),
    ],
)
def test_parts_are_found_by_name(name, torso, left_arm, right_leg):
    skeleton = named_skeleton(name).skeleton
    body = BodyParts.of(skeleton)
    assert named(skeleton, body.torso) == torso.split()
    assert named(skeleton, body.arms[0]) == left_arm.split()
    assert named(skeleton, body.legs[1]) == right_leg.split()
    assert sorted(body.joints) == list(range(len(skeleton)))
    for sides in (body.arms, body.legs):
        assert set(zip(*sides, strict=True)) <= set(skeleton.left_right_pairs)


def test_what_hangs_from_a_limb_is_of_it_and_other_pairs_are_of_the_torso():
    names = ("hips", "eyeL", "eyeR", "handL", "nub", "handR", "nub2", "footL", "footR", "pinkyL")
    skeleton = Skeleton((*names, "pinkyR"), (-1, 0, 0, 0, 3, 0, 5, 0, 0, 3, 5))
    body = BodyParts.of(skeleton)
    assert named(skeleton, body.torso) == ["hips", "eyeL", "eyeR"]
    assert named(skeleton, body.arms[0]) == ["handL", "nub", "pinkyL"]
    assert named(skeleton, body.arms[1]) == ["handR", "nub2", "pinkyR"]


def test_twins_correspond_where_the_sides_are_in_different_orders():
    names = ("hips", "lhand", "lthumb", "lwrist", "rwrist", "rhand", "rthumb", "lfoot", "rfoot")
    skeleton = Skeleton(names, (-1, 0, 1, 0, 0, 0, 5, 0, 0))
    left, right = BodyParts.of(skeleton).arms
    assert named(skeleton, left) == ["lhand", "lthumb", "lwrist"]
    assert named(skeleton, right) == ["rhand", "rthumb", "rwrist"]


def test_parts_may_be_told_and_keep_the_order_they_are_told_in():
    skeleton = Skeleton(tuple("abcdefg"), (-1, 0, 0, 0, 0, 0, 0))
    parts = {"torso": ["b"], "left_arm": ["d", "a"], "right_arm": ["c", "e"]}
    body = BodyParts.of(skeleton, {**parts, "left_leg": ["g"], "right_leg": ["f"]})
    assert body == BodyParts((1,), ((3, 0), (2, 4)), ((6,), (5,)))
    assert body.joints == (1, 3, 0, 2, 4, 6, 5)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"torso": ["hips"]}, "parts: tail in none; every joint that is written belongs to a part"),
        ({"torso": ["hips", "tial"]}, r"parts\.torso: no joint is called 'tial'; did you mean 't"),
        ({"left_leg": ["left_leg", "tail"]}, "parts: tail is in torso and left_leg; a joint bel"),
        ({"torso": ["hips", "tail", "tail"]}, "parts: tail is in torso and torso"),
        ({"spine": []}, "parts: no part is called 'spine'; "),
        (
            {"torso": ["hips", "tail", "left_leg"], "left_leg": []},
            "parts: no joint of left_leg is given; choose joints by name for each of torso, left_a",
        ),
        (
            {"torso": ["hips"], "right_leg": ["right_leg", "tail"]},
            "parts: left_leg has 1 joints, right_leg 2; they share weights: choose equally many",
        ),
    ],
)
def test_parts_that_do_not_fit_are_refused_in_one_line(change, message):
    with pytest.raises(ConfigError, match=message) as caught:
        BodyParts.of(SMALL, {**TOLD, **change})
    assert "\n" not in str(caught.value)
    assert BodyParts.of(SMALL, TOLD) == BodyParts.of(SMALL)


def test_names_that_say_too_little_are_refused_in_one_line():
    skeleton = Skeleton(("hips", "left", "right", "left_foot", "right_foot"), (-1, 0, 0, 0, 0))
    with pytest.raises(ConfigError, match="no joint of left_arm, right_arm is among the names"):
        BodyParts.of(skeleton)
    uneven = Skeleton((*SMALL.names, "nub"), (*SMALL.parents, 1))
    with pytest.raises(ConfigError, match="left_arm has 2 joints, right_arm 1"):
        BodyParts.of(uneven)
