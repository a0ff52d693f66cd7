"""A checkpoint folder: exact round trip, honest refusals, no code execution."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import torch

from posecast.checkpoint import Checkpoint, load_checkpoint, save_checkpoint
from posecast.errors import DataError
from posecast.skeleton import Skeleton


@pytest.fixture
def checkpoint(generator: torch.Generator) -> Checkpoint:
    return Checkpoint(
        recipe={"model": {"residual": "compose"}, "training": {"epochs": 3}},
        skeleton=Skeleton(("Hips", "Head"), (-1, 0)),
        offsets=((0.0, 0.0, 0.0), (0.0, 0.5, 0.0)),
        fps=25.0,
        tensors={"weight": torch.randn(3, 2, generator=generator)},
        progress={"epoch": 2, "loss": 0.5},
    )


def test_what_is_saved_is_what_is_loaded(checkpoint: Checkpoint, tmp_path: Path) -> None:
    save_checkpoint(checkpoint, tmp_path / "best")
    loaded = load_checkpoint(tmp_path / "best")
    assert loaded.recipe == checkpoint.recipe
    assert loaded.skeleton == checkpoint.skeleton
    assert loaded.offsets == checkpoint.offsets
    assert loaded.fps == checkpoint.fps
    assert loaded.progress == checkpoint.progress
    assert torch.equal(loaded.tensors["weight"], checkpoint.tensors["weight"])


def test_saving_again_replaces_the_folder_and_leaves_nothing_beside_it(
    checkpoint: Checkpoint, tmp_path: Path
) -> None:
    for _ in range(2):
        save_checkpoint(checkpoint, tmp_path / "best")
    assert [entry.name for entry in tmp_path.iterdir()] == ["best"]
    assert sorted(entry.name for entry in (tmp_path / "best").iterdir()) == [
        "checkpoint.json",
        "recipe.yaml",
        "weights.safetensors",
    ]


def test_a_kill_between_the_two_renames_loses_nothing(
    checkpoint: Checkpoint, tmp_path: Path
) -> None:
    save_checkpoint(checkpoint, tmp_path / "last")
    (tmp_path / "last").rename(tmp_path / "last.previous")
    assert load_checkpoint(tmp_path / "last").progress == checkpoint.progress


def test_a_folder_with_other_files_is_not_overwritten(
    checkpoint: Checkpoint, tmp_path: Path
) -> None:
    (tmp_path / "best").mkdir()
    (tmp_path / "best" / "thesis.tex").write_text("years of work")
    with pytest.raises(DataError, match="exists and is not a checkpoint"):
        save_checkpoint(checkpoint, tmp_path / "best")
    assert (tmp_path / "best" / "thesis.tex").read_text() == "years of work"


def test_an_exchanged_weights_file_is_refused(checkpoint: Checkpoint, tmp_path: Path) -> None:
    save_checkpoint(checkpoint, tmp_path / "best")
    with (tmp_path / "best" / "weights.safetensors").open("ab") as file:
        file.write(b"more")
    with pytest.raises(DataError, match="does not match the checksum"):
        load_checkpoint(tmp_path / "best")


def test_a_recipe_that_asks_for_python_objects_is_refused(
    checkpoint: Checkpoint, tmp_path: Path
) -> None:
    save_checkpoint(checkpoint, tmp_path / "best")
    witness = tmp_path / "witness"
    (tmp_path / "best" / "recipe.yaml").write_text(
        f"model: !!python/object/apply:os.mkdir ['{witness}']\n"
    )
    with pytest.raises(DataError, match="damaged"):
        load_checkpoint(tmp_path / "best")
    assert not witness.exists()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"format": 99}, "checkpoint format 99, this version reads up to 1"),
        ({"format": None}, "checkpoint format None"),
        ({"skeleton": {"names": ["a"], "parents": [3]}}, "damaged"),
        ({"offsets": [[0, 0]]}, "damaged"),
        ({"offsets": []}, "damaged"),
        ({"offsets": [[0, 0, float("nan")]] * 2}, "damaged"),
        ({"fps": "many"}, "damaged"),
        ({"skeleton": {"names": ["a"], "parents": [float("inf")]}}, "damaged"),
    ],
)
def test_damaged_facts_are_one_line_of_error(
    checkpoint: Checkpoint, tmp_path: Path, change: dict[str, object], message: str
) -> None:
    save_checkpoint(checkpoint, tmp_path / "best")
    path = tmp_path / "best" / "checkpoint.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), **change}))
    with pytest.raises(DataError, match=message) as caught:
        load_checkpoint(tmp_path / "best")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["recipe.yaml", "checkpoint.json"])
def test_a_file_nested_without_end_is_one_line_of_error(
    checkpoint: Checkpoint, tmp_path: Path, name: str
) -> None:
    save_checkpoint(checkpoint, tmp_path / "best")
    (tmp_path / "best" / name).write_text("[" * 100_000)
    with pytest.raises(DataError, match="nested too deep"):
        load_checkpoint(tmp_path / "best")


def test_where_there_is_no_best_the_last_is_named(checkpoint: Checkpoint, tmp_path: Path) -> None:
    save_checkpoint(checkpoint, tmp_path / "last")
    for wrong in (tmp_path, tmp_path / "best"):
        with pytest.raises(DataError, match=f"take {tmp_path / 'last'}$"):
            load_checkpoint(wrong)


def test_a_folder_that_is_no_checkpoint_says_what_was_expected(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"expected a folder with recipe\.yaml"):
        load_checkpoint(tmp_path / "nowhere")
