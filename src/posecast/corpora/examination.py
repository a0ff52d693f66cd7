"""What one motion file tells about itself, measured: size, rate, swings of the feet, jumps."""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Literal, NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from posecast.corpora.cmu import is_t_pose
from posecast.errors import DataError
from posecast.geometry import quaternion
from posecast.io.amass import read_amass
from posecast.io.amass_first import read_amass_first
from posecast.io.archive import read_archive
from posecast.io.asf_amc import read_amc
from posecast.io.bvh import BvhLayout, read_bvh
from posecast.io.bvh_layout import guess_up
from posecast.io.h36m import read_h36m
from posecast.motion import Clip
from posecast.skeleton import Skeleton, joint_positions

Format = Literal["bvh", "amc", "h36m", "amass", "pickle", "archive"]

_SAMPLED_FRAMES = 48
_NO_LENGTH = 1e-5
_JUMP_ANGLE = math.radians(60)
_JUMP_TURNING = 50.0
_JUMP_STEP = 0.05
_JUMP_SPEED = 12.0
"""No body moves faster (m/s), and no joint turns faster (rad/s) by so much between two frames."""
_SWING_SPEED = 0.2
_SWING_LENGTH = 0.15


class Jump(NamedTuple):
    """A change between two frames that no body makes.

    Args:
        frame: the later one, counted from 0.
        joint: which joint.
        amount: radians for a turn, meters for a step of the root.
    """

    frame: int
    joint: str
    amount: float


@dataclass(frozen=True)
class Facts:
    """What is known of one file.

    Args:
        name: its path below the folder examined.
        digest: hash of its motion, line ends aside; "" if it cannot be opened.
        error: why it cannot be read; "" if it can, else all that follows means nothing.
        frames: number of frames.
        fps: frames per second that it claims.
        skeleton: its joints.
        height: how high the body reaches from its lowest to its highest joint, meters; NaN where
            the file does not say how long bones are.
        unit: meters per unit of the file, if guessed.
        up: vertical axis, of the file if guessed, else of what was read.
        swings: seconds that a foot is off the floor, one for each step.
        without_length: joints at the very place of their parent.
        moving: joints whose translation from the parent changes.
        flips: turns of a joint that no body makes, the worst of each joint.
        leaps: steps of the root that no body makes.
        t_pose: the first frame is an inserted T pose.
        notes: of the reader.
    """

    name: str
    digest: str = ""
    error: str = ""
    frames: int = 0
    fps: float = 0.0
    skeleton: Skeleton | None = None
    height: float = math.nan
    unit: float | None = None
    up: str = ""
    swings: tuple[float, ...] = ()
    without_length: tuple[str, ...] = ()
    moving: tuple[str, ...] = ()
    flips: tuple[Jump, ...] = ()
    leaps: tuple[Jump, ...] = ()
    t_pose: bool = False
    notes: tuple[str, ...] = ()


def examine_file(name: str, file: Path, format: Format) -> Facts:
    """Read one file and measure it; a file that cannot be read becomes facts too."""
    try:
        digest = motion_digest(file, format)
    except OSError as error:
        return Facts(name, error=f"cannot be read ({error.strerror or error})")
    try:
        clip = _read(file, format)
    except DataError as error:
        where = "" if error.line is None else f"line {error.line}: "
        return Facts(name, digest, error=where + error.message)
    return _measure(name, digest, clip, format)


def motion_digest(file: Path, format: Format) -> str:
    """Hash of the motion in a file: of BVH what follows MOTION; line ends do not count."""
    content = file.read_bytes()
    if format == "bvh":
        content = content[max(content.find(b"MOTION"), 0) :]
    if format in ("bvh", "amc", "h36m"):
        content = content.replace(b"\r", b"").rstrip()
    return hashlib.blake2b(content, digest_size=16).hexdigest()


def _read(file: Path, format: Format) -> Clip:
    match format:
        case "bvh":
            return read_bvh(file)
        case "amc":
            return read_amc(file)
        case "h36m":
            return read_h36m(file, root="increments")
        case "amass":
            return read_amass(file)
        case "pickle":
            return read_amass_first(file)
        case "archive":
            return read_archive(file)


