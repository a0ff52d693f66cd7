"""A scene: clips seen by one camera, as flat line segments that all fit into one frame."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from posecast.errors import ConfigError, DataError
from posecast.motion.clip import Clip
from posecast.skeleton import Skeleton
from posecast.skeleton.kinematics import joint_positions

Array = npt.NDArray[np.float64]
Side = Literal["left", "middle", "right"]
Camera = Literal["auto", "fixed", "follow"]

_GRID_STEP = 0.5  # meters between lines of the floor grid, where that makes no forest of them
_GRID_LINES = 80
_MARGIN = 0.06  # of the larger side of the frame, on every side
_FINE = 0.05  # bones shorter than this, in meters, are drawn finer: fingers and toes
_ROOMY = 2.0  # a body that travels farther than this many of its heights is followed
_SMOOTHING = 0.4  # seconds, standard deviation of the followed path


class Bounds(NamedTuple):
    """Edges of the frame in the picture plane, meters."""

    left: float
    right: float
    bottom: float
    top: float

    @property
    def width(self) -> float:
        """Meters from left to right."""
        return self.right - self.left

    @property
    def height(self) -> float:
        """Meters from bottom to top."""
        return self.top - self.bottom


class View(NamedTuple):
    """Axes of the picture in the world: a point's flat place is its product with each.

    Args:
        across: unit vector that points to the right of the picture.
        up: unit vector that points to its top.
        toward: unit vector from the scene to the viewer.
    """

    across: Array
    up: Array
    toward: Array

    def flat(self, points: Array) -> Array:
        """Places in the picture, (..., 2), of points in the world, (..., 3)."""
        return np.stack([points @ self.across, points @ self.up], axis=-1)


def look(azimuth: float, elevation: float) -> View:
    """A view without perspective; y stays upright.

    Args:
        azimuth: radians about the vertical; 0 looks a character that faces +z in the face, a
            quarter turn sees its left side.
        elevation: radians above the horizon.
    """
    sine, cosine = math.sin(azimuth), math.cos(azimuth)
    toward = np.array(
        [sine * math.cos(elevation), math.sin(elevation), cosine * math.cos(elevation)]
    )
    across = np.array([cosine, 0.0, -sine])
    return View(across, np.cross(toward, across), toward)


@dataclass(frozen=True)
class Figure:
    """One clip, ready to be drawn.

    Args:
        positions: joints in the world, (frames, joints, 3), meters.
        bones: (parent, joint) of each line.
        sides: side of the body of each line.
        fine: which lines are drawn thinner.
        floor: height of the floor, meters.
        center: what the camera looks at on the floor, (frames, 2) of x and z, meters.
        fps: frames per second.
    """

    positions: Array
    bones: tuple[tuple[int, int], ...]
    sides: tuple[Side, ...]
    fine: tuple[bool, ...]
    floor: float
    center: Array
    fps: float

    @property
    def duration(self) -> float:
        """Seconds from the first frame to the last."""
        return (len(self.positions) - 1) / self.fps

    def pose(self, time: float) -> Pose:
        """The body at a time, as seen from its center; linear between frames, then at rest."""
        place = min(max(time * self.fps, 0.0), len(self.positions) - 1.0)
        before = math.floor(place + 1e-6)
        after, share = min(before + 1, len(self.positions) - 1), max(place - before, 0.0)
        joints = (1 - share) * self.positions[before] + share * self.positions[after]
        center = (1 - share) * self.center[before] + share * self.center[after]
        return Pose(joints - np.array([center[0], self.floor, center[1]]), center)


class Pose(NamedTuple):
    """A body at one time.

    Args:
        joints: (joints, 3) meters, relative to the point of the floor the camera looks at.
        center: x and z of that point in the world.
    """

    joints: Array
    center: Array

    def lines(self, bones: Sequence[tuple[int, int]]) -> Array:
        """Ends of each bone, (bones, 2, 3)."""
        return self.joints[np.asarray(bones, dtype=int)]

    def shadow(self, bones: Sequence[tuple[int, int]]) -> Array:
        """The same lines, straight down on the floor."""
        return self.lines(bones) * np.array([1.0, 0.0, 1.0])


def figure_of(clip: Clip, camera: Camera) -> Figure:
    """Place the joints of a clip, choose its lines, its floor and where the camera looks.

    A joint is joined to its parent by a line if the distance between them stays the same: the
    motionless root that some files put below the hips carries the body and is no part of it. The
    floor is where the lowest joint comes to rest: the first percentile of its height.

    Raises:
        DataError: the clip has a position that is not a number.
        ConfigError: no joint hangs from another at a constant distance.
    """
    positions = _world_positions(clip)
    if not np.isfinite(positions).all():
        raise DataError(clip.name or "clip", "has positions that are not numbers; nothing to draw")
    bones, lengths = _bones(clip.skeleton, positions)
    if not bones:
        raise ConfigError(f"clip {clip.name!r} has no bones to draw: no joint hangs from another")
    body = positions[:, sorted({joint for bone in bones for joint in bone})]
    sides = _sides(clip.skeleton)
    return Figure(
        positions=positions,
        bones=bones,
        sides=tuple(sides[joint] for _, joint in bones),
        fine=tuple(length < _FINE for length in lengths),
        floor=float(np.percentile(body[..., 1].min(axis=1), 1)),
        center=_center(body, clip.fps, camera),
        fps=clip.fps,
    )


def frame_bounds(figures: Sequence[Figure], view: View) -> Bounds:
    """The smallest frame around every joint and shadow of every figure at every time."""
    flat = []
    for figure in figures:
        joints = sorted({joint for bone in figure.bones for joint in bone})
        body = figure.positions[:, joints].copy()
        body[..., 0] -= figure.center[:, None, 0]
        body[..., 1] -= figure.floor
        body[..., 2] -= figure.center[:, None, 1]
        flat.append(view.flat(body).reshape(-1, 2))
        flat.append(view.flat(body * np.array([1.0, 0.0, 1.0])).reshape(-1, 2))
    points = np.concatenate(flat)
    low, high = points.min(axis=0), points.max(axis=0)
    room = _MARGIN * float((high - low).max()) + 1e-3
    return Bounds(
        float(low[0]) - room, float(high[0]) + room, float(low[1]) - room, float(high[1]) + room
    )


def facing(clip: Clip) -> float:
    """Direction a body faces on average, radians about the vertical; 0 is +z.

    Square to the line from a right joint to its left twin, of the pair nearest to the root; 0 for
    a skeleton without sides.
    """
    positions = _world_positions(clip)
    pairs = sorted(clip.skeleton.left_right_pairs, key=lambda pair: clip.skeleton.depths[pair[0]])
    for left, right in pairs:
        across = positions[:, left] - positions[:, right]
        if np.linalg.norm(across, axis=-1).mean() < 1e-3:
            continue  # both hip joints of CMU's skeleton lie in the root
        ahead = np.stack([-across[:, 2], across[:, 0]], axis=-1)  # across x vertical, as (x, z)
        mean = ahead.mean(axis=0)
        if np.linalg.norm(mean) < 0.5 * np.linalg.norm(ahead, axis=-1).mean():
            mean = ahead[0]  # it turns about; the beginning is as good as any other time
        return math.atan2(mean[0], mean[1])
    return 0.0


def grid_step(reach: float) -> float:
    """Meters between the lines of a grid that reaches that far: half a meter, doubled as needed."""
    step = _GRID_STEP
    while 2 * reach > _GRID_LINES * step:
        step *= 2
    return step


def grid_lines(center: Array, reach: float) -> Array:
    """Lines of the floor grid on a square around a point, as seen from it, (lines, 2, 3).

    The lines are fixed to the world, at multiples of ``grid_step``.

    Args:
        center: x and z of the middle of the square, meters.
        reach: half its side.
    """
    lines, step = [], grid_step(reach)
    for axis in (0, 1):
        first = math.ceil((center[axis] - reach) / step)
        last = math.floor((center[axis] + reach) / step)
        for place in np.arange(first, last + 1) * step - center[axis]:
            ends = np.zeros((2, 3))
            ends[:, 2 * axis] = place
            ends[:, 2 - 2 * axis] = -reach, reach
            lines.append(ends)
    return np.stack(lines) if lines else np.zeros((0, 2, 3))


def _world_positions(clip: Clip) -> Array:
    """Joints in the world, (frames, joints, 3), float64."""
    offsets = clip.offsets if clip.translations_local is None else clip.translations_local
    positions = joint_positions(clip.skeleton, clip.rotations_local, offsets, clip.root_positions)
    return positions.detach().cpu().double().numpy()


def _bones(
    skeleton: Skeleton, positions: Array
) -> tuple[tuple[tuple[int, int], ...], tuple[float, ...]]:
    """Pairs of joints at a constant distance from each other, parent first, and the distances."""
    bones, lengths = [], []
    for joint, parent in enumerate(skeleton.parents):
        if parent < 0:
            continue
        length = np.linalg.norm(positions[:, joint] - positions[:, parent], axis=-1)
        if np.ptp(length) <= 0.02 + 0.05 * float(length.mean()):
            bones.append((parent, joint))
            lengths.append(float(length.mean()))
    return tuple(bones), tuple(lengths)


def _sides(skeleton: Skeleton) -> list[Side]:
    """Side of each joint: by its name, else that of its parent."""
    lefts = {left for left, _ in skeleton.left_right_pairs}
    rights = {right for _, right in skeleton.left_right_pairs}
    sides: list[Side] = []
    for joint, parent in enumerate(skeleton.parents):
        if joint in lefts:
            sides.append("left")
        elif joint in rights:
            sides.append("right")
        else:
            sides.append("middle" if parent < 0 else sides[parent])
    return sides


def _center(body: Array, fps: float, camera: Camera) -> Array:
    """What the camera looks at on the floor: the smoothed middle of the body, or one point."""
    path = body[..., [0, 2]].mean(axis=1)
    height = float(np.median(np.ptp(body[..., 1], axis=1)))
    travels = float(np.ptp(path, axis=0).max()) > _ROOMY * height
    if camera == "fixed" or (camera == "auto" and not travels):
        middle = (path.min(axis=0) + path.max(axis=0)) / 2
        return np.broadcast_to(middle, path.shape).copy()
    deviation = _SMOOTHING * fps
    reach = math.ceil(3 * deviation)
    weights = np.exp(-0.5 * (np.arange(-reach, reach + 1) / deviation) ** 2)
    # Beyond its ends the path goes on as it came, or the body would leave the middle there.
    padded = np.pad(path, ((reach, reach), (0, 0)), mode="reflect", reflect_type="odd")
    smooth = [np.convolve(padded[:, axis], weights / weights.sum(), "valid") for axis in (0, 1)]
    return np.stack(smooth, axis=-1)
