"""Changing a clip: its frame rate, its side, its heading, the signs of its quaternions.

All of them return a new clip and leave the one they are given as it was.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Literal

import torch
from jaxtyping import Float, Int
from torch import Tensor

from posecast.errors import ConfigError, SkeletonError
from posecast.geometry import quaternion
from posecast.motion.clip import Clip
from posecast.motion.tracks import FACING, MOVEMENT, PHASE, as_written, mirrored, turned
from posecast.skeleton import Skeleton

_WHOLE_RATIO = 1e-3
"""Files round their frame time (0.008333 s): a ratio this near to a whole number is one."""


def resample(
    clip: Clip, fps: float | int, *, phases: Literal["all", "first"] = "all"
) -> tuple[Clip, ...]:
    """Bring a clip to another frame rate without losing frames.

    A whole ratio keeps frames as they are: 120 to 30 frames per second gives four clips, which
    begin at frames 0, 1, 2, 3 and have the label ``phase`` "0" to "3". Any other ratio gives one
    clip, interpolated in time from the first frame on: rotations along the shortest arc after
    unrolling, positions and floating-point tracks linearly, the track ``phase`` along the shorter
    way round the circle, directions brought back to unit length, boolean and whole-number tracks
    from the nearest frame.

    Args:
        clip: at any frame rate; a rate within 0.1 % of a multiple of ``fps`` counts as one.
        fps: frames per second of the result.
        phases: of a whole ratio all copies, or the first only.

    Raises:
        ConfigError: ``fps`` is not a positive number.
    """
    if not (math.isfinite(fps) and fps > 0):
        raise ConfigError(f"fps is {fps}: expected a positive number of frames per second")
    ratio = clip.fps / fps
    whole = round(ratio)
    if whole < 1 or abs(ratio - whole) > _WHOLE_RATIO * whole:
        return (_interpolate(clip, fps),)
    if whole == 1:
        return (replace(clip, fps=float(fps)),)
    copies = min(whole, clip.frames) if phases == "all" else 1
    return tuple(_every(clip, whole, phase, fps) for phase in range(copies))


def _every(clip: Clip, step: int, phase: int, fps: float | int) -> Clip:
    """Frames ``phase``, ``phase + step`` ... of a clip."""
    piece = slice(phase, None, step)
    moved = clip.translations_local
    return replace(
        clip,
        fps=float(fps),
        root_positions=clip.root_positions[piece],
        rotations_local=clip.rotations_local[piece],
        translations_local=None if moved is None else moved[piece],
        labels={**clip.labels, "phase": str(phase)},
        tracks={track: values[piece] for track, values in clip.tracks.items()},
    )


def _interpolate(clip: Clip, fps: float | int) -> Clip:
    """One clip at another rate; its last frame is at most one frame earlier than before."""
    count = math.floor((clip.frames - 1) * fps / clip.fps + 1e-6) + 1
    times = torch.arange(count, dtype=torch.float64) * (clip.fps / fps)
    before = times.floor().long().clamp(0, max(clip.frames - 2, 0))
    after = (before + 1).clamp(max=clip.frames - 1)
    fraction = (times - before).clamp(0, 1)
    rotations = quaternion.unroll(clip.rotations_local)
    between = fraction.to(rotations)[:, None]
    turned = quaternion.slerp(rotations[before], rotations[after], between)
    moved = clip.translations_local
    return replace(
        clip,
        fps=float(fps),
        root_positions=_linear(clip.root_positions, before, after, fraction),
        rotations_local=quaternion.unroll(quaternion.normalize(turned)),
        translations_local=None if moved is None else _linear(moved, before, after, fraction),
        tracks={
            track: _interpolate_track(track, values, before, after, fraction)
            for track, values in clip.tracks.items()
        },
    )


def _linear(
    values: Tensor,
    before: Int[Tensor, "frames"],
    after: Int[Tensor, "frames"],
    fraction: Float[Tensor, "frames"],
) -> Tensor:
    return values[before] + _along(values, fraction) * (values[after] - values[before])


def _along(values: Tensor, fraction: Float[Tensor, "frames"]) -> Tensor:
    """One number a frame, shaped to multiply values of more axes."""
    return fraction.to(values).reshape(-1, *(1,) * (values.ndim - 1))


def _interpolate_track(
    track: str,
    values: Tensor,
    before: Int[Tensor, "frames"],
    after: Int[Tensor, "frames"],
    fraction: Float[Tensor, "frames"],
) -> Tensor:
    if not values.is_floating_point():
        return values[torch.where(fraction < 0.5, before, after)]
    if track in (FACING, MOVEMENT):
        return torch.nn.functional.normalize(_linear(values, before, after, fraction), dim=-1)
    if track != PHASE:
        return _linear(values, before, after, fraction)
    step = torch.remainder(values[after] - values[before] + math.pi, 2 * math.pi) - math.pi
    return as_written(values, values[before] + _along(values, fraction) * step)


def mirror(clip: Clip) -> Clip:
    """Exchange left and right: the world positions are reflected in the plane x = 0, exactly.

    Joints change places with their twins on the other side, found by name; those without one stay
    on the middle line. The body is reflected too, so asymmetric bones are. The columns of the
    track ``contacts`` change places, ``phase`` is shifted by half a cycle, ``facing``, ``movement``
    and ``path`` are reflected, ``lateral`` changes its sign; other tracks are kept. The label
    ``mirrored`` is "yes" after one reflection and gone after two.

    Raises:
        SkeletonError: two joints are twins by name, but their parents are not.

    Source: (w, x, y, z) becomes (w, x, -y, -z), the rotation seen in the mirror x -> -x.
    """
    twins = _twins(clip.skeleton)
    reflect = clip.offsets.new_tensor((-1.0, 1.0, 1.0))
    moved = clip.translations_local
    labels = {**clip.labels, "mirrored": "yes"}
    if "mirrored" in clip.labels:
        del labels["mirrored"]
    signs = clip.rotations_local.new_tensor((1.0, 1.0, -1.0, -1.0))
    return replace(
        clip,
        offsets=clip.offsets[twins] * reflect,
        root_positions=clip.root_positions * reflect,
        rotations_local=clip.rotations_local[:, twins] * signs,
        translations_local=None if moved is None else moved[:, twins] * reflect,
        labels=labels,
        tracks=mirrored(clip.tracks),
    )


def _twins(skeleton: Skeleton) -> list[int]:
    """For each joint its twin, once it is sure that the tree is the same on both sides."""
    twins = list(skeleton.mirror_permutation)
    for joint, parent in enumerate(skeleton.parents):
        other = skeleton.parents[twins[joint]]
        if other != (-1 if parent == -1 else twins[parent]):
            raise SkeletonError(
                f"joints {skeleton.names[joint]!r} and {skeleton.names[twins[joint]]!r} are left "
                "and right by name but hang from joints that are not; rename them to mirror"
            )
    return twins


def turn(clip: Clip, angle: float | int) -> Clip:
    """Turn a clip about the vertical axis through the world's origin.

    The tracks ``facing``, ``movement`` and ``path`` are turned along.

    Args:
        clip: its roots are turned; all other joints keep their local rotations.
        angle: radians, positive from +z (forward) towards +x (left).
    """
    up = clip.rotations_local.new_tensor((0.0, 1.0, 0.0))
    about = quaternion.about_axis(up, up.new_tensor(angle))
    roots = list(clip.skeleton.roots)
    rotations, offsets = clip.rotations_local.clone(), clip.offsets.clone()
    rotations[:, roots] = quaternion.product(about, rotations[:, roots])
    # What a root has of offset is in the axes of the world.
    offsets[roots] = quaternion.rotate(about.to(offsets), offsets[roots])
    moved = clip.translations_local
    if moved is not None:
        moved = moved.clone()
        moved[:, roots] = quaternion.rotate(about.to(moved), moved[:, roots])
    return replace(
        clip,
        offsets=offsets,
        root_positions=quaternion.rotate(about.to(clip.root_positions), clip.root_positions),
        rotations_local=rotations,
        translations_local=moved,
        tracks=turned(clip.tracks, angle),
    )


def unroll(clip: Clip) -> Clip:
    """Choose the signs of the quaternions so that they are continuous in time."""
    return replace(clip, rotations_local=quaternion.unroll(clip.rotations_local))
