"""Small forecasters, and features for them, for the tests of models."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import pytest
import torch
from torch import Tensor

from posecast.geometry import quaternion
from posecast.model import DenseHead, Forecaster, GRUBackbone
from posecast.motion import Motion
from posecast.representation import Codec, Quaternion
from posecast.skeleton import Skeleton

SKELETON = Skeleton(("hips", "spine", "head", "left", "right"), (-1, 0, 1, 1, 1))


def random_motion(batch: int, frames: int, generator: torch.Generator) -> Motion:
    """Smooth random motion of the five-joint skeleton."""
    start, speed = torch.randn(2, batch, 1, 5, 3, generator=generator, dtype=torch.float64)
    time = torch.arange(frames, dtype=torch.float64)[:, None, None] / 10
    return Motion(
        quaternion.exp(start + speed * time),
        torch.randn(batch, frames, 3, generator=generator, dtype=torch.float64),
        torch.randn(batch, 5, 3, generator=generator, dtype=torch.float64),
    )


@pytest.fixture
def motion(generator: torch.Generator) -> Motion:
    """Two motions of twelve frames."""
    return random_motion(2, 12, generator)


@pytest.fixture
def make_forecaster() -> Callable[..., Forecaster]:
    """A forecaster of seven units, the same weights every time, in double precision."""

    def make(*, codec: Codec | None = None, **options: object) -> Forecaster:
        options = {
            "backbone": partial(GRUBackbone, hidden=7, layers=2),
            "head": DenseHead,
            "residual": "compose",
            **options,
        }
        codec = Codec(SKELETON, Quaternion(), root="displacement") if codec is None else codec
        forecaster = Forecaster(codec, **options).double()
        forecaster.reset_parameters(torch.Generator().manual_seed(3))
        return forecaster

    return make


@pytest.fixture
def forecaster(make_forecaster: Callable[..., Forecaster]) -> Forecaster:
    """A velocity model with root channels."""
    return make_forecaster()


@pytest.fixture
def features(forecaster: Forecaster, motion: Motion) -> Tensor:
    """Features (2, 12, 23) of the two motions."""
    return forecaster.codec.encode(motion)
