"""A tiny corpus of swinging joints and a tiny forecaster, in a module that a subprocess can run."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import torch
from safetensors.torch import save_file

from posecast.geometry.euler import euler_to_quaternion
from posecast.model import DenseHead, Forecaster, GRUBackbone, rollout
from posecast.motion import Clip
from posecast.motion.corpus import Corpus
from posecast.representation import Codec
from posecast.representation.rotations import Quaternion
from posecast.skeleton import Skeleton
from posecast.training import Adversary, FitResult, Machines, Objective, Plan, fit
from posecast.training.feeding import ScheduledSampling
from posecast.training.losses import euler_l1

PREFIX, HORIZON = 10, 5
SKELETON = Skeleton(("hips", "spine", "head", "left_arm", "right_arm"), (-1, 0, 1, 1, 1))
OFFSETS = torch.tensor([[0, 0, 0], [0, 0.5, 0], [0, 0.3, 0], [0.2, 0.2, 0], [-0.2, 0.2, 0]])


def swinging_clip(seed: int, frames: int) -> Clip:
    """Every Euler angle a sine of its own frequency, amplitude and phase; the root drifts."""
    generator = torch.Generator().manual_seed(seed)
    amplitude, rate, phase = torch.rand(3, len(SKELETON), 3, generator=generator).unbind(0)
    time = torch.arange(frames)[:, None, None] / 25
    angles = 0.6 * amplitude * torch.sin(math.tau * ((0.3 + rate) * time + phase))
    height = 1 + 0.05 * torch.sin(8 * time[:, 0])
    drift = torch.cat([0.4 * time[:, 0], height, 0.1 * time[:, 0].square()], dim=-1)
    return Clip(
        skeleton=SKELETON,
        offsets=OFFSETS * (1 + 0.1 * seed),
        fps=25.0,
        root_positions=drift,
        rotations_local=euler_to_quaternion(angles, "zyx"),
        name=f"swing-{seed}",
    )


def tiny_corpus(lengths: tuple[int, ...] = (40, 30, 55, 12, 70)) -> Corpus:
    """One recording of each length for training, and two of 40 frames for validation."""
    clips = [swinging_clip(seed, frames) for seed, frames in enumerate((*lengths, 40, 40))]
    train = tuple(range(len(lengths)))
    return Corpus(
        "swinging", clips, {"train": train, "validation": (len(lengths), len(lengths) + 1)}
    )


def tiny_forecaster(
    *, dropout: float = 0.0, root: str = "none", hidden: int = 24, seed: int = 5
) -> Forecaster:
    """A velocity model; the same weights for the same seed."""
    codec = Codec(SKELETON, Quaternion(), root=root)
    forecaster = Forecaster(
        codec,
        backbone=lambda inputs: GRUBackbone(inputs, hidden=hidden, layers=1),
        head=DenseHead,
        residual="compose",
        input_dropout=dropout,
    )
    forecaster.reset_parameters(torch.Generator().manual_seed(seed))
    return forecaster


def forecast_error(
    forecaster: Forecaster, corpus: Corpus, split: str = "validation"
) -> dict[str, float]:
    """Error of free forecasts over a split, radians, and that of holding still."""
    windows = corpus.windows(split, PREFIX + HORIZON, stride=5)
    motion = corpus.gather(windows, PREFIX + HORIZON)
    features = forecaster.codec.encode(motion)
    found = rollout(forecaster, features[:, :PREFIX], HORIZON).features
    still = features[:, PREFIX - 1 : PREFIX].expand_as(found)
    truth = motion.rotations_local[:, PREFIX:]
    return {
        name: float(euler_l1(forecaster.codec.split(guess).joints, truth))
        for name, guess in {"forecast": found, "still": still}.items()
    }


def save_weights(folder: Path, forecaster: Forecaster, progress: Mapping[str, Any]) -> None:
    """A stand-in for a checkpoint: the weights and what is known of them."""
    folder.mkdir(exist_ok=True)
    save_file(forecaster.state_dict(), folder / "weights.safetensors")
    (folder / "progress.json").write_text(json.dumps(progress))


def train(
    folder: Path,
    *,
    epochs: int,
    forecaster: Forecaster | None = None,
    devices: int | None = None,
    accelerator: str = "cpu",
    cuda_graphs: bool = False,
    resume: bool = False,
    on_validation: Callable[[], None] = lambda: None,
    adversary: Adversary | None = None,
    **plan: Any,
) -> FitResult:
    """The run that the tests interrupt, resume and spread over processes."""

    corpus = tiny_corpus()

    def validate(model: Forecaster) -> dict[str, float]:
        on_validation()
        return forecast_error(model, corpus)

    return fit(
        forecaster or tiny_forecaster(),
        corpus,
        Plan(
            **{
                "epochs": epochs,
                "batch": 3,
                "prefix": PREFIX,
                "horizon": HORIZON,
                "save_every": 3,
                "turn": True,
                **plan,
            }
        ),
        objective=Objective({"euler": 1.0, "penalty": 0.01}),
        feed=ScheduledSampling(0.98),
        adversary=adversary,
        folder=folder,
        machines=Machines(accelerator, devices or "auto", cuda_graphs=cuda_graphs),
        validate=validate,
        save=save_weights,
        resume=resume,
        progress=False,
        loggers=(),
    )
