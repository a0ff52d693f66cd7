"""Gait analysis: contacts, walk cycle, path, speed, facing, and the root relative to its path."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal, NamedTuple

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from posecast.errors import ConfigError
from posecast.motion.checks import check_motion
from posecast.motion.clip import Clip
from posecast.motion.contacts import NEAR, find_contacts
from posecast.motion.facing import body_heading, root_heading
from posecast.motion.feet import Feet, find_feet, leg_length
from posecast.motion.low_pass import gaussian, low_pass
from posecast.motion.walk_cycle import find_walk_cycle
from posecast.skeleton.kinematics import joint_positions

_STRIDE = 1.1
"""Seconds of two steps, where a clip shows none."""

_SMOOTHING = 0.4
"""Standard deviation of the low-pass of path and facing, in strides.

What sways once a stride is left with 8 % of its amplitude, what surges once a step with none.
"""

_STANDING = 0.1
"""Leg lengths a second, below which a root goes nowhere."""

_POSES = 64
"""So many poses, spread over the clip, tell feet by geometry where names do not."""

_PUBLISHED_SIGMA = 5 / 30
"""Seconds."""


class Gait(NamedTuple):
    """What a clip's feet and root do, one value a frame; float64, metres, radians, seconds.

    In every frame the root's (x, z) is ``path + longitudinal * movement + lateral * left``, where
    the left of a direction (x, z) is (z, -x).

    Args:
        contacts: whether the left foot, and the right one, stands; see ``find_contacts``.
        phase: place in the walk cycle, growing by pi with each step: 0 modulo 2 pi where the right
            foot begins to stand, pi where the left one does; see ``find_walk_cycle``.
        walking: whether the phase means something; it does not while standing.
        step_rate: radians of phase a second; 0 where nobody walks.
        path: (x, z) of the root without the sway and surge of single steps.
        distance: along the path, from the first frame on.
        speed: m/s along the path.
        movement: unit tangent (x, z) of the path, held while standing.
        longitudinal: of the root, ahead of where the path is in this frame.
        lateral: of the root, to the left of the path.
        height: of the root.
        facing: unit vector (x, z) on the floor, where the body faces, without the turning to and
            fro of single steps.
    """

    contacts: Bool[Tensor, "frames 2"]
    phase: Float[Tensor, "frames"]
    walking: Bool[Tensor, "frames"]
    step_rate: Float[Tensor, "frames"]
    path: Float[Tensor, "frames 2"]
    distance: Float[Tensor, "frames"]
    speed: Float[Tensor, "frames"]
    movement: Float[Tensor, "frames 2"]
    longitudinal: Float[Tensor, "frames"]
    lateral: Float[Tensor, "frames"]
    height: Float[Tensor, "frames"]
    facing: Float[Tensor, "frames 2"]


def analyse_gait(
    clip: Clip,
    *,
    feet: Feet | None = None,
    facing: Literal["body", "root"] = "body",
    near: float = NEAR,
) -> Gait:
    """Find out how a clip walks: any clip of a skeleton with two feet.

    Thresholds are of leg lengths and seconds: a scaled body, or another frame rate, walks alike.
    The path is a low-pass over the clip's own strides, and bounded: over any length of time the
    root stays as near to it as sway and surge are wide.

    Args:
        feet: as ``find_feet`` returns; ``None``: found by name, else in the clip's own poses.
        facing: ``"body"`` by hips and shoulders (``body_heading``), low-passed like the path;
            ``"root"`` as published (``root_heading``), as it is.
        near: how high above where it stands a foot in contact may be, leg lengths; infinite where
            the floor is not level.

    Raises:
        ConfigError: ``near`` is not positive.
        DataError: a number of the clip is not finite, or a quaternion no rotation.
        SkeletonError: no feet are found, or its legs have no length.
    """
    if not near > 0:
        raise ConfigError(f"near is {near}; expected a positive number of leg lengths")
    check_motion(clip.name or "clip", clip)
    positions = _positions(clip)
    if feet is None:
        some = torch.linspace(0, clip.frames - 1, min(clip.frames, _POSES)).long()
        feet = find_feet(clip.skeleton, clip.offsets, positions[some])
    leg = leg_length(clip.skeleton, clip.offsets, feet)
    cycle = find_walk_cycle(positions[:, list(feet.ankles)], fps=clip.fps, leg=leg)
    sigma = _SMOOTHING * (cycle.stride or _STRIDE) * clip.fps
    if facing == "body":
        heading = low_pass(body_heading(clip.skeleton, positions, feet), sigma)
    else:
        heading = root_heading(clip.rotations_local[:, clip.skeleton.roots[0]])
    root = positions[:, clip.skeleton.roots[0]]
    ahead = torch.stack([heading.sin(), heading.cos()], dim=-1)
    way = _along(root[:, [0, 2]], ahead, sigma=sigma, fps=clip.fps, least=_STANDING * leg)
    contacts = find_contacts(positions[:, list(feet.toes)], fps=clip.fps, leg=leg, near=near)
    return Gait(
        contacts=contacts,
        phase=cycle.phase,
        walking=cycle.walking,
        step_rate=cycle.step_rate,
        **way._asdict(),
        height=root[:, 1],
        facing=ahead,
    )


def with_gait(clip: Clip, gait: Gait | None = None) -> Clip:
    """The clip with its gait as tracks, named as in ``Gait``, in the precision of its positions.

    Tracks of these names that the clip had are replaced. ``mirror``, ``turn``, ``resample`` and
    ``reproportion`` know what to do with all of them.

    Args:
        gait: what ``analyse_gait`` found in this clip; ``None``: what it finds by default.
    """
    found = analyse_gait(clip) if gait is None else gait
    tracks = {
        track: values.to(clip.root_positions) if values.is_floating_point() else values
        for track, values in found._asdict().items()
    }
    return replace(clip, tracks={**clip.tracks, **tracks})


def integrated_offset(clip: Clip) -> Float[Tensor, "frames"]:
    """Longitudinal offset of the root as published: the sum of its speed less its mean speed.

    The mean is a Gaussian of 1/6 s. Over long recordings the sum drifts, since both need not sum
    up to the same; ``Gait.longitudinal`` is bounded.

    Returns:
        Metres, from the first frame on.

    Source: the code of Pavllo et al. 2020, sigma 5 frames at 30 frames a second.
    """
    floor = clip.root_positions[:, [0, 2]].double()
    way = floor.diff(dim=0).norm(dim=-1)
    way = torch.cat([way, way[-1:]]) if len(way) else way.new_zeros(1)
    return (way - gaussian(way, _PUBLISHED_SIGMA * clip.fps, ends="even")).cumsum(0)


def _positions(clip: Clip) -> Float[Tensor, "frames joints 3"]:
    moved = clip.translations_local
    return joint_positions(
        clip.skeleton,
        clip.rotations_local.double(),
        (clip.offsets if moved is None else moved).double(),
        clip.root_positions.double(),
    )


class _Way(NamedTuple):
    path: Float[Tensor, "frames 2"]
    distance: Float[Tensor, "frames"]
    speed: Float[Tensor, "frames"]
    movement: Float[Tensor, "frames 2"]
    longitudinal: Float[Tensor, "frames"]
    lateral: Float[Tensor, "frames"]


def _along(
    root: Float[Tensor, "frames 2"],
    facing: Float[Tensor, "frames 2"],
    *,
    sigma: float,
    fps: float,
    least: float,
) -> _Way:
    """What follows from the root's way over the floor; see ``Gait``.

    Args:
        root: on the floor, metres.
        facing: the movement where nothing ever moves.
        sigma: of the low-pass, frames.
        fps: frames a second.
        least: speed below which the movement is held, m/s.
    """
    path = low_pass(root, sigma)
    steps = path.diff(dim=0).norm(dim=-1)
    distance = torch.cat([steps.new_zeros(1), steps.cumsum(0)])
    velocity = torch.gradient(path, dim=0)[0] * fps if len(path) > 1 else torch.zeros_like(path)
    speed = velocity.norm(dim=-1)
    movement = _held(velocity, speed > least, facing)
    offset = root - path
    left = torch.stack([movement[:, 1], -movement[:, 0]], dim=-1)
    longitudinal, lateral = (offset * movement).sum(-1), (offset * left).sum(-1)
    return _Way(path, distance, speed, movement, longitudinal, lateral)


def _held(
    directions: Float[Tensor, "frames 2"],
    known: Bool[Tensor, "frames"],
    otherwise: Float[Tensor, "frames 2"],
) -> Float[Tensor, "frames 2"]:
    """Unit directions; where not known those known last, before any those known first."""
    if not known.any():
        return otherwise
    frames = torch.arange(len(known))
    last = torch.where(known, frames, -1).cummax(0).values
    first = int(known.nonzero()[0])
    return torch.nn.functional.normalize(directions[last.clamp(min=first)], dim=-1)
