"""Positions for streams are those of forward kinematics."""

from __future__ import annotations

import pytest
import torch
from tests.references.plain_kinematics import plain_positions

from posecast.errors import SkeletonError
from posecast.geometry import quaternion
from posecast.skeleton import BodyKinematics, Skeleton, joint_positions, named_skeleton

TREES = {
    "one joint": (-1,),
    "chain": tuple(range(-1, 19)),
    "star": (-1, *[0] * 6),
    "forest": (-1, 0, 1, -1, 3, 3, 0, -1),
}


def body(parents, generator):
    skeleton = Skeleton(tuple(f"joint {number}" for number in range(len(parents))), parents)
    offsets = torch.randn(len(parents), 3, generator=generator, dtype=torch.float64)
    return skeleton, offsets


def poses(joints, generator, *batch):
    rotations = torch.randn(*batch, joints, 4, generator=generator, dtype=torch.float64)
    roots = torch.randn(*batch, 3, generator=generator, dtype=torch.float64)
    return quaternion.normalize(rotations), roots


@pytest.mark.parametrize("batch", [(), (1,), (3, 2), (0,)], ids=str)
@pytest.mark.parametrize("tree", TREES)
def test_joints_are_where_a_plain_loop_puts_them(tree, batch, generator):
    skeleton, offsets = body(TREES[tree], generator)
    rotations, roots = poses(len(skeleton), generator, *batch)
    place = BodyKinematics(skeleton, offsets)
    for at in (roots, None):
        wanted = plain_positions(skeleton.parents, rotations, offsets, at)
        torch.testing.assert_close(place(rotations, at), wanted, atol=1e-12, rtol=0)


def test_both_kinematics_of_the_library_agree_in_single_precision(generator):
    skeleton = named_skeleton("cmu-31").skeleton
    offsets = 0.2 * torch.randn(31, 3, generator=generator)
    rotations, roots = poses(31, generator, 4)
    found = BodyKinematics(skeleton, offsets)(rotations, roots)
    assert found.dtype == torch.float32
    wanted = joint_positions(skeleton, rotations, offsets.double(), roots)
    torch.testing.assert_close(found, wanted.float(), atol=3e-6, rtol=0)


def test_poses_that_are_given_stay_as_they_are(generator):
    skeleton, offsets = body(TREES["forest"], generator)
    rotations, roots = poses(len(skeleton), generator, 2)
    place = BodyKinematics(skeleton, offsets)
    before = [each.clone() for each in (rotations, roots, offsets)]
    first = place(rotations.requires_grad_(), roots)
    assert not first.requires_grad
    first.zero_()
    assert place(rotations, roots).any()
    for own, other in zip((rotations, roots, offsets), before, strict=True):
        assert torch.equal(own, other)


def test_other_numbers_of_joints_are_refused(generator):
    skeleton, offsets = body(TREES["star"], generator)
    with pytest.raises(SkeletonError, match="6 joints along the joint axis"):
        BodyKinematics(skeleton, offsets[:6])
    rotations, _ = poses(8, generator, 1)
    with pytest.raises(SkeletonError, match="8 joints along the joint axis"):
        BodyKinematics(skeleton, offsets)(rotations)
