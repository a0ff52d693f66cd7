"""Topology and kinematics of skeletons."""

from posecast.skeleton.skeleton import Skeleton

__all__ = ["Skeleton"]
