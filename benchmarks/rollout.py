"""Frames a second of a session at paper size, beside a plain step of ``torch.nn.GRU``."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import partial

import torch
from benchmarks.timing import paired, table

from posecast.geometry import quaternion
from posecast.model import DenseHead, Forecaster, GRUBackbone, Session
from posecast.representation import Codec, Quaternion
from posecast.skeleton import Skeleton

JOINTS, HIDDEN, LAYERS = 26, 1000, 2
PREFIX, FRAMES = 30, 50
BATCHES = (1, 16)


def run(rounds: int = 7) -> list[dict[str, object]]:
    """Milliseconds a frame for one character and for several.

    ``plain step`` is ``nn.GRU`` on one frame, the linear output and the normalization; ``weights``
    is the time to read all weights once, which no step with few characters can go below.
    """
    skeleton = Skeleton(tuple(map(str, range(JOINTS))), tuple(range(-1, JOINTS - 1)))
    forecaster = Forecaster(
        Codec(skeleton, Quaternion()),
        backbone=partial(GRUBackbone, hidden=HIDDEN, layers=LAYERS),
        head=DenseHead,
    )
    forecaster.reset_parameters(torch.Generator().manual_seed(0))
    forecaster.eval()
    rows: list[dict[str, object]] = []
    with torch.inference_mode():
        for batch in BATCHES:
            generator = torch.Generator().manual_seed(batch)
            prefix = torch.randn(batch, PREFIX, JOINTS, 4, generator=generator)
            prefix = quaternion.normalize(prefix).flatten(-2)
            candidates = {
                "plain step": _plain(forecaster, prefix),
                "session": _session(forecaster, prefix),
                "weights": partial(_read, list(forecaster.parameters())),
            }
            times = paired(candidates, reference="plain step", rounds=rounds)
            for name, timing in times.items():
                rows.append(
                    {
                        "characters": batch,
                        "step": name,
                        "ms_a_frame": 1e3 * timing.median_seconds / FRAMES,
                        "ratio": timing.ratio,
                        "frames_a_second": batch * FRAMES / timing.median_seconds,
                        "difference": _difference(forecaster, prefix)
                        if name == "session"
                        else None,
                        "foreign_load": timing.foreign_load,
                        "threads": torch.get_num_threads(),
                    }
                )
    return rows


def _plain(forecaster: Forecaster, prefix: torch.Tensor) -> Callable[[], torch.Tensor]:
    """Frames by one call of ``nn.GRU`` each."""
    backbone, head = forecaster.backbone, forecaster.head
    assert isinstance(backbone, GRUBackbone)
    _, first = backbone.gru(prefix[:, :-1], torch.stack(backbone.initial_state(len(prefix))))

    def call() -> torch.Tensor:
        frame, state = prefix[:, -1], first
        for _ in range(FRAMES):
            context, state = backbone.gru(frame[:, None], state)
            frame = quaternion.normalize(head(context[:, -1])).flatten(-2)
        return frame

    return call


def _session(forecaster: Forecaster, prefix: torch.Tensor) -> Callable[[], torch.Tensor]:
    """Frames by the steps of a session."""
    start = Session.start(forecaster, prefix[:, :-1])
    start.advance()

    def call() -> torch.Tensor:
        session = Session(forecaster, start.state, prefix[:, -1:])
        frame = prefix[:, -1]
        for _ in range(FRAMES):
            frame = session.step()
        return frame

    return call


def _read(weights: list[torch.Tensor]) -> None:
    """Look at every weight once a frame."""
    for _ in range(FRAMES):
        for weight in weights:
            weight.sum()


def _difference(forecaster: Forecaster, prefix: torch.Tensor) -> float:
    """Largest difference of the last frames of both."""
    return float((_plain(forecaster, prefix)() - _session(forecaster, prefix)()).abs().max())


def main() -> None:
    """Print the table, then the same as JSON."""
    rows = run()
    print(table(rows))
    print(json.dumps(rows))


if __name__ == "__main__":
    main()
