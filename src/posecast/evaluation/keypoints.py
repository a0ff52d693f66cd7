"""The share of correct joints over the threshold, as a curve."""

from __future__ import annotations

import torch

from posecast.errors import ConfigError
from posecast.evaluation.prediction import Predictor, run_predictor
from posecast.evaluation.protocol import Protocol
from posecast.evaluation.scores import Milliseconds
from posecast.evaluation.until_metrics import THRESHOLDS, correct_keypoints, distances_in_thighs
from posecast.motion.corpus import Corpus


def keypoint_curve(
    predictor: Predictor,
    protocol: Protocol,
    corpus: Corpus,
    *,
    horizon_ms: Milliseconds,
    split: str = "test",
    batch: int = 256,
) -> tuple[tuple[float, float], ...]:
    """(threshold in thighs, share of joints within it), mean over windows and frames until a time.

    Args:
        predictor: given prefixes in float64.
        protocol: which windows, which joints; windows of all actions count alike.
        corpus: where the windows are.
        horizon_ms: one of the protocol's.
        split: which clips.
        batch: windows a call of ``predict``.

    Raises:
        ConfigError: not a horizon of the protocol, or bones without length.

    Source: Aksan et al. 2019, Figures 4 and 8.
    """
    if horizon_ms not in protocol.horizons_ms:
        raise ConfigError(
            f"{horizon_ms:g} ms is no horizon of protocol {protocol.name!r}, which has "
            f"{', '.join(f'{each:g}' for each in protocol.horizons_ms)} ms"
        )
    frames = protocol.frames(corpus.fps)
    until = frames.horizons[protocol.horizons_ms.index(horizon_ms)]
    counting = protocol.counting(corpus)
    shares: list[torch.Tensor] = []
    for group in protocol.windows(corpus, split).groups:
        predicted, target, scene = run_predictor(
            predictor, corpus, group.windows, frames, counting=counting, batch=batch
        )
        distances = distances_in_thighs(predicted, target, scene)[:, :until]
        shares.append(correct_keypoints(distances).mean(1))
    mean = torch.cat(shares).mean(0).tolist()
    return tuple(zip(THRESHOLDS, mean, strict=True))
