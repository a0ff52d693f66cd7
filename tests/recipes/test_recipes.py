"""Every recipe that comes with the package: it builds, every key of it counts, and it learns."""

from __future__ import annotations

import csv
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch

from posecast.corpora.synthetic import make_clip
from posecast.corpora.walks import with_walks
from posecast.errors import ConfigError
from posecast.geometry import quaternion
from posecast.model import ZeroVelocity
from posecast.motion import Clip
from posecast.motion.corpus import Corpus
from posecast.recipe import RECIPES, Recipe, count_parameters, list_recipes, load_recipe
from posecast.skeleton import Skeleton
from posecast.skeleton.catalog import named_skeleton
from posecast.system import load, train
from posecast.training import Adversary


@pytest.mark.parametrize("divide_by", ["deviation", "variance"])
def test_statistics_are_of_all_frames_in_pieces_as_long_as_windows(
    divide_by: str, tiny_corpus: Corpus
) -> None:
    overrides = ["training.prefix=10", "training.horizon=15"]
    recipe = load_recipe("acrnn-quaternion", [*overrides, f"codec.standardize={divide_by}"])
    found = recipe.measure(tiny_corpus)
    assert found is not None
    codec = recipe.build_codec(tiny_corpus.skeleton)
    pieces = [
        codec.encode(clip.cut(first, min(first + 25, 90)).motion()).double()
        for clip in tiny_corpus.clips
        for first in (0, 25, 50, 75)
    ]
    whole = torch.cat(pieces, dim=1)[0]
    assert len(whole) == 180
    torch.testing.assert_close(found.mean, whole.mean(0))
    spread = whole.var(0, correction=0) if divide_by == "variance" else whole.std(0, correction=0)
    # What hardly moves is left as it is, and its deviation says so, whatever it is divided by.
    still = whole.std(0, correction=0) < 1e-4
    expected = torch.where(still, torch.ones_like(spread), spread)
    torch.testing.assert_close(found.scale, expected, atol=1e-6, rtol=1e-5)


FILES = sorted(path.stem for path in RECIPES.glob("*.yaml"))


def test_the_recipes_are_all_here() -> None:
    assert len(FILES) == 62
    # Every one but those that are small themselves has a small form.
    assert sorted(list_recipes()) == sorted(
        {*FILES, *(f"{name}-small" for name in FILES if not name.endswith("-small"))}
    )
    assert len(list_recipes()) == 121


@pytest.mark.parametrize("name", list_recipes())
def test_a_recipe_says_what_it_is(name: str) -> None:
    recipe = load_recipe(name)
    assert recipe.name == name
    for text in ("summary", "source", "expect"):
        assert len(recipe.config[text]) > 10
    small = name.endswith("-small")
    assert ("small" in recipe.config["summary"]) == small
    backbone = recipe.config["model"]["backbone"]
    units = backbone[_units(recipe)]
    if backbone["kind"] == "structural_rnn":
        # Seven LSTMs, 512 units each as published.
        assert units == (128 if small else 512)
    else:
        assert units == (256 if small else 1000 if _of_thousand(recipe) else 1024)


def _of_thousand(recipe: Recipe) -> bool:
    """Whether its layers have 1000 units, as those of QuaterNet and of Fragkiadaki et al. have."""
    kind = recipe.config["model"]["backbone"]["kind"]
    return kind == "gru" or recipe.name in ("h36m-lstm-3lr", "h36m-erd")


def _units(recipe: Recipe) -> str:
    """What the size of the backbone is called."""
    return "channels" if "channels" in recipe.config["model"]["backbone"] else "hidden"


WHOLE = (
    *("acrnn-quaternion", "quaternet-vel", "quaternet-locomotion"),
    *("amass-quaternet", "amass-rnn", "amass-seq2seq"),
    *("h36m-lstm-3lr", "h36m-rnn", "h36m-seq2seq-sampling"),
)


@pytest.mark.parametrize("name", FILES)
def test_a_recipe_fits_on_a_page_and_says_how_to_train_it(name: str) -> None:
    lines = (RECIPES / f"{name}.yaml").read_text().splitlines()
    # Most need 30; those of systems that others extend say every constant of a paper themselves.
    assert len(lines) <= (40 if name in WHOLE else 30)
    assert any(f"posecast train {name}" in line for line in lines if line.startswith("#"))


