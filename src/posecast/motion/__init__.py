"""The canonical clip and what can be done to it."""

from posecast.motion.clip import Clip, Motion

__all__ = ["Clip", "Motion"]
