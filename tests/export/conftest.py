"""Small forecasters to export."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import pytest
import torch

from posecast.geometry import quaternion
from posecast.model import BACKBONES, HEADS, ControlLayers, Forecaster
from posecast.motion import Motion
from posecast.representation import Codec, build_representation
from posecast.skeleton import Skeleton

SKELETON = Skeleton(("hips", "spine", "head", "left", "right"), (-1, 0, 1, 1, 1))
OFFSETS = ((0.0, 0.9, 0.0), (0.0, 0.5, 0.0), (0.0, 0.3, 0.0), (0.3, 0.0, 0.1), (-0.3, 0.0, 0.1))
PARTS = {
    "torso": ["spine"],
    "left_arm": ["left"],
    "right_arm": ["right"],
    "left_leg": ["head"],
    "right_leg": ["hips"],
}
BACKBONE_OPTIONS: dict[str, dict[str, object]] = {
    "convolutional": {"channels": 6, "widths": [2, 3, 2], "dilations": [1, 2, 1]},
    "early_reset_gru": {"hidden": 6, "layers": 2},
    "gru": {"hidden": 7, "layers": 2},
    "lstm": {"hidden": 6, "layers": 2, "wiring": "delayed", "initial_state": "learned"},
    "structural_rnn": {"hidden": 5, "encoder": 4, "parts": PARTS},
}
CONTROLS = 6


@pytest.fixture
def motion(generator: torch.Generator) -> Motion:
    """Two motions of sixteen frames, a run and a walk."""
    start, speed = 0.5 * torch.randn(2, 2, 1, 5, 3, generator=generator)
    time = torch.arange(16)[:, None, None] / 10
    return Motion(
        quaternion.exp(start + speed * time),
        0.1 * torch.randn(2, 16, 3, generator=generator),
        torch.tensor(OFFSETS).expand(2, -1, -1),
        actions=("run", "walk"),
    )


@pytest.fixture
def make(motion: Motion) -> Callable[..., Forecaster]:
    """A small forecaster of standardized features, the same weights every time."""

    def make(
        backbone: str = "gru",
        head: str = "dense",
        representation: str = "quaternion",
        *,
        backbone_options: dict[str, object] | None = None,
        steered: bool = False,
        codec_options: dict[str, object] | None = None,
        codec: Codec | None = None,
        **options: object,
    ) -> Forecaster:
        written = build_representation(representation, SKELETON)
        plain = partial(Codec, SKELETON, written, "displacement", **(codec_options or {}))
        chosen = BACKBONE_OPTIONS[backbone] if backbone_options is None else backbone_options
        forecaster = Forecaster(
            plain(statistics=plain().measure([motion])) if codec is None else codec,
            backbone=partial(BACKBONES[backbone], **chosen),
            head=HEADS[head],
            controls=ControlLayers(CONTROLS, hidden=4) if steered else None,
            **options,
        )
        forecaster.reset_parameters(torch.Generator().manual_seed(3))
        return forecaster.eval()

    return make
