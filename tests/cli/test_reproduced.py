"""What stands beside what in a reproduced table: the paper's cells, its averages, its windows."""

from __future__ import annotations

from collections.abc import Mapping

import pytest
import torch

from posecast.cli.reproduced import Found, Reproduction
from posecast.evaluation import Scores, published_tables
from posecast.evaluation.reproduced import printed_table
from posecast.evaluation.windows import H36M_ACTIONS
from posecast.model import ZeroVelocity
from posecast.motion import Clip
from posecast.motion.corpus import Corpus
from posecast.skeleton import Skeleton


def corpus(name: str, recordings: Mapping[str, int]) -> Corpus:
    """One joint that rests, in as many recordings of each split."""
    still = torch.tensor([1.0, 0, 0, 0]).expand(2, 1, 4)
    skeleton = Skeleton(("hips",), (-1,))
    clip = Clip(skeleton, torch.zeros(1, 3), 25.0, torch.zeros(2, 3), still)
    splits: dict[str, tuple[int, ...]] = {}
    for split, count in recordings.items():
        first = sum(map(len, splits.values()))
        splits[split] = tuple(range(first, first + count))
    return Corpus(name, [clip] * sum(recordings.values()), splits)


def reproduction(
    table: str,
    rows: Mapping[str, str],
    windows: Mapping[str, int],
    *,
    name: str = "h36m",
    recordings: Mapping[str, int] | None = None,
) -> Reproduction:
    """What would be found if every error were 1 under the protocol of a table."""
    printed = printed_table(table)
    values = {
        (action, part.metric): torch.ones(count, len(printed.horizons_ms), dtype=torch.float64)
        for action, count in windows.items()
        for part in printed.parts
    }
    found = [
        Found(
            row,
            system,
            (
                Scores(
                    *(system, name, printed.protocol, "test", printed.horizons_ms, values),
                    expected=15 if printed.protocol.startswith("h36m") else 1,
                    missing=(),
                    notes=(),
                    joints_left_out={},
                ),
            ),
            ZeroVelocity(),
        )
        for row, system in rows.items()
    ]
    return Reproduction(printed, found, {}, [corpus(name, recordings or {"test": 1})], True)


def test_a_printed_average_stands_beside_that_of_all_its_actions() -> None:
    rows = {"QuaterNet short-term, quaternions": "quaternet-vel"}
    every = reproduction("sca2022-2", rows, dict.fromkeys(H36M_ACTIONS, 8)).to_markdown()
    line = (
        "| average of 15 | QuaterNet short-term, quaternions | paper | 0.3871 | 0.6766 | 1.0117 |"
    )
    assert line in every
    some = reproduction("sca2022-2", rows, dict.fromkeys(H36M_ACTIONS[:11], 8)).to_markdown()
    assert "| paper" not in some
    assert "| average of 11 | quaternet-vel | ours | 1.000 |" in some


def test_an_average_that_no_paper_prints_is_said_to_be_a_mean_of_its_cells() -> None:
    rows = {"Zero-velocity": "zero-velocity"}
    whole = reproduction("ijcv2019-2", rows, dict.fromkeys(H36M_ACTIONS, 256)).to_markdown()
    assert "| average of 15 | Zero-velocity | paper | 0.43 |" in whole
    two = reproduction("ijcv2019-2", rows, {"walking": 256, "eating": 256}).to_markdown()
    # Walking 0.43, 0.78, 1.23, 1.34 and eating 0.30, 0.59, 0.94, 1.07.
    (line,) = [each for each in two.splitlines() if "paper, mean of the 2" in each]
    assert line.startswith("| average of 2 | Zero-velocity | paper, mean of the 2 | 0.3")
    values = [float(cell) for cell in line.split(" | ")[3:6]]
    assert values == pytest.approx([0.365, 0.685, 1.085], abs=0.00501)
    assert all(len(cell) == 4 for cell in line.removesuffix(" |").split(" | ")[3:])


def test_no_average_stands_beside_actions_that_the_paper_lacks() -> None:
    rows = {"QuaterNet velocity": "quaternet-vel"}
    text = reproduction("bmvc2018-1", rows, {"walking": 8, "directions": 8}).to_markdown()
    assert "| walking | QuaterNet velocity | paper |" in text
    assert "| average of 2 | quaternet-vel | ours |" in text
    assert text.count("| paper") == 1


def test_cells_have_the_decimals_of_the_paper() -> None:
    text = reproduction("iccv2019-6", {"RNN-mean": "h36m-rnn"}, {"walking": 8}).to_markdown()
    assert "| walking | RNN-mean | paper | 0.319 | 0.515 | 0.771 | 0.900 |" in text
    digits = {
        (table.source, table.protocol, table.metric): table.digits for table in published_tables()
    }
    assert digits["iccv2019, Table 2", "amass-spl", "joint_angle_sum"] == 2
    assert digits["iccv2019, Table 7", "amass-spl", "joint_angle_sum"] == 3
    assert digits["sca2022, Table 2", "h36m-long", "euler"] == 4
    assert set(digits.values()) == {2, 3, 4}


@pytest.mark.parametrize(
    ("table", "row", "wanted"),
    [("bmvc2018-1", "QuaterNet velocity", 8), ("ijcv2019-2", "QuaterNet vel.", 256)],
)
def test_windows_of_an_action_are_counted(table: str, row: str, wanted: int) -> None:
    rows = {row: "quaternet-vel"}
    whole = reproduction(table, rows, dict.fromkeys(H36M_ACTIONS, wanted))
    assert "not the same test set" not in whole.to_markdown()
    assert whole.to_json()["caveats"] == []
    assert whole.to_json()["paper_windows"] == wanted
    fewer = reproduction(table, rows, {"walking": wanted, "eating": wanted - 1})
    said = f"eating {wanted - 1} windows; the paper has {wanted} an action: not the same test set."
    assert said in fewer.to_markdown().split("\n\n")[1]
    assert fewer.to_json()["caveats"] == [said]
    assert fewer.to_json()["windows"] == {"walking": wanted, "eating": wanted - 1}


def test_windows_and_recordings_of_the_first_release_are_counted() -> None:
    published = {"train": 7865, "validation": 343, "test": 385}
    options = {"table": "iccv2019-2", "rows": {"RNN": "amass-rnn"}, "name": "amass-first"}
    same = reproduction(**options, windows={"all": 3304}, recordings=published)
    assert same.to_json()["caveats"] == []
    other = reproduction(**options, windows={"all": 2}, recordings={**published, "train": 9})
    said = [
        "2 windows; the paper has 3304: not the same test set.",
        "Recordings for training, validation and testing: 9, 343, 385; the paper has 7865, 343, "
        "385.",
    ]
    assert other.to_json()["caveats"] == said
    assert " ".join(said) in other.to_markdown().split("\n\n")[1]
