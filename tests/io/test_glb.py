"""GLB files put every joint where the clip has it, and are what glTF asks for."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from tests.io.glb_clips import (
    CLIPS,
    EXACT,
    SKELETON,
    forest,
    positions,
    with_moving_bones,
    written,
)
from tests.io.glb_reference import Array, Glb

import posecast
from posecast.corpora.synthetic import make_clip as make_walk
from posecast.errors import DataError
from posecast.geometry import quaternion
from posecast.io import read_clip
from posecast.io.glb import write_glb
from posecast.io.h36m import read_h36m
from posecast.motion import Clip
from posecast.skeleton import Skeleton, joint_positions


@pytest.fixture(params=CLIPS)
def clip(request: pytest.FixtureRequest) -> Clip:
    return CLIPS[request.param]()


def check_joints(clip: Clip, glb: Glb, frames: list[int]) -> None:
    """Every joint is where the clip has it, by matrices, at the time that frame has."""
    expected, joints = positions(clip), len(clip.skeleton)
    for frame in frames:
        found = glb.world(frame / clip.fps)[:joints, :3, 3]
        assert np.abs(found - expected[frame]).max() < EXACT


def test_joints_are_where_the_clip_has_them(tmp_path, clip):
    check_joints(clip, written(clip, tmp_path), [*range(0, clip.frames, 3), clip.frames - 1])


def test_between_frames_joints_turn_by_the_short_way(tmp_path):
    clip = forest()
    glb = written(clip, tmp_path)
    early, late = clip.rotations_local[3], clip.rotations_local[4]
    for fraction in (0.25, 0.5):
        middle = quaternion.slerp(early, late, torch.tensor(fraction, dtype=torch.float64))
        root = torch.lerp(clip.root_positions[3], clip.root_positions[4], fraction)
        expected = joint_positions(clip.skeleton, middle, clip.offsets, root).numpy()
        found = glb.world((3 + fraction) / clip.fps)[: len(SKELETON), :3, 3]
        assert np.abs(found - expected).max() < EXACT


def test_rotations_are_unit_with_continuous_signs(tmp_path, clip):
    glb = written(clip.to(torch.float16), tmp_path)
    for joint in range(len(clip.skeleton)):
        track = glb.track(joint, "rotation")
        assert track.shape == (clip.frames, 4)
        assert np.abs(np.linalg.norm(track, axis=1) - 1).max() < 1e-6
        assert (np.sum(track[1:] * track[:-1], axis=1) >= 0).all()


def test_only_what_may_slide_has_a_track_of_translations(tmp_path, clip):
    glb = written(clip, tmp_path)
    every = range(len(clip.skeleton))
    sliding = {joint for joint in every if glb.track(joint, "translation") is not None}
    stiff = clip.translations_local is None
    assert sliding == set(clip.skeleton.roots if stiff else every)


def test_frames_are_at_their_times_from_zero(tmp_path, clip):
    glb = written(clip, tmp_path)
    assert glb.times[0] == 0
    np.testing.assert_allclose(glb.times, np.arange(clip.frames) / clip.fps, rtol=1e-7)
    assert glb.json["asset"]["extras"]["fps"] == clip.fps
    assert glb.json["asset"]["generator"] == f"posecast {posecast.__version__}"
    assert glb.json["asset"]["version"] == "2.0"


def test_bounds_are_given_where_they_must_be(tmp_path, clip):
    glb = written(clip, tmp_path)
    accessors = glb.json["accessors"]
    clock = glb.json["animations"][0]["samplers"][0]["input"]
    vertices = glb.json["meshes"][0]["primitives"][0]["attributes"]["POSITION"]
    for accessor in (clock, vertices):
        values = glb.numbers(accessor).reshape(accessors[accessor]["count"], -1)
        assert accessors[accessor]["min"] == values.min(axis=0).tolist()
        assert accessors[accessor]["max"] == values.max(axis=0).tolist()


def test_the_skin_is_undeformed_at_rest(tmp_path, clip):
    glb = written(clip, tmp_path)
    (skin,) = glb.json["skins"]
    joints = len(clip.skeleton)
    assert skin["joints"] == list(range(joints))
    rest: list[Array] = []
    for joint, parent in enumerate(clip.skeleton.parents):
        rest.append((np.eye(4) if parent < 0 else rest[parent]) @ glb.local(joint, None))
    unmoved = np.stack(rest) @ glb.numbers(skin["inverseBindMatrices"])
    assert np.abs(unmoved - np.eye(4)).max() < EXACT


def test_at_rest_the_body_stands_where_the_first_frame_does(tmp_path, clip):
    glb = written(clip, tmp_path)
    for joint in range(len(clip.skeleton)):
        expected = clip.offsets[joint].double()
        if joint in clip.skeleton.roots:
            expected = expected + clip.root_positions[0]
        assert np.abs(glb.local(joint, None)[:3, 3] - expected.numpy()).max() < 1e-6


def test_names_stay_and_what_is_added_is_called_otherwise(tmp_path):
    nodes = written(forest(), tmp_path).json["nodes"]
    names = [node["name"] for node in nodes]
    assert names == [*SKELETON.names, "armature_2", "bones_2"]
    nameless = replace(forest(), skeleton=Skeleton(("", *SKELETON.names[1:]), SKELETON.parents))
    assert written(nameless, tmp_path).json["nodes"][0]["name"] == "joint_0"


def test_one_armature_is_above_all_roots_and_the_mesh_beside_it(tmp_path, clip):
    glb = written(clip, tmp_path)
    armature, mesh = glb.json["scenes"][0]["nodes"]
    assert glb.json["nodes"][armature]["children"] == list(clip.skeleton.roots)
    assert glb.json["skins"][0]["skeleton"] == armature
    assert armature == len(clip.skeleton)
    node = glb.json["nodes"][mesh]
    assert (node["mesh"], node["skin"], set(node)) == (0, 0, {"name", "mesh", "skin"})


def test_without_mesh_the_armature_is_alone(tmp_path):
    glb = written(forest(), tmp_path, mesh=False)
    assert "meshes" not in glb.json
    assert "materials" not in glb.json
    assert len(glb.json["nodes"]) == len(SKELETON) + 1
    assert len(glb.json["skins"][0]["joints"]) == len(SKELETON)
    check_joints(forest(), glb, [0, 8])


def test_equal_clips_give_equal_bytes(tmp_path):
    for name in "ab":
        write_glb(with_moving_bones(), tmp_path / name)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_writing_leaves_the_clip_as_it_was(tmp_path):
    clip, same = forest(), forest()
    write_glb(clip, tmp_path / "a.glb")
    assert torch.equal(clip.offsets, same.offsets)
    assert torch.equal(clip.rotations_local, same.rotations_local)
    assert torch.equal(clip.root_positions, same.root_positions)


def test_half_a_minute_of_a_body_takes_less_than_half_a_megabyte(tmp_path):
    clip = make_walk(0, fps=30.0, seconds=36.0)
    write_glb(clip, tmp_path / "walk.glb")
    assert len(clip.skeleton) == 21
    assert (tmp_path / "walk.glb").stat().st_size < 450_000


def spoilt(key: str, value: float) -> Clip:
    clip = with_moving_bones()
    getattr(clip, key)[..., 0] = value
    return clip


def endless() -> Clip:
    """Frames without number, in the memory of one."""
    clip, frames = forest(1), 2**25
    return replace(
        clip,
        root_positions=clip.root_positions.expand(frames, 3),
        rotations_local=clip.rotations_local.expand(frames, -1, 4),
    )


def renamed(name: str) -> Clip:
    return replace(forest(), skeleton=Skeleton((name, *SKELETON.names[1:]), SKELETON.parents))


FAULTS = {
    "no number": (lambda: spoilt("root_positions", math.nan), "root_positions has a value that is"),
    "no rotation": (lambda: spoilt("rotations_local", 3), "quaternion of length"),
    "far away": (
        lambda: spoilt("offsets", 1e33),
        r"a position of 1\.0e\+33 m, too large.*its unit",
    ),
    "far apart": (lambda: spoilt("translations_local", -1e33), "too large for single precision"),
    "too long": (endless, "33554432 frames of 8 joints take 4.9 GiB.*cut the clip into pieces"),
    "too fast": (lambda: replace(forest(), fps=1e60), "9 frames, 1e.60 a second.*tell apart"),
    "too slow": (lambda: replace(forest(), fps=1e-60), "tell apart"),
    "a name that is no text": (lambda: renamed("a\ud800"), r"a name holds '\\ud800'.*rename it"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_what_no_file_can_hold_is_refused(tmp_path, fault):
    make, message = FAULTS[fault]
    with pytest.raises(DataError, match=message):
        write_glb(make(), tmp_path / "a.glb")
    assert not list(tmp_path.iterdir())


def test_a_clip_from_a_network_is_written_without_its_gradient(tmp_path):
    clip, same = with_moving_bones(), with_moving_bones()
    for values in (clip.offsets, clip.root_positions, clip.rotations_local):
        values.requires_grad_()
    assert clip.translations_local is not None
    clip.translations_local.requires_grad_()
    check_joints(same, written(clip, tmp_path), [4])


@pytest.mark.data
@pytest.mark.parametrize(
    ("corpus", "pattern", "joints"),
    [
        ("bandai-locomotion", "dataset-2_walk_*.bvh", 22),
        ("bandai-locomotion", "dataset-2_run_*.bvh", 22),
        ("cmu-salsa", "61/61_01.bvh", 43),
        ("cmu-asf", "**/*.amc", 31),
        ("h36m", "S5/walking_1.txt", 32),
    ],
)
def test_real_recordings_stand_upright_where_they_are(
    data_root: Path, tmp_path: Path, corpus: str, pattern: str, joints: int
) -> None:
    files = sorted((data_root / corpus).glob(pattern))
    if not files:
        pytest.skip(f"no {pattern} in {corpus}")
    clip = read_h36m(files[0], root="world") if corpus == "h36m" else read_clip(files[0])
    assert len(clip.skeleton) == joints
    glb = written(clip, tmp_path)
    check_joints(clip, glb, [0, clip.frames // 2, clip.frames - 1])
    vertices = glb.skinned(clip.duration / 2)
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    assert -0.2 < low[1] < 0.2
    assert 1.3 < high[1] < 2.0
