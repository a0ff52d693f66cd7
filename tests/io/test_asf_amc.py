"""ASF/AMC agrees with a slow computation by matrices, bone by bone, that shares no code with it."""

from __future__ import annotations

import itertools
import math
from pathlib import Path

import numpy as np
import pytest
import torch

from posecast.errors import DataError
from posecast.io.asf import read_asf
from posecast.io.asf_amc import read_amc
from posecast.skeleton import joint_positions

ASF = """# made for this test
:version 1.10
:name TEST
:units
  mass 1.0
  length 0.45
  angle deg
:documentation
   root begin end :not a section
   begin
:root
   order TX TY TZ RX RY RZ
   axis XYZ
   position 0 0 0
   orientation 0 0 0
:bonedata
  begin
     id 1
     name hip
     direction 0.6 -0.8 0
     length 2.5
     axis 0 0 0  XYZ
  end
  begin
     id 2
     name thigh
     direction 0.34202 -0.939693 0
     length 7.25e+000
     axis 10 -20 30 XYZ
     dof rx ry rz
     limits (-160.0 20.0)
            (-70.0 70.0)
            (-inf inf)
  end
  begin
     id 3
     name shin
     direction 0 -1 0
     length 7
     axis -90 7.62852e-016 20 ZXY
     dof rx
     limits (-10.0 170.0)
  end
  begin
     id 4
     name back
     direction 0 1 0
     length 4
     axis 15 25 35 YZX
     dof rz rx
     bodymass 3
  end
:hierarchy
  begin
    root back hip
    hip thigh
    thigh shin
  end
"""

AMC = """#!OML:ASF C:\\somewhere\\test.ASF
:FULLY-SPECIFIED
:DEGREES
1
root 1 2 3 10 20 30
back 5 -6
thigh 7 8 9e-001
shin -10
2
root 1.5 2 -3 100 -20 35
back 5.5 -6.25
thigh 7.125 80 9
shin -1.25e-015
"""


@pytest.fixture
def trial(tmp_path: Path) -> Path:
    (tmp_path / "07.asf").write_text(ASF)
    (tmp_path / "07_01.amc").write_text(AMC)
    return tmp_path / "07_01.amc"


def elementary(axis: str, degrees: float) -> np.ndarray:
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return np.array(
        {
            "x": [[1, 0, 0], [0, c, -s], [0, s, c]],
            "y": [[c, 0, s], [0, 1, 0], [-s, 0, c]],
            "z": [[c, -s, 0], [s, c, 0], [0, 0, 1]],
        }[axis]
    )


def chained(order: str, degrees: list[float]) -> np.ndarray:
    """Turns about fixed axes, first letter first."""
    matrix = np.eye(3)
    for axis, angle in zip(order, degrees, strict=True):
        matrix = elementary(axis, angle) @ matrix
    return matrix


class SlowActor:
    """Bones read naively (well-formed files, degrees) and placed by the definition of the format.

    A bone starts where its parent ends and ends at start + W direction length, with
    W = W_parent C M C^T.
    """

    def __init__(self, asf: Path) -> None:
        words = asf.read_text().split(":bonedata")[1].split()
        self.bones: dict[str, dict[str, list[str]]] = {}
        keys = (
            "id",
            "bodymass",
            "name",
            "direction",
            "length",
            "axis",
            "dof",
            "limits",
            "begin",
            "end",
        )
        key, bone = "", {}
        for word in words[: words.index(":hierarchy")]:
            if word == "begin":
                bone = {"dof": []}
            if word in keys:
                key = word
                bone.setdefault(key, [])
            else:
                bone[key].append(word)
            if word == "end":
                self.bones[bone["name"][0]] = bone
        self.parent: dict[str, str] = {}
        for line in asf.read_text().split(":hierarchy")[1].splitlines():
            parent, *children = line.split() or [""]
            self.parent.update(dict.fromkeys(children, parent))

    def place(self, frame: dict[str, list[float]]) -> tuple[dict, dict]:
        """Start and end of every bone, in the unit of the file."""
        turn = {"root": chained("xyz", frame["root"][3:])}
        start: dict[str, np.ndarray] = {}
        end = {"root": np.array(frame["root"][:3])}
        waiting = list(self.parent)
        while waiting:
            name = waiting.pop(0)
            if self.parent[name] not in end:
                waiting.append(name)
                continue
            bone = self.bones[name]
            about = dict(zip("xyz", map(float, bone["axis"][:3]), strict=True))
            order = bone["axis"][3].lower()
            frame_axes = chained(order, [about[axis] for axis in order])
            moved = chained("".join(dof[1] for dof in bone["dof"]), frame.get(name, []))
            turn[name] = turn[self.parent[name]] @ frame_axes @ moved @ frame_axes.T
            start[name] = end[self.parent[name]]
            direction = np.array([float(part) for part in bone["direction"]])
            end[name] = start[name] + turn[name] @ direction * float(bone["length"][0])
        return start, end


