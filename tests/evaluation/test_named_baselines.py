"""Baselines by name: which are in a table, and what they are made from."""

from __future__ import annotations

from dataclasses import replace

import pytest

from posecast.cli.scoring import score_systems
from posecast.corpora.synthetic import make_clip as make_walk
from posecast.errors import ConfigError
from posecast.evaluation import baseline_scores, build_protocol, make_baseline
from posecast.io import write_clip
from posecast.model import MeanPose
from posecast.motion.corpus import Corpus


def test_a_mean_pose_is_in_the_table_only_where_there_are_training_clips(make_clip):
    clips = [make_clip(100, seed, action="walk") for seed in (1, 2)]
    protocol = replace(
        build_protocol("short-term", stride=40, prefix_ms=400), baselines=("mean-pose",)
    )
    (scores,) = baseline_scores(protocol, Corpus("toy", clips, {"train": (0,), "test": (1,)}))
    assert scores.system == "mean-pose"
    expected = protocol.score(
        MeanPose.of(clips[:1]), Corpus("toy", clips, {"test": (1,)}), system="mean-pose"
    )
    assert scores.rows == expected.rows
    for splits in ({"test": (1,)}, {"train": (), "test": (1,)}):
        without = Corpus("toy", clips, splits)
        assert baseline_scores(protocol, without) == ()
        with pytest.raises(ConfigError, match="no clips in split 'train' to take a mean pose of"):
            make_baseline("mean-pose", without)


def test_an_unknown_baseline_is_refused(make_clip):
    with pytest.raises(ConfigError, match="unknown baseline 'mean-pos'; did you mean 'mean-pose'"):
        replace(build_protocol("short-term"), baselines=("mean-pos",))
    with pytest.raises(ConfigError, match="unknown baseline 'mean'"):
        make_baseline("mean", Corpus("toy", [make_clip(9, 1)], {"train": (0,)}))


@pytest.mark.parametrize(
    ("protocol", "windows", "system"),
    [("cross-skeleton", 8, "zero-velocity"), ("short-term", 2, "mean-pose")],
)
def test_a_baseline_is_scored_at_a_rate_that_the_protocol_falls_on(
    protocol, windows, system, tmp_path
):
    for index in range(10):
        write_clip(make_walk(index, fps=150.0, seconds=3.0), tmp_path / f"{index}.bvh")
    report = score_systems(
        [system], corpus="folder", root=tmp_path, protocol=protocol, split="test"
    )
    # One clip of 3 s: 90 frames at 30 per second for windows of 40, 75 at 25 for windows of 60.
    assert report.lines[0].windows == windows
    assert report.system == system
