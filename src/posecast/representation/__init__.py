"""How a pose is written as numbers, and those numbers for a network."""

from __future__ import annotations

import inspect
from collections.abc import Callable

from posecast.errors import ConfigError
from posecast.representation.base import Representation
from posecast.representation.codec import Codec, Parts, Statistics
from posecast.representation.rotations import Quaternion
from posecast.skeleton import Skeleton

REPRESENTATIONS: dict[str, Callable[..., Representation]] = {"quaternion": Quaternion}


def build_representation(kind: str, skeleton: Skeleton, **options: object) -> Representation:
    """A representation by name; those that depend on the skeleton are given it.

    Raises:
        ConfigError: there is no such representation; the message lists those there are.
    """
    if kind not in REPRESENTATIONS:
        raise ConfigError(
            f"representation {kind!r} is not known; choose among: {', '.join(REPRESENTATIONS)}"
        )
    make = REPRESENTATIONS[kind]
    if "skeleton" in inspect.signature(make).parameters:
        options = {"skeleton": skeleton, **options}
    return make(**options)


__all__ = [
    "REPRESENTATIONS",
    "Codec",
    "Parts",
    "Quaternion",
    "Representation",
    "Statistics",
    "build_representation",
]
