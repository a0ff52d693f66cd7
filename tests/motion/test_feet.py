"""Feet are found on every usual skeleton, by name, and without names by how a body stands."""

from __future__ import annotations

from collections.abc import Sequence

import pytest
import torch
from torch import Tensor

from posecast.corpora.gait.body import CAST, SKELETON
from posecast.errors import SkeletonError
from posecast.motion import Feet, find_feet, leg_length
from posecast.skeleton import Skeleton, named_skeleton

SIDES = (("Left", "Right"), ("left", "right"), ("L", "R"), ("l", "r"))

VOCABULARIES = {
    # hip, knee, ankle, toes with {} for the side, and how it writes left and right
    "motionbuilder": ("{}UpLeg {}Leg {}Foot {}ToeBase", 0),
    "mixamo": ("mixamorig:{}UpLeg mixamorig:{}Leg mixamorig:{}Foot mixamorig:{}ToeBase", 0),
    "3ds-max": ("{}Hip {}Knee {}Ankle {}Toe", 0),
    "xsens": ("{}UpperLeg {}LowerLeg {}Foot {}Toe", 0),
    "smpl": ("{}_hip {}_knee {}_ankle {}_foot", 1),
    "bandai": ("UpperLeg_{} LowerLeg_{} Foot_{} Toes_{}", 2),
    "biped": ("Bip01|{}|Thigh Bip01|{}|Calf Bip01|{}|Foot Bip01|{}|Toe0", 2),
    "unreal": ("thigh_{} calf_{} foot_{} ball_{}", 3),
    "asf": ("{}femur {}tibia {}foot {}toes", 3),
    "opensim": ("femur_{} tibia_{} talus_{} toes_{}", 3),
}
LEG = ((0.1, -0.05, 0.0), (0.0, -0.42, 0.0), (0.0, -0.4, 0.0), (0.0, -0.08, 0.13))


def body(left: Sequence[str], right: Sequence[str]) -> tuple[Skeleton, Tensor]:
    """A trunk and two legs of these names, the right one first."""
    names, parents, offsets = ["Hips", "Spine", "Head"], [-1, 0, 1], [[0, 0, 0], [0, 0.25, 0]]
    offsets.append([0, 0.4, 0])
    for leg, sign in ((right, -1), (left, 1)):
        for place, name in enumerate(leg):
            parents.append(len(names) - 1 if place else 0)
            names.append(name)
            x, y, z = LEG[place]
            offsets.append([sign * x, y, z])
    return Skeleton(tuple(names), tuple(parents)), torch.tensor(offsets, dtype=torch.float64)


def names_of(skeleton: Skeleton, feet: Feet) -> list[tuple[str, str]]:
    return [(skeleton.names[left], skeleton.names[right]) for left, right in feet]


def nameless(skeleton: Skeleton) -> Skeleton:
    return Skeleton(tuple(f"joint {j}" for j in range(len(skeleton))), skeleton.parents)


@pytest.mark.parametrize("kind", VOCABULARIES)
def test_feet_are_found_by_the_usual_names(kind: str) -> None:
    words, spelling = VOCABULARIES[kind]
    left, right = (
        [word.replace("|", " ").format(s) for word in words.split()] for s in SIDES[spelling]
    )
    skeleton, offsets = body(left, right)
    assert names_of(skeleton, find_feet(skeleton, offsets)) == list(zip(left, right, strict=True))
    assert leg_length(skeleton, offsets, find_feet(skeleton, offsets)) == pytest.approx(0.82)


def test_names_come_before_geometry() -> None:
    """A rest pose with all bones along x says nothing of standing; swapped offsets mislead."""
    words = ["UpperLeg_{}", "LowerLeg_{}", "Foot_{}", "Toes_{}"]
    left, right = ([word.format(side) for word in words] for side in "LR")
    skeleton, offsets = body(left, right)
    for lying in (offsets[:, [1, 0, 2]], offsets * torch.tensor([-1.0, 1.0, 1.0]).double()):
        found = names_of(skeleton, find_feet(skeleton, lying))
        assert found == list(zip(left, right, strict=True))


@pytest.mark.parametrize("name", ["cmu-31", "h36m-32", "h36m-21"])
def test_zero_length_bones_and_end_sites_do_not_mislead(name: str) -> None:
    named = named_skeleton(name)
    feet = find_feet(named.skeleton, named.offsets())
    words = ("UpLeg", "Leg", "Foot", "ToeBase")
    assert names_of(named.skeleton, feet) == [(f"Left{word}", f"Right{word}") for word in words]


