"""Topology and kinematics of skeletons."""

from posecast.skeleton.kinematics import (
    World,
    forward_kinematics,
    joint_positions,
    local_to_root,
    root_to_local,
)
from posecast.skeleton.skeleton import Skeleton

__all__ = [
    "Skeleton",
    "World",
    "forward_kinematics",
    "joint_positions",
    "local_to_root",
    "root_to_local",
]
