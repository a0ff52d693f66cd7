"""Measuring a predictor on groups of windows."""

from __future__ import annotations

from collections.abc import Sequence

from torch import Tensor

from posecast.errors import ConfigError
from posecast.evaluation.metric import EVERY_JOINT, Counting
from posecast.evaluation.metrics import METRICS
from posecast.evaluation.prediction import Predictor, Replayer, run_predictor
from posecast.evaluation.times import Frames
from posecast.evaluation.windows import Group
from posecast.motion.corpus import Corpus


def measure(
    predictor: Predictor,
    corpus: Corpus,
    groups: Sequence[Group],
    frames: Frames,
    metrics: Sequence[str],
    *,
    counting: Counting = EVERY_JOINT,
    batch: int = 256,
) -> dict[tuple[str, str], Tensor]:
    """All metrics of all windows: (group, metric) -> values (windows, horizons), float64.

    The predictor is asked for the frames of the prefix only where a metric looks at them.

    Args:
        predictor: given prefixes in float64; what it returns may have any precision.
        corpus: where the windows are.
        groups: windows; a metric is shown all those of a group at once.
        frames: of the prefix and the horizons.
        metrics: names in ``METRICS``.
        counting: which joints they look at.
        batch: windows a call of ``predict``.

    Raises:
        ConfigError: what it returns is not what was asked for, or it has no ``replay`` that a
            metric needs.
    """
    replaying = [metric for metric in metrics if "replayed" in METRICS[metric].asks]
    if replaying and not isinstance(predictor, Replayer):
        raise ConfigError(
            f"{type(predictor).__name__} has no replay(prefix), which gives what was expected of "
            f"the prefix's frames; leave out the metrics {', '.join(replaying)}"
        )
    values: dict[tuple[str, str], Tensor] = {}
    for group in groups:
        predicted, target, scene = run_predictor(
            predictor,
            corpus,
            group.windows,
            frames,
            replay=bool(replaying),
            counting=counting,
            batch=batch,
        )
        for name in metrics:
            values[group.name, name] = METRICS[name].values(
                predicted, target, scene, frames.horizons
            )
    return values