def test_the_leg_of_the_published_body_is_as_long_as_its_bones() -> None:
    named = named_skeleton("cmu-31")
    thigh, shin = 2.44811**2 + 6.72613**2, 2.56220**2 + 7.03959**2
    other = 2.54253**2 + 6.98555**2, 2.56826**2 + 7.05623**2
    units = (thigh**0.5 + shin**0.5 + other[0] ** 0.5 + other[1] ** 0.5) / 2
    feet = find_feet(named.skeleton, named.offsets())
    length = leg_length(named.skeleton, named.offsets(), feet)
    assert length == pytest.approx(units * 2.54 / 0.45 / 100, abs=1e-9)


@pytest.mark.parametrize("person", CAST, ids=lambda person: person.name)
def test_the_generated_bodies_have_legs_as_planned(person) -> None:
    feet = find_feet(SKELETON, person.offsets)
    assert leg_length(SKELETON, person.offsets, feet) == pytest.approx(person.leg)
    assert find_feet(nameless(SKELETON), person.offsets) == feet


def test_a_foot_without_toes_ends_at_the_ankle() -> None:
    left, right = ([f"{s}Thigh", f"{s}Shin", f"{s}Foot"] for s in "lr")
    skeleton, offsets = body(left, right)
    feet = find_feet(skeleton, offsets)
    assert feet.toes == feet.ankles
    assert find_feet(nameless(skeleton), offsets) == feet


def test_targets_of_inverse_kinematics_are_not_feet() -> None:
    left, right = ([f"{word}_{s}" for word in ("thigh", "calf", "foot", "ball")] for s in "lr")
    skeleton, offsets = body(left, right)
    count = len(skeleton)
    aids = ("ik_foot_root", "ik_foot_l", "ik_foot_r")
    skeleton = Skeleton((*skeleton.names, *aids), (*skeleton.parents, 0, count, count))
    offsets = torch.cat([offsets, torch.tensor([[0.0, -0.9, 0], [0.1, 0, 0], [-0.1, 0, 0]])])
    assert names_of(skeleton, find_feet(skeleton, offsets)) == list(zip(left, right, strict=True))


@pytest.mark.parametrize("quarter", [0, 1, 2, 3])
def test_without_names_left_is_left_of_where_the_toes_point(quarter: int) -> None:
    left, right = (["h" + s, "k" + s, "a" + s, "t" + s] for s in ("1", "2"))
    skeleton, offsets = body(left, right)
    for _ in range(quarter):
        offsets = torch.stack([offsets[:, 2], offsets[:, 1], -offsets[:, 0]], dim=-1)
    assert names_of(skeleton, find_feet(skeleton, offsets)) == list(zip(left, right, strict=True))


def test_several_toes_on_a_foot_are_one_foot() -> None:
    left, right = (["h" + s, "k" + s, "a" + s, "t" + s] for s in ("1", "2"))
    skeleton, offsets = body(left, right)
    ankle = skeleton.index("a1")
    skeleton = Skeleton((*skeleton.names, "u1"), (*skeleton.parents, ankle))
    offsets = torch.cat([offsets, torch.tensor([[0.05, -0.081, 0.1]]).double()])
    feet = find_feet(skeleton, offsets)
    assert names_of(skeleton, feet._replace(toes=feet.ankles))[:3] == [
        ("h1", "h2"),
        ("k1", "k2"),
        ("a1", "a2"),
    ]


@pytest.mark.parametrize("shape", ["lying", "one leg", "no legs", "one leg up"])
def test_a_body_without_recognizable_feet_is_refused(shape: str) -> None:
    left, right = (["h" + s, "k" + s, "a" + s, "t" + s] for s in ("1", "2"))
    skeleton, offsets = body(left, right)
    if shape == "lying":
        offsets = offsets[:, [1, 0, 2]]
    elif shape == "one leg":
        skeleton = skeleton.select(range(7))
        offsets = offsets[:7]
    elif shape == "no legs":
        skeleton, offsets = skeleton.select(range(3)), offsets[:3]
    else:
        offsets[8:10] = offsets[8:10] * -1
    message = r"(?s)looked for joints called ankle, foot or talus.*this skeleton has Hips, Spine"
    with pytest.raises(SkeletonError, match=message):
        find_feet(skeleton, offsets)


def test_a_leg_without_length_is_refused() -> None:
    skeleton, offsets = body(*([f"{s}{w}" for w in ("UpLeg", "Leg", "Foot")] for s in SIDES[0]))
    feet = find_feet(skeleton, offsets)
    with pytest.raises(SkeletonError, match=r"'LeftUpLeg' to 'LeftFoot' have length 0\.0 m"):
        leg_length(skeleton, 0 * offsets, feet)
