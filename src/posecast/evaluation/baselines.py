"""Baselines by name: the rows that tables begin with."""

from __future__ import annotations

from collections.abc import Mapping

from posecast.config import did_you_mean
from posecast.errors import ConfigError
from posecast.evaluation.prediction import Predictor
from posecast.model.baselines import MeanPose, RunningAverage, ZeroVelocity
from posecast.motion.corpus import Corpus

BASELINES: Mapping[str, Predictor] = {
    "zero-velocity": ZeroVelocity(),
    "running-average-2": RunningAverage(2),
    "running-average-4": RunningAverage(4),
}
"""Baselines that know no corpus."""

MEAN_POSE = "mean-pose"
BASELINE_NAMES = (*BASELINES, MEAN_POSE)


def has_training_clips(corpus: Corpus) -> bool:
    """Whether there is something to take a mean pose of."""
    return bool(corpus.splits.get("train"))


def make_baseline(name: str, corpus: Corpus) -> Predictor:
    """A baseline by name; ``mean-pose`` is taken from the split ``train``.

    Raises:
        ConfigError: no baseline has this name, or there are no training clips for the mean.
    """
    if name in BASELINES:
        return BASELINES[name]
    if name != MEAN_POSE:
        raise ConfigError(f"unknown baseline {name!r}; {did_you_mean(name, BASELINE_NAMES)}")
    if not has_training_clips(corpus):
        raise ConfigError(
            f"corpus {corpus.name!r} has no clips in split 'train' to take a mean pose of; choose "
            f"another baseline ({', '.join(BASELINES)}) or give it such a split"
        )
    return MeanPose.of(corpus.clips[index] for index in corpus.indices("train"))
