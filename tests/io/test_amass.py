"""AMASS archives: both dialects, z up to y up on the root only, templates, refusals."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from posecast.errors import DataError
from posecast.io.amass import read_amass
from posecast.io.archive import write_archive
from posecast.motion import Clip
from posecast.skeleton import joint_positions, named_skeleton

FRAMES = 6
BODY = named_skeleton("smpl-22").skeleton
TURN = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
"""z up to y up: a turn by -90 degrees about x."""


@pytest.fixture
def fields() -> dict[str, np.ndarray]:
    """An SMPL-H recording; small angles, but the root turned about the vertical, z."""
    random = np.random.default_rng(5)
    poses = random.normal(scale=0.3, size=(FRAMES, 156))
    return {
        "poses": poses,
        "trans": random.normal(size=(FRAMES, 3)),
        "betas": random.normal(size=16),
        "dmpls": random.normal(size=(FRAMES, 8)),
        "gender": np.array("female"),
        "mocap_framerate": np.array(120.0),
    }


@pytest.fixture
def template() -> np.ndarray:
    """Invented joint positions at rest for 24 joints, metres; no body model's."""
    random = np.random.default_rng(6)
    rest = np.zeros((24, 3))
    rest[0] = (0.01, -0.2, 0.03)
    for joint, parent in enumerate(named_skeleton("smpl-24").skeleton.parents):
        if joint:
            rest[joint] = rest[parent] + random.normal(scale=0.1, size=3)
    return rest


def save(path: Path, fields: dict[str, np.ndarray], **changes: object) -> Path:
    np.savez(path, **{k: v for k, v in {**fields, **changes}.items() if v is not None})
    return path


def test_smpl_h_gives_the_22_body_joints(tmp_path, fields):
    clip = read_amass(save(tmp_path / "walk_poses.npz", fields))
    assert clip.skeleton == BODY
    assert (clip.frames, clip.fps, clip.name) == (FRAMES, 120.0, "walk_poses")
    assert clip.rotations_local.dtype == torch.float64
    expected = Rotation.from_rotvec(fields["poses"][:, 3:66].reshape(-1, 3))
    found = Rotation.from_quat(clip.rotations_local[:, 1:].reshape(-1, 4), scalar_first=True)
    assert (found * expected.inv()).magnitude().max() < 1e-12


def test_only_the_root_is_turned_from_z_up_to_y_up(tmp_path, fields):
    clip = read_amass(save(tmp_path / "a.npz", fields))
    expected = Rotation.from_matrix(TURN) * Rotation.from_rotvec(fields["poses"][:, :3])
    found = Rotation.from_quat(clip.rotations_local[:, 0], scalar_first=True)
    assert (found * expected.inv()).magnitude().max() < 1e-12
    np.testing.assert_array_equal(clip.root_positions.numpy(), fields["trans"] @ TURN.T)


def test_joints_are_where_the_body_model_puts_them(tmp_path, fields, template):
    clip = read_amass(save(tmp_path / "a.npz", fields), template=torch.from_numpy(template))
    found = joint_positions(clip.skeleton, clip.rotations_local, clip.offsets, clip.root_positions)
    for t in range(FRAMES):
        # Transforms of the model in its own, z-up world: p -> A p + b, from the root outwards.
        chain: list[tuple[np.ndarray, np.ndarray]] = []
        for joint, parent in enumerate(BODY.parents):
            turn = Rotation.from_rotvec(fields["poses"][t, 3 * joint : 3 * joint + 3]).as_matrix()
            about = template[joint] - turn @ template[joint]
            if parent >= 0:
                above, shift = chain[parent]
                turn, about = above @ turn, above @ about + shift
            chain.append((turn, about))
        places = [
            turn @ template[joint] + about + fields["trans"][t]
            for joint, (turn, about) in enumerate(chain)
        ]
        np.testing.assert_allclose(found[t].numpy(), np.array(places) @ TURN.T, atol=1e-12)


def test_smpl_x_parts_read_like_whole_poses(tmp_path, fields):
    whole = read_amass(save(tmp_path / "whole.npz", fields))
    parts = {
        "root_orient": fields["poses"][:, :3],
        "pose_body": fields["poses"][:, 3:66],
        "pose_hand": np.zeros((FRAMES, 90)),
        "trans": fields["trans"],
        "mocap_frame_rate": np.array([120]),
        "surface_model_type": np.array("smplx"),
    }
    found = read_amass(save(tmp_path / "parts_stageii.npz", parts))
    assert found.fps == 120.0
    assert torch.equal(found.rotations_local, whole.rotations_local)
    assert torch.equal(found.root_positions, whole.root_positions)


@pytest.mark.parametrize("columns", [66, 72, 156, 165])
def test_every_member_of_the_family_has_the_same_first_22_joints(tmp_path, fields, columns):
    poses = np.resize(fields["poses"], (FRAMES, columns))
    poses[:, :66] = fields["poses"][:, :66]
    found = read_amass(save(tmp_path / "a.npz", fields, poses=poses.astype(np.float32)))
    whole = read_amass(save(tmp_path / "b.npz", fields))
    torch.testing.assert_close(found.rotations_local, whole.rotations_local, rtol=0, atol=1e-6)


def test_poses_without_translation_say_so(tmp_path, fields):
    clip = read_amass(save(tmp_path / "a.npz", fields, trans=None))
    assert clip.labels == {"offsets": "unknown", "translation": "unknown"}
    assert not clip.root_positions.any()


