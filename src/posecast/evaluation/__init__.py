"""Protocols, metrics and reports: how predictors are compared."""

from posecast.evaluation.metric import FrameMetric, Metric, Scene
from posecast.evaluation.metrics import METRICS
from posecast.evaluation.prediction import Predictor
from posecast.evaluation.protocol import PROTOCOLS, Protocol, build_protocol
from posecast.evaluation.published import Published, find_published, published_tables
from posecast.evaluation.report import (
    BASELINE_NAMES,
    BASELINES,
    Report,
    baseline_scores,
    bootstrap,
    evaluate,
    make_baseline,
)
from posecast.evaluation.scores import AVERAGE, Row, Scores

__all__ = [
    "AVERAGE",
    "BASELINES",
    "BASELINE_NAMES",
    "METRICS",
    "PROTOCOLS",
    "FrameMetric",
    "Metric",
    "Predictor",
    "Protocol",
    "Published",
    "Report",
    "Row",
    "Scene",
    "Scores",
    "baseline_scores",
    "bootstrap",
    "build_protocol",
    "evaluate",
    "find_published",
    "make_baseline",
    "published_tables",
]
