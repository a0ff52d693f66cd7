"""Protocols, metrics and reports: how predictors are compared."""

from posecast.evaluation.baselines import BASELINE_NAMES, BASELINES, make_baseline
from posecast.evaluation.bootstrap import bootstrap
from posecast.evaluation.freeze import FreezeDetector, Liveliness
from posecast.evaluation.keypoints import keypoint_curve
from posecast.evaluation.metric import FrameMetric, Metric, Scene
from posecast.evaluation.metrics import METRICS
from posecast.evaluation.motion_metrics import joint_jitter
from posecast.evaluation.npss import npss
from posecast.evaluation.prediction import Predictor, Replayer
from posecast.evaluation.protocol import Protocol
from posecast.evaluation.protocols import PROTOCOLS, build_protocol
from posecast.evaluation.published import Published, find_published, published_tables
from posecast.evaluation.report import Report, baseline_scores, evaluate
from posecast.evaluation.scores import AVERAGE, Row, Scores
from posecast.evaluation.steadiness import Steadiness, steadiness
from posecast.evaluation.walk_report import WalkReport, WalkRow, score_walker
from posecast.evaluation.walks import WalkScores, reference_of, score_walk

__all__ = [
    "AVERAGE",
    "BASELINES",
    "BASELINE_NAMES",
    "METRICS",
    "PROTOCOLS",
    "FrameMetric",
    "FreezeDetector",
    "Liveliness",
    "Metric",
    "Predictor",
    "Protocol",
    "Published",
    "Replayer",
    "Report",
    "Row",
    "Scene",
    "Scores",
    "Steadiness",
    "WalkReport",
    "WalkRow",
    "WalkScores",
    "baseline_scores",
    "bootstrap",
    "build_protocol",
    "evaluate",
    "find_published",
    "joint_jitter",
    "keypoint_curve",
    "make_baseline",
    "npss",
    "published_tables",
    "reference_of",
    "score_walk",
    "score_walker",
    "steadiness",
]
