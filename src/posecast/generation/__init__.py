"""Walking along paths: a pace for a path, and poses along it, frame by frame."""

from posecast.generation.annotate import arriving, pace_by_hand
from posecast.generation.course import Course, timed
from posecast.generation.courses import eight_courses, eight_paths
from posecast.generation.gait_table import GaitTable, measure_gait
from posecast.generation.match_features import Weights
from posecast.generation.matched_walk import MatchedWalk
from posecast.generation.matching import MotionMatcher
from posecast.generation.walk import Pose, Walk, Walker, walked_clip

__all__ = [
    "Course",
    "GaitTable",
    "MatchedWalk",
    "MotionMatcher",
    "Pose",
    "Walk",
    "Walker",
    "Weights",
    "arriving",
    "eight_courses",
    "eight_paths",
    "measure_gait",
    "pace_by_hand",
    "timed",
    "walked_clip",
]
