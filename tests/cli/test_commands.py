"""The verbs as a user types them: results on standard output, mistakes with exit code 2."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import pytest
import torch
import typer.main

from posecast.cli.main import app, main
from posecast.corpora.synthetic import make_clip
from posecast.io import read_clip, write_clip

VERBS = (
    "demo",
    "recipes",
    "train",
    "evaluate",
    "forecast",
    "convert",
    "inspect",
    "doctor",
    "view",
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


def test_a_folder_is_converted_whole(
    posecast: Callable[..., Outcome], walk: Path, tmp_path: Path
) -> None:
    outcome = posecast("convert", walk.parent, tmp_path / "out", "--to", "npz")
    assert outcome.code == 0
    assert (tmp_path / "out" / "walk.npz").is_file()
    refused = posecast("convert", walk.parent, tmp_path / "out")
    assert refused.code == 2
    assert "--to bvh or --to npz" in refused.err


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
    outcome = posecast(*[walk if argument == "WALK" else argument for argument in arguments])
    assert outcome.code == 2
    assert message in outcome.err
    assert "Traceback" not in outcome.err
    assert not outcome.out
    assert not list(tmp_path.iterdir())
