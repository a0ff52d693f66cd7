"""posecast walk: a path in a file becomes a clip of somebody who walks along it."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch
from torch.testing import assert_close

from posecast.cli import walking
from posecast.cli.main import main
from posecast.io import read_clip
from posecast.io.path_files import read_path
from posecast.motion import pin_feet

EIGHT = Path(__file__).parents[2] / "examples" / "figure_eight.csv"


def run(*arguments: str) -> int:
    """The exit code of a command."""
    with pytest.raises(SystemExit) as stopped:
        main(arguments)
    return int(stopped.value.code or 0)


@pytest.fixture(scope="module")
def walker(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A checkpoint after one epoch on made-up walks in two styles."""
    folder = tmp_path_factory.mktemp("walker")
    arguments = ["train", "quaternet-locomotion-small", "--out", str(folder / "run"), "--quiet"]
    arguments += ["corpus.clips=12", "corpus.seconds=4.0", "training.epochs=1"]
    arguments += ["model.backbone.hidden=32", "training.sampling.steps_per_epoch=4"]
    assert run(*arguments) == 0
    return folder / "run" / "best"


def walk(walker: Path, out: Path, *arguments: str) -> int:
    return run("walk", str(walker), "--path", str(EIGHT), "--out", str(out), *arguments)


def test_a_drawn_path_becomes_a_clip_that_follows_it(walker: Path, tmp_path: Path) -> None:
    assert walk(walker, tmp_path / "walk.bvh", "--speed", "1.2") == 0
    clip, path = read_clip(tmp_path / "walk.bvh"), read_path(EIGHT)
    assert clip.fps == pytest.approx(30, rel=1e-4)
    floor = clip.root_positions[:, [0, 2]]
    assert float(path.distance_to(floor).max()) < 0.3
    ends = torch.stack([path.points[0], path.points[-1]])
    assert float((floor[[0, -1]] - ends).norm(dim=-1).max()) < 0.4
    assert clip.duration > path.length / 1.3


def test_arrival_times_at_way_points_are_kept(walker: Path, tmp_path: Path) -> None:
    assert walk(walker, tmp_path / "walk.npz", "--arrive", "11@4", "--arrive", "30@13") == 0
    clip, path = read_clip(tmp_path / "walk.npz"), read_path(EIGHT)
    there = clip.tracks["path"][[330, 899]]
    expected = path.at(path.marks[[3, 12]]).position
    assert float((there - expected).norm(dim=-1).max()) < 0.1
    assert clip.frames == 901


def test_a_step_made_for_a_long_walk_is_the_network_s_own(
    walker: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert walk(walker, tmp_path / "own.npz", "--seconds", "4") == 0
    monkeypatch.setattr(walking, "WORTHWHILE", 0)
    assert walk(walker, tmp_path / "made.npz", "--seconds", "4") == 0
    own, made = (read_clip(tmp_path / f"{name}.npz") for name in ("own", "made"))
    assert_close(made.rotations_local, own.rotations_local, rtol=0, atol=1e-4)
    assert walk(walker, tmp_path / "none.npz", "--mode", "quick") == 2
    assert "choose 'exact' or 'fast'" in capsys.readouterr().err
    assert walk(walker, tmp_path / "none.npz", "--mode", "fast") == 2  # 32 units are no large layer


def test_a_walk_may_have_its_feet_pinned(
    walker: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for name, arguments in (("free", []), ("pinned", ["--pin-feet"])):
        out = tmp_path / f"{name}.npz"
        assert walk(walker, out, "--seconds", "20", *arguments) == 0
        said = capsys.readouterr().err
        assert (" contacts: toes moved by " in said) == bool(arguments)
    free, pinned = (read_clip(tmp_path / f"{name}.npz") for name in ("free", "pinned"))
    assert torch.equal(pinned.root_positions, free.root_positions)
    again, report = pin_feet(free)
    assert report.text() in said
    assert_close(again.rotations_local, pinned.rotations_local, atol=1e-5, rtol=0)


@pytest.mark.parametrize("name", ["walk.glb", "walk.gif"])
def test_a_walk_may_be_written_in_other_formats(walker: Path, tmp_path: Path, name: str) -> None:
    assert walk(walker, tmp_path / name, "--seconds", "1") == 0
    assert (tmp_path / name).stat().st_size > 1000


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--arrive", "soon@3"], "expected SECONDS@POINT, such as 12.5@3"),
        (["--arrive", "12"], "expected SECONDS@POINT"),
        (["--arrive", "12@14"], "the path has 13 way points, counted from 1"),
        (["--arrive", "12@0"], "the path has 13 way points, counted from 1"),
        (["--arrive", "1@13"], "m/s would be needed"),
        (["--arrive", "5@9", "--arrive", "6@4"], "do not ascend"),
        (["--style", "calm"], "this walker has no styles; leave it out"),
        (["--speed", "-1"], "expected a positive number of metres a second"),
    ],
)
def test_what_cannot_be_walked_is_refused_in_one_line(
    walker: Path,
    tmp_path: Path,
    arguments: list[str],
    message: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert walk(walker, tmp_path / "walk.bvh", *arguments) == 2
    said = capsys.readouterr().err.strip()
    assert message in said
    assert "\n" not in said
    assert not (tmp_path / "walk.bvh").exists()


def test_a_forecaster_does_not_walk_and_a_walker_does_not_forecast(
    walker: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["train", "quaternet-vel-small", "--out", str(tmp_path / "run"), "--quiet"]
    arguments += ["corpus.clips=12", "corpus.seconds=4.0", "training.epochs=1"]
    arguments += ["model.backbone.hidden=16", "training.sampling.steps_per_epoch=1"]
    assert run(*arguments) == 0
    assert walk(tmp_path / "run" / "best", tmp_path / "walk.bvh") == 2
    assert "quaternet-vel-small does not walk along paths" in capsys.readouterr().err
    assert walk(walker, tmp_path / "walk.bvh", "--seconds", "3") == 0
    capsys.readouterr()
    clip, out = tmp_path / "walk.bvh", tmp_path / "forecast.bvh"
    assert run("forecast", str(walker), str(clip), "--out", str(out)) == 2
    assert "let it walk along one (posecast walk)" in capsys.readouterr().err
