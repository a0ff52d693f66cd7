"""Walking one character at the published size, frame by frame: how long, how late, how exact.

The network is the long-term pose network of Pavllo et al. 2020, section 3.4: 26 joints of 4 numbers
and 2 root channels, 6 controls through two leaky layers of 30, two GRU layers of 1000, a linear
output, quaternions scaled to unit length. ``step`` reads controls and the last frame and gives the
next; ``frame`` places the joints, too. Every frame is timed on its own.

- ``plain loop``: ``nn.GRU`` and ``nn.Linear`` modules called once a frame; joints one by one as in
  tests/references/plain_kinematics.py.
- ``session``: a session of the forecaster in PyTorch; ``exact`` and ``fast``: of its steppers.
- ``floor``: the bytes of the weights, read once a frame by a sum.

``ratio`` is of the median frames of a round, ``frames_a_second`` of whole rounds, with every hitch.
``difference`` is the largest of any feature over all frames, each candidate on its own. The output
layer stands, as trained ones do: random ones put out quaternions near zero, whose directions mean
nothing.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable
from functools import partial

import torch
from benchmarks.timing import main_of, paired
from tests.references.plain_kinematics import plain_positions
from torch import Tensor, nn

from posecast.export import Stepper
from posecast.geometry import quaternion
from posecast.model import ControlLayers, DenseHead, Forecaster, GRUBackbone, Session
from posecast.representation import Codec, Quaternion
from posecast.skeleton import BodyKinematics, Skeleton

PARAMETERS = 9_529_246
HIDDEN, LAYERS, CONTROLS = 1000, 2, 6
PREFIX, FRAMES = 30, 200
PARENTS = (-1, 0, 1, 2, 3, 0, 5, 6, 7, 0, 9, 10, 11, 12, 11, 14, 15, 16, 17, 11, 19, 20, 21, 22)
PARENTS = (*PARENTS, 21, 16)
"""A hip, two legs, a spine with a head, two arms: 26 joints, in a tree of depth 8."""

Walk = Callable[[bool], tuple[Tensor, list[float]]]
"""Walks ``FRAMES`` frames, placing joints or not; features of all, and seconds of each."""


@torch.inference_mode()
def run(rounds: int = 7) -> list[dict[str, object]]:
    """A row a candidate: ``p50_ms``, ``p99_ms``, ``frames_a_second``, ``ratio``, ``difference``."""
    forecaster = published_network()
    exact, fast = Stepper(forecaster), Stepper(forecaster, "fast")
    alone = Stepper(forecaster, "fast", threads=1)
    prefix, controls = _beginning(forecaster)
    walks: dict[str, Walk] = {
        "plain loop": _plain(forecaster, prefix, controls),
        "session": _session(forecaster, prefix, controls),
        "exact": _session(exact, prefix, controls),
        "fast": _session(fast, prefix, controls),
        "fast, one thread": _session(alone, prefix, controls),
        "floor, exact": _reading(exact.weight_bytes),
        "floor, fast": _reading(fast.weight_bytes),
    }
    found = {name: walk(False)[0] for name, walk in walks.items()}
    rows: list[dict[str, object]] = []
    for task, placed in (("step", False), ("frame", True)):
        kept: dict[str, list[float]] = {name: [] for name in walks}
        calls = {name: partial(_keep, walk, placed, kept[name]) for name, walk in walks.items()}
        timings = paired(calls, "plain loop", rounds=rounds, warmup=0)
        middle = {name: _medians(seconds) for name, seconds in kept.items()}
        for name, timing in timings.items():
            seconds = sorted(kept[name])
            pairs = zip(middle["plain loop"], middle[name], strict=True)
            rows.append(
                {
                    "name": task,
                    "candidate": name,
                    "p50_ms": 1e3 * statistics.median(seconds),
                    "p99_ms": 1e3 * seconds[round(0.99 * (len(seconds) - 1))],
                    "frames_a_second": FRAMES / timing.median_seconds,
                    "ratio": statistics.median(base / own for base, own in pairs),
                    "difference": _largest(found[name], found["plain loop"]),
                    "foreign_load": timing.foreign_load,
                    "threads": torch.get_num_threads(),
                }
            )
    return rows


def published_network() -> Forecaster:
    """The network with random weights, its output layer near a standing pose."""
    skeleton = Skeleton(tuple(f"joint {number}" for number in range(len(PARENTS))), PARENTS)
    forecaster = Forecaster(
        Codec(skeleton, Quaternion(), root="path"),
        backbone=partial(GRUBackbone, hidden=HIDDEN, layers=LAYERS),
        head=DenseHead,
        controls=ControlLayers(CONTROLS),
    )
    forecaster.reset_parameters(torch.Generator().manual_seed(0))
    forecaster.head.start_at(quaternion.identity(len(PARENTS), like=torch.zeros(())))
    found = sum(weight.numel() for weight in forecaster.parameters())
    assert found == PARAMETERS, f"{found} parameters; the published network has {PARAMETERS}"
    return forecaster.eval()


def _beginning(forecaster: Forecaster) -> tuple[Tensor, Tensor]:
    """A prefix, and the controls of it and of all frames that follow."""
    generator = torch.Generator().manual_seed(1)
    joints = torch.randn(1, PREFIX, len(PARENTS), 4, generator=generator)
    root = 0.1 * torch.randn(1, PREFIX, 2, generator=generator)
    prefix = forecaster.codec.merge(quaternion.normalize(joints), root)
    return prefix, torch.randn(1, PREFIX + FRAMES, CONTROLS, generator=generator)


def _body() -> Tensor:
    """Offsets of the joints, metres."""
    return 0.2 * torch.randn(len(PARENTS), 3, generator=torch.Generator().manual_seed(2))


def _root_at(features: Tensor) -> Tensor:
    """Where the root is: as high as the last channel says."""
    return torch.nn.functional.pad(features[..., -1:], (1, 1))


def _plain(forecaster: Forecaster, prefix: Tensor, controls: Tensor) -> Walk:
    """The loop as it is usually written."""
    backbone, head, root = forecaster.backbone, forecaster.head, forecaster.root
    layers = forecaster.controls
    assert isinstance(backbone, GRUBackbone)
    assert isinstance(head, DenseHead)
    assert layers is not None
    assert root is not None
    rotations, offsets = 4 * len(PARENTS), _body()

    def steer(of_frames: Tensor) -> Tensor:
        for layer in layers.layers:
            of_frames = nn.functional.leaky_relu(layer(of_frames), layers.slope)
        return of_frames

    known = torch.cat([prefix[:, :-1], steer(controls[:, : PREFIX - 1])], dim=-1)
    _, begun = backbone.gru(known, torch.stack(backbone.initial_state(1)))

    def walk(placed: bool) -> tuple[Tensor, list[float]]:
        state, frame, frames, seconds = begun, prefix[:, -1], [], []
        for number in range(PREFIX - 1, PREFIX - 1 + FRAMES):
            start = time.perf_counter()
            inputs = torch.cat([frame, steer(controls[:, number])], dim=-1)
            context, state = backbone.gru(inputs[:, None], state)
            joints = head.output(context[:, 0]).view(1, -1, 4)
            joints = joints / joints.norm(dim=-1, keepdim=True)
            frame = torch.cat([joints.view(1, rotations), root(context[:, 0])], dim=-1)
            if placed:
                plain_positions(PARENTS, joints, offsets, _root_at(frame))
            seconds.append(time.perf_counter() - start)
            frames.append(frame)
        return torch.stack(frames, dim=1), seconds

    return walk


def _session(stepping: Forecaster | Stepper, prefix: Tensor, controls: Tensor) -> Walk:
    """A session, of the forecaster or of a stepper."""
    codec, place = stepping.codec, BodyKinematics(stepping.codec.skeleton, _body())
    begun = Session.start(stepping, prefix[:, :-1], controls[:, : PREFIX - 1])
    begun.advance()

    def walk(placed: bool) -> tuple[Tensor, list[float]]:
        session = Session(stepping, begun.state, prefix[:, -1:])
        frames, seconds = [], []
        for number in range(PREFIX - 1, PREFIX - 1 + FRAMES):
            start = time.perf_counter()
            frame = session.step(controls[:, number])
            if placed:
                place(codec.split(frame).joints, _root_at(frame))
            seconds.append(time.perf_counter() - start)
            frames.append(frame)
        return torch.stack(frames, dim=1), seconds

    return walk


def _reading(size: int) -> Walk:
    """Read as many bytes once a frame."""
    weights = torch.ones(size // 4)

    def walk(placed: bool) -> tuple[Tensor, list[float]]:
        seconds = []
        for _ in range(FRAMES):
            start = time.perf_counter()
            weights.sum()
            seconds.append(time.perf_counter() - start)
        return weights[:0], seconds

    return walk


def _medians(seconds: list[float]) -> list[float]:
    """The median frame of every round."""
    return [
        statistics.median(seconds[first : first + FRAMES])
        for first in range(0, len(seconds), FRAMES)
    ]


def _keep(walk: Walk, placed: bool, kept: list[float]) -> None:
    """Walk, and keep the seconds of every frame."""
    kept += walk(placed)[1]


def _largest(found: Tensor, true: Tensor) -> float | None:
    """Largest difference of any feature of any frame; none for the floor, which has no frames."""
    return (found - true).abs().max().item() if len(found) else None


if __name__ == "__main__":
    main_of(run, __doc__, 7)
