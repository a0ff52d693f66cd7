"""Every recipe that comes with the package: it builds, every key of it counts, and it learns."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import torch

from posecast.errors import ConfigError
from posecast.geometry import quaternion
from posecast.model import ZeroVelocity
from posecast.motion import Clip
from posecast.motion.corpus import Corpus
from posecast.recipe import Recipe, count_parameters, list_recipes, load_recipe
from posecast.skeleton import Skeleton
from posecast.system import load, train

NUMBER_OF_RECIPES = 4


def test_the_recipes_are_all_here() -> None:
    assert len(list_recipes()) == NUMBER_OF_RECIPES


@pytest.mark.parametrize("name", list_recipes())
def test_a_recipe_says_what_it_is_and_fits_on_a_page(name: str) -> None:
    recipe = load_recipe(name)
    assert recipe.name == name
    for text in ("summary", "source", "expect"):
        assert len(recipe.config[text]) > 10
    path = Path(__file__).parents[2] / "src" / "posecast" / "recipes" / f"{name}.yaml"
    lines = path.read_text().splitlines()
    assert len(lines) <= 30
    assert any(f"posecast train {name}" in line for line in lines if line.startswith("#"))


def test_published_systems_have_the_published_size() -> None:
    # 32 joints x 4, two GRUs of 1000 with learned first states, a linear layer of 128.
    assert count_parameters(load_recipe("quaternet-vel")) == 9_526_128
    assert count_parameters(load_recipe("quaternet-abs")) == 9_526_128
    assert count_parameters(load_recipe("quaternet-vel-tf")) == 9_526_128


def test_the_paper_recipes_have_every_constant_of_the_papers() -> None:
    # models.md, section 1: Pavllo et al. 2018, sections 3.3 and 4.1, and their released settings.
    vel, abs_, teacher = (load_recipe(f"quaternet-{name}") for name in ("vel", "abs", "vel-tf"))
    for recipe in (vel, abs_, teacher):
        plan = recipe.plan
        assert (plan.prefix, plan.horizon, plan.batch, plan.epochs) == (50, 10, 60, 3000)
        assert (plan.optimizer, plan.clip) == ("adam", 0.1)
        assert [plan.rate.at(epoch=k, update=7) for k in (0, 1, 10)] == pytest.approx(
            [1e-3, 1e-3 * 0.999, 1e-3 * 0.999**10], rel=1e-12
        )
        assert (plan.turn, plan.mirror) == (False, False)
        assert (recipe.fps, recipe.objective.order) == (25, "zyx")
        assert recipe.protocol.name == "h36m-128"
    for recipe in (vel, abs_):
        assert dict(recipe.objective.terms) == {"euler": 1.0, "penalty": 0.01}
        assert [recipe.feed.share(epoch) for epoch in (0, 1, 100)] == pytest.approx(
            [1, 0.995, 0.995**100]
        )
    assert [recipe.config["model"]["residual"] for recipe in (vel, abs_, teacher)] == [
        "compose",
        "none",
        "compose",
    ]


def test_the_teacher_forced_variant_has_the_loss_of_the_paper_only() -> None:
    recipe = load_recipe("quaternet-vel-tf")
    assert dict(recipe.objective.terms) == {"quaternion": 1.0, "penalty": 0.01}
    assert recipe.feed.share(1000) == 1


def _leaves(config: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    """Paths of all keys, sections included."""
    for key, value in config.items():
        yield (*path, key)
        if isinstance(value, dict):
            yield from _leaves(value, (*path, key))


@pytest.mark.parametrize("name", list_recipes())
def test_every_key_of_a_recipe_is_checked_for_spelling(name: str) -> None:
    recipe = load_recipe(name)
    paths = [path for path in _leaves(recipe.config) if path[-1] != "name"]
    assert len(paths) > 25
    for path in paths:
        misspelled = ".".join((*path[:-1], path[-1] + "x"))
        if path[-1] == "kind":
            misspelled, value = ".".join(path), "nonsense"
        else:
            value = "1"
        with pytest.raises(ConfigError) as caught:
            load_recipe(name, [f"{misspelled}={value}"])
        assert path[-1] in str(caught.value)


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("training.seed=99999999999999999999", "seed is 99999999999999999999; expected 0 to 2**63"),
        ("epochs=3", "epochs: unknown key at the top; did you mean 'training.epochs'?"),
        ("hidden=64", "did you mean 'model.backbone.hidden'?"),
        ("model.backbone.layers=1000000", "layers: 1000000; expected 1 to 100"),
        ("training.epochz=1", "training.epochz: unknown key; did you mean 'epochs'?"),
        ("model.backbone.hidden=many", "model.backbone.hidden: found 'many', expected a whole"),
        ("model.residual=sum", "model.residual: found 'sum', expected one of 'none'"),
        ("training.feed.decay=2", "training.feed"),
        ("training.objective.terms.eulre=1", "did you mean 'euler'?"),
        ("training.batch=0", "training"),
        ("protocol.kind=h36m", "protocol.kind: unknown 'h36m'"),
        ("fps=0", "fps: found 0, expected a positive number"),
        ("model=3", "model: found 3, expected keys"),
        ("corpus.kind=h36", "corpus.kind: unknown 'h36'; did you mean 'h36m'?"),
        ("corpus.kind=[1]", "corpus.kind: unknown [1]"),
        ("fps=1e9", "fps: found 1000000000.0, expected a positive number, at most 10000"),
        ("fps=true", "fps: found True, expected a positive number"),
        (
            "training.objective.terms.euler=x",
            "found {'euler': 'x', 'penalty': 0.01}, expected keys",
        ),
        ("training.objective.order=abc", "training.objective: order 'abc' is unknown"),
        (
            "protocol.horizons_ms=[soon]",
            "found ['soon'], expected a list, each item a whole number",
        ),
        ("fps=50", "protocol 'h36m-128' is defined at 25 fps"),
        ("protocol.horizons_ms=[90]", "90 ms is 2.25 frames at 25 fps"),
        ("model.backbone.hidden=0", "model: hidden_size must be greater than zero"),
        ("model.head.hidden=0", "model: head.hidden is 0; expected 1 or more"),
        ("model.projection_activation=relu", "model: projection_activation: 'relu' follows"),
        ("codec.root=displacement", "training.objective: the codec writes 3 root channels"),
    ],
)
def test_a_mistake_stops_before_any_data_is_read(override: str, message: str) -> None:
    with pytest.raises(ConfigError) as caught:
        load_recipe("quaternet-vel", [override])
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_an_unknown_recipe_names_the_nearest() -> None:
    with pytest.raises(ConfigError, match="did you mean 'quaternet-vel'"):
        load_recipe("quaternet-vell")


def test_a_recipe_may_extend_one_that_extends_nothing(tmp_path: Path) -> None:
    (tmp_path / "mine.yaml").write_text("extends: quaternet-vel\ntraining: {epochs: 7}\n")
    recipe = load_recipe(str(tmp_path / "mine.yaml"))
    assert (recipe.name, recipe.plan.epochs, recipe.plan.batch) == ("mine", 7, 60)
    (tmp_path / "deeper.yaml").write_text("extends: mine\n")
    with pytest.raises(ConfigError, match="extend 'quaternet-vel' and repeat what 'mine' adds"):
        load_recipe(str(tmp_path / "deeper.yaml"))


@pytest.fixture(scope="module")
def tiny_corpus() -> Corpus:
    """Two recordings of a swinging arm, to be learned by heart; the same for all three splits."""
    skeleton = Skeleton(("Hips", "Spine", "LeftArm", "RightArm"), (-1, 0, 1, 1))
    seconds = torch.arange(90, dtype=torch.float64) / 25
    clips = []
    for phase in (0.0, 1.5):
        swing = 0.6 * torch.sin(4 * seconds + phase)
        joints = torch.stack([0.2 * swing, 0.3 * swing, swing, -swing], dim=-1)
        axes = torch.tensor([[0, 1, 0], [0, 0, 1], [1, 0, 0], [1, 0, 0]], dtype=torch.float64)
        clips.append(
            Clip(
                skeleton,
                torch.tensor([[0, 0, 0], [0, 0.5, 0], [0.2, 0, 0], [-0.2, 0, 0]]).double(),
                25.0,
                seconds[:, None] * torch.tensor([0.0, 0.0, 1.0]).double()
                + torch.tensor([0.0, 1.0, 0.0]).double(),
                quaternion.exp(joints[..., None] * axes),
                name=f"swing-{phase}",
                labels={"action": "swing"},
            ).to(torch.float32)
        )
    return Corpus("tiny", clips, {"train": (0, 1), "validation": (0, 1), "test": (0, 1)})


@pytest.mark.parametrize("name", list_recipes())
def test_a_recipe_learns_a_tiny_corpus_by_heart(
    name: str, tiny_corpus: Corpus, tmp_path: Path
) -> None:
    recipe = _shrunk(name)
    result = train(recipe, tiny_corpus, tmp_path / "run", progress=False)
    assert result.best is not None
    system = load(tmp_path / "run" / "best")
    scores = recipe.protocol.score(system.predictor, tiny_corpus, "test")
    still = recipe.protocol.score(ZeroVelocity(), tiny_corpus, "test")
    assert scores.value("joint_angle", 400) < 0.25 * still.value("joint_angle", 400)


def _shrunk(name: str) -> Recipe:
    """The recipe with few units, quick decays and the protocol for any corpus; the same code."""
    sampling = "{kind: random_recordings, steps_per_epoch: 15}"
    overrides = [
        "model.backbone.hidden=32",
        "training.prefix=10",
        "training.epochs=12",
        "training.validate_every=12",
        "training.batch=8",
        "training.learning_rate=0.01",
        "training.decay=0.8",
        f"training.sampling={sampling}",
        "protocol={kind: short-term, prefix_ms: 400, metrics: [joint_angle]}",
    ]
    recipe = load_recipe(name)
    if "decay" in recipe.config["training"]["feed"]:
        overrides.append("training.feed.decay=0.6")
    return load_recipe(name, overrides)