def test_without_a_template_offsets_are_zero_and_labelled_unknown(tmp_path, fields, template):
    path = save(tmp_path / "a.npz", fields)
    assert read_amass(path).labels == {"offsets": "unknown"}
    assert not read_amass(path).offsets.any()
    assert read_amass(path, template=torch.from_numpy(template)).labels == {}


def test_templates_of_every_form_agree(tmp_path, fields, template):
    path = save(tmp_path / "a.npz", fields)
    expected = read_amass(path, template=torch.from_numpy(template))
    np.save(tmp_path / "rest.npy", template)
    np.savez(tmp_path / "J.npz", J=template, v_template=np.zeros((10, 3)))
    np.savez(tmp_path / "joints.npz", joints=template[:22])
    (tmp_path / "rest.json").write_text(json.dumps(template.tolist()))
    for name in ("rest.npy", "J.npz", "joints.npz", "rest.json"):
        found = read_amass(path, template=tmp_path / name)
        assert torch.equal(found.offsets, expected.offsets), name
        assert torch.equal(found.root_positions, expected.root_positions), name


def test_a_clip_of_our_own_serves_as_template(tmp_path, fields, template):
    path = save(tmp_path / "a.npz", fields)
    expected = read_amass(path, template=torch.from_numpy(template))
    write_archive(expected, tmp_path / "clip.npz")
    found = read_amass(path, template=tmp_path / "clip.npz")
    torch.testing.assert_close(found.offsets, expected.offsets, rtol=0, atol=1e-15)
    strange = Clip(
        named_skeleton("h36m-32").skeleton,
        named_skeleton("h36m-32").offsets(),
        50,
        torch.zeros(1, 3, dtype=torch.float64),
        torch.eye(4, dtype=torch.float64)[:1].expand(1, 32, 4),
    )
    write_archive(strange, tmp_path / "strange.npz")
    with pytest.raises(DataError, match="not those of the skeleton smpl-22"):
        read_amass(path, template=tmp_path / "strange.npz")


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.json", b"{}", r"shape \(\), expected \(24, 3\)"),
        ("a.json", b"[[1, 2, 3]]", r"shape \(1, 3\), expected \(24, 3\)"),
        ("a.json", b"[[1, 2, 3], [1]]", "no JSON list of joint positions"),
        ("a.json", b"nonsense", "no JSON list of joint positions"),
        ("a.json", b"", "is empty"),
        ("a.json", json.dumps([["a", "b", "c"]] * 24).encode(), "expected numbers"),
        ("a.json", json.dumps([[0, 100 * j, 0] for j in range(24)]).encode(), "expected metres"),
        ("a.npy", b"nonsense", "no NumPy array"),
        ("a.npz", b"nonsense", "damaged"),
    ],
)
def test_a_template_that_is_none_is_refused(tmp_path, fields, name, content, message):
    (tmp_path / name).write_bytes(content)
    path = save(tmp_path / "motion.npz", fields)
    with pytest.raises(DataError, match=message) as caught:
        read_amass(path, template=tmp_path / name)
    assert caught.value.path == str(tmp_path / name)


HOLED = np.zeros((FRAMES, 156))
HOLED[4, 9] = np.nan

FAULTS = {
    "no rate": ({"mocap_framerate": None}, r"no mocap_framerate.*--fps"),
    "rate zero": ({"mocap_framerate": 0}, "mocap_framerate is 0, expected one number > 0"),
    "rate a word": ({"mocap_framerate": "fast"}, "mocap_framerate is 'fast'"),
    "only a shape": ({"poses": None, "trans": None}, "no motion: found betas.*shape of a body"),
    "too few joints": ({"poses": np.zeros((FRAMES, 63))}, r"poses has shape \(6, 63\)"),
    "not threes": ({"poses": np.zeros((FRAMES, 157))}, r"poses has shape \(6, 157\)"),
    "matrices": ({"poses": np.zeros((FRAMES, 24, 3))}, r"poses has shape \(6, 24, 3\)"),
    "no frames": ({"poses": np.zeros((0, 156)), "trans": np.zeros((0, 3))}, "no frames"),
    "NaN": ({"poses": HOLED}, "poses has a value that is not finite in row 4"),
    "huge": ({"poses": HOLED * 0 + 1e200, "x": 0}, "not finite|no axis-angle"),
    "degrees": ({"poses": np.full((FRAMES, 156), 180.0)}, "180 rad, expected at most 100"),
    "texts": ({"poses": np.full((FRAMES, 156), "a")}, "poses is <U1"),
    "trans of other frames": ({"trans": np.zeros((5, 3))}, r"trans is float64 \(5, 3\)"),
    "objects": ({"poses": np.array([{}] * FRAMES, dtype=object)}, "'poses' holds Python objects"),
    "only the root": ({"poses": None, "root_orient": np.zeros((6, 3))}, "no motion"),
    "root a number": ({"poses": None, "root_orient": 3, "pose_body": 4}, "root_orient is"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_recording_that_cannot_be_used_is_refused(tmp_path, fields, fault):
    changes, message = FAULTS[fault]
    path = save(tmp_path / "a.npz", fields, **changes)
    with pytest.raises(DataError, match=message) as caught:
        read_amass(path)
    assert caught.value.path == str(path)


def test_a_rate_may_be_given_where_the_file_has_none(tmp_path, fields):
    path = save(tmp_path / "a.npz", fields, mocap_framerate=None)
    assert read_amass(path, fps=59.94).fps == 59.94


def test_objects_that_nobody_asked_for_do_no_harm(tmp_path, fields):
    path = save(tmp_path / "a.npz", fields, gender=np.array({"a": 1}, dtype=object))
    assert read_amass(path).frames == FRAMES
