"""The corpus of the first release of AMASS: lists decide, and must fit the files."""

from __future__ import annotations

import pickle
from pathlib import Path

import numpy as np
import pytest

from posecast.cli.main import main
from posecast.corpora import build_corpus
from posecast.corpora.doctor import examine
from posecast.errors import DataError
from posecast.evaluation import build_protocol
from posecast.io import read_clip
from posecast.model import ZeroVelocity

LISTS = ("training", "validation", "test")


@pytest.fixture
def root(tmp_path: Path) -> Path:
    identity = np.tile(np.eye(3).ravel(), 15)
    for number, name in enumerate(("ACCAD/walk", "ACCAD/run", "CMU/01/walk", "CMU/02/jump", "x/y")):
        file = tmp_path / "amass" / f"{name}.pkl"
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(pickle.dumps({"poses": np.tile(identity, (190 + number, 1))}))
    write_lists(tmp_path / "amass", ["ACCAD/walk.pkl", "01/walk"], ["ACCAD/run"], ["CMU/02/jump"])
    return tmp_path / "amass"


def write_lists(folder: Path, *names: list[str]) -> None:
    for kind, lines in zip(LISTS, names, strict=True):
        (folder / f"{kind}_fnames.txt").write_text("\n".join(lines) + "\n\n")


def test_lists_say_what_is_for_what(root):
    corpus = build_corpus("amass-first", root=root, cache=False)
    names = {
        split: [corpus.clips[index].labels["file"] for index in indices]
        for split, indices in corpus.splits.items()
    }
    assert names == {
        "train": ["ACCAD/walk.pkl", "CMU/01/walk.pkl"],
        "validation": ["ACCAD/run.pkl"],
        "test": ["CMU/02/jump.pkl"],
    }
    assert corpus.clips[0].labels["subset"] == "ACCAD"
    assert corpus.fps == 60
    assert any("1 files are in none" in note for note in corpus.notes)


def test_lists_may_lie_elsewhere(root, tmp_path):
    (tmp_path / "lists").mkdir()
    write_lists(tmp_path / "lists", ["x/y"], ["ACCAD/run"], ["CMU/02/jump"])
    corpus = build_corpus("amass-first", root=root, cache=False, lists=str(tmp_path / "lists"))
    assert len(corpus.clips) == 3


def test_the_protocol_of_the_paper_scores_it(root):
    corpus = build_corpus("amass-first", root=root, cache=False)
    protocol = build_protocol("amass-spl", metrics=["euler_inverse_sum", "joint_angle_sum"])
    scores = protocol.score(ZeroVelocity(), corpus)
    assert scores.value("joint_angle_sum", 400) == pytest.approx(0, abs=1e-9)
    assert scores.rows[0].windows == 1
    assert len(scores.joints_left_out["joint_angle_sum"]) == 7


@pytest.mark.parametrize(
    ("names", "message"),
    [
        (
            (["walk_x", "ACCAD/walk", "ACCAD/hop"], ["x/y"], ["CMU/02/jump"]),
            r"training_fnames.txt: names recordings that are not there: walk_x, ACCAD/hop",
        ),
        ((["ACCAD/walk"], ["walk"], ["CMU/02/jump"]), r"validation_fnames.txt.*walk \(of 2 fold"),
        ((["x/y"], ["ACCAD/run"], ["x/y"]), "x/y is for test, and for train by another list"),
    ],
)
def test_lists_that_do_not_fit_the_files_are_refused_before_anything_is_read(root, names, message):
    write_lists(root, *names)
    with pytest.raises(DataError, match=message):
        build_corpus("amass-first", root=root, cache=False)


def test_a_missing_list_or_folder_is_named(root, tmp_path):
    (root / "test_fnames.txt").unlink()
    with pytest.raises(DataError, match=r"test_fnames\.txt"):
        build_corpus("amass-first", root=root, cache=False)
    (tmp_path / "empty").mkdir()
    with pytest.raises(DataError, match="no motion of the first release"):
        build_corpus("amass-first", root=tmp_path / "empty", cache=False)


def test_a_recording_is_a_file_like_others(root, tmp_path, capsys):
    for arguments in (
        ("inspect", root / "ACCAD" / "walk.pkl"),
        ("convert", root / "ACCAD" / "walk.pkl", tmp_path / "walk.npz"),
        ("doctor", root),
    ):
        with pytest.raises(SystemExit) as stopped:
            main([str(argument) for argument in arguments])
        assert not stopped.value.code
    said = capsys.readouterr().out
    assert f"{root}: amass-first" in said
    assert "5 files (pickle), 960 frames, 22 joints, 60 fps" in said
    assert read_clip(tmp_path / "walk.npz").frames == 190
    (root / "test_fnames.txt").unlink()
    (root / "other.pkl").write_bytes(pickle.dumps({"weights": [1.0]}))
    report = examine(root)
    assert report.files == 5
    assert (report.findings[0].problem, report.findings[0].severity) == ("splits", "error")
    assert "corpus.lists=DIR" in report.findings[0].remedy
    # The one that is no recording, and no other, is said to be left unread.
    assert [each.message for each in report.findings if each.problem == "not read"] == [
        "1 files *.pkl are not read"
    ]
