"""Drawing one training batch, as a share of the training step that it feeds."""

from __future__ import annotations

import json
import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import torch
from benchmarks.timing import table

from posecast.geometry import quaternion
from posecast.model import DenseHead, Forecaster, GRUBackbone
from posecast.motion import Clip
from posecast.motion.corpus import Corpus
from posecast.motion.store import pack
from posecast.representation import Codec
from posecast.representation.rotations import Quaternion
from posecast.skeleton import Skeleton
from posecast.training import Objective, Windows, training_loss

BATCH, PREFIX, HORIZON = 60, 50, 10
JOINTS, HIDDEN, LAYERS = 32, 1000, 2
RECORDINGS, FRAMES = 120, 1500
STEPS_TIMED, BATCHES_TIMED = 5, 60
GOAL = 0.05


def run() -> list[dict[str, object]]:
    """Milliseconds of a batch of 60 x 60 frames of 32 joints, and its share of the step.

    The step is QuaterNet's at paper size: forward, backward and Adam, half of the frames true.
    """
    clips = _clips()
    splits = {"train": tuple(range(len(clips)))}
    with tempfile.TemporaryDirectory() as folder:
        corpora = {
            "clips in memory": Corpus("memory", clips, splits),
            "packed store": Corpus("store", pack(clips, Path(folder) / "store"), splits),
        }
        step = _median(_training_step(corpora["clips in memory"]), STEPS_TIMED)
        rows: list[dict[str, object]] = []
        for name, corpus in corpora.items():
            for turn in (False, True):
                batch = _median(_next_batch(corpus, turn=turn), BATCHES_TIMED)
                rows.append(
                    {
                        "corpus": name,
                        "augmentation": "turned and mirrored" if turn else "none",
                        "batch_ms": 1e3 * batch,
                        "step_ms": 1e3 * step,
                        "share": batch / step,
                        "goal": GOAL,
                    }
                )
    return rows


def _clips() -> list[Clip]:
    """Random recordings of one skeleton, as large as a corpus of one actor."""
    generator = torch.Generator().manual_seed(0)
    pairs = [f"{side}Joint{index}" for index in range(JOINTS // 2) for side in ("Left", "Right")]
    skeleton = Skeleton(tuple(pairs), tuple(range(-1, JOINTS - 1)))
    return [
        Clip(
            skeleton=skeleton,
            offsets=torch.randn(JOINTS, 3, generator=generator),
            fps=25.0,
            root_positions=torch.randn(FRAMES, 3, generator=generator),
            rotations_local=quaternion.normalize(
                torch.randn(FRAMES, JOINTS, 4, generator=generator)
            ),
        )
        for _ in range(RECORDINGS)
    ]


def _next_batch(corpus: Corpus, *, turn: bool) -> Callable[[], object]:
    """Draws another batch with every call."""
    windows = Windows(corpus, length=PREFIX + HORIZON, batch=BATCH, seed=0, turn=turn, mirror=turn)
    drawn = iter(range(10**9))

    def draw() -> object:
        epoch, step = divmod(next(drawn), windows.steps)
        return windows.share(epoch, step)

    return draw


def _training_step(corpus: Corpus) -> Callable[[], object]:
    """One update of the velocity network at paper size, on a batch that is there already."""
    forecaster = Forecaster(
        Codec(corpus.skeleton, Quaternion()),
        backbone=lambda inputs: GRUBackbone(inputs, hidden=HIDDEN, layers=LAYERS),
        head=DenseHead,
        residual="compose",
    )
    forecaster.reset_parameters(torch.Generator().manual_seed(0))
    optimizer = torch.optim.Adam(forecaster.parameters(), fused=True)
    motion = Windows(corpus, length=PREFIX + HORIZON, batch=BATCH, seed=0).share(0, 0).motion
    objective = Objective({"euler": 1.0, "penalty": 0.01})
    mask = [step % 2 == 0 for step in range(HORIZON)]

    def update() -> object:
        optimizer.zero_grad()
        loss = training_loss(forecaster, motion, prefix=PREFIX, mask=mask, objective=objective)
        loss.total.backward()
        torch.nn.utils.clip_grad_norm_(forecaster.parameters(), 0.1)
        optimizer.step()
        return loss

    return update


def _median(call: Callable[[], object], times: int) -> float:
    """Median seconds of a call, after one that is not counted."""
    call()
    seconds = []
    for _ in range(times):
        start = time.perf_counter()
        call()
        seconds.append(time.perf_counter() - start)
    return statistics.median(seconds)


def main() -> None:
    """Print the table, then the same as JSON."""
    rows = run()
    print(table(rows))
    print(json.dumps(rows))


if __name__ == "__main__":
    main()
