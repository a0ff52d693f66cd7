"""Protocols, metrics and reports: how predictors are compared."""

from posecast.evaluation.metrics import METRICS, FrameMetric, Metric, Scene
from posecast.evaluation.prediction import Predictor
from posecast.evaluation.protocol import PROTOCOLS, Protocol, build_protocol
from posecast.evaluation.published import Published, find_published, published_tables
from posecast.evaluation.report import BASELINES, Report, bootstrap, evaluate
from posecast.evaluation.scores import AVERAGE, Row, Scores

__all__ = [
    "AVERAGE",
    "BASELINES",
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
    "bootstrap",
    "build_protocol",
    "evaluate",
    "find_published",
    "published_tables",
]
