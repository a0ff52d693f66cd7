"""Small corpora for the tests of evaluation."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import pytest
import torch

from posecast.corpora.gait.body import CAST
from posecast.corpora.gait.body import SKELETON as BODY
from posecast.generation import Course, GaitTable, timed
from posecast.geometry import quaternion
from posecast.motion import Clip, Path, find_feet
from posecast.motion.corpus import Corpus
from posecast.motion.tracks import turned_on_floor
from posecast.skeleton import Skeleton
from posecast.skeleton.kinematics import joint_positions

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


class Statue(NamedTuple):
    """How a stiff body glides towards +z, without moving a joint; see ``make_statue``."""

    frames: int = 301
    fps: float = 30.0
    speed: float = 1.0
    ahead: float = 0.0
    beside: float = 0.0
    height: float = 0.0
    turned: float = 0.0
    pitched: float = 0.0


@pytest.fixture
def make_statue() -> Callable[..., Clip]:
    """``make_statue(**fields of Statue)``: a body on two feet, its toes at ``height``, which
    ``turned`` to the left and ``pitched`` forwards (degrees) glides from (``beside``, ``ahead``).
    """
    body = next(iter(CAST))

    def make(**wishes: float) -> Clip:
        statue = Statue(**wishes)
        joints = len(BODY)
        time = torch.arange(statue.frames, dtype=torch.float64) / statue.fps
        rotations = quaternion.identity(joints, like=body.offsets.double())
        up, left = torch.eye(3, dtype=torch.float64)[[1, 0]]
        turned, pitched = (
            torch.deg2rad(torch.tensor(angle).double()) for angle in (statue.turned, statue.pitched)
        )
        rotations[0] = quaternion.product(
            quaternion.about_axis(up, turned), quaternion.about_axis(left, pitched)
        )
        rest = joint_positions(BODY, rotations, body.offsets.double())
        toes = list(find_feet(BODY, body.offsets).toes)
        root = torch.stack(
            [
                torch.full_like(time, statue.beside),
                torch.full_like(time, statue.height - float(rest[toes, 1].mean())),
                statue.ahead + statue.speed * time,
            ],
            dim=-1,
        )
        return Clip(
            BODY, body.offsets.double(), statue.fps, root, rotations.repeat(statue.frames, 1, 1)
        )

    return make


@pytest.fixture
def make_course() -> Callable[..., Course]:
    """``make_course(path, speed=1.0, facing=0.0)``: even speed, facing so many degrees to the left
    of the path."""

    def make(path: Path, *, speed: float = 1.0, facing: float = 0.0) -> Course:
        ahead = turned_on_floor(path.tangents, math.radians(facing))
        path = path.with_scalar("speed", speed).with_scalar("step_rate", 6.0)
        return timed(path.with_direction("facing", ahead))

    return make


@pytest.fixture
def straight() -> Path:
    """Ten metres towards +z, a way point every two."""
    points = torch.stack([torch.zeros(6), 2 * torch.arange(6.0)], dim=-1)
    return Path.through(points.double())


@pytest.fixture
def walk_table() -> GaitTable:
    """Walks from 0.5 to 2.5 m/s."""
    speeds = torch.linspace(0.5, 2.5, 9).double()[None]
    return GaitTable(
        speeds=speeds,
        step_rates=4 + 2 * speeds,
        sideways=torch.tensor([2.0]).double(),
        gathering=torch.tensor([1.0]).double(),
        poses=torch.zeros(1, 1).double(),
    )
