"""How finely a path is drawn, as multiples of the leg of whoever walks it.

QuaterNet's published constants are in units of 5.644 cm and tuned to one body. Its legs, hip to
ankle, are 14.65 units long: as multiples of that length the constants suit a child, and a file in
any unit. Source: Pavllo et al. 2019, section 3.7, and the code released with it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from posecast.errors import ConfigError

UNIT = 0.05644
"""Metres in a unit of that body's files."""

LEG = math.hypot(2.44811, 6.72613) + math.hypot(2.56220, 7.03959)
"""Units: that body's left thigh and shank."""

ADULT_LEG = LEG * UNIT
"""Metres, 0.83: whose path it is where nobody is named."""


class PathScale(NamedTuple):
    """What depends on the size of the body that walks a path.

    Args:
        spacing: between points of the path, metres. Published: 0.2 units.
        smoothing: sigma, in metres, of the Gaussian for tangent, curvature and scalar tracks.
            Published: 5 points, 1 unit.
        least_speed: m/s; a path is never walked more slowly. Published: 0.1 units a frame of 1/30
            of a second.
    """

    spacing: float
    smoothing: float
    least_speed: float


def path_scale(leg_length: float = ADULT_LEG) -> PathScale:
    """The published constants for a body.

    Args:
        leg_length: hip to ankle along the bones, metres.

    Raises:
        ConfigError: it is not a positive number.
    """
    if not 0 < leg_length < math.inf:
        raise ConfigError(f"leg_length is {leg_length}: expected a positive number of metres")
    unit = leg_length / LEG
    return PathScale(spacing=0.2 * unit, smoothing=unit, least_speed=0.1 * 30 * unit)


SPACING, SMOOTHING, _ = path_scale()
"""An adult's, metres: 0.0113 and 0.0564."""
