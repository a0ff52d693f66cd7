"""Models that come with posecast: what they are, where they are, and that they walk."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import torch
from safetensors import safe_open

from posecast.checkpoint import WEIGHTS
from posecast.cli.main import main
from posecast.errors import DataError
from posecast.geometry.quaternion import angle
from posecast.io import read_bvh, read_clip
from posecast.shipped import checkpoint_folder, shipped_models
from posecast.system import load

MODELS = shipped_models()


def run(*arguments: object) -> int:
    """The exit code of a call of the command line."""
    with pytest.raises(SystemExit) as stop:
        main([str(argument) for argument in arguments])
    return stop.value.code or 0


EIGHT = Path(__file__).parents[1] / "examples" / "figure_eight.csv"


@pytest.mark.parametrize("model", MODELS, ids=lambda model: model.name)
def test_a_model_is_small_and_says_what_it_is(model):
    assert model.megabytes <= 20
    assert model.summary
    assert model.data
    for word in ("Data", "Licence", "Scores", "Train it again", model.license.split(",")[0]):
        assert word in model.card
    with safe_open(model.folder / WEIGHTS, "pt") as file:
        kinds = {file.get_tensor(name).dtype for name in file.keys() if "gait" not in name}  # noqa: SIM118
    assert kinds == {torch.float16}
    system = load(model.name)
    assert {weight.dtype for weight in system.forecaster.parameters()} == {torch.float32}
    assert system.gait is not None


def test_a_folder_of_that_name_comes_first(tmp_path, monkeypatch):
    assert checkpoint_folder("locomotion") == MODELS[0].folder
    assert checkpoint_folder("no-such-model") == Path("no-such-model")
    (tmp_path / "locomotion").mkdir()
    monkeypatch.chdir(tmp_path)
    assert checkpoint_folder("locomotion") == Path("locomotion")
    with pytest.raises(DataError, match="not a checkpoint"):
        load("locomotion")


def test_models_are_listed_and_shown(capsys):
    assert run("models") == 0
    shown = capsys.readouterr().out
    assert all(f"{model.name}: {model.summary}" in shown for model in MODELS)
    assert run("models", "--json") == 0
    assert [row["name"] for row in json.loads(capsys.readouterr().out)] == [
        model.name for model in MODELS
    ]
    assert run("models", "locomotion") == 0
    assert capsys.readouterr().out == MODELS[0].card
    assert run("models", "locomotio") == 2
    assert "did you mean 'locomotion'?" in capsys.readouterr().err


def test_a_shipped_model_walks_by_its_name(tmp_path):
    out = tmp_path / "walk.bvh"
    wishes = ("--style", "normal", "--seconds", 3)
    assert run("walk", "locomotion", "--path", EIGHT, *wishes, "--out", out) == 0
    clip = read_bvh(out)
    assert clip.frames == 90
    positions = clip.root_positions[:, 1]
    assert 0.8 < float(positions.min()) < float(positions.max()) < 1.1


def test_a_fast_walk_is_nearly_the_exact_one(tmp_path):
    wishes = ("--path", EIGHT, "--style", "normal", "--seconds", 2)
    clips = []
    for mode in ("exact", "fast"):
        out = tmp_path / f"{mode}.npz"
        assert run("walk", "locomotion", *wishes, "--mode", mode, "--out", out) == 0
        clips.append(read_clip(out))
    apart = angle(*(clip.rotations_local for clip in clips))
    assert 1e-5 < float(apart.mean()) < 0.1


def test_half_precision_is_read_back_as_single(tmp_path):
    assert run("export", "locomotion", "--half", "--out", tmp_path / "again") == 0
    sizes = [(folder / WEIGHTS).stat().st_size for folder in (MODELS[0].folder, tmp_path / "again")]
    assert sizes[0] == sizes[1]
    assert run("export", "locomotion", "--half", "--json", "--out", tmp_path / "other") == 2
    assert not (tmp_path / "other").exists()
    first, second = load("locomotion"), load(tmp_path / "again")
    for one, other in zip(
        first.forecaster.parameters(), second.forecaster.parameters(), strict=True
    ):
        assert torch.equal(one, other)
