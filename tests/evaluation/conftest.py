"""Small corpora for the tests of evaluation."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import pytest
import torch

from posecast.geometry import quaternion
from posecast.motion import Clip
from posecast.motion.corpus import Corpus
from posecast.skeleton import Skeleton

SKELETON = Skeleton(("Hips", "Spine", "LeftLeg", "RightLeg", "Head"), (-1, 0, 0, 0, 1))
OFFSETS = torch.tensor(
    [[0.0, 0.0, 0.0], [0.0, 0.5, 0.0], [0.1, -0.9, 0.0], [-0.1, -0.9, 0.0], [0.0, 0.2, 0.1]],
    dtype=torch.float64,
)


def _clip(frames: int, seed: int, *, fps: float = 25.0, **labels: str) -> Clip:
    """Joints that swing about fixed axes, each at its own pace; the Head never moves."""
    generator = torch.Generator().manual_seed(seed)
    axes = torch.randn(5, 3, dtype=torch.float64, generator=generator)
    paces = 0.3 + torch.rand(5, dtype=torch.float64, generator=generator)
    time = torch.arange(frames, dtype=torch.float64) / fps
    swing = 0.8 * torch.sin(2 * math.pi * paces * time[:, None])
    swing[:, 4] = 0.3
    rotations = quaternion.exp(swing[..., None] * axes / axes.norm(dim=-1, keepdim=True))
    root = torch.stack([time, torch.ones_like(time), torch.zeros_like(time)], dim=-1)
    name = "_".join(labels.values()) or f"clip_{seed}"
    return Clip(SKELETON, OFFSETS, fps, root, rotations, name=name, labels=labels)


@pytest.fixture
def make_clip() -> Callable[..., Clip]:
    """``make_clip(frames, seed, fps=25.0, **labels)``."""
    return _clip


@pytest.fixture
def make_h36m() -> Callable[[Sequence[str]], Corpus]:
    """A corpus labelled as Human3.6M: two recordings of each action, 400 frames and more."""

    def make(actions: Sequence[str]) -> Corpus:
        clips = [
            _clip(
                400 + 10 * place,
                2 * place + recording,
                subject="S5",
                action=action,
                recording=str(recording),
            )
            for place, action in enumerate(actions)
            for recording in (1, 2)
        ]
        return Corpus("toy", clips, {"train": (), "test": tuple(range(len(clips)))})

    return make
