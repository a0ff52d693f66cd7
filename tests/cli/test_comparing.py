"""Comparing systems and rolling them out for long, on a tiny synthetic corpus."""

from __future__ import annotations

import csv
import json
import shutil
import statistics
from importlib.resources import files
from pathlib import Path

import pytest
import torch
from PIL import Image

from posecast.cli.comparing import short_names
from posecast.cli.enduring import _drift, _moving_at_the_end
from posecast.cli.main import main
from posecast.evaluation.freeze import Liveliness
from posecast.system import load, save

TINY = (
    *("corpus.clips=10", "corpus.seconds=6", "model.backbone.hidden=8", "model.backbone.layers=1"),
    *("training.epochs=2", "training.batch=2", "training.horizon=6", "training.validate_every=1"),
    "training.sampling={kind: random_recordings, steps_per_epoch: 2, weight: equal}",
    "training.select_best_by=euclidean_cm_1000ms",
    "protocol={kind: cmu-acrnn, horizons_ms: [100, 1000], stride: 60,"
    " metrics: [npss, euclidean_cm, euclidean_with_prefix_cm, emitted_cm, bone_length_drift]}",
)
ROWS = ("acrnn-quaternion-small", "acrnn-dual-quaternion-all-small", "acrnn-positions-small")


@pytest.fixture(scope="module")
def compared(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A comparison of three representations, two seeds each."""
    out = tmp_path_factory.mktemp("compared")
    _run("compare", *ROWS, *TINY, "--corpus", "synthetic", "--seeds", "2", "--out", out, "--quiet")
    return out


def _run(*arguments: object) -> None:
    try:
        main([str(argument) for argument in arguments])
    except SystemExit as stop:
        assert stop.code in (0, None)  # noqa: PT017


def test_a_comparison_has_a_row_for_every_system_and_baseline(compared: Path) -> None:
    text = (compared / "comparison.md").read_text("utf-8")
    assert "**3 systems on equal terms**: corpus synthetic, protocol cmu-acrnn, 2 seeds" in text
    for name in ROWS:
        assert text.count(f"| {name} |") == 6  # costs, and five metrics
    for name in ("zero-velocity", "mean-pose"):
        assert text.count(f"| {name} |") == 5
    content = json.loads((compared / "comparison.json").read_text("utf-8"))
    assert [system["system"] for system in content["systems"]] == list(ROWS)
    for system in content["systems"]:
        assert len(system["seeds"]) == len(system["training_seconds"]) == 2
        assert system["parameters"] > 1000
        assert system["step_ms"] > 0
        assert [updates for updates, _ in system["validation"][0]] == [2, 4]


def test_costs_are_those_of_the_logs(compared: Path) -> None:
    content = json.loads((compared / "comparison.json").read_text("utf-8"))
    system = content["systems"][0]
    seconds = []
    for seed in ("0", "1"):
        with (compared / ROWS[0] / seed / "log.csv").open(newline="") as file:
            seconds.append([float(row["seconds"]) for row in csv.DictReader(file)])
    assert system["training_seconds"] == pytest.approx([sum(each) for each in seconds])
    # Two updates an epoch; milliseconds of one.
    of_one = [1000 * epoch / 2 for each in seconds for epoch in each]
    assert system["step_ms"] == pytest.approx(statistics.median(of_one))


def test_only_what_can_stretch_does(compared: Path) -> None:
    content = json.loads((compared / "comparison.json").read_text("utf-8"))
    drift = {
        system["system"]: [
            row["value"] for row in system["seeds"][0] if row["metric"] == "bone_length_drift"
        ]
        for system in content["systems"]
    }
    assert max(drift["acrnn-quaternion-small"]) == 0
    assert min(drift["acrnn-dual-quaternion-all-small"]) > 0
    assert min(drift["acrnn-positions-small"]) > 0


def test_a_comparison_is_drawn(compared: Path) -> None:
    with Image.open(compared / "comparison.gif") as film:
        assert film.n_frames > 10
        assert film.width > 3 * film.height / 2  # four panels side by side
    with Image.open(compared / "convergence.png") as plot:
        assert plot.width > 400


def test_what_is_trained_is_not_trained_again(compared: Path) -> None:
    before = {path: path.stat().st_mtime_ns for path in compared.rglob("state.safetensors")}
    assert len(before) == 6
    again = ("compare", *ROWS[:2], *TINY, "--corpus", "synthetic", "--seeds", "1", "--out")
    _run(*again, compared, "--quiet")
    assert all(path.stat().st_mtime_ns == then for path, then in before.items())
    text = (compared / "comparison.md").read_text("utf-8")
    assert "**2 systems on equal terms**" in text
    assert "±" not in text


def test_a_run_with_other_settings_is_refused_before_any_other_is_trained(
    compared: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(compared / ROWS[1], tmp_path / ROWS[1])
    with pytest.raises(SystemExit) as stop:
        main(
            [
                *("compare", *ROWS[:2], *TINY, "--corpus", "synthetic", "--quiet"),
                *("training.batch=1", "--seeds", "1", "--out", str(tmp_path)),
            ]
        )
    assert stop.value.code == 2
    assert "this run was started with other settings (batch was 2" in capsys.readouterr().err
    assert [each.name for each in tmp_path.iterdir()] == [ROWS[1]]


def test_unequal_terms_are_refused_before_anything_is_trained(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as stopped:
        main(
            [
                *("compare", "acrnn-quaternion-small", "quaternet-vel-small"),
                *("--corpus", "synthetic", "--out", str(tmp_path / "out")),
            ]
        )
    assert stopped.value.code == 2
    said = capsys.readouterr().err
    assert "not on equal terms: fps is 30 and 25" in said
    assert not (tmp_path / "out").exists()


def test_a_recipe_named_twice_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as stopped:
        main(["compare", "acrnn-quaternion", "acrnn-quaternion", "--out", str(tmp_path / "out")])
    assert stopped.value.code == 2
    assert "a recipe is named twice" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("training.epochs=1",), "nothing to compare; name recipes"),
        ((ROWS[0], "training.seed=4"), "training.seed tells the runs apart; leave it out"),
        ((*ROWS[:2], "name=same"), "name tells the runs apart"),
    ],
)
def test_what_tells_runs_apart_is_not_overridden(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...], said: str
) -> None:
    with pytest.raises(SystemExit) as stopped:
        main(["compare", *arguments, "--corpus", "synthetic", "--out", str(tmp_path / "out")])
    assert stopped.value.code == 2
    assert said in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_recipe_by_its_name_and_by_its_file_is_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    copy = tmp_path / "acrnn-quaternion.yaml"
    copy.write_bytes(files("posecast.recipes").joinpath(copy.name).read_bytes())
    with pytest.raises(SystemExit) as stopped:
        main(["compare", "acrnn-quaternion", str(copy), "--out", str(tmp_path / "out")])
    assert stopped.value.code == 2
    assert "a recipe is named twice" in capsys.readouterr().err


def test_another_codec_is_no_equal_term(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    other = tmp_path / "bare.yaml"
    other.write_text("extends: acrnn-quaternion\ncodec: {standardize: none}\n", "utf-8")
    with pytest.raises(SystemExit) as stopped:
        main(["compare", "acrnn-quaternion", str(other), "--out", str(tmp_path / "out")])
    assert stopped.value.code == 2
    assert "not on equal terms: codec is" in capsys.readouterr().err


def test_other_metrics_later_keep_their_own_columns(tmp_path: Path) -> None:
    one = ("compare", ROWS[0], *TINY, "--corpus", "synthetic", "--seeds", "1", "--quiet", "--out")
    _run(*one, tmp_path)
    later = "protocol={kind: cmu-acrnn, horizons_ms: [400], stride: 60, metrics: [npss]}"
    _run(*one, tmp_path, "training.epochs=3", later, "training.select_best_by=npss_400ms")
    with (tmp_path / ROWS[0] / "0" / "validation.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [bool(row["euclidean_cm_1000ms"]) for row in rows] == [True, True, False]
    assert [bool(row["npss_400ms"]) for row in rows] == [False, False, True]
    content = json.loads((tmp_path / "comparison.json").read_text("utf-8"))
    assert [updates for updates, _ in content["systems"][0]["validation"][0]] == [6]


def test_groups_of_windows_have_rows_of_their_own(tmp_path: Path) -> None:
    options = [each for each in TINY if not each.startswith(("protocol", "training.select"))]
    _run(
        *("compare", "bodies-dual-quaternion-small", "bodies-quaternion-offsets-small"),
        *(*options, "training.validate_every=2", "corpus.of=synthetic"),
        "protocol={kind: cross-skeleton, horizons_ms: [400], metrics: [euclidean_cm], stride: 60}",
        *("training.select_best_by=null", "--seeds", "1", "--quiet", "--out", tmp_path),
    )
    text = (tmp_path / "comparison.md").read_text("utf-8")
    for name in ("bodies-dual-quaternion-small", "bodies-quaternion-offsets-small"):
        assert f"| unseen body (tall), unseen motion | {name} |" in text
        assert f"| unseen body (tall), seen motion | {name} |" in text


@pytest.mark.parametrize(
    ("names", "short"),
    [
        (ROWS, ["quaternion", "dual-quaternion-all", "positions"]),
        (("a-b-small", "a-b-x-small"), ["b", "b-x"]),
        (("alone-small",), ["alone-small"]),
    ],
)
def test_titles_leave_out_what_all_names_share(names: tuple[str, ...], short: list[str]) -> None:
    assert short_names(names) == short


@pytest.mark.parametrize("name", ROWS)
def test_long_rollouts_are_held_against_the_training_set(
    compared: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    checkpoint = compared / name / "0" / "best"
    _run("endure", checkpoint, "--frames", "130", "--starts", "2", "--out", tmp_path / "end")
    facts = json.loads(capsys.readouterr().out)
    assert (facts["frames"], facts["rollouts"], facts["seconds"]) == (130, 2, 4)
    assert facts["split"] == "test"
    assert 0 <= facts["frozen_share"] <= 1
    assert 0 <= facts["moving_at_the_end"] <= 2
    assert facts == json.loads((tmp_path / "end" / "endurance.json").read_text("utf-8"))
    rows = (tmp_path / "end" / "endurance.csv").read_text("utf-8").splitlines()
    assert len(rows) == 1 + 2 * 4
    for picture in ("endurance.png", "end.png"):
        with Image.open(tmp_path / "end" / picture) as opened:
            assert opened.width > 300


def test_a_rollout_on_another_skeleton_is_refused(
    compared: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from posecast.corpora.synthetic import make_clip
    from posecast.forecast import rename_joints
    from posecast.io import write_clip

    clip = make_clip(0, fps=30.0, seconds=3.0)
    first = clip.skeleton.names[3]
    (tmp_path / "in").mkdir()
    for number in range(10):
        write_clip(rename_joints(clip, {"other": first}), tmp_path / "in" / f"{number}.bvh")
    with pytest.raises(SystemExit) as stopped:
        main(
            [
                *("endure", str(compared / ROWS[0] / "0" / "best"), "--corpus", "folder"),
                *("--root", str(tmp_path / "in"), "--out", str(tmp_path / "end")),
            ]
        )
    assert stopped.value.code == 2
    assert f"it lacks {first}; it has besides other" in capsys.readouterr().err


def test_a_rollout_that_blows_up_is_said_to(
    compared: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    system = load(compared / "acrnn-positions-small" / "0" / "best")
    with torch.no_grad():
        for weight in system.forecaster.head.parameters():
            weight.mul_(1e30)
    save(system, tmp_path / "blown")
    _run("endure", tmp_path / "blown", "--frames", "90", "--starts", "1", "--out", tmp_path / "end")
    facts = json.loads(capsys.readouterr().out)
    assert (facts["blown_share"], facts["moving_at_the_end"]) == (1, 0)


def test_rollouts_may_begin_in_another_split(
    compared: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    checkpoint = compared / ROWS[0] / "0" / "best"
    found = {}
    for split in ("test", "validation"):
        _run(
            *("endure", checkpoint, "--frames", "90", "--starts", "1"),
            *("--split", split, "--out", tmp_path / split),
        )
        facts = json.loads(capsys.readouterr().out)
        assert facts.pop("split") == split
        found[split] = facts
    assert found["test"] != found["validation"]
    with pytest.raises(SystemExit) as stopped:
        main(["endure", str(checkpoint), "--split", "dev", "--out", str(tmp_path / "dev")])
    assert stopped.value.code == 2
    assert "has no split 'dev'; it has" in capsys.readouterr().err
    assert not (tmp_path / "dev").exists()


@pytest.mark.parametrize(
    ("still", "blown", "count"),
    [
        ([*range(100)], [], 1),  # only the last minute counts
        ([*range(100, 160)], [], 0),
        ([*range(100, 130)], [], 0),  # in most seconds: half is not enough
        ([*range(100, 129)], [], 1),
        ([*range(100, 120)], [*range(120, 130)], 0),
    ],
)
def test_who_moves_in_most_seconds_of_the_last_minute_moves_at_the_end(
    still: list[int], blown: list[int], count: int
) -> None:
    marks = [torch.zeros(2, 160, dtype=torch.bool) for _ in range(2)]
    for mark, seconds in zip(marks, (still, blown), strict=True):
        mark[0, seconds] = True
    marks[0][1] = True  # the other rollout is frozen throughout
    found = Liveliness(*(torch.zeros(2, 160) for _ in range(3)), *marks)
    assert _moving_at_the_end(found) == count


def test_a_rollout_that_slides_away_is_said_to_drift() -> None:
    moved = torch.tensor([[3.0, 9.0, 4.0], [0.0, 1.0, 0.0]])
    assert _drift(moved, 10.0) == pytest.approx(0.25)


def test_a_rollout_that_stands_still_does_not_move_at_the_end(
    compared: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    system = load(compared / "acrnn-quaternion-small" / "0" / "best")
    with torch.no_grad():
        for part in (system.forecaster.head, system.forecaster.root):
            for weight in part.parameters():
                weight.zero_()  # with the residual, the last frame again and again
    save(system, tmp_path / "still")
    _run("endure", tmp_path / "still", "--frames", "90", "--starts", "2", "--out", tmp_path / "end")
    facts = json.loads(capsys.readouterr().out)
    assert (facts["frozen_share"], facts["moving_at_the_end"]) == (1, 0)


def test_a_mapping_of_a_joint_that_no_checkpoint_has_is_refused(
    compared: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from posecast.corpora.synthetic import make_clip
    from posecast.forecast import rename_joints
    from posecast.io import write_clip

    clip = make_clip(0, fps=30.0, seconds=3.0)
    name = clip.skeleton.names[3]
    write_clip(rename_joints(clip, {"other": name}), tmp_path / "walk.bvh")
    (tmp_path / "names.yaml").write_text(f"{name}x: other\n", "utf-8")
    with pytest.raises(SystemExit) as stopped:
        main(
            [
                *("forecast", str(compared / ROWS[0] / "0" / "best"), str(tmp_path / "walk.bvh")),
                *("--mapping", str(tmp_path / "names.yaml"), "--out", str(tmp_path / "out.bvh")),
            ]
        )
    assert stopped.value.code == 2
    said = capsys.readouterr().err
    assert f"'{name}x' is no joint of the checkpoint; did you mean '{name}'" in said


@pytest.mark.parametrize("name", ROWS)
def test_a_forecast_of_any_representation_goes_out_as_bvh(
    compared: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    from posecast.corpora.synthetic import make_clip
    from posecast.io import read_clip, write_clip

    system = load(compared / name / "0" / "best")
    clip = make_clip(0, fps=30.0, seconds=3.0)
    write_clip(clip, tmp_path / "walk.bvh")
    out = tmp_path / "out.bvh"
    _run("forecast", compared / name / "0" / "best", tmp_path / "walk.bvh", "--out", out)
    continued = read_clip(out)
    assert continued.skeleton.names == system.skeleton.names
    assert continued.frames == clip.frames + 30
    said = capsys.readouterr().err
    assert ("the twist of each bone" in said) == ("positions" in name)
