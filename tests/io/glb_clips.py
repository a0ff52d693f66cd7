"""Clips of every kind for tests of GLB files, and what is looked at in the files."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import torch
from tests.io.glb_reference import Array, Glb

from posecast.corpora.synthetic import make_clip as make_walk
from posecast.geometry import quaternion
from posecast.io.glb import write_glb
from posecast.motion import Clip
from posecast.skeleton import Skeleton, joint_positions

EXACT = 1e-5
"""Metres: single precision over a chain of joints, some metres from the origin."""

SKELETON = Skeleton(
    ("hips", "knie.l", "Füße", "armature", "prop", "prop end", "bones", "頭"),
    (-1, 0, 1, 0, -1, 4, 3, 6),
)


def forest(frames: int = 9) -> Clip:
    """Two roots with offsets of their own, and any rotations, half of them with the other sign."""
    generator = torch.Generator().manual_seed(11)
    joints = len(SKELETON)

    def random(*shape: int) -> torch.Tensor:
        return torch.randn(*shape, dtype=torch.float64, generator=generator)

    steps = 0.3 * torch.arange(frames)[:, None, None] * random(joints, 3) + random(joints, 3)
    signs = torch.where(torch.arange(frames) % 2 == 0, 1.0, -1.0).double()[:, None, None]
    return Clip(
        SKELETON, random(joints, 3), 119.88, random(frames, 3), signs * quaternion.exp(steps)
    )


def with_moving_bones() -> Clip:
    clip = forest()
    generator = torch.Generator().manual_seed(12)
    noise = torch.randn(9, len(SKELETON), 3, dtype=torch.float64, generator=generator)
    return replace(clip, translations_local=clip.offsets + 0.1 * noise)


def with_bones_of_length_zero() -> Clip:
    clip = forest()
    return replace(clip, offsets=clip.offsets * torch.tensor([1, 0, 1, 1, 1, 0, 1, 1])[:, None])


def without_a_body() -> Clip:
    clip = forest()
    return replace(clip, offsets=torch.zeros_like(clip.offsets))


CLIPS = {
    "a walk": lambda: make_walk(0, fps=30.0, seconds=1.0),
    "several roots": forest,
    "bones that move": with_moving_bones,
    "bones of length zero": with_bones_of_length_zero,
    "no body": without_a_body,
    "one frame": lambda: forest(1),
    "one joint": lambda: replace(
        forest(),
        skeleton=Skeleton(("ball",), (-1,)),
        offsets=forest().offsets[:1],
        rotations_local=forest().rotations_local[:, :1],
    ),
    "single precision": lambda: forest().to(torch.float32),
}


def written(clip: Clip, folder: Path, *, mesh: bool = True) -> Glb:
    write_glb(clip, folder / "clip.glb", mesh=mesh)
    return Glb(folder / "clip.glb")


def positions(clip: Clip) -> Array:
    offsets = clip.offsets if clip.translations_local is None else clip.translations_local
    found = joint_positions(
        clip.skeleton,
        clip.rotations_local.double(),
        offsets.double(),
        clip.root_positions.double(),
    )
    return found.numpy()
