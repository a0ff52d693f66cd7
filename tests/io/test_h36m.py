"""H3.6M text: conventions against slow matrices, errors, and the sanity of integrated motion."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from posecast.errors import ConfigError, DataError
from posecast.io.h36m import read_h36m, read_h36m_columns
from posecast.io.h36m_root import RootTrack, integrate_root, level_root
from posecast.motion import Clip
from posecast.skeleton import joint_positions, named_skeleton

FEET = ("RightFoot", "RightToeBase", "RightToeBaseSite")
FEET += tuple(name.replace("Right", "Left") for name in FEET)


def write_columns(path: Path, columns: np.ndarray) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savetxt(path, columns, fmt="%.7f", delimiter=",")
    return path


@pytest.fixture
def columns() -> np.ndarray:
    values = np.random.default_rng(7).normal(scale=0.5, size=(40, 99))
    values[:, :6] *= 0.05
    values[0, :6] = 0
    return np.round(values, 7)


@pytest.fixture
def recording(tmp_path: Path, columns: np.ndarray) -> Path:
    return write_columns(tmp_path / "S5" / "walking_1.txt", columns)


def world_positions(clip: Clip) -> torch.Tensor:
    return joint_positions(clip.skeleton, clip.rotations_local, clip.offsets, clip.root_positions)


def test_the_columns_are_the_numbers_of_the_file(recording, columns):
    found = read_h36m_columns(recording)
    assert found.dtype == torch.float64
    assert np.array_equal(found.numpy(), columns)


def test_a_clip_knows_its_skeleton_rate_and_labels(recording):
    clip = read_h36m(recording)
    assert clip.skeleton == named_skeleton("h36m-32").skeleton
    assert (clip.frames, clip.fps, clip.name) == (40, 50.0, "S5_walking_1")
    assert clip.labels == {"subject": "S5", "action": "walking", "recording": "1"}
    assert clip.offsets[2, 1].item() == pytest.approx(-0.442894612)


def test_a_path_without_labels_gives_none(recording):
    other = recording.rename(recording.parent.parent / "take.txt")
    assert read_h36m(other).labels == {}
    assert read_h36m(other).name == "take"


def test_local_rotations_place_joints_as_the_row_vector_chain_of_the_data_does(recording, columns):
    clip = read_h36m(recording, root="increments")
    found = joint_positions(clip.skeleton, clip.rotations_local, clip.offsets)
    for t in (0, 17, 39):
        maps = columns[t, 3:].reshape(32, 3)
        matrices = Rotation.from_rotvec(maps).as_matrix()
        above, place = [matrices[0]], [np.zeros(3)]
        for joint, parent in list(enumerate(clip.skeleton.parents))[1:]:
            # p_j = o_j G_parent + p_parent and G_j = R_j G_parent with rows (Martinez et al.)
            place.append(clip.offsets[joint].numpy() @ above[parent] + place[parent])
            above.append(matrices[joint] @ above[parent])
        np.testing.assert_allclose(found[t].numpy(), np.array(place), rtol=0, atol=1e-12)


def test_increments_are_kept_raw_on_demand(recording, columns):
    clip = read_h36m(recording, root="increments")
    np.testing.assert_allclose(clip.root_positions.numpy(), columns[:, :3] / 1000, rtol=1e-15)
    found = Rotation.from_quat(clip.rotations_local[:, 0].numpy(), scalar_first=True)
    expected = Rotation.from_rotvec(-columns[:, 3:6])
    assert (found * expected.inv()).magnitude().max() < 1e-12


def test_only_the_root_differs_between_world_and_increments(recording):
    world = read_h36m(recording)
    increments = read_h36m(recording, root="increments")
    assert torch.equal(world.rotations_local[:, 1:], increments.rotations_local[:, 1:])
    assert not torch.allclose(world.rotations_local[:, 0], increments.rotations_local[:, 0])


def test_another_kind_of_root_is_refused(recording):
    with pytest.raises(ConfigError, match="expected 'world' or 'increments'"):
        read_h36m(recording, root="camera")


def test_integrating_the_root_equals_a_plain_loop_over_frames(generator):
    steps = torch.randn(203, 3, dtype=torch.float64, generator=generator)
    maps = torch.randn(203, 3, dtype=torch.float64, generator=generator)
    turns = Rotation.from_rotvec(maps.numpy())
    track = integrate_root(steps, torch.from_numpy(turns.as_quat(scalar_first=True)))
    position, rotation = np.zeros(3), np.eye(3)
    for t in range(len(steps)):
        position = position + rotation @ steps[t].numpy()
        rotation = rotation @ turns[t].as_matrix()
        np.testing.assert_allclose(track.positions[t].numpy(), position, rtol=0, atol=1e-11)
        found = Rotation.from_quat(track.rotations[t].numpy(), scalar_first=True)
        np.testing.assert_allclose(found.as_matrix(), rotation, rtol=0, atol=1e-12)


def stepping(frames: int) -> tuple[RootTrack, torch.Tensor]:
    """A root moving along z at 1 m/s and 0.9 m; feet that stand for 20 frames and swing for 20."""
    t = torch.arange(frames, dtype=torch.float64)
    position = torch.stack([0 * t, 0.9 + 0 * t, t / 50], dim=-1)
    rotations = torch.zeros(frames, 4, dtype=torch.float64)
    rotations[:, 0] = 1
    feet = []
    for side, phase in ((-0.1, 0), (0.1, 20)):
        swing = (t + phase) % 40 / 20
        along = ((t + phase) // 40 + torch.clamp(swing - 1, min=0)) * 0.8
        up = 0.08 * torch.sin(torch.clamp(swing - 1, min=0) * math.pi)
        for ahead, height in ((0.0, 0.09), (0.15, 0.02), (0.22, 0.01)):
            feet.append(torch.stack([side + 0 * t, height + up, along + ahead], dim=-1))
    return RootTrack(position, rotations), torch.stack(feet, dim=1)


@pytest.mark.parametrize("axis", [[0.35, 0.0, 0.0], [0.0, 0.0, -0.25], [0.2, 0.0, 0.3]])
def test_leveling_finds_the_floor_under_a_tilted_walk(axis):
    track, feet = stepping(400)
    tilt = Rotation.from_rotvec(axis)
    leaning = RootTrack(
        torch.from_numpy(tilt.apply(track.positions.numpy())) + 0.3,
        torch.from_numpy(tilt.as_quat(scalar_first=True)).expand(400, 4).contiguous(),
    )
    tilted = torch.from_numpy(tilt.apply(feet.reshape(-1, 3).numpy())).reshape_as(feet) + 0.3
    kinds = torch.tensor([0, 1, 2, 0, 1, 2])
    level = level_root(leaning, tilted, kinds, 50.0)
    # Walking along z: the lean forward is seen over 8 m, the lean aside only between the feet,
    # and there the pelvis of the first frame counts too.
    assert level.positions[:, 1].max() - level.positions[:, 1].min() < 0.06
    assert level.positions[0, [0, 2]].abs().max() < 1e-12
    assert level.positions[0, 1].item() == pytest.approx(0.89, abs=0.05)


def test_a_recording_too_short_to_show_a_floor_keeps_its_rotation(tmp_path, columns):
    short = write_columns(tmp_path / "a.txt", columns[:1])
    clip = read_h36m(short)
    assert clip.frames == 1
    assert clip.rotations_local[0, 0].tolist() == [1, 0, 0, 0]
    assert world_positions(clip)[0, :11, 1].min().item() == pytest.approx(0, abs=1e-12)


def line_of(columns: np.ndarray, row: int) -> str:
    return ",".join(f"{value:.7f}" for value in columns[row])


def test_a_wrong_number_of_columns_is_told_with_its_line(recording):
    lines = recording.read_text().splitlines()
    lines[30] = ",".join(lines[30].split(",")[:96])
    recording.write_text("\n".join(lines) + "\n")
    with pytest.raises(DataError) as caught:
        read_h36m(recording)
    assert str(caught.value) == (
        f"{recording}, line 31: 96 columns, expected 99 (root 3 + 32 joints x 3); copy the file "
        "again, or leave out what is no Human3.6M text"
    )


def test_a_file_cut_off_in_its_last_line_is_told(recording):
    text = recording.read_text()
    recording.write_text(text[: len(text) - 300])
    with pytest.raises(DataError, match=r"line 40: \d+ columns.*cut off, copy it again"):
        read_h36m(recording)


@pytest.mark.parametrize(
    ("written", "message"),
    [
        ("half", "line 3: 'half' in column 12, expected a finite number"),
        ("nan", "line 3: 'nan' in column 12"),
        ("-inf", "line 3: '-inf' in column 12"),
        ("", "line 3: '' in column 12"),
        ("1e200", "line 3: 1e+200 rad, expected at most 100"),
    ],
)
def test_a_value_that_is_no_angle_is_told(tmp_path, columns, written, message):
    lines = [line_of(columns, row) for row in range(5)]
    fields = lines[2].split(",")
    fields[12] = written
    lines[2] = ",".join(fields)
    path = tmp_path / "a.txt"
    path.write_text("\n".join(lines))
    with pytest.raises(DataError, match=re.escape(message)):
        read_h36m(path)


def test_a_step_of_the_root_no_one_can_make_is_told(tmp_path, columns):
    columns[3, 1] = 2e6
    with pytest.raises(DataError, match=r"line 4: 2e\+06 mm, expected at most 100000"):
        read_h36m(write_columns(tmp_path / "a.txt", columns))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "is empty"),
        (b"\n \n", "is empty"),
        (b"\x7fELF\x00\x01", "zero byte at position 4"),
        (b"hello\n", "line 1: 1 columns, expected 99"),
        ("\ufeff1,2".encode("utf-16"), "zero byte"),
        (b"\xff\xfe\xe9" + b",1" * 98, "column 0, expected a finite number"),
        (b"1 " * 99, "line 1: 1 columns, expected 99"),
    ],
)
def test_files_of_another_kind_are_refused(tmp_path, content, message):
    path = tmp_path / "a.txt"
    path.write_bytes(content)
    with pytest.raises(DataError, match=message):
        read_h36m(path)


@pytest.mark.parametrize("newline", ["\n", "\r\n"])
def test_line_ends_and_blank_lines_do_not_matter(tmp_path, columns, newline):
    text = newline.join(line_of(columns, row) for row in range(5))
    path = tmp_path / "a.txt"
    path.write_bytes((text + newline * 3).encode())
    assert np.array_equal(read_h36m_columns(path).numpy(), columns[:5])


@pytest.mark.data
def test_walking_stands_on_the_floor_and_goes_forward(data_root):
    clip = read_h36m(data_root / "h36m" / "S5" / "walking_1.txt")
    positions = world_positions(clip)
    index = clip.skeleton.index
    lowest = positions[..., 1].amin(-1)
    assert -0.03 < lowest.min() < lowest.max() < 0.06
    assert 0.85 < clip.root_positions[:, 1].min() < clip.root_positions[:, 1].max() < 1.0
    assert 1.4 < positions[:, index("Head"), 1].median() < 1.7
    assert (positions[:, index("LeftFoot")] - positions[:, index("Head")])[:, 1].max() < -1.0
    velocity = clip.root_positions.diff(dim=0) * clip.fps
    assert 0.5 < velocity.norm(dim=-1).mean() < 1.5
    facing = torch.linalg.cross(
        positions[:-1, index("LeftUpLeg")] - positions[:-1, index("RightUpLeg")],
        torch.tensor([0.0, 1.0, 0.0], dtype=torch.float64).expand(clip.frames - 1, 3),
    )
    forward = torch.nn.functional.cosine_similarity(velocity, facing)
    assert forward.median() > 0.9
    ankles = positions[:, [index("LeftFoot"), index("RightFoot")]].diff(dim=0) * clip.fps
    assert ankles.norm(dim=-1).amin(-1).median() < 0.08  # one foot stands while the other swings


@pytest.mark.data
@pytest.mark.parametrize("subject", ["S1", "S5", "S6", "S7", "S8", "S9", "S11"])
def test_walking_of_every_subject_is_level(data_root, subject):
    path = data_root / "h36m" / subject / "walking_1.txt"
    clip = read_h36m(path)
    lowest = world_positions(clip)[..., 1].amin(-1)
    assert lowest.quantile(0.01).abs() < 1e-6
    assert lowest.quantile(0.99) < 0.06
    assert 0.85 < clip.root_positions[:, 1].median() < 1.05


@pytest.mark.data
@pytest.mark.slow
def test_every_recording_at_hand_is_read(data_root):
    files = sorted((data_root / "h36m").glob("S*/*.txt"))
    assert len(files) >= 189
    for file in files:
        clip = read_h36m(file)
        assert set(clip.labels) == {"subject", "action", "recording"}, file
        assert torch.isfinite(clip.root_positions).all(), file
        assert torch.isfinite(clip.rotations_local).all(), file
        assert 0.0 < clip.root_positions[:, 1].median() < 1.5, file
