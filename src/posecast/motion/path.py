"""Path, a curve on the floor by arc length: tangent, curvature, named tracks along it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from os import PathLike

import torch
from jaxtyping import Float
from torch import Tensor

from posecast.config import did_you_mean
from posecast.errors import ConfigError
from posecast.motion.bending import Bending, bending
from posecast.motion.curve import draw_curve, draw_track, lay, lead_on
from posecast.motion.nearest import nearest_places
from posecast.motion.path_checks import check_finite, check_size, check_track
from posecast.motion.path_scale import SMOOTHING, SPACING
from posecast.motion.path_tracks import held, spread_directions, spread_numbers
from posecast.motion.places import Between, Place, bearing, between_points, heading
from posecast.motion.smoothing import smooth


@dataclass(frozen=True, eq=False)
class Path:
    """A curve on the floor in equal segments of arc length, metres, float64. It may cross itself.

    See ``path_of`` for that of a clip, ``posecast.io.read_path`` for that in a file.

    Args:
        points: (x, z), neighbours ``spacing`` apart along the curve.
        spacing: arc length from point to point.
        marks: arc length of each way point that the curve was drawn through.
        closed: whether the last point is joined to the first, which is not repeated.
        scalars: tracks of one number a point, such as ``speed`` (m/s) or ``step_rate`` (radians of
            the walk cycle's phase a second).
        directions: tracks of one unit vector (x, z) a point, such as ``facing``.
        smoothing: sigma of the Gaussian through which points go before tangents and curvatures are
            taken of them. Positions are not smoothed.
    """

    points: Float[Tensor, "points 2"]
    spacing: float
    marks: Float[Tensor, " marks"] = field(default_factory=lambda: torch.zeros(0).double())
    closed: bool = False
    scalars: Mapping[str, Float[Tensor, " points"]] = field(default_factory=dict)
    directions: Mapping[str, Float[Tensor, "points 2"]] = field(default_factory=dict)
    smoothing: float = SMOOTHING

    def __post_init__(self) -> None:
        check_finite("path", self.points, kind="point")
        check_size("path", self.length, self.spacing)
        if not 0 <= self.smoothing < math.inf:
            raise ConfigError(f"smoothing is {self.smoothing}: expected 0 metres or more")
        for name, values in {**self.scalars, **self.directions}.items():
            check_track(name, values, expected=len(self.points))

    @classmethod
    def through(
        cls,
        waypoints: Float[Tensor, "waypoints 2"],
        *,
        closed: bool = False,
        straight: bool = False,
        spacing: float = SPACING,
        smoothing: float = SMOOTHING,
        name: str | PathLike[str] = "path",
    ) -> Path:
        """Draw a path through way points.

        Args:
            waypoints: (x, z), metres; neighbours must differ.
            closed: join the last to the first, which must not be repeated.
            straight: join them by straight lines, not by a smooth curve (``smooth_curve``).
            spacing: arc length from point to point, at most: a whole number of segments must fit.
            smoothing: see the class.
            name: what errors call the path, such as its file.

        Raises:
            DataError: fewer than two way points (three if closed), two equal ones in a row, one
                that is not finite, or a path too long for its spacing.
            ConfigError: a spacing that is not positive, a smoothing that is negative.
        """
        curve = draw_curve(name, waypoints, closed=closed, straight=straight, spacing=spacing)
        laid = lay(curve, spacing=spacing, closed=closed)
        return cls(*laid, closed=closed, smoothing=smoothing)

    @classmethod
    def along(
        cls,
        positions: Float[Tensor, "frames 2"],
        *,
        closed: bool = False,
        spacing: float = SPACING,
        smoothing: float = SMOOTHING,
        name: str | PathLike[str] = "path",
    ) -> Path:
        """Draw a path along a recorded track; its ``marks`` are the arc lengths of the frames.

        Args:
            positions: (x, z), metres, joined by straight lines. Equal ones in a row are somebody
                who stands still.
            closed, spacing, smoothing, name: see ``through``.

        Raises:
            DataError: a track that never moves, a position that is not finite, or a path too long
                for its spacing.
            ConfigError: see ``through``.
        """
        curve = draw_track(name, positions, closed=closed, spacing=spacing)
        laid = lay(curve, spacing=spacing, closed=closed)
        return cls(*laid, closed=closed, smoothing=smoothing)

    @cached_property
    def length(self) -> float:
        """Metres; of a closed path, once around."""
        return (len(self.points) - (not self.closed)) * self.spacing

    @cached_property
    def distances(self) -> Float[Tensor, " points"]:
        """Arc length of each point."""
        return torch.arange(len(self.points), device=self.points.device).double() * self.spacing

    @cached_property
    def tangents(self) -> Float[Tensor, "points 2"]:
        """Unit vectors (x, z) in which the smoothed path goes on at its points."""
        return heading(self._bending.bearings)

    @cached_property
    def curvatures(self) -> Float[Tensor, " points"]:
        """How fast the smoothed path turns at its points, 1/m; positive towards the left hand."""
        return self._bending.curvatures

    @cached_property
    def _bending(self) -> Bending:
        return bending(
            self.points, spacing=self.spacing, closed=self.closed, smoothing=self.smoothing
        )

    @cached_property
    def _bearings(self) -> Mapping[str, Float[Tensor, " points"]]:
        return {name: bearing(values) for name, values in self.directions.items()}

    def at(self, distance: Float[Tensor, "*places"]) -> Place:
        """Read the path at some arc lengths, on straight lines between its points.

        Before its start and beyond its end an open path goes straight on; a closed one goes round.
        """
        between = self._between(distance)
        position = between.vector(self.points)
        tangent = heading(between.angle(self._bending.bearings))
        if not self.closed:
            beyond = distance - distance.clamp(0, self.length)
            position = position + beyond[..., None].to(position) * tangent
        return Place(position, tangent, between.number(self.curvatures))

    def scalar(self, name: str, distance: Float[Tensor, "*places"]) -> Float[Tensor, "*places"]:
        """A track of numbers at some arc lengths, linear between points, held beyond open ends.

        Raises:
            ConfigError: there is no such track.
        """
        return self._between(distance).number(_named(name, self.scalars))

    def direction(
        self, name: str, distance: Float[Tensor, "*places"]
    ) -> Float[Tensor, "*places 2"]:
        """A track of unit vectors (x, z) at some arc lengths, held beyond open ends. From point to
        point they turn evenly, the shorter way round.

        Raises:
            ConfigError: there is no such track.
        """
        return heading(self._between(distance).angle(_named(name, self._bearings)))

    def _between(self, distance: Float[Tensor, "*places"]) -> Between:
        distance, count = distance.to(self.points), len(self.points)
        return between_points(distance, count=count, spacing=self.spacing, closed=self.closed)

    def with_scalar(
        self,
        name: str,
        values: Float[Tensor, " values"] | float,
        *,
        at: Float[Tensor, " places"] | None = None,
        smoothing: float = 0.0,
    ) -> Path:
        """The same path with one more track of numbers, or with another of that name.

        Args:
            name: such as ``speed`` (m/s).
            values: one for all points, one a point, or one for each arc length ``at``.
            at: arc lengths of the values, not falling, such as ``path.marks``. In between values
                are linear, beyond the outer ones held; on a closed path they go round.
            smoothing: sigma in metres of a Gaussian along the path. Published tracks, which come
                from recordings, are smoothed by ``path.smoothing``.

        Raises:
            DataError: too many or too few values, one that is not finite, arc lengths that fall or
                lie off the path.
        """
        given = torch.as_tensor(values, dtype=torch.float64, device=self.points.device).reshape(-1)
        track = spread_numbers(
            name, given, self.distances, at=at, period=self.length if self.closed else None
        )
        track = smooth(track, smoothing / self.spacing, closed=self.closed)
        return replace(self, scalars={**self.scalars, name: track})

    def with_direction(
        self,
        name: str,
        values: Float[Tensor, "values 2"],
        *,
        at: Float[Tensor, " places"] | None = None,
    ) -> Path:
        """The same path with one more track of directions, or with another of that name.

        Args:
            name: such as ``facing``.
            values: vectors (x, z) of any length but 0: one row for all points, one a point, or one
                for each arc length ``at``, between which they turn evenly, the shorter way round.
            at: see ``with_scalar``.

        Raises:
            DataError: see ``with_scalar``; or a vector that is zero.
        """
        given = values.to(self.points)
        track = spread_directions(
            name, given, self.distances, at=at, period=self.length if self.closed else None
        )
        return replace(self, directions={**self.directions, name: track})

    def extend(self, waypoints: Float[Tensor, "waypoints 2"], *, straight: bool = False) -> Path:
        """The same path led on through more way points, as while it is walked.

        Points, marks and tracks stay as they are; tangents and curvatures do up to four
        ``smoothing`` before the former end, from where they now look ahead. A smooth curve goes on
        in the direction of the last segment. The last new segment may reach past the last way
        point. On the new points tracks hold their last values.

        Args:
            waypoints: (x, z), metres; the first must not be the end of the path.
            straight: see ``through``.

        Raises:
            ConfigError: the path is closed.
            DataError: see ``through``; the end of the path counts as way point 1.
        """
        if self.closed:
            raise ConfigError("a closed path has no end to lead on from; draw it open to extend it")
        points, _, marks = lead_on(self.points, waypoints, spacing=self.spacing, straight=straight)
        return replace(
            self,
            points=torch.cat([self.points, points]),
            marks=torch.cat([self.marks, self.length + marks]),
            scalars={name: held(track, len(points)) for name, track in self.scalars.items()},
            directions={name: held(track, len(points)) for name, track in self.directions.items()},
        )

    def nearest(
        self,
        positions: Float[Tensor, "*places 2"],
        *,
        near: Float[Tensor, "*places"] | None = None,
        reach: float | None = None,
    ) -> Float[Tensor, "*places"]:
        """Arc lengths of the places of the path that are nearest to some positions.

        Args:
            positions: (x, z), metres.
            near: arc length about which to look, one for each position: who comes to a crossing
                stays on their own branch. On a closed path laps are counted on from it.
                ``None``: look everywhere.
            reach: how far before and after ``near`` to look, metres; ``None``: 40 segments.
        """
        return nearest_places(
            self.points,
            positions,
            spacing=self.spacing,
            closed=self.closed,
            near=near,
            reach=reach,
        ).arc_length

    def distance_to(self, positions: Float[Tensor, "*places 2"]) -> Float[Tensor, "*places"]:
        """Distances in metres from some positions to the nearest places of the path, everywhere on
        it; of long walks, ``nearest`` with ``near`` finds them sooner."""
        found = nearest_places(self.points, positions, spacing=self.spacing, closed=self.closed)
        return found.distance


def _named(name: str, tracks: Mapping[str, Tensor]) -> Tensor:
    if name not in tracks:
        raise ConfigError(f"the path has no track {name!r}; {did_you_mean(name, tracks)}")
    return tracks[name]
