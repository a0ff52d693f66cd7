"""CMU, Bandai and AMASS: what each file is for, and the faults that are mended on the way."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
from torch.testing import assert_close

from posecast.corpora import CORPORA, build_corpus
from posecast.corpora.cmu import ASF_FILES, SALSA_FILES
from posecast.errors import ConfigError, DataError
from posecast.motion import Clip, Corpus
from posecast.skeleton import joint_positions

Write = Callable[..., Path]
Change = Callable[[Clip], Clip]


def files_of(corpus: Corpus, split: str) -> list[str]:
    return [f"{c.labels['file']}:{c.labels.get('phase', '-')}" for c in corpus.split(split)]


def test_every_corpus_can_be_asked_for_by_name() -> None:
    assert tuple(CORPORA) == (
        "synthetic",
        "cmu-salsa",
        "cmu-asf",
        "bandai-locomotion",
        "h36m",
        "amass",
        "amass-first",
        "bodies",
        "folder",
    )
    assert (len(SALSA_FILES), len(ASF_FILES)) == (28, 28)


def test_the_synthetic_corpus_needs_no_folder() -> None:
    corpus = build_corpus("synthetic", fps=25.0, clips=12, seconds=1.0)
    assert corpus.fps == 25
    assert len(corpus.clips) == 12


def test_a_misspelled_corpus_or_option_is_refused_with_the_nearest(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="did you mean 'h36m'"):
        build_corpus("h3.6m", root=tmp_path)
    with pytest.raises(ConfigError, match="'validaton'; did you mean 'validation'"):
        build_corpus("h36m", root=tmp_path, validaton="11")
    with pytest.raises(ConfigError, match="give root"):
        build_corpus("cmu-salsa")


@pytest.mark.parametrize("kind", [kind for kind in CORPORA if kind not in ("synthetic", "bodies")])
def test_a_folder_that_is_not_there_or_empty_is_refused(kind: str, tmp_path: Path) -> None:
    with pytest.raises(DataError, match="no such folder"):
        build_corpus(kind, root=tmp_path / "nowhere", cache=False)
    with pytest.raises(DataError):
        build_corpus(kind, root=tmp_path, cache=False)


def test_salsa_is_split_as_in_its_paper_at_its_true_rate_without_the_t_pose(
    write_walks: Write, with_t_pose: Change
) -> None:
    names = [f"{name[:2]}/{name[3:]}" for name in SALSA_FILES if name[6:8] in ("01", "12", "13")]
    root = write_walks([*names, "61/61_14.bvh"], change=with_t_pose, fps=120.0, seconds=0.5)
    corpus = build_corpus("cmu-salsa", root=root, cache=False)
    assert corpus.fps == 30
    assert files_of(corpus, "train") == [
        "61/61_01.bvh:0",
        "61/61_01.bvh:1",
        "61/61_12.bvh:0",
        "61/61_12.bvh:1",
    ]
    assert files_of(corpus, "validation") == ["61/61_13.bvh:0"]
    assert files_of(corpus, "test") == ["61/61_14.bvh:0"]
    assert [clip.frames for clip in corpus.split("train")] == [30, 30, 30, 30]
    assert len(corpus.missing) == 10
    assert "61/61_15.bvh" in corpus.missing
    rotations = corpus.split("test")[0].rotations_local
    assert rotations[0, 1:, 0].abs().min() < 0.9999, "the T pose is gone"
    both = build_corpus("cmu-salsa", root=root, subjects=[61, "60"], cache=False)
    added = set(files_of(both, "train")) - set(files_of(corpus, "train"))
    assert added == {"60/60_01.bvh:0", "60/60_01.bvh:1", "60/60_12.bvh:0", "60/60_12.bvh:1"}
    assert files_of(both, "validation") == ["61/61_13.bvh:0"]
    assert not any(name.startswith(("60/60_13", "60/60_14", "60/60_15")) for name in both.missing)


def test_a_salsa_file_with_a_mended_header_and_no_t_pose_is_kept_as_it_is(
    write_walks: Write,
) -> None:
    root = write_walks(["61_01.bvh", "61_14.bvh"], fps=60.0, seconds=0.5)
    corpus = build_corpus("cmu-salsa", root=root, fps=60.0, cache=False)
    assert [clip.frames for clip in corpus.clips] == [30, 30]


@pytest.mark.parametrize("subjects", [["60"], ["61", "62"], []])
def test_salsa_needs_the_dancer_of_the_split(tmp_path: Path, subjects: list[str]) -> None:
    with pytest.raises(ConfigError, match="expected 61"):
        build_corpus("cmu-salsa", root=tmp_path, subjects=subjects)


def test_cmu_asf_tests_on_bodies_that_were_not_trained_on(write_amc: Write) -> None:
    root = write_amc(["01/01_03.amc", "02/02_01.amc", "02/02_02.amc", "02/02_09.amc"])
    corpus = build_corpus("cmu-asf", root=root, cache=False)
    assert corpus.fps == 30
    assert files_of(corpus, "train") == [f"02/02_01.amc:{phase}" for phase in range(4)]
    assert files_of(corpus, "validation") == ["02/02_02.amc:0", "02/02_09.amc:0"]
    assert files_of(corpus, "test") == ["01/01_03.amc:0"]
    assert len(corpus.missing) == 24
    actions = [clip.labels["action"] for clip in corpus.split("validation")]
    assert actions == ["walk", "swordplay"]


def test_a_changed_skeleton_file_is_read_again(write_amc: Write, tmp_path: Path) -> None:
    root = write_amc(["02/02_01.amc"])
    before = build_corpus("cmu-asf", root=root, cache=tmp_path / "cache").clips[0]
    asf = root / "02" / "02.asf"
    asf.write_text(asf.read_text().replace("axis 0 0 0 XYZ", "axis 0 0 90 XYZ"))
    after = build_corpus("cmu-asf", root=root, cache=tmp_path / "cache").clips[0]
    assert not torch.equal(before.rotations_local, after.rotations_local)


def test_bandai_is_split_within_groups_and_loses_its_upper_root(
    write_walks: Write, with_root_above: Change
) -> None:
    names = [f"dataset-2_walk_normal_{number:03d}.bvh" for number in range(1, 13)]
    names += [f"dataset-2_run_active_{number:03d}.bvh" for number in (1, 2, 4)]
    root = write_walks(names, change=with_root_above, fps=30.0, seconds=0.3)
    corpus = build_corpus("bandai-locomotion", root=root, cache=False)
    assert corpus.skeleton.names[0] == "Hips"
    assert files_of(corpus, "validation") == [
        "dataset-2_run_active_002.bvh:-",
        "dataset-2_walk_normal_011.bvh:-",
    ]
    assert files_of(corpus, "test") == [
        "dataset-2_run_active_004.bvh:-",
        "dataset-2_walk_normal_012.bvh:-",
    ]
    assert len(corpus.splits["train"]) == 11
    assert corpus.missing == ("dataset-2_run_active_003.bvh",)
    labels = corpus.clips[0].labels
    assert (labels["content"], labels["style"], labels["number"]) == ("run", "active", "001")
    assert corpus.windows("train", 5, labels={"style": "normal"})


def test_bandai_positions_are_those_of_the_motion(
    write_walks: Write, walk: Callable[..., Clip], with_root_above: Change
) -> None:
    name = "dataset-2_walk_normal_001.bvh"
    root = write_walks([name], change=with_root_above, fps=30.0, seconds=0.5)
    (clip,) = build_corpus("bandai-locomotion", root=root, cache=False).clips
    truth = walk(1, fps=30.0, seconds=0.5).to(torch.float32)
    assert clip.translations_local is None
    assert_close(
        joint_positions(clip.skeleton, clip.rotations_local, clip.offsets, clip.root_positions),
        joint_positions(truth.skeleton, truth.rotations_local, truth.offsets, truth.root_positions),
        atol=2e-6,
        rtol=0,
    )


def test_amass_is_split_by_subset_in_old_and_new_spelling(write_amass: Write) -> None:
    rates = {
        "ACCAD/s001/walk_poses.npz": 120.0,
        "MPI_HDM05/bk/jump_poses.npz": 120.0,
        "HumanEva/S1/box_stageii.npz": 60.0,
        "SSM_synced/a/b_poses.npz": 60.0,
        "Transitions_mocap/c/d_poses.npz": 59.0,
        "SomethingNew/e/f.npz": 60.0,
    }
    root = write_amass(rates)
    np.savez(root / "ACCAD" / "s001" / "shape.npz", betas=np.zeros(16))
    corpus = build_corpus("amass", root=root, cache=False)
    assert corpus.fps == 60
    assert files_of(corpus, "train") == [
        "ACCAD/s001/walk_poses.npz:0",
        "ACCAD/s001/walk_poses.npz:1",
        "SomethingNew/e/f.npz:-",
    ]
    assert files_of(corpus, "validation") == [
        "HumanEva/S1/box_stageii.npz:-",
        "MPI_HDM05/bk/jump_poses.npz:0",
    ]
    assert files_of(corpus, "test") == [
        "SSM_synced/a/b_poses.npz:-",
        "Transitions_mocap/c/d_poses.npz:-",
    ]
    assert corpus.clips[0].labels["subset"] == "ACCAD"
    assert corpus.clips[0].labels["subject"] == "s001"
    assert "no template" in " ".join(corpus.notes)


def test_amass_can_be_split_by_lists(write_amass: Write, tmp_path: Path) -> None:
    root = write_amass({f"CMU/0{number}/a_poses.npz": 60.0 for number in range(4)})
    yaml = tmp_path / "lists.yaml"
    yaml.write_text("train: CMU/00/*\nvalidation: [CMU/01/a_poses.npz]\ntest: ['CMU/02/*']\n")
    corpus = build_corpus("amass", root=root, splits=yaml, cache=False)
    assert [len(corpus.splits[split]) for split in ("train", "validation", "test")] == [1, 1, 1]
    assert "1 of 4 files are not named" in " ".join(corpus.notes)


def test_a_template_gives_amass_its_bones(write_amass: Write, tmp_path: Path) -> None:
    root = write_amass({"ACCAD/s/a.npz": 60.0})
    rest = np.random.default_rng(0).normal(0, 0.4, (24, 3))
    np.save(tmp_path / "rest.npy", rest)
    cache = tmp_path / "cache"
    before = build_corpus("amass", root=root, cache=cache, template=str(tmp_path / "rest.npy"))
    assert before.clips[0].offsets[1].abs().sum() > 0
    np.save(tmp_path / "rest.npy", rest * 1.1)
    after = build_corpus("amass", root=root, cache=cache, template=str(tmp_path / "rest.npy"))
    assert_close(after.clips[0].offsets, before.clips[0].offsets * 1.1)


def test_a_file_that_is_there_twice_is_refused(
    write_walks: Write, write_amc: Write, tmp_path: Path
) -> None:
    for folder in ("a", "b"):
        write_walks(["61_01.bvh", "dataset-2_run_x_001.bvh"], root=tmp_path / folder, seconds=0.1)
        write_amc(["02/02_01.amc"], root=tmp_path / folder)
    for kind in ("cmu-salsa", "bandai-locomotion", "cmu-asf"):
        with pytest.raises(DataError, match=r"is there (twice|more than once)"):
            build_corpus(kind, root=tmp_path, cache=False)


@pytest.mark.data
def test_the_salsa_at_hand_moves_at_human_speed(data_root: Path, tmp_path: Path) -> None:
    corpus = build_corpus(
        "cmu-salsa", root=data_root / "cmu-salsa", subjects=("60", "61"), cache=tmp_path
    )
    assert corpus.missing == ()
    assert [len(corpus.splits[split]) for split in corpus.splits] == [44, 1, 2]
    assert len(corpus.skeleton) == 43
    minutes = sum(clip.duration for clip in corpus.clips) / 60
    assert 26 < minutes < 28
    assert all(clip.translations_local is None for clip in corpus.clips)


@pytest.mark.data
def test_the_asf_trials_at_hand_are_complete(data_root: Path, tmp_path: Path) -> None:
    corpus = build_corpus("cmu-asf", root=data_root / "cmu-asf", cache=tmp_path)
    assert corpus.missing == ()
    assert [len(corpus.splits[split]) for split in corpus.splits] == [32, 2, 18]
    assert len(corpus.skeleton) == 31


@pytest.mark.data
def test_the_bandai_files_at_hand_are_complete(data_root: Path, tmp_path: Path) -> None:
    corpus = build_corpus("bandai-locomotion", root=data_root / "bandai-locomotion", cache=tmp_path)
    assert corpus.missing == ()
    assert len(corpus.clips) == 716
    assert [len(corpus.splits[split]) for split in corpus.splits] == [570, 73, 73]
    assert len(corpus.skeleton) == 21
    assert all(clip.translations_local is None for clip in corpus.clips)
    assert 58 < sum(clip.duration for clip in corpus.clips) / 60 < 60
