"""All metrics by name."""

from __future__ import annotations

from posecast.evaluation.metric import Metric
from posecast.evaluation.motion_metrics import MOTION_METRICS
from posecast.evaluation.pose_metrics import POSE_METRICS
from posecast.evaluation.until_metrics import UNTIL_METRICS

METRICS: dict[str, Metric] = {
    metric.name: metric for metric in (*POSE_METRICS, *UNTIL_METRICS, *MOTION_METRICS)
}
