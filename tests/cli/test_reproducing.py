"""Published tables: what is listed, trained, printed side by side, and refused."""

from __future__ import annotations

import json
import pickle
import shutil
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from posecast.cli.main import main
from posecast.cli.reproducing import _protocol
from posecast.evaluation.reproduced import (
    choose_rows,
    printed_table,
    printed_tables,
    small_form,
)
from posecast.recipe import list_recipes, load_recipe

TINY = (
    *("model.backbone.hidden=8", "model.projection=6", "training.epochs=2", "training.batch=2"),
    *("training.validate_every=1", "training.horizon=20", "training.select_best_by=null"),
    "training.sampling={kind: random_recordings, steps_per_epoch: 2}",
    "protocol.metrics=[joint_angle_sum,euler_inverse_sum]",
)


def run(*arguments: object) -> int:
    try:
        main([str(argument) for argument in arguments])
    except SystemExit as stop:
        return int(stop.code or 0)
    return 0


@pytest.fixture(scope="module")
def recordings(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four recordings of the first release of AMASS, swinging, and the lists."""
    root = tmp_path_factory.mktemp("amass")
    seconds = np.arange(200) / 60
    for number in range(4):
        turns = 0.5 * np.sin(3 * seconds[:, None, None] + np.arange(45).reshape(15, 3) + number)
        matrices = Rotation.from_rotvec(turns.reshape(-1, 3)).as_matrix().reshape(200, 135)
        (root / f"{number}.pkl").write_bytes(pickle.dumps({"poses": matrices}))
    for name, members in (("training", "01"), ("validation", "2"), ("test", "3")):
        (root / f"{name}_fnames.txt").write_text("\n".join(members))
    return root


@pytest.fixture(scope="module")
def reproduced(recordings: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two rows and a baseline of a table, two seeds each."""
    out = tmp_path_factory.mktemp("reproduced")
    assert _reproduce(recordings, out) == 0
    return out


def _reproduce(recordings: Path, out: Path, *more: object) -> int:
    return run(
        *("reproduce", "iccv2019-2", *TINY, "--rows", "RNN", "--rows", "amass-rnn-spl"),
        *("--rows", "Zero-Velocity [20]", "--corpus", "amass-first", "--small", "--seeds", "2"),
        *("--root", f"amass-first={recordings}", "--out", out, "--quiet", *more),
    )


def test_the_papers_numbers_stand_above_ours(reproduced: Path) -> None:
    text = (reproduced / "iccv2019-2.md").read_text("utf-8")
    assert text.startswith("# iccv2019-2: Table 2 of Aksan, Kaufmann, Hilliges")
    assert "| all | RNN | paper | 0.31 | 1.05 | 2.17 | 3.62 |" in text
    assert "| all | RNN-SPL | paper | 0.22 | 0.73 | 1.51 | 2.51 |" in text
    assert "| all | Zero-Velocity [20] | paper | 0.37 | 1.22 | 2.44 | 3.94 |" in text
    content = json.loads((reproduced / "iccv2019-2.json").read_text("utf-8"))
    by_row = {row["row"]: row for row in content["rows"]}
    assert set(by_row) == {"RNN", "RNN-SPL", "Zero-Velocity [20]"}
    values = [
        next(
            row["value"]
            for row in seed
            if (row["action"], row["metric"], row["horizon_ms"]) == ("all", "joint_angle_sum", 400)
        )
        for seed in by_row["RNN-SPL"]["seeds"]
    ]
    assert len(set(values)) == 2
    mean, spread = np.mean(values), np.std(values, ddof=1)
    line = [line for line in text.splitlines() if "| amass-rnn-spl-small | ours |" in line][-1]
    assert line.endswith(f"{mean:.3f} ± {spread:.3f} |")
    assert by_row["RNN"]["paper"]["joint_angle_sum"] == {"all": [0.31, 1.05, 2.17, 3.62]}
    # What was not measured is not printed.
    assert "pck_auc" not in text
    assert "| RNN-SPL | amass-rnn-spl-small |" in text


def test_the_first_release_is_taken_if_it_is_what_there_is(
    reproduced: Path, recordings: Path, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    arguments = ("reproduce", "iccv2019-2", "--rows", "zero-velocity", "--out", tmp_path / "out")
    assert run(*arguments, TINY[-1], "--root", f"amass-first={recordings}") == 0
    text = capsys.readouterr().out
    # Baselines alone need no training, and are scored as beside the others.
    assert "Ours: corpus amass-first, protocol amass-spl" in text
    assert "1 window; the paper has 3304: not the same test set. Recordings for training" in text
    assert "| all | Zero-Velocity [20] | paper | 0.37 | 1.22 | 2.44 | 3.94 |" in text
    assert "parameters" not in text
    line = "| all | zero-velocity | ours |"
    beside = (reproduced / "iccv2019-2.md").read_text("utf-8")
    ours = [each for each in text.splitlines() if each.startswith(line)]
    assert ours[0] in beside
    assert len(ours) == 2


@pytest.mark.parametrize(
    ("changed", "said"),
    [
        ((), "The paper's recordings are not those of synthetic"),
        (("protocol={kind: short-term, prefix_ms: 400}", "fps=25"), "protocol is amass-spl"),
    ],
)
def test_on_other_recordings_the_papers_numbers_are_left_out(
    changed: tuple[str, ...], said: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    code = run(
        *("reproduce", "iccv2019-2", "--rows", "zero-velocity", "--corpus", "synthetic"),
        *("codec.joints=null", "protocol.joints=null", *changed, "--out", tmp_path),
    )
    text = capsys.readouterr().out
    assert code == 0
    assert said in text
    assert "paper |" not in text
    assert json.loads((tmp_path / "iccv2019-2.json").read_text("utf-8"))["comparable"] is False


def test_the_papers_protocol_alone_does_not_make_its_numbers_comparable(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    code = run(
        *("reproduce", "sca2022-1", "--rows", "acrnn-quaternion", "--corpus", "synthetic"),
        *("--small", "--seeds", "1", "model.backbone.hidden=8", "training.epochs=1"),
        *("training.sampling={kind: random_recordings, steps_per_epoch: 1}", "corpus.clips=24"),
        *("corpus.seconds=11", "protocol.metrics=[euclidean_cm]", "--quiet", "--out", tmp_path),
    )
    text = capsys.readouterr().out
    assert code == 0
    assert "corpus synthetic, protocol cmu-acrnn" in text
    assert "The paper's recordings are not those of synthetic" in text
    assert "paper |" not in text
    assert json.loads((tmp_path / "sca2022-1.json").read_text("utf-8"))["comparable"] is False


@pytest.mark.parametrize("name", printed_tables())
def test_every_row_is_scored_under_the_protocol_of_its_table_on_its_recordings(name: str) -> None:
    table = printed_table(name)
    for system in table.rows.values():
        if system in list_recipes():
            for form in (system, small_form(system)):
                recipe = load_recipe(form)
                assert recipe.config["corpus"]["kind"] in table.corpora
                protocol = _protocol(table, recipe, own=False)
                assert (protocol.name, protocol.horizons_ms) == (table.protocol, table.horizons_ms)
                assert {part.metric for part in table.parts} <= set(protocol.metrics)


def test_what_is_trained_is_not_trained_again(reproduced: Path, recordings: Path) -> None:
    log = reproduced / "amass-rnn-small" / "0" / "log.csv"
    before = log.read_text()
    assert _reproduce(recordings, reproduced) == 0
    assert log.read_text() == before


def test_a_run_with_other_settings_is_refused_before_anything_is_trained(
    reproduced: Path, recordings: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    last = "amass-rnn-spl-small/1"
    shutil.copytree(reproduced / last, tmp_path / last)
    assert _reproduce(recordings, tmp_path, "training.batch=1") == 2
    said = capsys.readouterr().err
    assert "this run was started with other settings (batch was 2, now 1)" in said
    assert [each.name for each in tmp_path.iterdir()] == ["amass-rnn-spl-small"]
    assert [each.name for each in (tmp_path / "amass-rnn-spl-small").iterdir()] == ["1"]


def test_all_tables_are_listed_with_what_stands_for_their_rows(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert run("reproduce") == 0
    text = capsys.readouterr().out
    assert "ijcv2019-2 (h36m-128): Table 2 of Pavllo" in text
    assert "  RNN-SPL-reverse: amass-rnn-spl-reverse" in text
    assert "  SRNN [14]: h36m-srnn" in text
    assert "  AGED [33]: h36m-aged" in text
    assert "iccv2019-3-h36m-standard" in text
    assert "iccv2019-3-amass-spl" in text


def test_every_system_of_a_table_is_a_recipe_or_a_baseline() -> None:
    known = {*list_recipes(), "zero-velocity", "running-average-2", "running-average-4"}
    for table in printed_tables().values():
        assert set(table.rows.values()) <= known
        assert set(table.rows) == {system for part in table.parts for system in part.systems}
    rows = choose_rows(printed_table("sca2022-1"), ["dual-quaternions (all)"])
    assert rows == {"dual-quaternions (all)": "acrnn-dual-quaternion-all"}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("iccv2019-22",), "no table is called 'iccv2019-22'; did you mean 'iccv2019-2'"),
        (("iccv2019-2", "--rows", "RNN-SLP"), "iccv2019-2 has no row 'RNN-SLP'; did you mean"),
        (("iccv2019-2",), "no row has its data; give --root amass-first=DIR or --root amass=DIR"),
        (("ijcv2019-1", "--rows", "zero-velocity"), "no row has its data; give --root h36m=DIR"),
        (("iccv2019-2", "--root", "amass"), "expected KIND=DIR with a corpus among"),
        (("iccv2019-2", "--root", "amass=nowhere"), "nowhere is not a folder"),
        (("iccv2019-2", "--seeds", "0"), "--seeds 0: expected 1 or more"),
        (("iccv2019-2", "training.seed=3"), "tell the runs apart; leave them out"),
    ],
)
def test_what_cannot_be_reproduced_is_said_before_anything_is_read(
    arguments: tuple[str, ...], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("reproduce", *arguments, "--out", tmp_path / "out") == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_bodies_without_bones_are_refused_where_thighs_are_the_unit(
    recordings: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    code = run(
        *("reproduce", "iccv2019-2", *TINY[:-1], "--rows", "RNN", "--corpus", "amass-first"),
        *("--small", "--root", f"amass-first={recordings}", "--out", tmp_path / "out"),
    )
    assert code == 2
    assert "position_thighs_sum, pck_auc are in thighs, but bones" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_another_protocol_is_said_to_be_another(
    recordings: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = "protocol={kind: short-term, metrics: [joint_angle_mean], horizons_ms: [100, 400]}"
    code = run(
        *("reproduce", "iccv2019-2", *TINY[:-1], other, "--rows", "RNN", "--seeds", "1"),
        *("--corpus", "amass-first", "--small", "--root", f"amass-first={recordings}"),
        *("--out", tmp_path / "out", "--quiet"),
    )
    assert code == 0
    text = capsys.readouterr().out
    assert "The paper's protocol is amass-spl: its numbers say nothing of ours" in text
    assert "| paper |" not in text
    assert "| amass-rnn-small |" in text
