"""The verbs as a user types them: results on standard output, mistakes with exit code 2."""

from __future__ import annotations

import json
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
import torch
import typer.main
from tests.io.glb_reference import Glb

from posecast.cli.main import app, main
from posecast.corpora.synthetic import make_clip
from posecast.io import read_clip, write_clip
from posecast.motion import drop_joints

VERBS = (
    "demo",
    "recipes",
    "train",
    "evaluate",
    "compare",
    "reproduce",
    "endure",
    "export",
    "models",
    "forecast",
    "convert",
    "inspect",
    "doctor",
    "view",
    "walk",
)


class Outcome(NamedTuple):
    """What a call of the command line did."""

    code: int
    out: str
    err: str


@pytest.fixture
def posecast(capsys: pytest.CaptureFixture[str]) -> Callable[..., Outcome]:
    """Call the command line in this process."""

    def call(*arguments: object) -> Outcome:
        try:
            main([str(argument) for argument in arguments])
            code: object = 0
        except SystemExit as stop:
            code = stop.code
        captured = capsys.readouterr()
        return Outcome(0 if code is None else int(str(code)), captured.out, captured.err)

    return call


@pytest.fixture(scope="module")
def walk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A BVH file of three seconds of synthetic walking."""
    path = tmp_path_factory.mktemp("clips") / "walk.bvh"
    write_clip(make_clip(0, fps=50.0, seconds=3.0), path)
    return path


@pytest.mark.parametrize(
    ("verb", "lacking", "extra"),
    [
        (["train", "quaternet-vel-small"], "lightning", "posecast[train]"),
        (["demo"], "lightning", "posecast[train]"),
        (["demo"], "matplotlib.figure", "posecast[video]"),
        (["demo"], "PIL.Image", "posecast[video]"),
        (["view", "WALK", "--out", "walk.png"], "matplotlib.figure", "posecast[video]"),
        (["export", "runs/none/best", "--out", "step.onnx"], "onnxruntime", "posecast[onnx]"),
    ],
)
def test_what_is_not_installed_is_named_before_any_work(
    posecast: Callable[..., Outcome],
    walk: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    verb: list[str],
    lacking: str,
    extra: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, lacking, None)
    outcome = posecast(*[walk if word == "WALK" else word for word in verb])
    assert outcome.code == 2
    assert f"is not installed; pip install {extra}" in outcome.err
    assert outcome.err.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_every_verb_is_there_and_its_help_ends_with_an_example() -> None:
    group = typer.main.get_command(app)
    commands = group.commands  # type: ignore[attr-defined]
    assert set(commands) == set(VERBS)
    for name, command in commands.items():
        assert str(command.epilog).startswith(f"Example: posecast {name}")


def test_converting_there_and_back_keeps_the_motion(
    posecast: Callable[..., Outcome], walk: Path, tmp_path: Path
) -> None:
    assert posecast("convert", walk, tmp_path / "walk.npz").code == 0
    assert posecast("convert", tmp_path / "walk.npz", tmp_path / "again.bvh").code == 0
    first, again = read_clip(walk), read_clip(tmp_path / "again.bvh")
    assert first.skeleton == again.skeleton
    torch.testing.assert_close(first.root_positions, again.root_positions, atol=1e-6, rtol=0)


def test_a_folder_is_converted_whole_without_its_licence(
    posecast: Callable[..., Outcome], walk: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "in"
    (folder / "more").mkdir(parents=True)
    shutil.copy(walk, folder / "walk.bvh")
    shutil.copy(walk, folder / "more" / "WALK.BVH")
    (folder / "license.txt").write_text("Free, for research.")
    outcome = posecast("convert", folder, tmp_path / "out", "--to", "npz")
    assert outcome.code == 0
    assert "2 files written" in outcome.err
    assert (tmp_path / "out" / "walk.npz").is_file()
    assert (tmp_path / "out" / "more" / "WALK.npz").is_file()
    refused = posecast("convert", walk.parent, tmp_path / "out")
    assert refused.code == 2
    assert "--to bvh, --to glb or --to npz" in refused.err


def test_convert_may_pin_feet(posecast: Callable[..., Outcome], walk: Path, tmp_path: Path) -> None:
    clip = read_clip(walk)
    scale = clip.root_positions.new_tensor((1.05, 1.0, 1.05))
    sliding, pinned = tmp_path / "sliding.npz", tmp_path / "pinned.bvh"
    write_clip(replace(clip, root_positions=clip.root_positions * scale), sliding)
    outcome = posecast("convert", sliding, pinned, "--pin-feet")
    assert outcome.code == 0
    assert f"{sliding}: feet pinned in " in outcome.err
    again = posecast("convert", pinned, tmp_path / "again.bvh", "--pin-feet")
    assert "feet pinned in 0 of " in again.err
    stiff = tmp_path / "stiff.npz"
    write_clip(drop_joints(clip, ["LeftLeg", "RightLeg"]), stiff)
    refused = posecast("convert", stiff, tmp_path / "out.bvh", "--pin-feet")
    assert refused.code == 2
    assert f"{stiff}: clip " in refused.err
    assert "has no thigh or no shin" in refused.err


def test_a_clip_and_a_folder_become_animated_armatures(
    posecast: Callable[..., Outcome], walk: Path, tmp_path: Path
) -> None:
    outcome = posecast("convert", walk, tmp_path / "slow.glb", "--resample", "25")
    assert (outcome.code, outcome.out, outcome.err) == (0, "", "")
    glb = Glb(tmp_path / "slow.glb")
    assert len(glb.times) == 75
    assert glb.json["asset"]["extras"]["fps"] == pytest.approx(25)
    assert posecast("convert", walk.parent, tmp_path / "out", "--to", "glb").code == 0
    assert len(Glb(tmp_path / "out" / "walk.glb").times) == 150


def test_two_files_of_a_folder_never_become_one(
    posecast: Callable[..., Outcome], walk: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "in"
    folder.mkdir()
    shutil.copy(walk, folder / "walk.bvh")
    write_clip(read_clip(walk), folder / "walk.npz")
    outcome = posecast("convert", folder, tmp_path / "out", "--to", "npz")
    assert outcome.code == 2
    assert "walk.bvh and " in outcome.err
    assert "would both become" in outcome.err
    assert not (tmp_path / "out").exists()


def test_what_a_format_cannot_keep_is_said(
    posecast: Callable[..., Outcome], tmp_path: Path
) -> None:
    clip = make_clip(0, fps=50.0, seconds=1.0)
    moving = clip.offsets.expand(clip.frames, -1, -1).clone()
    moving[5, clip.skeleton.index("Head")] += 0.01
    write_clip(replace(clip, translations_local=moving), tmp_path / "walk.npz")
    outcome = posecast("convert", tmp_path / "walk.npz", tmp_path / "again.bvh")
    assert outcome.code == 0
    assert "'Head' moves, which its channels cannot say" in outcome.err


def test_names_in_any_script_are_json_on_any_terminal(
    posecast: Callable[..., Outcome], walk: Path, tmp_path: Path
) -> None:
    path = tmp_path / "walk.bvh"
    path.write_bytes(walk.read_bytes().replace(b"JOINT Head", "JOINT 頭".encode()))
    outcome = posecast("inspect", path, "--json")
    assert outcome.out.isascii()
    assert "頭" in [joint["name"] for joint in json.loads(outcome.out)["joints"]]


def test_resampling_changes_the_frame_rate(
    posecast: Callable[..., Outcome], walk: Path, tmp_path: Path
) -> None:
    assert posecast("convert", walk, tmp_path / "slow.bvh", "--resample", "25").code == 0
    assert read_clip(tmp_path / "slow.bvh").fps == pytest.approx(25)
    assert read_clip(tmp_path / "slow.bvh").frames == 75


def test_inspect_says_what_is_in_a_file(posecast: Callable[..., Outcome], walk: Path) -> None:
    outcome = posecast("inspect", walk, "--json")
    facts = json.loads(outcome.out)
    assert (outcome.code, facts["frames"], facts["fps"]) == (0, 150, 50)
    assert 1.0 < facts["height_m"] < 2.2
    assert len(facts["joints"]) > 15
    assert f"joints: {len(facts['joints'])}" in posecast("inspect", walk).out


def test_doctor_reports_on_a_folder(posecast: Callable[..., Outcome], walk: Path) -> None:
    outcome = posecast("doctor", walk.parent)
    assert outcome.code == 0
    assert "walk" in outcome.out or "folder" in outcome.out
    assert isinstance(json.loads(posecast("doctor", walk.parent, "--json").out), dict)


def test_doctor_tells_scripts_of_files_that_cannot_be_read(
    posecast: Callable[..., Outcome], walk: Path, tmp_path: Path
) -> None:
    (tmp_path / "good.bvh").write_bytes(walk.read_bytes())
    (tmp_path / "cut.bvh").write_bytes(walk.read_bytes()[:500])
    outcome = posecast("doctor", tmp_path)
    assert outcome.code == 1
    assert "cut.bvh" in outcome.out


def test_view_draws_a_strip(posecast: Callable[..., Outcome], walk: Path, tmp_path: Path) -> None:
    assert posecast("view", walk, walk, "--out", tmp_path / "walk.png").code == 0
    assert (tmp_path / "walk.png").read_bytes()[:4] == b"\x89PNG"


def test_recipes_are_listed_with_source_and_size(posecast: Callable[..., Outcome]) -> None:
    rows = {row["name"]: row for row in json.loads(posecast("recipes", "--json").out)}
    assert rows["quaternet-vel"]["parameters"] == 9_526_128
    listing = posecast("recipes").out
    assert "9,526,128 parameters" in listing
    assert all(f"{name}: " in listing for name in rows)
    assert "kind: gru" in posecast("recipes", "quaternet-vel").out


def test_a_baseline_is_scored_as_one_json_object(posecast: Callable[..., Outcome]) -> None:
    outcome = posecast(
        "evaluate", "zero-velocity", "--corpus", "synthetic", "--protocol", "short-term", "--json"
    )
    report = json.loads(outcome.out)
    assert set(report) == {"system", "corpus", "protocol", "rows", "missing"}
    assert report["system"] == "zero-velocity"
    assert len(report["rows"]) > 16
    assert {"action", "metric", "horizon_ms", "value", "windows"} <= set(report["rows"][0])


MISTAKES = {
    "a file that is not there": (["inspect", "nowhere.bvh"], "nowhere.bvh"),
    "a misspelled key": (
        ["train", "quaternet-vel-small", "training.epoch=3"],
        "training.epoch: unknown key; did you mean 'epochs'?",
    ),
    "an unknown recipe": (["train", "quaternet"], "no recipe is called 'quaternet'"),
    "an unknown system": (["evaluate", "zero-velocityy"], "did you mean 'zero-velocity'?"),
    "a baseline without corpus": (["evaluate", "zero-velocity"], "name one with --corpus"),
    "an unknown corpus": (
        ["evaluate", "zero-velocity", "--corpus", "synthetc"],
        "did you mean 'synthetic'?",
    ),
    "an unknown protocol": (
        ["evaluate", "zero-velocity", "--corpus", "synthetic", "--protocol", "short"],
        "did you mean 'short-term'?",
    ),
    "an unknown split": (
        ["evaluate", "zero-velocity", "--corpus", "synthetic", "--split", "tset"],
        "has no split 'tset'",
    ),
    "a folder that is not there": (
        ["train", "quaternet-vel", "--root", "nowhere"],
        "--root nowhere: not a folder",
    ),
    "a checkpoint that is none": (
        ["forecast", ".", "walk.bvh", "--out", "out.bvh"],
        "not a checkpoint",
    ),
    "a frame rate that is no number": (
        ["convert", "WALK", "out.bvh", "--fps", "inf"],
        "--fps inf: expected frames per second",
    ),
    "more frames than fit in memory": (
        ["convert", "WALK", "out.bvh", "--resample", "1e9"],
        "--resample 1e+09: expected frames per second, above 0 and at most 10000",
    ),
    "a horizon of ages": (
        ["forecast", ".", "WALK", "--out", "out.bvh", "--horizon-ms", "1e15"],
        "--horizon-ms",
    ),
    "a folder's option for a file": (
        ["convert", "WALK", "out.bvh", "--to", "npz"],
        "--to npz is for folders",
    ),
    "a folder written over itself": (["convert", "FOLDER", "FOLDER", "--to", "bvh"], "to be read"),
    "a folder where a file is": (
        ["convert", "FOLDER", "WALK", "--to", "npz"],
        "walk.bvh: File exists",
    ),
    "a forecast that begins at no time": (
        ["view", "WALK", "--out", "walk.png", "--split-ms", "nan"],
        "--split-ms nan: expected a time in the clip, 0 to 3000 ms",
    ),
    "a forecast that begins after the end": (
        ["view", "WALK", "--out", "walk.png", "--split-ms", "3000"],
        "--split-ms 3000: expected a time in the clip",
    ),
    "an adversary that weighs less than nothing": (
        [
            *("train", "quaternet-vel-small", "--corpus", "synthetic", "--out", "run"),
            "training.adversary={continuity: -0.5}",
        ],
        "training.adversary: continuity has weight -0.5; expected more than 0",
    ),
    "an armature to be read": (
        ["convert", "walk.glb", "out.bvh"],
        "GLB is only written; keep the clip as .bvh or .npz beside it, and read that",
    ),
    "a picture nobody can draw": (["view", "WALK", "--out", "walk.docx"], "walk.docx"),
    "an unknown option": (["inspect", "--colour"], "No such option"),
}


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_a_line_and_exit_code_2(
    posecast: Callable[..., Outcome],
    walk: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    mistake: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    arguments, message = MISTAKES[mistake]
    before = walk.read_bytes()
    places = {"WALK": walk, "FOLDER": walk.parent}
    outcome = posecast(*[places.get(argument, argument) for argument in arguments])
    assert outcome.code == 2
    assert message in outcome.err
    assert "Traceback" not in outcome.err
    assert not outcome.out
    assert not list(tmp_path.iterdir())
    assert list(walk.parent.iterdir()) == [walk]
    assert walk.read_bytes() == before


def test_where_a_table_cannot_go_is_said_before_it_is_made(
    posecast: Callable[..., Outcome], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def never(*arguments: object, **options: object) -> None:
        raise AssertionError("scored")

    monkeypatch.setattr("posecast.cli.scoring.score_systems", never)
    target = tmp_path / "nowhere" / "table.csv"
    outcome = posecast("evaluate", "zero-velocity", "--corpus", "synthetic", "--csv", target)
    assert outcome.code == 2
    assert "there is no folder" in outcome.err


def test_several_names_with_a_baseline_among_them_are_refused(
    posecast: Callable[..., Outcome],
) -> None:
    outcome = posecast("evaluate", "zero-velocity", "running-average-2", "--corpus", "synthetic")
    assert outcome.code == 2
    assert (
        "'zero-velocity' is a baseline, and those of the protocol are in every table" in outcome.err
    )


def test_a_body_without_bones_is_not_drawn_and_is_noted_where_it_is_written(
    posecast: Callable[..., Outcome], tmp_path: Path
) -> None:
    source, body = tmp_path / "amass.npz", tmp_path / "body.npy"
    np.savez(source, poses=np.zeros((4, 72)), trans=np.zeros((4, 3)), mocap_framerate=60.0)
    np.save(body, np.random.default_rng(0).uniform(-0.5, 0.5, (24, 3)))
    refused = posecast("view", source, "--out", tmp_path / "a.png")
    assert refused.code == 2
    assert "give the body at rest (--template FILE)" in refused.err
    for written in ("a.bvh", "a.glb"):
        assert "no bone lengths" in posecast("convert", source, tmp_path / written).err
    assert "no bone lengths" in posecast("inspect", source).out
    drawn = posecast("view", source, "--out", tmp_path / "a.png", "--template", body)
    assert (drawn.code, (tmp_path / "a.png").is_file()) == (0, True)


def test_an_option_goes_to_the_files_that_have_it(
    posecast: Callable[..., Outcome], walk: Path, tmp_path: Path
) -> None:
    archive = tmp_path / "walk.npz"
    write_clip(read_clip(walk), archive)
    outcome = posecast("inspect", archive, walk, "--unit", "0.02", "--json")
    assert outcome.code == 0
    small, large = (fact["height_m"] for fact in json.loads(outcome.out))
    assert large == pytest.approx(2 * small, rel=1e-3)
    refused = posecast("inspect", archive, "--unit", "0.02")
    assert refused.code == 2
    assert refused.err == "posecast: --unit is for BVH files, and there is none here\n"
    assert "--up q: expected x, y or z" in posecast("inspect", walk, "--up", "q").err


def test_tables_are_written_whoever_reads_standard_output(tmp_path: Path) -> None:
    target = tmp_path / "table.csv"
    verb = ["evaluate", "zero-velocity", "--corpus", "synthetic", "--csv", target]
    command = [sys.executable, "-m", "posecast.cli.main", *verb]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as scoring:
        assert scoring.stdout is not None
        scoring.stdout.close()
        scoring.wait(120)
    assert target.read_text().startswith("system,")


def test_a_folder_half_converted_says_how_far_it_came(
    posecast: Callable[..., Outcome], walk: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "in"
    folder.mkdir()
    shutil.copy(walk, folder / "a.bvh")
    (folder / "b.bvh").write_text("HIERARCHY")
    outcome = posecast("convert", folder, tmp_path / "out", "--to", "npz")
    assert outcome.code == 2
    assert f"1 of 2 files were written to {tmp_path / 'out'} before this one" in outcome.err


def test_too_little_memory_is_a_line(
    posecast: Callable[..., Outcome], walk: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*arguments: object, **options: object) -> None:
        raise MemoryError

    monkeypatch.setattr("posecast.io.read_clip", full)
    outcome = posecast("inspect", walk)
    assert outcome.code == 1
    assert outcome.err == "posecast: there is not enough memory for this; try a shorter clip\n"


def test_a_terminated_program_leaves_nothing_half_written(walk: Path, tmp_path: Path) -> None:
    target = tmp_path / "walk.gif"
    command = [sys.executable, "-m", "posecast.cli.main", "view", *[walk] * 4, "--out", target]
    with subprocess.Popen(command) as drawing:
        while drawing.poll() is None and not list(tmp_path.iterdir()):
            time.sleep(0.01)
        drawing.terminate()
        assert drawing.wait(60) == 128 + signal.SIGTERM
    assert not list(tmp_path.iterdir())
