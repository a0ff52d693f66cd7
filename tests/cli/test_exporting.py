"""``posecast export``: a checkpoint in, a step and its record out."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

from posecast.cli.main import main
from posecast.recipe import load_recipe
from posecast.skeleton import Skeleton
from posecast.system import System, save


@pytest.fixture
def checkpoint(tmp_path: Path) -> Path:
    """A system that was not trained."""
    skeleton = Skeleton(("Hips", "Spine", "Head"), (-1, 0, 1))
    recipe = load_recipe("quaternet-vel-small", ["model.backbone.hidden=16"])
    forecaster = recipe.build_forecaster(recipe.build_codec(skeleton))
    offsets = ((0.0, 0.9, 0.0), (0.0, 0.4, 0.0), (0.0, 0.3, 0.0))
    save(System(recipe, forecaster, offsets, {"epoch": 0}), tmp_path / "best")
    return tmp_path / "best"


def run(*arguments: object) -> None:
    """Call the command line, which succeeds."""
    with pytest.raises(SystemExit) as stop:
        main([str(argument) for argument in arguments])
    assert not stop.value.code


def test_a_step_and_its_record_are_written_and_their_difference_is_told(
    checkpoint: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], onnx_extra: None
) -> None:
    run("export", checkpoint, "--out", tmp_path / "step.onnx", "--json")
    said = json.loads(capsys.readouterr().out)
    run("export", checkpoint, "--out", tmp_path / "again.onnx")
    record = json.loads((tmp_path / "step.json").read_text("utf-8"))
    assert said == {
        "step": str(tmp_path / "step.onnx"),
        "record": str(tmp_path / "step.json"),
        "parity": record["parity"],
    }
    assert record["skeleton"]["names"] == ["Hips", "Spine", "Head"]
    told = capsys.readouterr().err
    assert re.search(
        r"again\.onnx written: [\d,]+ weights, 0\.\d MB; differs .* by \d\.\de-0", told
    )
    assert "at batch sizes 1, 3, 8" in told


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--out", "step.onnx", "--mode", "quick"], "mode: 'quick' is not known"),
        (["--out", "step.pt"], "choose a name that ends in .onnx"),
    ],
)
def test_a_wrong_option_is_one_line(
    options: list[str],
    message: str,
    checkpoint: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    onnx_extra: None,
) -> None:
    monkeypatch.chdir(checkpoint.parent)
    with pytest.raises(SystemExit) as stop:
        main(["export", str(checkpoint), *options])
    assert stop.value.code == 2
    said = capsys.readouterr().err
    assert message in said
    assert said.count("\n") == 1
