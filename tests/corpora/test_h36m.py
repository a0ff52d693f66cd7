"""Human3.6M: the split of the short-term protocols, its holes, and its leaked recordings."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
import torch

from posecast.corpora import build_corpus
from posecast.corpora.h36m import ACTIONS, FILES, TEST_FRAMES
from posecast.errors import DataError
from posecast.evaluation.windows import H36M_ACTIONS
from posecast.io.h36m import read_h36m
from posecast.motion import Corpus, unroll

WriteH36m = Callable[..., Path]
SEVEN = [f"S{subject}/walking_1.txt" for subject in (1, 5, 6, 7, 8, 9, 11)]


def build(root: Path, **options: object) -> Corpus:
    options = {"check_lengths": False, "cache": False, **options}
    return build_corpus("h36m", root=root, **options)  # type: ignore[arg-type]


def files_of(corpus: Corpus, split: str) -> list[str]:
    return [f"{clip.labels['file']}:{clip.labels['phase']}" for clip in corpus.split(split)]


def test_there_are_210_recordings_and_ranges_for_all_those_of_the_test_subject() -> None:
    assert len(FILES) == len(set(FILES)) == 210
    assert tuple(TEST_FRAMES) == ACTIONS == H36M_ACTIONS


def test_training_has_both_phases_of_six_subjects_and_testing_the_even_one_of_the_fifth(
    write_h36m: WriteH36m,
) -> None:
    corpus = build(write_h36m(SEVEN))
    assert corpus.fps == 25
    trained = [name for name in SEVEN if not name.startswith("S5/")]
    expected = [f"{name}:{phase}" for name in trained for phase in (0, 1)]
    assert sorted(files_of(corpus, "train")) == sorted(expected)
    assert files_of(corpus, "test") == ["S5/walking_1.txt:0"]
    assert files_of(corpus, "validation") == []
    (clip,) = corpus.split("test")
    assert dict(clip.labels) == {
        "subject": "S5",
        "action": "walking",
        "recording": "1",
        "file": "S5/walking_1.txt",
        "phase": "0",
    }


def test_training_may_have_the_even_frames_alone(write_h36m: WriteH36m) -> None:
    root = write_h36m(SEVEN)
    even, both = (build(root, phases=phases) for phases in ("even", "both"))
    assert {clip.labels["phase"] for clip in both.split("train")} == {"0", "1"}
    assert {clip.labels["phase"] for clip in even.split("train")} == {"0"}
    assert 2 * len(even.splits["train"]) == len(both.splits["train"])
    assert files_of(even, "test") == files_of(both, "test")


def test_the_clips_are_the_even_and_odd_frames_as_quaternet_saw_them(
    write_h36m: WriteH36m,
) -> None:
    root = write_h36m({"S1/eating_2.txt": 7, "S5/eating_2.txt": 7})
    raw = unroll(read_h36m(root / "S1/eating_2.txt", root="increments")).to(torch.float32)
    even, odd = build(root).split("train")
    assert torch.equal(even.rotations_local, raw.rotations_local[0::2])
    assert torch.equal(odd.rotations_local, raw.rotations_local[1::2])
    assert torch.equal(odd.root_positions, raw.root_positions[1::2])
    world = build(root, trajectory="world").split("train")[0]
    assert not torch.equal(world.root_positions, even.root_positions)
    assert len(build(root, fps=50.0).clips) == 2


@pytest.mark.parametrize("subject", ["6", 11])
def test_a_validation_subject_leaves_training_with_its_even_phase(
    write_h36m: WriteH36m, subject: str | int
) -> None:
    corpus = build(write_h36m(SEVEN), validation=subject)
    assert files_of(corpus, "validation") == [f"S{subject}/walking_1.txt:0"]
    assert len(corpus.splits["train"]) == 10


def test_what_is_not_there_is_listed_as_missing(write_h36m: WriteH36m) -> None:
    corpus = build(write_h36m(SEVEN))
    assert len(corpus.missing) == 203
    assert not set(corpus.missing) & set(SEVEN)
    assert "S5/waiting_2.txt" in corpus.missing


def test_a_training_recording_that_is_a_test_recording_is_left_out(write_h36m: WriteH36m) -> None:
    root = write_h36m([*SEVEN, "S8/smoking_2.txt", "S1/eating_1.txt"])
    (root / "S5/smoking_2.txt").write_bytes((root / "S8/smoking_2.txt").read_bytes())
    corpus = build(root)
    assert not any(name.startswith("S8/smoking_2") for name in files_of(corpus, "train"))
    assert any(name.startswith("S1/eating_1") for name in files_of(corpus, "train"))
    assert "S8/smoking_2.txt is S5/smoking_2.txt" in " ".join(corpus.notes)
    assert "S8/smoking_2.txt" not in corpus.missing
    kept = build(root, copies="keep")
    assert any(name.startswith("S8/smoking_2") for name in files_of(kept, "train"))
    assert "Trained on, copies of test recordings: S8/smoking_2.txt" in " ".join(kept.notes)


def test_a_test_recording_cut_off_before_the_published_windows_counts_as_missing(
    write_h36m: WriteH36m,
) -> None:
    fewest = TEST_FRAMES["phoning"][1][0]
    lengths = {
        "S1/phoning_2.txt": 20,
        "S5/phoning_1.txt": 2 * fewest,
        "S5/phoning_2.txt": 2 * fewest - 1,
    }
    corpus = build(write_h36m(lengths), check_lengths=True)
    assert files_of(corpus, "test") == ["S5/phoning_2.txt:0"]
    assert "S5/phoning_1.txt" in corpus.missing
    assert "Cut off, so the published windows do not fit: S5/phoning_1.txt" in corpus.notes[0]


def test_the_folder_may_lie_deeper(write_h36m: WriteH36m, tmp_path: Path) -> None:
    write_h36m(SEVEN, root=tmp_path / "a" / "dataset")
    assert len(build(tmp_path).splits["test"]) == 1


def test_two_copies_of_the_corpus_below_one_folder_are_refused(
    write_h36m: WriteH36m, tmp_path: Path
) -> None:
    write_h36m(SEVEN, root=tmp_path / "a")
    write_h36m(SEVEN, root=tmp_path / "b")
    with pytest.raises(DataError, match="is there twice"):
        build(tmp_path)


def test_a_folder_without_recordings_is_refused(tmp_path: Path) -> None:
    (tmp_path / "S1").mkdir()
    (tmp_path / "S1" / "notes.txt").write_text("nothing")
    with pytest.raises(DataError, match=r"no recording of Human3\.6M"):
        build(tmp_path)
    with pytest.raises(DataError, match="no such folder"):
        build(tmp_path / "elsewhere")


def test_a_damaged_recording_is_named(write_h36m: WriteH36m) -> None:
    root = write_h36m(SEVEN)
    with (root / "S7/walking_1.txt").open("a") as file:
        file.write("1,2,3")
    with pytest.raises(DataError, match=r"S7/walking_1\.txt, line 61: 3 columns, expected 99"):
        build(root)


@pytest.mark.data
def test_the_files_at_hand_are_split_as_published(data_root: Path, tmp_path: Path) -> None:
    corpus = build_corpus("h36m", root=data_root / "h36m", cache=tmp_path)
    here = 210 - len(corpus.missing)
    assert here >= 189
    copies = " ".join(corpus.notes)
    for twin in ("S6/posing_1.txt", "S6/posing_2.txt", "S8/smoking_1.txt", "S8/smoking_2.txt"):
        assert f"{twin} is S5/{twin.split('/')[1]}" in copies
    dropped = copies.count(" is S5/")
    tested = len(corpus.splits["test"])
    assert tested == sum(name.startswith("S5/") for name in set(FILES) - set(corpus.missing))
    assert len(corpus.splits["train"]) == 2 * (here - dropped - tested)
    for clip in corpus.split("test"):
        low, high = TEST_FRAMES[clip.labels["action"]][int(clip.labels["recording"]) - 1]
        assert low <= clip.frames <= high, clip.name
    assert set(corpus.missing) == {
        name for name in FILES if not (data_root / "h36m" / name).is_file()
    }


def test_known_copies_are_left_out_where_the_test_recording_is_not_there_to_compare(
    write_h36m: WriteH36m,
) -> None:
    names = ["S9/discussion_1.txt", "S9/walking_1.txt", "S6/posing_2.txt", "S5/posing_2.txt"]
    corpus = build(write_h36m(names))
    trained = {name.split(":")[0] for name in files_of(corpus, "train")}
    # S6/posing_2 is there beside S5's and is not its copy, so it stays.
    assert trained == {"S9/walking_1.txt", "S6/posing_2.txt"}
    assert "S9/discussion_1.txt is S5/discussion_1.txt" in " ".join(corpus.notes)
    kept = build(write_h36m(names), copies="keep")
    assert "S9/discussion_1.txt:0" in files_of(kept, "train")