@pytest.mark.parametrize(
    ("kind", "joints", "parameters"),
    [
        # Andreou et al. 2022, Table 4, wherever it reconciles (models.md 8.3): CMU has 31 joints,
        # Mixamo 25. Its positions are of 38 points, joints and end sites.
        ("positions", 38, 21_579_890 + 5121 * 3),
        ("euler", 31, 21_487_712),
        ("quaternion", 31, 21_646_463),
        ("quaternion", 25, 21_523_559),
        ("ortho6d", 31, 21_963_965),
        ("dual_quaternion", 31, 22_281_467),
        ("dual_quaternion", 25, 22_035_659),
        ("quaternion+positions", 31, 22_122_716),
        ("ortho6d+positions", 31, 22_440_218),
        ("quaternion+positions", 25, 21_907_634),
        ("quaternion+offsets", 25, 21_907_634),
        ("ortho6d+positions", 25, 22_163_684),
        ("ortho6d+offsets", 25, 22_163_684),
        # Printed 3 lower, which no whole number of features gives: a misprint.
        ("ortho6d", 25, 21_779_609),
    ],
)
def test_acrnn_has_the_printed_number_of_parameters(
    kind: str, joints: int, parameters: int
) -> None:
    skeleton = Skeleton(tuple(map(str, range(joints))), tuple(range(-1, joints - 1)))
    recipe = load_recipe("acrnn-quaternion", [f"representation={{kind: {kind}}}"])
    forecaster = recipe.outline(recipe.build_codec(skeleton))
    assert sum(weight.numel() for weight in forecaster.parameters()) == parameters


def test_the_positional_row_of_table_4_has_no_root_channels() -> None:
    # 38 points x 3, the root among them as three values: 114 features in all.
    skeleton = Skeleton(tuple(map(str, range(38))), tuple(range(-1, 37)))
    overrides = ["representation={kind: positions}", "codec.root=none"]
    recipe = load_recipe("acrnn-quaternion", overrides)
    forecaster = recipe.outline(recipe.build_codec(skeleton))
    assert sum(weight.numel() for weight in forecaster.parameters()) == 21_579_890


def test_the_delayed_stack_has_as_many_parameters() -> None:
    skeleton = Skeleton(tuple(map(str, range(31))), tuple(range(-1, 30)))
    recipe = load_recipe("acrnn-quaternion", ["model.backbone.wiring=delayed"])
    forecaster = recipe.outline(recipe.build_codec(skeleton))
    assert sum(weight.numel() for weight in forecaster.parameters()) == 21_646_463


def test_the_rows_of_table_1_differ_in_representation_and_losses_only() -> None:
    rows = {
        "acrnn-quaternion": ("quaternion", {"features": 1.0}),
        "acrnn-quaternion-fk": ("quaternion", {"features": 1.0, "position_fk": 0.25}),
        "acrnn-quaternion-positions": ("quaternion+positions", {"features": 1.0}),
        "acrnn-ortho6d": ("ortho6d", {"features": 1.0}),
        "acrnn-ortho6d-positions": ("ortho6d+positions", {"features": 1.0}),
        "acrnn-dual-quaternion": ("dual_quaternion", {"features": 1.0}),
        "acrnn-dual-quaternion-all": (
            "dual_quaternion",
            {"position": 1 / 3, "offset": 1 / 3, "quaternion": 1.0, "penalty": 0.01, "root": 1.0},
        ),
    }
    for name, (kind, terms) in rows.items():
        recipe = load_recipe(name)
        assert recipe.config["representation"] == {"kind": kind}
        assert dict(recipe.objective.terms) == pytest.approx(terms, abs=1e-4)
        plan = recipe.plan
        # models.md 8.1: 150 000 updates, Adam 1e-4, batch 32, no decay, no clipping.
        assert plan.epochs * recipe.sampling.steps(22, plan.batch) == 150_000
        assert (plan.batch, plan.learning_rate, plan.clip) == (32, 1e-4, None)
        assert plan.rate.at(epoch=1000, update=100_000) == 1e-4
        # 101 frames, 100 of them predicted: five true frames, five own, over 100 inputs.
        assert (plan.prefix, plan.horizon) == (1, 100)
        mask = recipe.feed.mask(100, 0, torch.Generator())
        assert mask.tolist() == ([True] * 5 + [False] * 5) * 10
        assert (recipe.fps, recipe.config["model"]["residual"]) == (30, "none")


