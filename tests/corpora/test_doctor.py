"""Every finding of the doctor on a folder made to have it, and on no other."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from posecast.corpora.cmu import ASF_FILES, SALSA_FILES
from posecast.corpora.doctor import Report, examine
from posecast.corpora.examination import swing_times
from posecast.corpora.h36m import FILES, TEST_FRAMES
from posecast.errors import DataError
from posecast.geometry import quaternion
from posecast.io.archive import write_archive
from posecast.motion import Clip, drop_joints
from posecast.skeleton import joint_positions

Write = Callable[..., Path]
Walk = Callable[..., Clip]
Change = Callable[[Clip], Clip]


def problems(report: Report) -> list[tuple[str, str]]:
    return [(finding.severity, finding.problem) for finding in report.findings]


def edit(file: Path, old: str, new: str) -> None:
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new))


def test_a_sound_folder_has_no_findings(write_walks: Write) -> None:
    report = examine(write_walks([f"{number}.bvh" for number in range(4)]))
    assert report.findings == ()
    assert report.is_sound
    assert (report.corpus, report.format, report.files) == ("folder", "bvh", 4)
    assert (report.frames, report.joints, report.fps) == (960, (21,), (60.0,))
    assert report.minutes == pytest.approx(16 / 60)
    assert (report.unit, report.up) == (0.01, "y")
    assert report.height == pytest.approx(1.55, abs=0.2)
    assert "nothing looks wrong" in report.text()


def test_a_report_is_plain_json(write_walks: Write) -> None:
    root = write_walks(["a.bvh", "b.bvh"], seconds=0.5)
    (root / "b.bvh").write_text("")
    report = examine(root)
    back = json.loads(json.dumps(report.to_json()))
    assert back["files"] == 2
    assert back["findings"][0]["problem"] == "unreadable"
    assert back["findings"][0]["files"] == ["b.bvh"]


def test_broken_files_are_named_with_line_and_stop_nothing(write_walks: Write) -> None:
    root = write_walks(["a.bvh", "b.bvh", "c.bvh", "d.bvh"], seconds=0.5)
    (root / "a.bvh").write_bytes(b"\x00\xff" * 100)
    edit(root / "b.bvh", "Frame Time", "Frame Tame")
    lines = (root / "c.bvh").read_text().splitlines()
    lines[-2] = "nan " + lines[-2].split(" ", 1)[1]
    (root / "c.bvh").write_text("\n".join(lines) + "\n")
    report = examine(root)
    assert [finding.files for finding in report.findings] == [("a.bvh",), ("b.bvh",), ("c.bvh",)]
    assert {finding.problem for finding in report.findings} == {"unreadable"}
    assert f"line {len(lines) - 1}: " in report.findings[2].message
    assert not report.is_sound
    assert report.frames == 30


def test_a_walk_at_the_wrong_rate_is_noticed_and_the_right_one_named(write_walks: Write) -> None:
    for factor, word in ((2.2, "quicker"), (1 / 4, "slower")):
        root = write_walks(["a.bvh", "b.bvh"], fps=50.0)
        for file in root.iterdir():
            edit(file, "Frame Time: 0.02", f"Frame Time: {0.02 / factor:.9f}")
        (finding,) = examine(root).findings
        assert (finding.severity, finding.problem) == ("warning", "frame rate")
        assert word in finding.message
        assert "perhaps 50 fps" in finding.remedy or "perhaps 60 fps" in finding.remedy


@pytest.mark.parametrize("fps", [25.0, 30.0, 60.0, 120.0])
def test_swings_of_the_feet_do_not_depend_on_the_frame_rate(walk: Walk, fps: float) -> None:
    clip = walk(fps=fps, seconds=6.0)
    places = joint_positions(clip.skeleton, clip.rotations_local, clip.offsets, clip.root_positions)
    times = swing_times(clip, places, 1.5)
    assert 6 <= len(times) <= 14
    assert 0.3 < float(np.median(times)) < 0.55


def test_a_clip_at_rest_has_no_swings(walk: Walk) -> None:
    clip = walk(seconds=0.1).cut(0, 1)
    places = joint_positions(clip.skeleton, clip.rotations_local, clip.offsets, clip.root_positions)
    assert swing_times(clip, places, 1.5) == ()
    many = replace(
        clip,
        root_positions=clip.root_positions.expand(50, 3),
        rotations_local=clip.rotations_local.expand(50, -1, 4),
    )
    assert swing_times(many, places, 1.5) == ()


def scaled(clip: Clip, factor: float) -> Clip:
    return replace(clip, offsets=clip.offsets * factor, root_positions=clip.root_positions * factor)


def test_a_body_of_no_persons_height_is_noticed(write_walks: Write) -> None:
    report = examine(write_walks(["a.bvh"], change=lambda clip: scaled(clip, 3), seconds=0.5))
    assert ("warning", "unit") in problems(report)
    (finding,) = [finding for finding in report.findings if finding.problem == "unit"]
    assert "m high, which is no person's height" in finding.message


def test_units_that_differ_are_noticed(write_walks: Write) -> None:
    root = write_walks(["a.bvh", "b.bvh"], seconds=0.5)
    write_walks(["c.bvh"], root=root, change=lambda clip: scaled(clip, 100), seconds=0.5)
    report = examine(root)
    (finding,) = [finding for finding in report.findings if finding.problem == "unit"]
    assert finding.files == ("c.bvh",)
    assert "0.01 m in 2 files" in finding.message


def tipped(clip: Clip) -> Clip:
    """The same motion with z up."""
    turn = clip.rotations_local.new_tensor([0.5**0.5, 0.5**0.5, 0.0, 0.0])
    rotations = clip.rotations_local.clone()
    rotations[:, 0] = quaternion.product(turn, rotations[:, 0])
    return replace(
        clip,
        rotations_local=rotations,
        root_positions=quaternion.rotate(turn, clip.root_positions),
    )


def test_z_up_is_a_note_for_bvh_which_is_turned_and_a_warning_elsewhere(
    write_walks: Write, walk: Walk, tmp_path: Path
) -> None:
    report = examine(write_walks(["a.bvh", "b.bvh"], change=tipped))
    assert problems(report) == [("note", "up axis")]
    assert report.up == "z"
    write_archive(tipped(walk()), tmp_path / "a.npz")
    report = examine(tmp_path / "a.npz")
    assert problems(report) == [("warning", "up axis")]


def test_different_axes_rates_and_skeletons_are_noticed(write_walks: Write) -> None:
    root = write_walks(["a.bvh", "b.bvh"], fps=60.0)
    write_walks(["c.bvh"], root=root, change=tipped)
    write_walks(["d.bvh"], root=root, fps=25.0)
    write_walks(["e.bvh"], root=root, change=lambda clip: drop_joints(clip, ["Head"]))
    report = examine(root)
    found = {finding.problem: finding for finding in report.findings}
    assert set(found) == {"up axis", "frame rate", "skeleton"}
    assert found["up axis"].files == ("c.bvh",)
    assert "60 in 4 files, 25 in 1 files" in found["frame rate"].message
    assert found["skeleton"].files == ("e.bvh",)
    assert found["skeleton"].severity == "error"


def test_joints_without_length_are_named(write_walks: Write) -> None:
    def flat(clip: Clip) -> Clip:
        offsets = clip.offsets.clone()
        offsets[clip.skeleton.index("Head")] = 0
        return replace(clip, offsets=offsets)

    report = examine(write_walks(["a.bvh"], change=flat, seconds=0.5))
    assert problems(report) == [("note", "zero length")]
    assert "1 joints lie on their parent: Head" in report.findings[0].message


def test_a_leap_and_a_flip_are_found_where_they_are(write_walks: Write) -> None:
    def broken(clip: Clip) -> Clip:
        positions, rotations = clip.root_positions.clone(), clip.rotations_local.clone()
        positions[100:, 0] += 0.5
        head = clip.skeleton.index("Head")
        half_turn = rotations.new_tensor([0.0, 1.0, 0.0, 0.0])
        rotations[50, head] = quaternion.product(rotations[50, head], half_turn)
        return replace(clip, root_positions=positions, rotations_local=rotations)

    report = examine(write_walks(["a.bvh"], change=broken))
    leap, flip = report.findings
    assert problems(report) == [("warning", "jump"), ("note", "jump")]
    assert "leaps 1 times" in leap.message
    assert "(a.bvh, frame 100)" in leap.message
    assert "Head in a.bvh, frame 50" in flip.message or "Head in a.bvh, frame 51" in flip.message


def test_an_inserted_t_pose_is_found(write_walks: Write, with_t_pose: Change) -> None:
    report = examine(write_walks(["a.bvh", "b.bvh"], change=with_t_pose))
    assert problems(report) == [("warning", "T pose")]
    assert report.frames == 2 * 241


def test_bones_that_change_length_are_found(write_walks: Write) -> None:
    def stretching(clip: Clip) -> Clip:
        moved = clip.offsets.expand(clip.frames, -1, -1).clone()
        moved[:, clip.skeleton.index("Head"), 1] += torch.linspace(0, 0.1, clip.frames)
        return replace(clip, translations_local=moved)

    report = examine(write_walks(["a.bvh"], change=stretching))
    assert problems(report) == [("note", "moving bones")]
    assert "Head" in report.findings[0].message


def test_a_recording_for_training_and_testing_is_an_error(write_walks: Write) -> None:
    names = [f"{number:02d}.bvh" for number in range(4)]
    root = write_walks(names, seconds=0.5)
    text = (root / "00.bvh").read_text()
    (root / "03.bvh").write_bytes(text.replace("\n", "\r\n").encode())
    report = examine(root)
    assert problems(report) == [("error", "duplicate")]
    assert "00.bvh (train), 03.bvh (test)" in report.findings[0].message
    (root / "splits.yaml").write_text("train: ['00.bvh', '03.bvh']\ntest: '01.bvh'\n")
    assert problems(examine(root)) == [("note", "duplicate")]
    (root / "splits.yaml").write_text("tarin: '*'\n")
    report = examine(root)
    assert ("error", "splits") in problems(report)


def test_what_the_reader_noted_is_passed_on(write_walks: Write) -> None:
    root = write_walks(["a.bvh"], seconds=0.5)
    edit(root / "a.bvh", "Frames: 30", "Frames: 40")
    report = examine(root)
    assert problems(report) == [("note", "format")]
    assert "40 frames declared, 30 found" in report.findings[0].message


def test_salsa_is_recognised_with_what_is_known_of_it(
    write_walks: Write, with_t_pose: Change
) -> None:
    root = write_walks(SALSA_FILES[:4], change=with_t_pose, fps=120.0, seconds=0.2)
    report = examine(root)
    assert report.corpus == "cmu-salsa"
    assert len(report.missing) == 24
    assert set(problems(report)) == {("warning", "missing"), ("note", "T pose")}
    assert report.minutes == pytest.approx(4 * 25 / 60 / 60)
    assert "60 (headers: 120) fps" in report.text()


def test_asf_trials_are_recognised(write_amc: Write) -> None:
    root = write_amc(ASF_FILES)
    report = examine(root)
    assert (report.corpus, report.files, report.missing) == ("cmu-asf", 28, ())
    assert report.fps == (120.0,)
    assert report.is_sound
    (root / "02" / "02.asf").unlink()
    assert problems(examine(root)).count(("error", "unreadable")) == 10


def test_bandai_is_recognised_with_its_gaps(write_walks: Write, with_root_above: Change) -> None:
    names = [f"dataset-2_walk_normal_{number:03d}.bvh" for number in (1, 2, 4)]
    report = examine(write_walks(names, change=with_root_above, fps=30.0))
    assert report.corpus == "bandai-locomotion"
    assert report.missing == ("dataset-2_walk_normal_003.bvh",)
    assert problems(report) == [("warning", "missing"), ("note", "upper root")]


def test_h36m_is_recognised_with_copies_gaps_and_cut_recordings(write_h36m: Write) -> None:
    low, high = TEST_FRAMES["phoning"][1]
    lengths = {
        "S1/phoning_1.txt": 30,
        "S5/phoning_2.txt": 2 * low,
        "S5/greeting_1.txt": 90,
        "S8/smoking_1.txt": 31,
    }
    root = write_h36m(lengths)
    (root / "S6").mkdir()
    (root / "S6" / "phoning_2.txt").write_bytes((root / "S5" / "phoning_2.txt").read_bytes())
    report = examine(root)
    assert report.corpus == "h36m"
    assert len(report.missing) == 205
    found = {finding.problem: finding for finding in report.findings}
    assert found["length"].files == ("S5/greeting_1.txt",)
    assert "45 frames at 25 fps; the published windows need 679 to 985" in found["length"].message
    assert set(found["duplicate"].files) == {"S5/phoning_2.txt", "S6/phoning_2.txt"}
    assert "walking" in found["missing"].remedy
    assert set(found) == {"length", "duplicate", "missing"}
    assert high > low


def test_amass_is_recognised_and_a_bad_file_in_it(write_amass: Write) -> None:
    root = write_amass({"ACCAD/a/1.npz": 120.0, "SSM/a/1.npz": 60.0, "SSM/a/2.npz": 60.0})
    (root / "SSM" / "a" / "3.npz").write_bytes(b"PK\x03\x04 cut")
    np.savez(root / "SSM" / "a" / "shape.npz", betas=np.zeros(10))
    report = examine(root)
    assert (report.corpus, report.files, report.height) == ("amass", 4, None)
    assert [finding.problem for finding in report.findings] == ["unreadable", "frame rate", "body"]


def test_a_single_file_can_be_examined(
    write_walks: Write, write_h36m: Write, tmp_path: Path
) -> None:
    report = examine(write_walks(["a.bvh"], seconds=1.0) / "a.bvh")
    assert (report.corpus, report.files, report.missing) == ("folder", 1, ())
    root = write_h36m({"S1/phoning_1.txt": 30})
    report = examine(root / "S1" / "phoning_1.txt")
    assert (report.corpus, report.missing, report.findings) == ("h36m", (), ())
    (tmp_path / "notes.md").write_text("nothing")
    report = examine(tmp_path / "notes.md")
    assert problems(report) == [("error", "nothing")]


def test_a_folder_without_motion_says_what_was_expected(tmp_path: Path) -> None:
    report = examine(tmp_path)
    assert problems(report) == [("error", "nothing")]
    assert not report.is_sound
    assert "expected BVH" in report.text()
    with pytest.raises(DataError, match="no such folder or file"):
        examine(tmp_path / "nowhere")


def test_other_corpora_and_formats_in_the_folder_are_mentioned(
    write_walks: Write, write_amc: Write
) -> None:
    root = write_walks(["a.bvh", "b.bvh", "c.fbx"], seconds=0.5)
    write_amc(["02/02_01.amc"], root=root)
    assert problems(examine(root)) == [("warning", "mixture"), ("note", "not read")]


def test_progress_is_told(write_walks: Write) -> None:
    seen: list[tuple[int, int]] = []

    def progress(done: int, total: int) -> None:
        seen.append((done, total))

    examine(write_walks(["a.bvh", "b.bvh"], seconds=0.2), progress=progress)
    assert seen == [(1, 2), (2, 2)]


def test_a_text_names_the_first_files_and_counts_the_rest(
    write_walks: Write, with_t_pose: Change
) -> None:
    root = write_walks([f"{n}.bvh" for n in range(8)], change=with_t_pose, seconds=0.2)
    for number in range(9):
        (root / f"broken{number}.bvh").write_text("HIERARCHY")
    report = examine(root)
    text = report.text()
    assert [finding.problem for finding in report.findings].count("unreadable") == 9
    assert text.count("broken") == 9
    assert "unreadable: 3 more like these [broken6.bvh, broken7.bvh, broken8.bvh]" in text
    assert "[0.bvh, 1.bvh, 2.bvh, 3.bvh, 4.bvh, 5.bvh and 2 more]" in text


@pytest.mark.data
@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("cmu-salsa", {"frame rate", "jump", "T pose"}),
        ("cmu-asf", {"jump", "zero length"}),
        ("bandai-locomotion", {"upper root"}),
        ("h36m", {"duplicate", "missing", "jump"}),
    ],
)
def test_the_true_problems_of_real_data_are_found_and_no_others(
    data_root: Path, name: str, expected: set[str]
) -> None:
    report = examine(data_root / name)
    assert report.corpus == name
    assert {finding.problem for finding in report.findings} == expected
    assert report.is_sound
    if name == "h36m":
        doubles = [finding for finding in report.findings if finding.problem == "duplicate"]
        assert len(doubles) >= 4
        assert set(report.missing) == {
            file for file in FILES if not (data_root / name / file).is_file()
        }
