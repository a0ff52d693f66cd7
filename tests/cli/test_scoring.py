"""What may be scored together, and on which corpus."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from posecast.cli.scoring import score_systems
from posecast.corpora.synthetic import make_clip, synthetic
from posecast.errors import ConfigError, SkeletonError
from posecast.io import write_clip
from posecast.recipe import load_recipe
from posecast.skeleton import Skeleton
from posecast.system import train

SHORT = (
    "model.backbone.hidden=16",
    "training.epochs=1",
    "training.batch=4",
    "training.sampling.steps_per_epoch=1",
    "protocol.prefix_ms=400",
)


@pytest.fixture(scope="module")
def make_run(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., str]:
    """Train the small model for a moment, with overrides; the folder of its checkpoint."""
    corpus = synthetic(fps=25, clips=24, seconds=4.0)

    def make(*overrides: str) -> str:
        folder = tmp_path_factory.mktemp("run")
        train(load_recipe("quaternet-vel-small", (*SHORT, *overrides)), corpus, folder)
        return str(folder / "last")

    return make


@pytest.fixture(scope="module")
def run(make_run: Callable[..., str]) -> str:
    """One run."""
    return make_run()


def walks(folder: Path, rename: Callable[[str], str]) -> Path:
    """Ten walks as BVH, their joints renamed."""
    folder.mkdir()
    for index in range(10):
        clip = make_clip(index, fps=25.0, seconds=3.0)
        names = tuple(map(rename, clip.skeleton.names))
        renamed = replace(clip, skeleton=Skeleton(names, clip.skeleton.parents))
        write_clip(renamed, folder / f"{index}.bvh")
    return folder


def test_seeds_of_one_system_are_scored_together(run: str, make_run: Callable[..., str]) -> None:
    other = make_run("training.seed=1", "training.validate_every=1")
    report = score_systems(
        [run, other], corpus="synthetic", root=None, protocol="short-term", split="test"
    )
    assert len(report.runs) == 2


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ("model.residual=add", "model.residual is 'add', there 'compose'"),
        ("training.learning_rate=0.01", "training.learning_rate is 0.01, there 0.001"),
    ],
)
def test_other_systems_are_no_runs_of_the_first(
    run: str, make_run: Callable[..., str], changed: str, message: str
) -> None:
    with pytest.raises(ConfigError, match=re.escape(message)):
        score_systems([run, make_run(changed)], corpus=None, root=None, protocol=None, split="test")


def test_predictions_are_read_in_one_of_two_ways(run: str) -> None:
    with pytest.raises(ConfigError, match=r"'emited' is not known; choose valid or emitted"):
        score_systems(
            [run, "model.feedback=emited"], corpus=None, root=None, protocol=None, split="test"
        )


def test_one_run_is_not_two(run: str) -> None:
    with pytest.raises(ConfigError, match=r"are of one run, or of two with one seed \(0\)"):
        score_systems([run, run], corpus=None, root=None, protocol=None, split="test")


def test_a_system_is_scored_on_its_own_joints_only(run: str, tmp_path: Path) -> None:
    mine = walks(tmp_path / "mine", str)
    assert score_systems([run], corpus="folder", root=mine, protocol=None, split="test").runs
    theirs = walks(tmp_path / "theirs", str.upper)
    with pytest.raises(SkeletonError, match=r"lacks .*Hips.*has besides .*HIPS"):
        score_systems([run], corpus="folder", root=theirs, protocol=None, split="test")


def test_options_of_corpus_and_protocol_may_be_given(run: str) -> None:
    changes = ["protocol.horizons_ms=[400]", "protocol.joints=[Head]", "corpus.clips=24"]
    changes += ["protocol.metrics=[joint_angle_sum]", "corpus.seconds=4.0"]
    for name in (run, "zero-velocity"):
        report = score_systems(
            [name, *changes], corpus="synthetic", root=None, protocol=None, split="test"
        )
        scores = report.runs[0]
        assert (scores.horizons_ms, scores.metrics) == ((400,), ("joint_angle_sum",))
        assert len(scores.joints_left_out["joint_angle_sum"]) > 10


def test_how_predictions_are_read_again_may_be_given(make_run: Callable[..., str]) -> None:
    # Rotation matrices that a network put out are none until they are projected.
    run = make_run(
        "representation.kind=matrix",
        "model.residual=add",
        "training.objective.terms={features: 1.0, euler: null, penalty: null, root: null}",
        "training.objective.order=zyx",
    )
    found = {
        option: score_systems(
            [run, *option], corpus=None, root=None, protocol="short-term", split="test"
        )
        .runs[0]
        .value("euler", 400)
        for option in ((), ("model.feedback=valid",), ("model.feedback=emitted",))
    }
    own, valid, emitted = found.values()
    assert own == valid
    assert abs(emitted - valid) > 1e-4


def test_the_amass_metrics_are_for_any_skeleton() -> None:
    protocol = "amass-spl"
    with pytest.raises(ConfigError, match="set joints to null for all but the root"):
        score_systems(
            ["zero-velocity"], corpus="synthetic", root=None, protocol=protocol, split="test"
        )
    report = score_systems(
        ["zero-velocity", "protocol.joints=null"],
        corpus="synthetic",
        root=None,
        protocol=protocol,
        split="test",
    )
    assert report.runs[0].value("joint_angle_sum", 400, "all") > 0.1


@pytest.mark.parametrize(
    ("option", "message"),
    [
        ("training.epochs=3", "training: scoring has options of corpus and protocol, such as"),
        ("protocol=h36m-128", "protocol: scoring has options of corpus and protocol, such as"),
        ("protocol.kind=h36m-128", "protocol.kind: give it as --protocol"),
        ("protocol.jonts=null", "protocol.jonts: unknown key; did you mean 'joints'?"),
        ("corpus.cilps=3", "did you mean 'clips'?"),
        ("model.residual=add", "and model.feedback alone"),
        ("model.feedback=emitted", "zero-velocity reads no predictions; leave it out"),
    ],
)
def test_options_of_something_else_are_refused(option: str, message: str) -> None:
    with pytest.raises(ConfigError, match=re.escape(message)):
        score_systems(
            ["zero-velocity", option], corpus="synthetic", root=None, protocol=None, split="test"
        )