def test_quaternet_on_dual_quaternions_has_the_derived_size_and_the_losses_of_the_paper() -> None:
    recipe = load_recipe("quaternet-dual-quaternion")
    assert count_parameters(recipe) == 10_038_256
    assert dict(recipe.objective.terms) == {"euler": 1.0, "penalty": 0.01}
    assert (recipe.objective.order, recipe.protocol.name) == ("zyx", "h36m-long")
    long = load_recipe("quaternet-dual-quaternion-positions")
    assert dict(long.objective.terms) == {
        "position": 1.0,
        "offset": 1.0,
        "quaternion": 1.0,
        "penalty": 0.01,
    }


def test_the_pose_network_has_the_published_size() -> None:
    recipe = load_recipe("quaternet-locomotion")
    # The walks of the paper are of 26 joints.
    body = Skeleton(tuple(f"joint {number}" for number in range(26)), tuple(range(-1, 25)))
    outline = recipe.outline(recipe.build_codec(body))
    assert sum(weight.numel() for weight in outline.parameters()) == 9_529_246


def test_published_systems_have_the_published_size() -> None:
    # 32 joints x 4, two GRUs of 1000 with learned first states, a linear layer of 128.
    assert count_parameters(load_recipe("quaternet-vel")) == 9_526_128
    assert count_parameters(load_recipe("quaternet-abs")) == 9_526_128
    assert count_parameters(load_recipe("quaternet-vel-tf")) == 9_526_128
    # Five layers of two frames: 128 to 1024, three times 1024 to 1024, 1024 to 128.
    for variant in ("abs", "vel", "vel-tf"):
        assert count_parameters(load_recipe(f"quaternet-cnn-{variant}")) == 6_819_968


# Aksan et al. 2019: printed in the configurations that came with its code, or derived from them.
AKSAN = {
    "amass-rnn": 6_395_527,
    "amass-rnn-pjl": 6_395_527,
    "amass-rnn-spl": 6_295_303,
    "amass-rnn-spl-sparse": 6_281_479,
    "amass-rnn-spl-indep": 6_274_567,
    "amass-rnn-spl-random": 6_295_303,
    "amass-seq2seq": 4_428_845,
    "amass-seq2seq-sampling": 4_428_845,
    "amass-seq2seq-dropout-pjl": 4_428_845,
    "amass-seq2seq-spl": 5_376_557,
    "amass-seq2seq-sampling-spl": 5_376_557,
    "amass-seq2seq-dropout-spl": 5_376_557,
    "amass-quaternet": 10_212_620,
    "amass-quaternet-spl": 11_129_804,
    "h36m-rnn": 5_149_501,
    "h36m-rnn-spl": 5_385_277,
}


@pytest.mark.parametrize(("name", "parameters"), AKSAN.items())
def test_systems_of_aksan_et_al_have_the_size_of_their_configurations(
    name: str, parameters: int
) -> None:
    assert count_parameters(load_recipe(name)) == parameters


def test_structural_rnn_has_the_size_of_its_published_layers_and_the_schedule_of_erd() -> None:
    srnn, erd = load_recipe("h36m-srnn"), load_recipe("h36m-erd")
    # Torso, arms and legs of the 21 joints have 15, 12 and 12 numbers. Seven kinds of edges have
    # layers of 256 and 256, the four spatial ones an LSTM of 512; a node hears 256 of its own past,
    # 768 of each of two edges.
    edges = sum((read + 1) * 256 for read in (15, 12, 12, 27, 27, 24, 24)) + 7 * 257 * 256
    cells = 4 * 4 * 512 * (256 + 512 + 1) + 3 * 4 * 512 * (1792 + 512 + 1)
    layers = 3 * (2305 * 256 + 257 * 100) + 101 * (15 + 12 + 12)
    assert edges + cells + layers == 22_811_279
    assert count_parameters(srnn) == 22_811_279
    assert srnn.plan == erd.plan
    for section in ("fps", "corpus", "representation", "codec", "training", "protocol"):
        assert srnn.config[section] == erd.config[section]


