"""Topology and kinematics of skeletons."""

from posecast.skeleton.catalog import NamedSkeleton, named_skeleton, skeleton_names
from posecast.skeleton.kinematics import (
    World,
    forward_kinematics,
    joint_positions,
    local_to_root,
    root_to_local,
)
from posecast.skeleton.skeleton import Skeleton

__all__ = [
    "NamedSkeleton",
    "Skeleton",
    "World",
    "forward_kinematics",
    "joint_positions",
    "local_to_root",
    "named_skeleton",
    "root_to_local",
    "skeleton_names",
]
