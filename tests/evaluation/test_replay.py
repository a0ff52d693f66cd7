"""What a predictor expected of the prefix: asked for where a metric needs it, and checked."""

from __future__ import annotations

import pytest
import torch

from posecast.errors import ConfigError
from posecast.evaluation import METRICS, build_protocol
from posecast.evaluation.prediction import run_predictor
from posecast.model import ZeroVelocity
from posecast.motion import Motion
from posecast.motion.corpus import Corpus


class Silent:
    """Repeats the last pose and says nothing of the prefix."""

    def predict(self, prefix: Motion, horizon: int) -> Motion:
        return ZeroVelocity().predict(prefix, horizon)


@pytest.fixture
def corpus(make_h36m) -> Corpus:
    return make_h36m(("walking", "eating"))


def test_frames_of_the_prefix_need_a_predictor_that_replays(corpus):
    metrics = ["position", "npss_with_prefix", "euclidean_with_prefix_cm"]
    protocol = build_protocol("short-term", metrics=metrics, stride=40)
    named = r"Silent has no replay\(prefix\).* npss_with_prefix, euclidean_with_prefix_cm$"
    with pytest.raises(ConfigError, match=named):
        protocol.score(Silent(), corpus)
    protocol.score(ZeroVelocity(), corpus)


def test_a_predictor_is_asked_to_replay_only_where_a_metric_needs_it(corpus):
    class Counting(ZeroVelocity):
        def replay(self, prefix: Motion) -> Motion:
            replayed.append(len(prefix.root_positions))
            return super().replay(prefix)

    replayed: list[int] = []
    build_protocol("short-term", metrics=["npss"], stride=40).score(Counting(), corpus)
    assert replayed == []
    protocol = build_protocol("short-term", metrics=["npss_with_prefix"], stride=40)
    protocol.score(Counting(), corpus, batch=7)
    assert len(replayed) > 2
    assert max(replayed) == 7


def test_a_replay_of_the_wrong_length_is_refused(corpus):
    class Whole(ZeroVelocity):
        def replay(self, prefix: Motion) -> Motion:
            return prefix

    protocol = build_protocol("short-term", metrics=["npss_with_prefix"], stride=40)
    with pytest.raises(ConfigError, match=r"Whole.replay returned rotations_local of shape"):
        protocol.score(Whole(), corpus)


def test_values_with_the_prefix_are_those_of_one_longer_prediction(corpus):
    metrics = ["npss_with_prefix", "euclidean_with_prefix_cm", "npss", "euclidean_cm"]
    protocol = build_protocol("short-term", metrics=metrics, prefix_ms=400, stride=40)
    sampling = protocol.windows(corpus)
    windows = sampling.groups[0].windows
    outcome = run_predictor(ZeroVelocity(), corpus, windows, protocol.frames(25.0), replay=True)
    longer = Motion.join_frames([outcome.scene.replayed, outcome.predicted])
    truth = Motion.join_frames([outcome.scene.prefix.cut(1), outcome.target])
    assert longer.root_positions.shape[1] == 9 + 10
    for name in ("npss", "euclidean"):
        with_prefix = f"{name}_with_prefix" + ("" if name == "npss" else "_cm")
        alone = name if name == "npss" else "euclidean_cm"
        found = METRICS[with_prefix].values(
            outcome.predicted, outcome.target, outcome.scene, [2, 10]
        )
        expected = METRICS[alone].values(longer, truth, outcome.scene, [9 + 2, 9 + 10])
        torch.testing.assert_close(found, expected)