def test_the_amass_recipes_differ_in_what_they_compare_only() -> None:
    for base, others in (
        ("amass-rnn", ("pjl", "spl", "spl-sparse", "spl-indep", "spl-random", "spl-reverse")),
        ("amass-seq2seq", ("pjl", "spl", "sampling", "sampling-spl", "dropout", "dropout-spl")),
        ("amass-quaternet", ("spl",)),
        ("h36m-rnn", ("pjl", "spl", "spl-indep", "spl-random", "spl-reverse")),
    ):
        whole = load_recipe(base)
        for name in others:
            recipe = load_recipe(f"{base}-{name}")
            assert recipe.plan == whole.plan
            for section in ("fps", "corpus", "representation", "codec", "protocol"):
                assert recipe.config[section] == whole.config[section]
            assert recipe.config["model"]["backbone"] == whole.config["model"]["backbone"]
            assert (recipe.feed != whole.feed) == name.startswith("sampling")
            assert (recipe.config["model"].get("input_dropout", 0)) == (
                0.1 if "dropout" in name or base.endswith("-rnn") else 0
            )
            structured = recipe.config["model"]["head"]["kind"] == "structured"
            assert structured == ("spl" in name)
            if base != "amass-quaternet":
                per_joint = name.endswith("pjl") or structured
                terms = {"per_joint": 1.0} if per_joint else {"features": 1.0}
                assert recipe.objective.terms == terms


def test_martinez_and_aksan_train_on_even_frames_and_pavllo_and_jain_on_both() -> None:
    even = {
        name
        for name in FILES
        if load_recipe(name).config["corpus"].get("phases") == "even"
        and load_recipe(name).config["corpus"]["kind"] == "h36m"
    }
    assert even == {
        name for name in FILES if name.startswith(("h36m-seq2seq", "h36m-rnn", "h36m-aged"))
    }


def test_the_actions_of_human36m_have_a_name() -> None:
    skeleton = named_skeleton("h36m-32").skeleton
    for name in ("h36m-seq2seq-sampling-sup", "h36m-seq2seq-sampling-sup-spl", "h36m-aged"):
        codec = load_recipe(name).build_codec(skeleton)
        assert (len(codec.actions), codec.actions[0]) == (15, "walking")
        assert codec.feature_dim == 21 * 3 + 15


def test_matrices_are_fed_back_as_they_are_where_aksan_et_al_do() -> None:
    fed = {name for name in FILES if load_recipe(name).config["model"].get("feedback") == "emitted"}
    assert fed == {name for name in FILES if name.startswith(("amass-rnn", "h36m-rnn"))}


def test_the_schedule_of_aksan_et_al() -> None:
    rnn, seq2seq, quaternet = (
        load_recipe(f"amass-{name}").plan for name in ("rnn", "seq2seq", "quaternet")
    )
    assert (rnn.prefix + rnn.horizon, seq2seq.prefix, seq2seq.horizon) == (144, 120, 24)
    assert rnn.rate.at(epoch=99, update=2999) == pytest.approx(0.001 * 0.98**2)
    assert seq2seq.rate.at(epoch=99, update=2999) == pytest.approx(0.001 * 0.95**2)
    assert quaternet.rate.at(epoch=2, update=2999) == pytest.approx(0.001 * 0.96**2)
    for plan in (rnn, seq2seq, quaternet):
        assert (plan.batch, plan.epochs, plan.patience, plan.least_improvement) == (
            *(64, 500, 40, 0.01),
        )