def _measure(name: str, digest: str, clip: Clip, format: Format) -> Facts:
    layout = clip.source if isinstance(clip.source, BvhLayout) else None
    t_pose = format == "bvh" and clip.frames > 1 and is_t_pose(clip)
    if t_pose:
        clip = clip.cut(1, clip.frames)
    # H3.6M tells movements only, and one body for all; AMASS has no bones without a template.
    in_space = format not in ("h36m", "amass", "pickle") and len(clip.skeleton) > 1
    height, up = math.nan, ""
    swings: tuple[float, ...] = ()
    if in_space:
        frames = torch.linspace(0, clip.frames - 1, min(clip.frames, _SAMPLED_FRAMES)).long()
        places = _positions(clip, frames)
        up = guess_up(places)
        along = places[..., 1 if layout else "xyz".index(up)]
        height = float((along.amax(-1) - along.amin(-1)).quantile(0.9))
        up = layout.up if layout else up
        swings = swing_times(clip, places, height)
    moved = clip.translations_local
    lengths = (clip.offsets if moved is None else moved).norm(dim=-1)
    longest = lengths if moved is None else lengths.amax(0)
    strays = [] if moved is None else (moved - moved.mean(0)).norm(dim=-1).amax(0).tolist()
    names = clip.skeleton.names
    return Facts(
        name=name,
        digest=digest,
        frames=clip.frames + t_pose,
        fps=clip.fps,
        skeleton=clip.skeleton,
        height=height,
        unit=layout.unit if layout else None,
        up=up,
        swings=swings,
        without_length=tuple(
            names[joint]
            for joint, parent in enumerate(clip.skeleton.parents)
            if parent >= 0 and in_space and float(longest[joint]) < _NO_LENGTH
        ),
        moving=tuple(names[joint] for joint, stray in enumerate(strays) if stray > _NO_LENGTH),
        flips=_flips(clip, first=int(t_pose)),
        leaps=_leaps(clip, first=int(t_pose), increments=format == "h36m"),
        t_pose=t_pose,
        notes=() if layout is None else tuple(n for n in layout.notes if "read as 1/" not in n),
    )


def _positions(
    clip: Clip, frames: Tensor, joints: list[int] | None = None
) -> Float[Tensor, "frames joints 3"]:
    """World positions at some frames, of all joints or of some with all above them."""
    kept = list(range(len(clip.skeleton))) if joints is None else joints
    moved = clip.translations_local
    return joint_positions(
        clip.skeleton.select(kept),
        clip.rotations_local[frames][:, kept],
        clip.offsets[kept] if moved is None else moved[frames][:, kept],
        clip.root_positions[frames],
    )


def swing_times(
    clip: Clip, places: Float[Tensor, "frames joints 3"], height: float
) -> tuple[float, ...]:
    """Seconds that each foot moves on each of its steps, at the clip's frame rate.

    Steps are found without knowing the rate: the lowest pair of joints that are left and right of
    each other are the feet, and a step is a stretch of frames in which one moves faster than a
    fifth of its fastest and gets ahead by 15 per cent of the body's height.

    Args:
        clip: the recording.
        places: world positions of all joints at some frames, to find the feet.
        height: of the body, in the unit of ``places``.
    """
    heights = places[..., 1].mean(0)
    pairs = clip.skeleton.left_right_pairs
    if not pairs or clip.frames < 3:
        return ()
    feet = min(pairs, key=lambda pair: float(heights[list(pair)].sum()))
    joints = sorted({joint for foot in feet for joint in (foot, *clip.skeleton.ancestors(foot))})
    paths = _positions(clip, torch.arange(clip.frames), joints)
    found: list[float] = []
    for foot in feet:
        path = paths[:, joints.index(foot)]
        speed = path.diff(dim=0).norm(dim=-1)
        fast = speed > _SWING_SPEED * speed.quantile(0.98)
        changes = torch.nonzero(fast[1:] != fast[:-1]).flatten().add(1).tolist()
        for begin, end in pairwise(changes):
            stretch = float((path[end] - path[begin]).norm())
            if fast[begin] and stretch > _SWING_LENGTH * height:
                found.append((end - begin) / clip.fps)
    return tuple(found)


def _flips(clip: Clip, *, first: int) -> tuple[Jump, ...]:
    """The worst impossible turn of each joint that has one; ``first``: number of frame 0."""
    rotations = clip.rotations_local
    if clip.frames < 2:
        return ()
    angles = quaternion.angle(rotations[1:], rotations[:-1])
    limit = max(_JUMP_ANGLE, _JUMP_TURNING / clip.fps)
    worst, frames = angles.max(0)
    return tuple(
        Jump(first + int(frames[joint]) + 1, clip.skeleton.names[joint], float(worst[joint]))
        for joint in torch.nonzero(worst > limit).flatten().tolist()
    )


def _leaps(clip: Clip, *, first: int, increments: bool) -> tuple[Jump, ...]:
    """Impossible steps of the root; ``increments``: the positions are the steps already."""
    positions = clip.root_positions
    steps = positions.norm(dim=-1) if increments else positions.diff(dim=0).norm(dim=-1)
    limit = max(_JUMP_STEP, _JUMP_SPEED / clip.fps)
    root = clip.skeleton.names[clip.skeleton.roots[0]]
    return tuple(
        Jump(first + frame + (not increments), root, float(steps[frame]))
        for frame in torch.nonzero(steps > limit).flatten().tolist()
    )
