"""posecast evaluate --protocol locomotion: walkers on eight paths."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from posecast.cli.main import main
from posecast.evaluation.walks import WalkScores
from posecast.generation.courses import eight_paths

TINY = ["corpus.clips=12", "corpus.seconds=4.0", "training.epochs=1", "model.backbone.hidden=32"]
TINY += ["training.sampling.steps_per_epoch=4"]


def run(*arguments: str) -> int:
    """The exit code of a command."""
    with pytest.raises(SystemExit) as stopped:
        main(arguments)
    return int(stopped.value.code or 0)


def evaluate(*arguments: str) -> int:
    return run("evaluate", *arguments, "--protocol", "locomotion")


QUICK = "protocol.paths=[straight]"


def train(folder: Path, *arguments: str, recipe: str = "quaternet-locomotion-small") -> str:
    assert run("train", recipe, "--out", str(folder), "--quiet", *TINY, *arguments) == 0
    return str(folder / "best")


@pytest.fixture(scope="module")
def walkers(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, str]:
    """Two runs of one tiny walker."""
    folder = tmp_path_factory.mktemp("walkers")
    one, other = (train(folder / seed, f"training.seed={seed}") for seed in ("1", "2"))
    return one, other


def test_a_walker_and_generated_clips_are_in_one_table(
    walkers: tuple[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    options = ["--corpus", "synthetic", "corpus.clips=36", "protocol.speed=1.6"]
    assert evaluate(walkers[0], *options, "--json") == 0
    found = json.loads(capsys.readouterr().out)
    walker, real = found["rows"]
    assert walker["system"] == "quaternet-locomotion-small"
    assert real["system"] == "synthetic, validation clips"
    assert list(walker["runs"][0]) == list(eight_paths())
    assert all(value["value"] is not None for value in walker["scores"].values())
    assert tuple(walker["scores"]) == WalkScores._fields
    asked = ("arrival_mean", "arrival_max", "facing", "speed")
    assert {name for name, value in real["scores"].items() if value["value"] is None} == {*asked}
    # What a walk keeps to whatever its network says, and how generated people walk.
    assert walker["scores"]["arrival_max"]["value"] < 1
    assert 0.45 < real["scores"]["standing"]["value"] < 0.8
    assert real["scores"]["sink_max"]["value"] < 0.5
    assert real["scores"]["bone_drift"]["value"] < 1e-6


def test_runs_of_a_walker_are_one_row_with_a_spread(
    walkers: tuple[str, str], capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    table = tmp_path / "walks.csv"
    assert evaluate(*walkers, QUICK, "--csv", str(table)) == 0
    text = capsys.readouterr().out
    assert text.count("| quaternet-locomotion-small |") == 1
    assert " ± " in text
    assert "Mean ± standard deviation over 2 runs." in text
    assert "synthetic" not in text
    assert "quaternet-locomotion-small,facing,deg," in table.read_text()


def test_other_walkers_are_other_rows(
    walkers: tuple[str, str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    wider = train(tmp_path / "run", "model.backbone.hidden=24")
    assert evaluate(walkers[0], wider, QUICK, "--json", "protocol.speed=1.3") == 0
    found = json.loads(capsys.readouterr().out)
    assert [row["system"] for row in found["rows"]] == [
        f"quaternet-locomotion-small ({folder})" for folder in (walkers[0], wider)
    ]
    assert found["notes"][0] == "straight at 1.3 m/s."


def test_a_long_walk_is_scored_minute_by_minute(
    walkers: tuple[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert evaluate(walkers[0], QUICK, "--json", "protocol.minutes=0.6") == 0
    (walker,) = json.loads(capsys.readouterr().out)["rows"]
    assert len(walker["minutes"]) == 1
    assert 0 <= walker["frozen"] <= 1


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["protocol.stile=calm"], "did you mean 'style'"),
        (["protocol.style=calm"], "protocol.style calm: this walker has no styles"),
        (["protocol.minutes=-1"], "expected 0 or more"),
        (["protocol.speed=-1"], "expected a positive number of metres a second"),
        (["model.feedback=emitted"], "a walker reads what it says"),
        (["corpus.clips=12"], "name one with --corpus"),
        (
            ["--corpus", "synthetic", "protocol.speed=9"],
            "no train clip of corpus 'synthetic' walks",
        ),
        (["zero-velocity"], "does not walk along paths"),
    ],
)
def test_what_cannot_be_scored_is_refused_in_one_line(
    walkers: tuple[str, str],
    arguments: list[str],
    message: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert evaluate(walkers[0], *arguments) == 2
    said = capsys.readouterr().err.strip()
    assert message in said
    assert "\n" not in said


def test_one_run_is_no_two(
    walkers: tuple[str, str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(walkers[0], tmp_path / "copy")
    assert evaluate(walkers[0], str(tmp_path / "copy")) == 2
    assert "two with one seed (1)" in capsys.readouterr().err


def test_a_forecaster_has_no_walks_to_score(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    forecaster = train(tmp_path / "run", recipe="quaternet-vel-small")
    assert evaluate(forecaster) == 2
    assert "quaternet-vel-small does not walk along paths" in capsys.readouterr().err
