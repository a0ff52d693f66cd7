"""A walker that knows nothing, and paths to walk."""

from __future__ import annotations

import pytest
import torch

from posecast.generation import Course, GaitTable, Walk, pace_by_hand
from posecast.model import ControlLayers, DenseHead, Forecaster, GRUBackbone
from posecast.motion.path import Path
from posecast.representation import Codec, Controls, Quaternion
from posecast.skeleton import Skeleton

SKELETON = Skeleton(("hips", "left_leg", "right_leg", "head"), (-1, 0, 0, 0))
OFFSETS = torch.tensor([[0, 0, 0], [0.1, -0.8, 0], [-0.1, -0.8, 0], [0, 0.6, 0]])
STYLES = ("calm", "wild")


@pytest.fixture
def table() -> GaitTable:
    """Walks of two styles, from 0.5 to 2.5 m/s."""
    speeds = torch.linspace(0.5, 2.5, 9).double().expand(2, -1)
    rates = torch.stack([4 + 2 * speeds[0], 5 + 3 * speeds[1]])
    pose = torch.zeros(19).double()
    pose[[0, 4, 8, 12]] = 1
    pose[17] = 0.8
    return GaitTable(
        speeds=speeds,
        step_rates=rates,
        sideways=torch.tensor([2.0, 3.0]).double(),
        gathering=torch.tensor([1.0, 2.0]).double(),
        poses=pose.expand(2, -1),
    )


@pytest.fixture
def forecaster() -> Forecaster:
    """A pose network with drawn weights."""
    codec = Codec(SKELETON, Quaternion(), root="path_lateral", controls=Controls(STYLES))
    found = Forecaster(
        codec,
        backbone=lambda inputs: GRUBackbone(inputs, hidden=12, layers=1),
        head=DenseHead,
        controls=ControlLayers(codec.controls.dim),
    )
    found.reset_parameters(torch.Generator().manual_seed(3))
    return found.eval()


@pytest.fixture
def bend() -> Path:
    """Straight on, then a sharp corner to the left, then straight: 8 m."""
    return Path.through(
        torch.tensor([[0.0, 0.0], [0.0, 4.0], [4.0, 4.0]]).double(), straight=True, spacing=0.02
    )


@pytest.fixture
def circle() -> Path:
    """A closed circle of 2 m."""
    angles = torch.arange(32).double() * (torch.pi / 16)
    points = 2 * torch.stack([angles.sin(), angles.cos()], dim=-1)
    return Path.through(points, closed=True, spacing=0.02)


@pytest.fixture
def make_walk(forecaster, table, bend):
    """A walk along a course, by default along the bend at 1 m/s."""

    def make(course: Course | None = None, **options) -> Walk:
        chosen = pace_by_hand(bend, table, speed=1.0) if course is None else course
        return Walk(forecaster, chosen, table, OFFSETS, fps=30.0, **options)

    return make
