"""Random clips on small skeletons, in float64."""

from __future__ import annotations

from collections.abc import Callable

import pytest
import torch

from posecast.geometry import quaternion
from posecast.motion import Clip
from posecast.skeleton import Skeleton

TWINS = Skeleton(
    ("Hips", "LeftHip", "LeftFoot", "RightHip", "RightFoot", "Spine", "Head"),
    (-1, 0, 1, 0, 3, 0, 5),
)


@pytest.fixture
def make_clip(generator: torch.Generator) -> Callable[..., Clip]:
    """A clip that moves smoothly enough to be interpolated, from a fixed seed."""

    def make(
        skeleton: Skeleton = TWINS, frames: int = 40, fps: float = 120.0, **changes: object
    ) -> Clip:
        joints = len(skeleton)
        start = torch.randn(joints, 4, generator=generator, dtype=torch.float64)
        velocity = 0.05 * torch.randn(joints, 3, generator=generator, dtype=torch.float64)
        time = torch.arange(frames, dtype=torch.float64)[:, None, None]
        rotations = quaternion.product(
            quaternion.exp(time * velocity), quaternion.normalize(start)[None]
        )
        offsets = torch.randn(joints, 3, generator=generator, dtype=torch.float64)
        offsets[0] = 0
        positions = torch.randn(frames, 3, generator=generator, dtype=torch.float64).cumsum(0)
        content: dict[str, object] = {
            "skeleton": skeleton,
            "offsets": offsets,
            "fps": fps,
            "root_positions": positions,
            "rotations_local": rotations,
            "name": "made",
        }
        return Clip(**{**content, **changes})  # type: ignore[arg-type]

    return make
