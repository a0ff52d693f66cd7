"""Topology and kinematics of skeletons."""

from posecast.skeleton.body_kinematics import BodyKinematics
from posecast.skeleton.catalog import NamedSkeleton, named_skeleton, skeleton_names
from posecast.skeleton.dual_kinematics import (
    LocalMotion,
    local_to_root_dual,
    local_to_root_matrix,
    root_to_local_dual,
    root_to_local_matrix,
    root_to_local_motion,
)
from posecast.skeleton.kinematics import (
    World,
    forward_kinematics,
    joint_positions,
    local_to_root,
    root_to_local,
)
from posecast.skeleton.rotation_fit import fit_rotations
from posecast.skeleton.skeleton import Skeleton

__all__ = [
    "BodyKinematics",
    "LocalMotion",
    "NamedSkeleton",
    "Skeleton",
    "World",
    "fit_rotations",
    "forward_kinematics",
    "joint_positions",
    "local_to_root",
    "local_to_root_dual",
    "local_to_root_matrix",
    "named_skeleton",
    "root_to_local",
    "root_to_local_dual",
    "root_to_local_matrix",
    "root_to_local_motion",
    "skeleton_names",
]
