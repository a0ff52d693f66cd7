"""Walking along paths: a pace for a path, and poses along it, frame by frame."""

from posecast.generation.annotate import arriving, pace_by_hand
from posecast.generation.course import Course, timed
from posecast.generation.gait_table import GaitTable, measure_gait
from posecast.generation.walk import Pose, Walk, walked_clip

__all__ = [
    "Course",
    "GaitTable",
    "Pose",
    "Walk",
    "arriving",
    "measure_gait",
    "pace_by_hand",
    "timed",
    "walked_clip",
]
