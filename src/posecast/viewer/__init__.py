"""Pictures and moving pictures of clips, without a display."""

from posecast.viewer.figure import draw

__all__ = ["draw"]
