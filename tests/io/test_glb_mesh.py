"""The octahedra in GLB files: from joint to joint at any time, closed, and turned outwards."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from tests.io.glb_clips import CLIPS, EXACT, positions, written
from tests.io.glb_reference import Array, Glb

from posecast.corpora.synthetic import make_clip as make_walk
from posecast.geometry import quaternion
from posecast.motion import Clip
from posecast.skeleton import Skeleton


@pytest.fixture(params=CLIPS)
def clip(request: pytest.FixtureRequest) -> Clip:
    return CLIPS[request.param]()


def bodies(glb: Glb, seconds: float) -> Array:
    """The octahedra, (bodies, 6, 3): head, ring, tail."""
    return glb.skinned(seconds).reshape(-1, 6, 3)


def test_each_bone_is_drawn_from_joint_to_joint_at_any_time(tmp_path, clip):
    glb, expected = written(clip, tmp_path), positions(clip)
    lengths = clip.offsets.norm(dim=-1)
    children = [
        joint
        for joint, parent in enumerate(clip.skeleton.parents)
        if parent >= 0 and lengths[joint] > 0
    ]
    parents = [clip.skeleton.parents[joint] for joint in children]
    for frame in {0, clip.frames // 2, clip.frames - 1}:
        drawn = bodies(glb, frame / clip.fps)[: len(children)]
        assert np.abs(drawn[:, 0] - expected[frame, parents]).max(initial=0) < EXACT
        assert np.abs(drawn[:, 5] - expected[frame, children]).max(initial=0) < EXACT


def test_the_ends_of_chains_are_drawn_even_where_there_is_no_bone(tmp_path, clip):
    glb, expected = written(clip, tmp_path), positions(clip)
    ends = [joint for joint, below in enumerate(clip.skeleton.children) if not below]
    assert ends
    centers = bodies(glb, 0)[-len(ends) :].mean(axis=1)
    assert np.abs(centers - expected[0, ends]).max() < EXACT


def test_a_body_that_travels_below_a_still_root_is_drawn_without_that_root(tmp_path):
    walk = make_walk(0, fps=30.0, seconds=2.0)
    skeleton = Skeleton(
        ("still", *walk.skeleton.names), (-1, *(parent + 1 for parent in walk.skeleton.parents))
    )
    still = torch.zeros(walk.frames, 1, 3).to(walk.offsets)
    turn = quaternion.identity(walk.frames, 1, like=walk.rotations_local)
    moving = walk.offsets.expand(walk.frames, -1, -1).clone()
    moving[:, 0] += walk.root_positions
    clip = Clip(
        skeleton,
        torch.cat([still[0], moving[walk.frames // 2]]),
        walk.fps,
        still[:, 0],
        torch.cat([turn, walk.rotations_local], dim=1),
        torch.cat([still, moving], dim=1),
    )
    expected = written(walk, tmp_path).skinned(1.5)
    found = written(clip, tmp_path).skinned(1.5)
    assert found.shape == expected.shape
    assert np.abs(found - expected).max() < EXACT


def test_the_mesh_is_closed_and_turned_outwards(tmp_path, clip):
    glb = written(clip, tmp_path)
    triangles = glb.triangles()
    edges = {(int(a), int(b)) for t in triangles for a, b in zip(t, np.roll(t, -1), strict=True)}
    assert len(edges) == triangles.size
    assert all((b, a) in edges for a, b in edges)
    corners = glb.skinned(0)[triangles].reshape(-1, 8, 3, 3)
    inside = corners - corners.mean(axis=(1, 2), keepdims=True)
    assert (np.linalg.det(inside) > 0).all()
