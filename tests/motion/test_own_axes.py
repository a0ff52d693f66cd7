"""Mirror images on the skeleton's own axes: exact in the world, on the same bones."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from posecast.corpora.synthetic import make_clip
from posecast.errors import SkeletonError
from posecast.geometry import quaternion
from posecast.motion import Clip, mirror, turn
from posecast.motion.own_axes import mirror_on_own_axes
from posecast.skeleton.kinematics import joint_positions

HALF_TURNS = torch.eye(4, dtype=torch.float64)


@pytest.fixture(scope="module")
def walked() -> Clip:
    """A walk on a symmetric body, not along an axis of the world."""
    return turn(make_clip(0, fps=30, seconds=3), 0.7)


def on_other_axes(clip: Clip) -> Clip:
    """The same motion with the axes of joints turned: by side, and from joint to joint."""
    rotations, offsets = clip.rotations_local.clone(), clip.offsets.clone()
    changes = [_axes(name, joint) for joint, name in enumerate(clip.skeleton.names)]
    for joint, parent in enumerate(clip.skeleton.parents):
        if parent >= 0:
            back = quaternion.conjugate(changes[parent])
            rotations[:, joint] = quaternion.product(back, rotations[:, joint])
            offsets[joint] = quaternion.rotate(back, offsets[joint])
        rotations[:, joint] = quaternion.product(rotations[:, joint], changes[joint])
    return replace(clip, rotations_local=rotations, offsets=offsets)


def _axes(name: str, joint: int) -> torch.Tensor:
    """How the axes of a joint are turned: on the left not, in the middle x along the spine."""
    if "Left" in name:
        return HALF_TURNS[0]
    return HALF_TURNS[1 + joint % 3] if "Right" in name else HALF_TURNS[[0, 3]].sum(0) / 2**0.5


def positions(clip: Clip) -> torch.Tensor:
    return joint_positions(clip.skeleton, clip.rotations_local, clip.offsets, clip.root_positions)


def test_on_a_body_with_mirrored_axes_it_is_the_mirror_image(walked):
    image, own = mirror(walked), mirror_on_own_axes(walked)
    assert quaternion.angle(image.rotations_local, own.rotations_local).max() < 1e-9
    torch.testing.assert_close(own.offsets, image.offsets)


def test_whatever_the_axes_bones_stay_and_places_are_reflected(walked):
    clip = on_other_axes(walked)
    torch.testing.assert_close(positions(clip), positions(walked))
    own = mirror_on_own_axes(clip)
    torch.testing.assert_close(positions(own), positions(mirror(walked)))
    assert (mirror(clip).offsets - clip.offsets).abs().max() > 0.1
    torch.testing.assert_close(own.offsets, clip.offsets)
    assert own.labels["mirrored"] == "yes"


def test_whatever_the_axes_rotations_are_those_of_the_mirrored_body(walked):
    expected = on_other_axes(mirror(walked))
    found = mirror_on_own_axes(on_other_axes(walked))
    assert quaternion.angle(expected.rotations_local, found.rotations_local).max() < 1e-6


def test_bones_stay_where_one_side_moves_unlike_the_other(walked):
    raised = walked.rotations_local.clone()
    arm = walked.skeleton.names.index("LeftArm")
    bone = walked.offsets[walked.skeleton.children[arm][0]]
    aside = torch.linalg.cross(bone, torch.tensor([0.3, 0.2, 0.9]).double())
    about = quaternion.about_axis(aside, torch.tensor(2.6).double())
    raised[:, arm] = quaternion.product(raised[:, arm], about)
    clip = on_other_axes(replace(walked, rotations_local=raised))
    own = mirror_on_own_axes(clip)
    torch.testing.assert_close(own.offsets, clip.offsets)
    torch.testing.assert_close(positions(own), positions(mirror(clip)))


def test_a_body_that_is_not_symmetric_is_refused(walked):
    offsets = walked.offsets.clone()
    left, _ = walked.skeleton.left_right_pairs[1]
    offsets[left] *= 1.5
    with pytest.raises(SkeletonError, match="give a symmetric body, or do without mirrored clips"):
        mirror_on_own_axes(replace(walked, offsets=offsets))
