"""Turning and mirroring a batch of windows, each by a draw of its own."""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from posecast.geometry import quaternion
from posecast.motion import Motion
from posecast.motion.tracks import mirrored, turned
from posecast.skeleton import Skeleton


def turn(motion: Motion, angles: Float[Tensor, "batch"], skeleton: Skeleton) -> Motion:
    """Turn each window about the vertical through the world's origin.

    Args:
        motion: the windows.
        angles: radians, positive from +z towards +x. An angle and the same plus a full turn give
            the same motion with the other sign of the root quaternions.
        skeleton: its roots are turned; all other joints keep their rotations.
    """
    half = angles / 2
    zero = torch.zeros_like(half)
    about_y = torch.stack((half.cos(), zero, half.sin(), zero), dim=-1)[:, None]
    roots = list(skeleton.roots)
    rotations = motion.rotations_local.clone()
    rotations[:, :, roots] = quaternion.product(about_y[:, None], rotations[:, :, roots])
    # A root besides the first stands at its own offset from the first, in the world's axes.
    offsets = motion.offsets.clone()
    offsets[:, roots] = quaternion.rotate(about_y, offsets[:, roots])
    positions = quaternion.rotate(about_y, motion.root_positions)
    tracks = None if motion.tracks is None else turned(motion.tracks, angles)
    return Motion(rotations, positions, offsets, actions=motion.actions, tracks=tracks)


def mirror(motion: Motion, chosen: Bool[Tensor, "batch"], skeleton: Skeleton) -> Motion:
    """Exchange left and right in the chosen windows: reflect the world in the plane x = 0.

    Exact for every skeleton: rotations, root positions and the body itself are reflected, and
    joints are exchanged with their twins.
    """
    twins = torch.tensor(skeleton.mirror_permutation)
    reflect = torch.tensor((-1.0, 1.0, 1.0)).to(motion.offsets)
    conjugate = torch.tensor((1.0, 1.0, -1.0, -1.0)).to(motion.rotations_local)
    reflected = Motion(
        motion.rotations_local[:, :, twins] * conjugate,
        motion.root_positions * reflect,
        motion.offsets[:, twins] * reflect,
    )

    def chosen_of(before: Tensor, after: Tensor) -> Tensor:
        return torch.where(chosen.reshape(-1, *(1,) * (before.ndim - 1)), after, before)

    tracks = motion.tracks
    if tracks is not None:
        others = mirrored(tracks)
        tracks = {name: chosen_of(values, others[name]) for name, values in tracks.items()}
    rotations, positions, offsets = map(chosen_of, motion[:3], reflected[:3])
    return Motion(rotations, positions, offsets, actions=motion.actions, tracks=tracks)
