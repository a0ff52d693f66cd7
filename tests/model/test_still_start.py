"""A forecaster told to begin still repeats its last frame before it is trained."""

from __future__ import annotations

from functools import partial

import pytest
import torch

from posecast.errors import ConfigError
from posecast.geometry import quaternion
from posecast.model import DenseHead, Forecaster, GRUBackbone, rollout
from posecast.representation import Codec, Quaternion
from posecast.skeleton import Skeleton

SKELETON = Skeleton(("Hips", "Spine", "Head"), (-1, 0, 1))


def _forecaster(residual: str, still_start: bool) -> Forecaster:
    return Forecaster(
        Codec(SKELETON, Quaternion(), root="displacement"),
        backbone=partial(GRUBackbone, hidden=32),
        head=DenseHead,
        residual=residual,
        still_start=still_start,
    )


def _change(forecaster: Forecaster, generator: torch.Generator) -> float:
    """Mean change of the features over ten frames of rollout."""
    rotations = quaternion.normalize(torch.randn(4, 5, 3, 4, generator=generator))
    prefix = torch.cat([rotations.flatten(-2), torch.rand(4, 5, 3, generator=generator)], dim=-1)
    with torch.no_grad():
        predicted = rollout(forecaster, prefix, 10).features
    return float((predicted - prefix[:, -1:]).abs().mean())


@pytest.mark.parametrize("residual", ["add", "compose"])
def test_a_still_start_nearly_repeats_the_last_frame(
    residual: str, generator: torch.Generator
) -> None:
    forecaster = _forecaster(residual, still_start=True)
    forecaster.reset_parameters(generator)
    still = _change(forecaster, generator)
    other = _forecaster(residual, still_start=False)
    other.reset_parameters(generator)
    assert still < 0.1
    assert still < 0.3 * _change(other, generator)


def test_a_still_start_without_a_residual_is_refused() -> None:
    with pytest.raises(ConfigError, match="without a residual"):
        _forecaster("none", still_start=True)
