"""Clips that are easy to draw and hard to keep in the frame."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest
import torch

from posecast.geometry import quaternion
from posecast.motion import Clip
from posecast.skeleton import Skeleton

SKELETON = Skeleton(
    ("Hips", "LeftUpLeg", "LeftFoot", "RightUpLeg", "RightFoot", "Head"), (-1, 0, 1, 0, 3, 0)
)
OFFSETS = torch.tensor(
    [
        *([0.0, 0.0, 0.0], [0.1, -0.1, 0.0], [0.0, -0.8, 0.05]),
        *([-0.1, -0.1, 0.0], [0.0, -0.8, 0.05], [0.0, 0.7, 0.0]),
    ],
    dtype=torch.float64,
)


@pytest.fixture
def stand() -> Callable[..., Clip]:
    """``stand(frames=20, fps=25.0, heading=0.0)``: upright, facing +z turned by the heading."""

    def make(frames: int = 20, fps: float = 25.0, heading: float = 0.0) -> Clip:
        rotations = quaternion.identity(frames, 6, like=OFFSETS)
        turn = torch.tensor([0.0, heading, 0.0], dtype=torch.float64)
        rotations[:, 0] = quaternion.exp(turn)
        root = torch.tensor([0.0, 0.9, 0.0], dtype=torch.float64).expand(frames, 3)
        return Clip(SKELETON, OFFSETS, fps, root.clone(), rotations, name="stand")

    return make


@pytest.fixture
def wander() -> Callable[..., Clip]:
    """``wander(seed, frames=60, speed=0.2)``: tumbles about and jumps up to ``speed`` a frame."""

    def make(seed: int, frames: int = 60, speed: float = 0.2) -> Clip:
        generator = torch.Generator().manual_seed(seed)
        turns = torch.randn(frames, 6, 3, dtype=torch.float64, generator=generator)
        steps = speed * torch.randn(frames, 3, dtype=torch.float64, generator=generator)
        root = steps.cumsum(0) + torch.tensor([0.0, math.pi, 0.0], dtype=torch.float64)
        return Clip(SKELETON, OFFSETS, 25.0, root, quaternion.exp(turns), name=f"wander_{seed}")

    return make
