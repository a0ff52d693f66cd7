"""posecast: modelling human motion. See ``posecast --help`` and the README."""

__version__ = "0.1.0.dev0"
