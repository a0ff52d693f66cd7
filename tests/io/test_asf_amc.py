"""ASF/AMC agrees with a slow computation by matrices, bone by bone, that shares no code with it."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
import torch
from tests.io.asf_amc_reference import AMC, ASF, SlowActor, slow_frame

from posecast.errors import DataError
from posecast.io.asf_amc import read_amc
from posecast.skeleton import joint_positions


@pytest.fixture
def trial(tmp_path: Path) -> Path:
    (tmp_path / "07.asf").write_text(ASF)
    (tmp_path / "07_01.amc").write_text(AMC)
    return tmp_path / "07_01.amc"


def assert_agrees_with_matrices(amc: Path, asf: Path, every: int) -> int:
    """Compares every so manieth frame; returns how many places were compared."""
    clip = read_amc(amc, ends=True)
    names = clip.skeleton.names
    found = joint_positions(
        clip.skeleton,
        clip.rotations_local[::every],
        clip.offsets,
        clip.root_positions[::every],
    ).numpy()
    actor, lines = SlowActor(asf), amc.read_text().splitlines()
    assert clip.frames == sum(line.isdigit() for line in lines)
    compared = 0
    for t in range(0, clip.frames, every):
        start, end = actor.place(slow_frame(lines, t + 1))
        places = {"root": end["root"], **start}
        places.update({f"{name}_end": end[name] for name in end if f"{name}_end" in names})
        assert set(places) == set(names)
        expected = np.array([places[name] for name in names]) * 0.0254 / 0.45
        np.testing.assert_allclose(found[t // every], expected, rtol=0, atol=1e-9)
        compared += len(places)
    return compared


def test_joints_sit_where_matrices_put_the_starts_and_ends_of_bones(trial):
    assert assert_agrees_with_matrices(trial, trial.with_name("07.asf"), every=1) == 2 * (5 + 2)


def test_joints_stand_in_depth_first_order_and_bear_the_names_of_bones(trial):
    clip = read_amc(trial)
    assert clip.skeleton.names == ("root", "back", "hip", "thigh", "shin")
    assert clip.skeleton.parents == (-1, 0, 0, 2, 3)
    assert (clip.fps, clip.name) == (120.0, "07_01")
    assert clip.labels == {"subject": "07", "trial": "01"}
    assert clip.offsets.dtype == clip.rotations_local.dtype == torch.float64
    assert read_amc(trial, ends=True).skeleton.names[5:] == ("back_end", "shin_end")


def test_bones_that_leave_the_root_start_in_it(trial):
    clip = read_amc(trial)
    assert torch.equal(clip.offsets[:3], torch.zeros(3, 3, dtype=torch.float64))
    assert clip.offsets[3].tolist() == pytest.approx(
        [0.6 * 2.5 * 0.0254 / 0.45, -0.8 * 2.5 * 0.0254 / 0.45, 0]
    )


def test_the_rest_pose_of_angles_zero_has_identity_rotations_whatever_the_axes(trial):
    bones = "root 0 0 0 0 0 0\nback 0 0\nthigh 0 0 0\nshin 0\n"
    trial.write_text(f":DEGREES\n1\n{bones}")
    rest = read_amc(trial).rotations_local
    torch.testing.assert_close(rest[..., 0], torch.ones_like(rest[..., 0]), rtol=0, atol=1e-15)


@pytest.mark.parametrize(
    "change",
    [
        pytest.param(lambda text: text.replace("\n", "\r\n"), id="CRLF"),
        pytest.param(lambda text: text.replace(" ", "\t "), id="tabs"),
        pytest.param(lambda text: text + "\n \n", id="blank lines at the end"),
        pytest.param(lambda text: text.replace("2\nroot", "# half way\n2\nroot"), id="a comment"),
        pytest.param(lambda text: "\ufeff" + text, id="a byte order mark"),
        pytest.param(
            lambda text: text.replace("back 5.5 -6.25\n", "").rstrip() + "\nback 5.5 -6.25\n",
            id="another order of bones in one frame",
        ),
        pytest.param(lambda text: text.replace("back", "hip\nback"), id="a bone without freedom"),
        pytest.param(
            lambda text: text.replace("\n1\n", "\n8\n").replace("\n2\n", "\n9\n"),
            id="frames counted from 8",
        ),
    ],
)
def test_harmless_differences_of_writing_change_nothing(trial, change):
    plain = read_amc(trial)
    trial.write_bytes(change(AMC).encode())
    again = read_amc(trial)
    assert torch.equal(again.rotations_local, plain.rotations_local)
    assert torch.equal(again.root_positions, plain.root_positions)


def test_radians_in_both_files_give_the_same_motion(trial):
    plain = read_amc(trial)

    def convert(text: str, where: tuple[str, ...]) -> str:
        lines = []
        for line in text.splitlines():
            words = line.split()
            if words and words[0] in where:
                skip = 4 if words[0] == "root" else 1
                turned = [
                    repr(math.radians(float(word))) if word[-1].isdigit() else word
                    for word in words[skip:]
                ]
                line = " ".join(words[:skip] + turned)
            lines.append(line)
        return "\n".join(lines) + "\n"

    radians_amc = convert(AMC, ("root", "back", "thigh", "shin"))
    trial.write_text(radians_amc.replace(":DEGREES", ":RADIANS"))
    trial.with_name("07.asf").write_text(convert(ASF, ("axis",)).replace("angle deg", "angle rad"))
    again = read_amc(trial)
    torch.testing.assert_close(again.rotations_local, plain.rotations_local, rtol=0, atol=1e-14)
    trial.write_text(radians_amc.replace(":DEGREES\n", ""))
    unsaid = read_amc(trial)
    assert torch.equal(unsaid.rotations_local, again.rotations_local)


def test_a_length_of_x_is_x_over_the_unit_inches(trial):
    plain = read_amc(trial)
    trial.with_name("07.asf").write_text(ASF.replace("length 0.45", "length 1.0"))
    inches = read_amc(trial)
    torch.testing.assert_close(inches.offsets, plain.offsets * 0.45)
    torch.testing.assert_close(inches.root_positions, plain.root_positions * 0.45)


def test_root_position_and_orientation_of_the_skeleton_are_applied(trial):
    asf = ASF.replace("position 0 0 0", "position 4.5 0 -9")
    asf = asf.replace("orientation 0 0 0", "orientation 0 90 0")
    trial.with_name("07.asf").write_text(asf)
    trial.write_text(
        AMC.split("1\nroot")[0] + "1\nroot 0 0 0 90 0 0\nback 0 0\nthigh 0 0 0\nshin 0\n"
    )
    clip = read_amc(trial)
    assert clip.root_positions[0].tolist() == pytest.approx([0.254, 0, -0.508])
    # A turn about the root's own x, which its frame points along -z of the world.
    half = math.sqrt(0.5)
    assert clip.rotations_local[0, 0].tolist() == pytest.approx([half, 0, 0, -half], abs=1e-12)


def test_the_skeleton_is_found_by_name_or_alone_or_given(trial):
    asf = trial.with_name("07.asf")
    other = trial.with_name("08.asf")
    other.write_text(ASF.replace("length 7\n", "length 8\n"))
    expected = read_amc(trial)
    assert expected.offsets[4].norm().item() == pytest.approx(7.25 * 0.0254 / 0.45, rel=1e-5)
    stranger = trial.rename(trial.with_name("walk.amc"))
    with pytest.raises(DataError, match=r"2 skeletons beside it.*--skeleton"):
        read_amc(stranger)
    assert torch.equal(read_amc(stranger, asf).offsets, expected.offsets)
    other.unlink()
    assert torch.equal(read_amc(stranger).offsets, expected.offsets)
    asf.unlink()
    with pytest.raises(DataError, match=r"no skeleton beside it.*--skeleton"):
        read_amc(stranger)


@pytest.mark.data
def test_all_cmu_trials_agree_with_matrices_at_sampled_frames(data_root):
    trials = sorted((data_root / "cmu-asf").rglob("*.amc"))
    assert len(trials) == 28
    for trial in trials:
        skeleton = trial.with_name(f"{trial.stem.split('_')[0]}.asf")
        assert assert_agrees_with_matrices(trial, skeleton, every=997) >= 38


@pytest.mark.data
def test_cmu_actors_stand_on_the_floor_in_metres_and_walk(data_root):
    clip = read_amc(data_root / "cmu-asf" / "02" / "02_01.amc", ends=True)
    assert len(clip.skeleton) == 31 + 7
    positions = joint_positions(
        clip.skeleton, clip.rotations_local, clip.offsets, clip.root_positions
    )
    lowest = positions[..., 1].amin(-1)
    assert lowest.abs().max() < 0.1
    height = positions[:, clip.skeleton.index("head_end"), 1] - lowest
    assert 1.4 < height.median() < 2.0
    path = (clip.root_positions[-1] - clip.root_positions[0])[[0, 2]].norm()
    assert 0.8 < path / clip.duration < 2.0
