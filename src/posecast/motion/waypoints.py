"""WayPoints, what somebody asks for along a path: where to pass, when, how fast, facing where."""

from __future__ import annotations

from os import PathLike
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from posecast.motion.curve import Curve, lay
from posecast.motion.path import Path
from posecast.motion.path_checks import check_size
from posecast.motion.path_scale import SMOOTHING, SPACING
from posecast.motion.tracks import FACING, SPEED


class WayPoints(NamedTuple):
    """Way points in their order; NaN where nothing is asked, ``None`` where nowhere.

    Args:
        points: (x, z), metres.
        times: when to be there, seconds, rising.
        facing: where the body faces there, unit vectors (x, z).
        speed: how fast to be there, m/s.
        closed: whether the last is joined to the first.
        straight: whether they are joined by straight lines, not by a smooth curve.
        curve: the curve that joins them, where it is drawn, as in an SVG; its knots are they.
    """

    points: Float[Tensor, "waypoints 2"]
    times: Float[Tensor, " waypoints"] | None = None
    facing: Float[Tensor, "waypoints 2"] | None = None
    speed: Float[Tensor, " waypoints"] | None = None
    closed: bool = False
    straight: bool = False
    curve: Curve | None = None

    def path(
        self,
        *,
        spacing: float = SPACING,
        smoothing: float = SMOOTHING,
        name: str | PathLike[str] = "path",
    ) -> Path:
        """Draw the path; its ``marks`` belong to the way points, and so to their ``times``.

        It has the tracks ``speed`` and ``facing`` where these are asked for somewhere: linear, or
        turning evenly, from each way point that has one to the next.

        Args:
            spacing, smoothing, name: see ``Path.through``.

        Raises:
            DataError, ConfigError: see ``Path.through``.
        """
        if self.curve is None:
            path = Path.through(
                self.points,
                closed=self.closed,
                straight=self.straight,
                spacing=spacing,
                smoothing=smoothing,
                name=name,
            )
        else:
            check_size(name, self.curve.length, spacing)
            laid = lay(self.curve, spacing=spacing, closed=self.closed)
            path = Path(*laid, closed=self.closed, smoothing=smoothing)
        if self.speed is not None and (asked := torch.isfinite(self.speed)).any():
            path = path.with_scalar(SPEED, self.speed[asked], at=path.marks[asked])
        if self.facing is not None and (asked := torch.isfinite(self.facing[:, 0])).any():
            path = path.with_direction(FACING, self.facing[asked], at=path.marks[asked])
        return path
