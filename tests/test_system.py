"""A system written to disk and read back is the same system, and runs no code of its folder."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import pytest
import torch
import yaml

from posecast.checkpoint import load_checkpoint, save_checkpoint
from posecast.config import merge, parse_overrides
from posecast.corpora.synthetic import synthetic
from posecast.errors import ConfigError, DataError
from posecast.motion.corpus import Corpus
from posecast.recipe import Recipe, load_recipe
from posecast.system import System, load, save, train


@pytest.fixture(scope="module")
def recipe() -> Recipe:
    return load_recipe(
        "quaternet-vel-small",
        [
            "model.backbone.hidden=16",
            "codec.standardize=deviation",
            "training.epochs=2",
            "training.sampling.steps_per_epoch=2",
            "training.batch=4",
            "protocol.prefix_ms=400",
        ],
    )


@pytest.fixture(scope="module")
def corpus() -> Corpus:
    return synthetic(fps=25.0, clips=12, seconds=4.0)


@pytest.fixture(scope="module")
def run(recipe: Recipe, corpus: Corpus, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("run")
    train(recipe, corpus, folder, progress=False)
    return folder


def test_a_run_leaves_two_checkpoints_and_its_logs(run: Path) -> None:
    names = {entry.name for entry in run.iterdir()}
    assert {"best", "last", "log.csv", "validation.csv"} <= names


def test_a_loaded_system_predicts_what_the_saved_one_did(
    run: Path, corpus: Corpus, tmp_path: Path
) -> None:
    system = load(run / "best")
    save(system, tmp_path / "copy")
    copy = load(tmp_path / "copy")
    clip = corpus.split("test")[0]
    first, second = (each.forecast(clip, horizon_ms=400) for each in (system, copy))
    assert torch.equal(first.rotations_local, second.rotations_local)
    assert torch.equal(first.root_positions, second.root_positions)
    assert system.fps == copy.fps == 25
    assert system.recipe.name == "quaternet-vel-small"
    assert system.parameters == copy.parameters > 1000


def test_statistics_travel_with_the_weights(run: Path, recipe: Recipe, corpus: Corpus) -> None:
    measured = recipe.measure(corpus)
    kept = load(run / "last").forecaster.codec.statistics
    assert measured is not None
    assert kept is not None
    torch.testing.assert_close(kept.mean, measured.mean)
    torch.testing.assert_close(kept.scale, measured.scale)


def test_loading_leaves_the_global_random_state_alone(run: Path) -> None:
    before = torch.random.get_rng_state()
    load(run / "best")
    assert torch.equal(before, torch.random.get_rng_state())


def test_training_twice_gives_the_same_weights(
    recipe: Recipe, corpus: Corpus, run: Path, tmp_path: Path
) -> None:
    train(recipe, corpus, tmp_path, progress=False)
    first, second = (load(folder / "last").forecaster.state_dict() for folder in (run, tmp_path))
    assert first.keys() == second.keys()
    assert all(torch.equal(first[name], second[name]) for name in first)


def test_another_seed_gives_other_weights(
    recipe: Recipe, corpus: Corpus, run: Path, tmp_path: Path
) -> None:
    config = {**recipe.config, "training": {**recipe.config["training"], "seed": 5}}
    train(Recipe(config), corpus, tmp_path, progress=False)
    first, second = (load(folder / "last").forecaster.state_dict() for folder in (run, tmp_path))
    assert any(not torch.equal(first[name], second[name]) for name in first)


def test_a_run_begins_with_the_weights_of_another(
    recipe: Recipe, corpus: Corpus, run: Path, tmp_path: Path
) -> None:
    still = Recipe(merge(recipe.config, parse_overrides(["training.learning_rate=1e-12"])))
    start = load(run / "last")
    train(still, corpus, tmp_path / "begun", start=start, progress=False)
    found = load(tmp_path / "begun" / "last").forecaster.state_dict()
    for name, value in start.forecaster.state_dict().items():
        torch.testing.assert_close(found[name], value, rtol=0, atol=1e-8)
    train(still, corpus, tmp_path / "begun", start=start, resume=True, progress=False)
    with pytest.raises(ConfigError, match="start was '"):
        train(still, corpus, tmp_path / "begun", resume=True, progress=False)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ("model.backbone.hidden=8", "has another size there"),
        ("representation.kind=ortho6d", "its representation is another"),
    ],
)
def test_weights_of_another_network_are_nothing_to_begin_with(
    recipe: Recipe, corpus: Corpus, run: Path, tmp_path: Path, changed: str, message: str
) -> None:
    changes = [changed, "model.residual=add", "training.objective.terms={features: 1.0}"]
    other = Recipe(merge(recipe.config, parse_overrides(changes)))
    with pytest.raises(ConfigError, match=message):
        train(other, corpus, tmp_path / "begun", start=load(run / "last"), progress=False)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ("model.residual=add", "model.residual was 'compose', now 'add'"),
        ("model.input_dropout=0.2", "model.input_dropout was None, now 0.2"),
        ("codec.standardize=variance", "codec.standardize was 'deviation', now 'variance'"),
    ],
)
def test_a_run_is_not_resumed_as_another_system_whose_weights_would_fit(
    recipe: Recipe, corpus: Corpus, run: Path, changed: str, message: str
) -> None:
    other = Recipe(merge(recipe.config, parse_overrides([changed, "training.epochs=3"])))
    with pytest.raises(ConfigError, match=re.escape(message)):
        train(other, corpus, run, resume=True, progress=False)


def test_weights_that_are_no_numbers_are_refused(run: Path, tmp_path: Path) -> None:
    system = load(run / "best")
    with torch.no_grad():
        next(system.forecaster.parameters())[0] = float("nan")
    save(system, tmp_path / "sick")
    with pytest.raises(DataError, match=r"weight .* has values that are no numbers"):
        load(tmp_path / "sick")


@pytest.mark.parametrize(
    ("fact", "value", "message"),
    [("fps", -1, "-1 frames per second"), ("format", 0, "format 0"), ("format", True, "format")],
)
def test_facts_that_do_not_fit_are_refused(
    run: Path, tmp_path: Path, fact: str, value: object, message: str
) -> None:
    save(load(run / "best"), tmp_path / "copy")
    path = tmp_path / "copy" / "checkpoint.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), fact: value}))
    with pytest.raises(DataError, match=message):
        load(tmp_path / "copy")


def test_tensors_that_no_system_has_are_refused(run: Path, tmp_path: Path) -> None:
    checkpoint = load_checkpoint(run / "best")
    tensors = {**checkpoint.tensors, "stray": torch.zeros(2)}
    save_checkpoint(replace(checkpoint, tensors=tensors), tmp_path / "copy")
    with pytest.raises(DataError, match="holds 'stray', which no system has"):
        load(tmp_path / "copy")


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ("training.select_best_by=eulr", "select_best_by: validation measures no 'eulr'; did you"),
        ("training.select_best_by=pck_auc_400ms", "validation measures no 'pck_auc_400ms'"),
        ("protocol.metrics=[pck_auc,euler]", "is better the higher it is; put an error first"),
        ("protocol.prefix_ms=200000", "none of its"),
        ("protocol.kind=h36m-128", "use protocol 'short-term'"),
    ],
)
def test_what_validation_could_not_do_is_said_before_training(
    recipe: Recipe, corpus: Corpus, tmp_path: Path, changed: str, message: str
) -> None:
    other = Recipe(merge(recipe.config, parse_overrides([changed])))
    with pytest.raises(ConfigError, match=message):
        train(other, corpus, tmp_path / "run", progress=False)
    assert not (tmp_path / "run").exists()


def test_a_clip_whose_action_the_network_is_not_told_is_refused_before_training(
    recipe: Recipe, corpus: Corpus, tmp_path: Path
) -> None:
    changes = ["training.objective.terms.action=1", "codec.actions=[run, jog]"]
    told = Recipe(merge(recipe.config, parse_overrides(changes)))
    with pytest.raises(ConfigError, match="shows 'walk', which is not listed; known: jog, run"):
        train(told, corpus, tmp_path / "run", progress=False)
    bare = replace(corpus, clips=[replace(clip, labels={}) for clip in corpus.clips])
    with pytest.raises(ConfigError, match="says of no action, which is not listed"):
        train(told, bare, tmp_path / "run", progress=False)
    assert not (tmp_path / "run").exists()


def test_a_network_that_is_told_the_action_predicts_another_motion_for_another(
    recipe: Recipe, corpus: Corpus, tmp_path: Path
) -> None:
    known = sorted({clip.labels["action"] for clip in corpus.clips})
    changes = ["training.objective.terms.action=1", f"codec.actions=[{','.join(known)}]"]
    train(Recipe(merge(recipe.config, parse_overrides(changes))), corpus, tmp_path, progress=False)
    system = load(tmp_path / "best")
    clip = corpus.clips[0]
    found = [
        system.forecast(replace(clip, labels={"action": action}), horizon_ms=400).rotations_local
        for action in (known[0], known[0], known[1])
    ]
    assert torch.equal(found[0], found[1])
    assert not torch.equal(found[0], found[2])
    with pytest.raises(ConfigError, match="no action is given"):
        system.forecast(replace(clip, labels={}), horizon_ms=400)


def test_nothing_is_the_best_without_validation(
    recipe: Recipe, corpus: Corpus, tmp_path: Path
) -> None:
    bare = replace(corpus, splits={"train": corpus.splits["train"]})
    other = Recipe(merge(recipe.config, parse_overrides(["training.select_best_by=euler"])))
    with pytest.raises(ConfigError, match="has no validation clips to measure it on"):
        train(other, bare, tmp_path, progress=False)
    other = Recipe(merge(recipe.config, parse_overrides(["training.patience=3"])))
    with pytest.raises(
        ConfigError, match=r"training\.patience: 3, but corpus .* has no validation"
    ):
        train(other, bare, tmp_path, progress=False)


def test_a_corpus_at_another_rate_is_refused(recipe: Recipe, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="works at 25 frames per second, the corpus has 30"):
        train(recipe, synthetic(fps=30.0, clips=6, seconds=3.0), tmp_path, progress=False)


@pytest.mark.parametrize("hidden", [17, 10**9])
def test_weights_of_another_size_are_refused_in_one_line(
    run: Path, tmp_path: Path, hidden: int
) -> None:
    save(load(run / "best"), tmp_path / "copy")
    path = tmp_path / "copy" / "recipe.yaml"
    config = yaml.safe_load(path.read_text())
    config["model"]["backbone"]["hidden"] = hidden
    path.write_text(yaml.safe_dump(config))
    with pytest.raises(
        (ConfigError, DataError), match=r"do not fit the recipe|check its sizes"
    ) as caught:
        load(tmp_path / "copy")
    assert "\n" not in str(caught.value)


def test_a_checkpoint_says_what_it_was_trained_on(run: Path) -> None:
    facts = json.loads((run / "best" / "checkpoint.json").read_text())
    assert facts["fps"] == 25
    assert len(facts["skeleton"]["names"]) == len(facts["offsets"]) > 15
    assert isinstance(load(run / "best"), System)


def test_a_forecast_reads_as_many_frames_as_the_protocol_gives(run: Path, corpus: Corpus) -> None:
    system = load(run / "best")
    given = system.recipe.protocol.frames(system.fps).prefix
    assert given == 10
    clip = corpus.clips[0]

    def after(first: int) -> torch.Tensor:
        changed = clip.rotations_local.clone()
        changed[first, 3] = changed[first, 3].roll(1)
        there = replace(clip, rotations_local=changed)
        return system.forecast(there, horizon_ms=400).rotations_local[clip.frames :]

    plain = system.forecast(clip, horizon_ms=400).rotations_local[clip.frames :]
    reached = max(system.recipe.plan.prefix, given)
    torch.testing.assert_close(after(clip.frames - reached - 1), plain)
    assert (after(clip.frames - reached) - plain).abs().max() > 1e-6