def test_aged_is_the_sequence_to_sequence_network_against_two_discriminators() -> None:
    aged, alone = load_recipe("h36m-aged"), load_recipe("h36m-seq2seq-sampling-sup")
    assert (aged.plan, aged.feed, aged.sampling) == (alone.plan, alone.feed, alone.sampling)
    for section in ("fps", "corpus", "representation", "codec", "model", "protocol"):
        assert aged.config[section] == alone.config[section]
    # Angles are summed over the horizon and the joints of a prediction, and so are actions.
    frames, joints = aged.plan.horizon, len(named_skeleton("h36m-21").skeleton)
    assert aged.objective.terms == {"geodesic": frames * joints, "action": frames * 15}
    assert aged.adversary == Adversary(fidelity=0.6, continuity=0.6, hidden=1024)
    assert load_recipe("h36m-aged-small").adversary == Adversary(0.6, 0.6, hidden=256)
    assert alone.adversary is None
    assert load_recipe("h36m-aged", ["training.adversary=null"]).adversary is None


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("adversary={fidelty: 1.0}", "adversary.fidelty: unknown key; did you mean 'fidelity'?"),
        ("adversary={fidelity: much}", "adversary.fidelity: found 'much', expected a number"),
        ("adversary={fidelity: -1.0}", "adversary: fidelity has weight -1.0; expected more than 0"),
        ("adversary={hidden: 16}", "adversary: an adversary needs a weight for fidelity, for"),
        ("adversary={}", "adversary: an adversary needs a weight for fidelity, for continuity"),
        ("adversary=0.6", "adversary: found 0.6, expected a section of keys"),
    ],
)
def test_a_mistake_in_an_adversary_stops_before_any_data_is_read(
    override: str, message: str
) -> None:
    with pytest.raises(ConfigError) as caught:
        load_recipe("quaternet-vel", [f"training.{override}"])
    assert f"quaternet-vel: training.{message}" in str(caught.value)
    assert "\n" not in str(caught.value)


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


@pytest.mark.parametrize("name", FILES)
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
        ("model.feedback=raw", "model.feedback: found 'raw', expected one of 'valid'"),
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
        ("codec.joints=h36m-22", "codec.joints: no skeleton is called 'h36m-22'"),
        ("codec.joints=[Hips,Tail]", "codec.joints: no joint is called 'Tail'"),
        ("codec.root=displacement", "training.objective: the codec writes 3 root channels"),
        ("codec.actions=[walking]", "codec.actions lists actions that no loss trains"),
        ("codec.actions=h36", "codec.actions: 'h36' is no list of actions; did you mean 'h36m'?"),
        ("codec.actions=[eating,eating]", "codec.actions: 'eating' is there twice"),
        ("training.objective.terms.action=1", "loss 'action' needs actions, but the codec has non"),
        ("model.head={kind: parts}", "model: head: it reads what is said of each part of the body"),
        ("model.head={kind: parts, body: 1}", "model.head.body: unknown key"),
        ("model.backbone.skeleton=h36m-21", "model.backbone.skeleton: unknown key"),
        ("model.backbone={kind: structural_rnn, parts: {torso: [Hip]}}", "did you mean 'Hips'?"),
        ("model.backbone={kind: structural_rnn, parts: {torso: Hips}}", "backbone.parts: found"),
        (
            "model={backbone: {kind: structural_rnn}, projection: 9}",
            "model: projection: the backbone reads joints, which a projection mixes",
        ),
    ],
)
def test_a_mistake_stops_before_any_data_is_read(override: str, message: str) -> None:
    with pytest.raises(ConfigError) as caught:
        load_recipe("quaternet-vel", [override])
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_recipe_may_write_some_joints_only() -> None:
    skeleton = named_skeleton("h36m-32").skeleton
    assert len(load_recipe("quaternet-vel").build_codec(skeleton).written) == 32
    codec = load_recipe("quaternet-vel", ["codec.joints=h36m-21"]).build_codec(skeleton)
    assert codec.written == named_skeleton("h36m-21").skeleton
    assert codec.joints == named_skeleton("h36m-21").joints


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


@pytest.mark.parametrize("name", FILES)
def test_a_recipe_learns_a_tiny_corpus_by_heart(
    name: str, tiny_corpus: Corpus, tmp_path: Path
) -> None:
    recipe = _shrunk(name)
    if recipe.config["model"]["backbone"]["kind"] == "structural_rnn":
        tiny_corpus = _with_legs(tiny_corpus)
    controls = recipe.config["codec"].get("controls")
    if controls is not None:
        tiny_corpus = _walks(controls.get("styles", ()))
    result = train(recipe, tiny_corpus, tmp_path / "run", progress=False)
    assert result.best is not None
    with (tmp_path / "run" / "log.csv").open(newline="") as file:
        losses = [float(row["loss"]) for row in csv.DictReader(file)]
    # Lengths fall by the root of what squares fall by.
    share = 0.6**0.5 if "per_joint" in recipe.objective.terms else 0.6
    assert losses[-1] < share * losses[0]
    if name in EXACT:
        system = load(tmp_path / "run" / "best")
        scores = recipe.protocol.score(system.predictor, tiny_corpus, "test")
        still = recipe.protocol.score(ZeroVelocity(), tiny_corpus, "test")
        assert scores.value("joint_angle", 400) < 0.25 * still.value("joint_angle", 400)


