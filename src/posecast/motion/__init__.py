"""The canonical clip and what can be done to it."""

from posecast.motion.clip import Clip, Motion
from posecast.motion.corpus import Corpus, Window, Windows
from posecast.motion.feet import Feet, find_feet, leg_length
from posecast.motion.gait import Gait, analyse_gait, integrated_offset, with_gait
from posecast.motion.path import Path
from posecast.motion.path_scale import PathScale, path_scale
from posecast.motion.pinning import Pinned, PinReport, pin_feet
from posecast.motion.places import Place
from posecast.motion.proportions import body_parts, reproportion, scale_body
from posecast.motion.pruning import drop_joints
from posecast.motion.store import Store, pack
from posecast.motion.transforms import mirror, resample, turn, unroll
from posecast.motion.walked_path import path_of
from posecast.motion.waypoints import WayPoints

__all__ = [
    "Clip",
    "Corpus",
    "Feet",
    "Gait",
    "Motion",
    "Path",
    "PathScale",
    "PinReport",
    "Pinned",
    "Place",
    "Store",
    "WayPoints",
    "Window",
    "Windows",
    "analyse_gait",
    "body_parts",
    "drop_joints",
    "find_feet",
    "integrated_offset",
    "leg_length",
    "mirror",
    "pack",
    "path_of",
    "path_scale",
    "pin_feet",
    "reproportion",
    "resample",
    "scale_body",
    "turn",
    "unroll",
    "with_gait",
]