def slow_frame(lines: list[str], number: int) -> dict[str, list[float]]:
    """The frame with this number, from 1."""
    start = lines.index(str(number))
    rows = itertools.takewhile(lambda line: not line.isdigit(), lines[start + 1 :])
    return {row.split()[0]: [float(word) for word in row.split()[1:]] for row in rows}


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
    with pytest.raises(DataError, match=r"2 skeletons beside it.*skeleton="):
        read_amc(stranger)
    assert torch.equal(read_amc(stranger, asf).offsets, expected.offsets)
    other.unlink()
    assert torch.equal(read_amc(stranger).offsets, expected.offsets)
    asf.unlink()
    with pytest.raises(DataError, match=r"no skeleton beside it.*skeleton="):
        read_amc(stranger)


AMC_FAULTS = {
    "cut in a frame": (AMC[: AMC.rindex("thigh")], "ends without 2 of its bones", 11),
    "cut in a row": (AMC[: AMC.rindex(" 9")], "2 values for 'thigh', expected 3", 12),
    "bone lacks": (AMC.replace("back 5 -6\n", ""), r"frame 1 ends without 1.*\(back\)", 8),
    "bone twice": (AMC.replace("shin -10", "back 1 2\nshin -10"), "'back' stands twice", 8),
    "strange bone": (AMC.replace("back 5 -6", "tail 5 -6"), "'tail' is not in 07.asf", 6),
    "not a number": (AMC.replace("5.5", "5,5"), "'5,5', expected a finite number", 11),
    "NaN": (AMC.replace("5.5", "nan"), "'nan', expected a finite number", 11),
    "overflow": (AMC.replace("5.5", "5e999"), "'5e999', expected a finite number", 11),
    "underscore": (AMC.replace("5.5", "5_5"), "'5_5', expected a finite number", 11),
    "frame lost": (AMC.replace("\n2\n", "\n3\n"), "frame 3, expected 2", 9),
    "no frame number": (AMC.replace("\n1\n", "\n"), "'root', expected a frame number", 4),
    "header only": (AMC[: AMC.index("1\n")], "no frames", None),
    "empty": ("", "is empty", None),
    "binary": ("\x00\x01" + AMC, "zero byte at position 0", None),
}


@pytest.mark.parametrize("fault", AMC_FAULTS)
def test_a_damaged_motion_is_refused_with_line_and_reason(trial, fault):
    text, message, line = AMC_FAULTS[fault]
    trial.write_text(text)
    with pytest.raises(DataError, match=message) as caught:
        read_amc(trial)
    assert caught.value.line == line
    assert str(caught.value).startswith(str(trial))


ASF_FAULTS = {
    "no hierarchy": (ASF[: ASF.index(":hierarchy")], "no section ':hierarchy'", None),
    "cut in a bone": (
        ASF[: ASF.rindex("axis 15")] + ":hierarchy\nroot hip\n",
        "bone data are cut off",
        None,
    ),
    "bone without length": (ASF.replace("     length 7\n", ""), "'shin' has no 'length'", None),
    "bone without name": (ASF.replace("     name hip\n", ""), "no 'name'", None),
    "bone named twice": (
        ASF.replace("name shin", "name thigh"),
        "'thigh', expected one that no other",
        37,
    ),
    "unknown child": (ASF.replace("thigh shin", "thigh foot"), "no bone is called 'foot'", 57),
    "two parents": (ASF.replace("thigh shin", "thigh shin hip"), "'hip' has a second parent", 57),
    "unconnected": (ASF.replace("    thigh shin\n", ""), r"does not connect \['shin'\]", None),
    "circle": (
        ASF.replace("root back hip", "root back").replace("thigh shin", "thigh shin hip"),
        "does not connect",
        None,
    ),
    "bad axis": (ASF.replace("30 XYZ", "30 XYY"), "axis order 'xyy'", 29),
    "bad number": (ASF.replace("0.6 -0.8 0", "0.6 -0.8 up"), "'up', expected a finite", 20),
    "too few numbers": (ASF.replace("0.6 -0.8 0", "0.6"), "1 values, expected 3", 20),
    "stretching bone": (ASF.replace("dof rz rx", "dof rz l"), "slide or stretch", 50),
    "dof twice": (ASF.replace("dof rz rx", "dof rz rz"), "at most once", 50),
    "unit zero": (ASF.replace("length 0.45", "length 0"), "unit of length 0", 6),
    "unit of angle": (ASF.replace("angle deg", "angle grad"), "'grad', expected deg or rad", 7),
    "root without order": (ASF.replace("   order TX TY TZ RX RY RZ\n", ""), "no 'order'", None),
    "empty": (" \n", "is empty", None),
}


@pytest.mark.parametrize("fault", ASF_FAULTS)
def test_a_damaged_skeleton_is_refused_with_line_and_reason(trial, fault):
    text, message, line = ASF_FAULTS[fault]
    asf = trial.with_name("07.asf")
    asf.write_text(text)
    with pytest.raises(DataError, match=message) as caught:
        read_asf(asf)
    assert caught.value.line == line
    assert caught.value.path == str(asf)


def test_missing_files_and_folders_are_refused(tmp_path):
    with pytest.raises(DataError, match="there is no such file"):
        read_amc(tmp_path / "01_01.amc")
    with pytest.raises(DataError, match="not a regular file"):
        read_amc(tmp_path)
    (tmp_path / "01_01.amc").write_text(AMC)
    with pytest.raises(DataError, match="there is no such file"):
        read_amc(tmp_path / "01_01.amc", tmp_path / "02.asf")


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