def _with_legs(corpus: Corpus) -> Corpus:
    """The corpus on a body with legs, which do what the arms do."""
    skeleton = Skeleton((*corpus.skeleton.names, "LeftLeg", "RightLeg"), (-1, 0, 1, 1, 0, 0))
    joints = [0, 1, 2, 3, 2, 3]
    clips = [
        replace(
            clip,
            skeleton=skeleton,
            offsets=clip.offsets[joints],
            rotations_local=clip.rotations_local[:, joints],
        )
        for clip in corpus.clips
    ]
    return Corpus(corpus.name, clips, corpus.splits)


def _walks(styles: Sequence[str]) -> Corpus:
    """Two walks of 90 frames, or one of each style, and what their gait is."""
    labels = list(styles) or ["", ""]
    clips = [
        replace(make_clip(index % 2, fps=25.0, seconds=3.6), labels={"style": label})
        for index, label in enumerate(labels)
    ]
    every = tuple(range(len(clips)))
    return with_walks(
        Corpus("walks", clips, dict.fromkeys(("train", "validation", "test"), every)), styles
    )


EXACT = ("quaternet-vel", "quaternet-abs", "quaternet-vel-tf", "quaternet-vel-small")
"""Those that forecast it within a quarter of the error; of the others the loss must fall."""


def _shrunk(name: str) -> Recipe:
    """The recipe with few units, quick decays and the protocol for any corpus; the same code."""
    sampling = "{kind: random_recordings, steps_per_epoch: 15}"
    overrides = [
        "training.prefix=10",
        "training.epochs=12",
        "training.validate_every=12",
        "training.batch=8",
        "training.learning_rate=0.01",
        "training.decay=0.8",
        f"training.sampling={sampling}",
        "protocol={kind: short-term, prefix_ms: 400, metrics: [joint_angle]}",
        "protocol.horizons_ms=[80, 160, 320, 400]",
        "training.select_best_by=null",
        "fps=25",
    ]
    recipe = load_recipe(name)
    overrides.append(f"model.backbone.{_units(recipe)}=32")
    backbone = recipe.config["model"]["backbone"]
    if backbone["kind"] in ("lstm", "structural_rnn"):
        # As in the small forms: without a residual it takes long to learn to repeat a pose.
        overrides += ["model.residual=add", "model.still_start=true"]
        overrides.append(f"model.backbone.{'layers=1' if 'layers' in backbone else 'encoder=16'}")
        overrides += ["training.horizon=10", "training.prefix=5", "training.turn=false"]
        overrides += ["training.clip=1.0"]
    if name.startswith(("amass-", "h36m-")):
        overrides += ["codec.joints=null", "training.patience=null"]
        overrides += ["training.least_improvement=0", "training.decay_every=null"]
        overrides += ["training.decay_at=null", "training.optimizer=adam", "training.skip_start=0"]
        if "noise_at" in recipe.config["training"]:
            overrides.append("training.noise_at=[[20, 0.01], [50, 0.02]]")
        if recipe.adversary is not None:
            overrides.append("training.adversary.hidden=16")
        if recipe.config["training"]["prefix"] == 1:
            overrides += ["training.prefix=5", "training.horizon=10"]
        if recipe.config["model"].get("projection") is not None:
            overrides.append("model.projection=24")
        if recipe.config["model"]["head"].get("hidden") is not None:
            overrides.append("model.head.hidden=24")
    if recipe.config["codec"].get("actions") is not None:
        overrides.append("codec.actions=[swing]")
    if "decay" in recipe.config["training"]["feed"]:
        overrides.append("training.feed.decay=0.6")
    return load_recipe(name, overrides)
