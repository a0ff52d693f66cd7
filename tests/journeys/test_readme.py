"""What the README says, typed as it stands there, on data that anybody can make."""

from __future__ import annotations

import re
import shlex
import shutil
from pathlib import Path

import pytest

from posecast.cli.main import main
from posecast.corpora.synthetic import make_clip
from posecast.io import read_clip, write_clip

README = Path(__file__).parents[2] / "README.md"
SHORT = (
    "model.backbone.hidden=16",
    "training.epochs=1",
    "training.batch=4",
    "training.sampling.steps_per_epoch=2",
    "protocol.prefix_ms=400",
)


def _blocks(language: str) -> list[str]:
    """The README's code blocks in a language."""
    return re.findall(rf"```{language}\n(.*?)```", README.read_text("utf-8"), flags=re.DOTALL)


def _commands() -> list[list[str]]:
    """The README's calls of posecast, without their comments."""
    lines = [line for block in _blocks("sh") for line in block.splitlines()]
    return [shlex.split(line, comments=True)[1:] for line in lines if line.startswith("posecast ")]


@pytest.fixture
def desk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a walk, the examples, and ten walks, as the reader of the README would have."""
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "data" / "my-folder"
    folder.mkdir(parents=True)
    for index in range(10):
        write_clip(make_clip(index, fps=50.0, seconds=3.0), folder / f"walk_{index}.bvh")
    write_clip(make_clip(10, fps=50.0, seconds=3.0), tmp_path / "walk.bvh")
    shutil.copytree(README.parent / "examples", tmp_path / "examples")
    return tmp_path


def test_the_commands_and_the_script_of_the_readme_work(desk: Path) -> None:
    commands = _commands()
    assert [command[0] for command in commands] == [
        "--help",
        "doctor",
        "convert",
        "view",
        "train",
        "evaluate",
        "forecast",
        "models",
        "walk",
    ]
    for command in commands:
        _succeed([*command, *(SHORT if command[0] == "train" else ())])
    assert read_clip(desk / "walk.npz").frames == 150
    assert (desk / "walk.gif").read_bytes()[:3] == b"GIF"
    assert read_clip(desk / "forecast.bvh").frames == 200
    assert read_clip(desk / "eight.bvh").frames > 500
    scripts = _blocks("python")
    assert len(scripts) == 1
    (desk / "forecast.bvh").unlink()
    exec(compile(scripts[0], str(README), "exec"), {})
    assert read_clip(desk / "forecast.bvh").frames == 200


def test_the_demo_leaves_what_it_promises(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "demo"
    # as after an earlier demo that was killed
    for left in ("best", "last.previous", ".last-x1y2"):
        (folder / "run" / left).mkdir(parents=True)
    (folder / "run" / ".state.0123.safetensors").touch()
    _succeed(["demo", "--out", str(folder), *SHORT[:4]])
    out = capsys.readouterr().out
    assert "zero-velocity" in out
    assert "Error below zero velocity (euler):" in out
    names = {path.name for path in folder.iterdir()}
    assert {
        "run",
        "results.md",
        "results.csv",
        "results.json",
        "forecast.bvh",
        "truth.bvh",
        "forecast.gif",
        "error_over_horizon.png",
    } == names
    truth, forecast = (read_clip(folder / f"{name}.bvh") for name in ("truth", "forecast"))
    assert truth.frames == forecast.frames == 75
    assert truth.fps == forecast.fps == 25


def test_the_demo_removes_nothing_that_is_not_its_own(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    thesis = tmp_path / "project" / "run" / "thesis.txt"
    thesis.parent.mkdir(parents=True)
    thesis.write_text("years")
    with pytest.raises(SystemExit) as stop:
        main(["demo", "--out", str(tmp_path / "project"), *SHORT[:4]])
    assert stop.value.code == 2
    assert "holds 'thesis.txt', which no demo wrote" in capsys.readouterr().err
    assert thesis.read_text() == "years"


def _succeed(arguments: list[str]) -> None:
    """Call the command line, which must say that all went well."""
    with pytest.raises(SystemExit) as stop:
        main(arguments)
    assert stop.value.code == 0
