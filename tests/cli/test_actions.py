"""Forecasts of a network that is told what is done."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pytest
import torch
from tests.io.glb_reference import Glb

from posecast.cli.main import main
from posecast.corpora.synthetic import make_clip
from posecast.io import read_clip, write_clip
from posecast.recipe import load_recipe
from posecast.system import System, save

CLIP = make_clip(0, fps=30.0, seconds=3.0)


def checkpoint(folder: Path, overrides: Sequence[str]) -> Path:
    """An untrained network."""
    recipe = load_recipe("quaternet-vel-small", ["model.backbone.hidden=16", *overrides])
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(0)
        forecaster = recipe.build_forecaster(recipe.build_codec(CLIP.skeleton))
    body = tuple((x, y, z) for x, y, z in CLIP.offsets.tolist())
    save(System(recipe, forecaster, body, {}), folder)
    return folder


def forecast(*arguments: object) -> int:
    """Call the command line in this process; its exit code."""
    with pytest.raises(SystemExit) as stopped:
        main(["forecast", *map(str, arguments)])
    return int(str(stopped.value.code or 0))


@pytest.fixture
def told(tmp_path: Path) -> Path:
    """A checkpoint that tells two actions apart; ``walk.bvh``, which says nothing, is beside it."""
    write_clip(CLIP, tmp_path / "walk.bvh")
    changes = ["codec.actions=[walk, jog]", "training.objective.terms.action=1"]
    return checkpoint(tmp_path / "told", changes)


def test_the_action_that_is_said_changes_the_forecast(told: Path, tmp_path: Path) -> None:
    for name, action in (("a", "walk"), ("b", "jog"), ("c", "walk")):
        out = tmp_path / f"{name}.bvh"
        assert forecast(told, tmp_path / "walk.bvh", "--out", out, "--action", action) == 0
    a, b, c = (read_clip(tmp_path / f"{name}.bvh").rotations_local for name in "abc")
    assert torch.equal(a, c)
    assert torch.equal(a[: CLIP.frames], b[: CLIP.frames])
    assert not torch.equal(a[CLIP.frames :], b[CLIP.frames :])


def test_a_forecast_is_written_as_an_animated_armature(told: Path, tmp_path: Path) -> None:
    for name in ("a.bvh", "a.glb"):
        walk, out = tmp_path / "walk.bvh", tmp_path / name
        assert forecast(told, walk, "--out", out, "--action", "jog") == 0
    expected, glb = read_clip(tmp_path / "a.bvh"), Glb(tmp_path / "a.glb")
    assert len(glb.times) == expected.frames > CLIP.frames
    assert [node["name"] for node in glb.json["nodes"][:-2]] == list(expected.skeleton.names)


def test_an_action_that_is_not_said_or_not_known_is_refused(
    told: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    untold = checkpoint(tmp_path / "untold", [])
    for folder, options, message in (
        (told, [], "walk: this checkpoint is told what is done; give --action; known: jog, walk"),
        (told, ["--action", "jgo"], "action 'jgo' is unknown; give --action; did you mean 'jog'?"),
        (untold, ["--action", "jog"], "--action jog: this checkpoint is not told what is done"),
    ):
        files = (tmp_path / "walk.bvh", "--out", tmp_path / "out.bvh")
        assert forecast(folder, *files, *options) == 2
        assert message in capsys.readouterr().err
        assert not (tmp_path / "out.bvh").exists()
