"""Joints that stay keep their place in the world when others are dropped."""

from __future__ import annotations

from collections.abc import Callable
from itertools import combinations

import pytest
import torch
from torch.testing import assert_close

from posecast.errors import SkeletonError
from posecast.motion import Clip, drop_joints
from posecast.skeleton import Skeleton
from posecast.skeleton.kinematics import forward_kinematics

MakeClip = Callable[..., Clip]
FOREST = Skeleton(("Pelvis", "Knee", "Camera", "Lens", "Cap"), (-1, 0, -1, 2, 3))


def world(clip: Clip) -> tuple[torch.Tensor, torch.Tensor]:
    offsets = clip.offsets if clip.translations_local is None else clip.translations_local
    return forward_kinematics(clip.skeleton, clip.rotations_local, offsets, clip.root_positions)


def still(clip: Clip, *joints: int) -> Clip:
    """The same clip with joints that turn no more."""
    rotations = clip.rotations_local.clone()
    rotations[:, list(joints)] = rotations[:1, list(joints)]
    return Clip(clip.skeleton, clip.offsets, clip.fps, clip.root_positions, rotations)


@pytest.mark.parametrize("count", [1, 2, 3])
@pytest.mark.parametrize("moving_bones", [False, True])
def test_whatever_is_dropped_the_rest_stays_where_it_was(
    make_clip: MakeClip, generator: torch.Generator, count: int, moving_bones: bool
) -> None:
    tried = 0
    for skeleton in (None, FOREST):
        clip = make_clip() if skeleton is None else make_clip(FOREST)
        if moving_bones:
            joints = len(clip.skeleton)
            moved = torch.randn(40, joints, 3, generator=generator, dtype=torch.float64)
            clip = make_clip(clip.skeleton, translations_local=moved)
        positions, rotations = world(clip)
        for dropped in combinations(range(len(clip.skeleton)), count):
            kept = [joint for joint in range(len(clip.skeleton)) if joint not in dropped]
            pruned = drop_joints(clip, dropped)
            assert pruned.skeleton == clip.skeleton.select(kept)
            now_at, now_turned = world(pruned)
            assert_close(now_at, positions[:, kept], atol=1e-9, rtol=0)
            assert_close(now_turned, rotations[:, kept], atol=1e-9, rtol=0)
            tried += 1
    assert tried >= 12


def test_a_removed_joint_that_does_not_turn_leaves_rigid_bones(make_clip: MakeClip) -> None:
    clip = still(make_clip(), 1)
    pruned = drop_joints(clip, ["LeftHip"])
    assert pruned.translations_local is None
    assert_close(world(pruned)[0], world(clip)[0][:, [0, 2, 3, 4, 5, 6]], atol=1e-9, rtol=0)


def test_an_unmoving_root_is_folded_into_the_joint_below(make_clip: MakeClip) -> None:
    chain = Skeleton(("joint_Root", "Hips", "Spine"), (-1, 0, 1))
    clip = still(make_clip(chain), 0)
    pruned = drop_joints(clip, ["joint_Root"])
    assert pruned.skeleton == Skeleton(("Hips", "Spine"), (-1, 0))
    assert_close(pruned.root_positions, world(clip)[0][:, 1], atol=1e-9, rtol=0)
    assert pruned.translations_local is None
    assert_close(pruned.offsets[0], torch.zeros(3, dtype=torch.float64))
    assert_close(world(pruned)[0], world(clip)[0][:, 1:], atol=1e-9, rtol=0)


def test_the_mean_offset_can_be_taken_where_a_removed_joint_turns(make_clip: MakeClip) -> None:
    clip = make_clip()
    exact, rigid = drop_joints(clip, ["LeftHip"]), drop_joints(clip, ["LeftHip"], moving="mean")
    assert exact.translations_local is not None
    assert rigid.translations_local is None
    foot = rigid.skeleton.index("LeftFoot")
    assert_close(rigid.offsets[foot], exact.translations_local[:, foot].mean(0))
    others = [joint for joint in range(6) if joint != foot]
    assert_close(world(rigid)[0][:, others], world(clip)[0][:, [0, 3, 4, 5, 6]])


def test_untouched_offsets_are_not_replaced_by_means(make_clip: MakeClip) -> None:
    clip = make_clip(translations_local=torch.randn(40, 7, 3, dtype=torch.float64))
    assert torch.equal(drop_joints(clip, ["Head"]).offsets, clip.offsets[:6])


def test_dropping_nothing_returns_the_clip(make_clip: MakeClip) -> None:
    clip = make_clip()
    assert drop_joints(clip, []) is clip


def test_a_name_that_is_not_there_is_refused_with_the_names_that_are(make_clip: MakeClip) -> None:
    with pytest.raises(SkeletonError, match="LeftHip, LeftFoot"):
        drop_joints(make_clip(), ["Tail"])
    with pytest.raises(SkeletonError, match="joint 7"):
        drop_joints(make_clip(), [7])


def test_not_all_joints_can_be_dropped(make_clip: MakeClip) -> None:
    with pytest.raises(SkeletonError, match="all 7"):
        drop_joints(make_clip(), range(7))
