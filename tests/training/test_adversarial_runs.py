"""Whole runs against discriminators: each update by hand, killing and resuming, what is kept."""

from __future__ import annotations

import csv
import json
import signal
import subprocess
import sys
import time
from dataclasses import asdict
from pathlib import Path

import pytest
import torch
from safetensors.torch import load_file
from torch import nn
from torch.nn.functional import binary_cross_entropy_with_logits

from posecast.errors import ConfigError
from posecast.model import rollout
from posecast.training import STATE, Adversary, Objective
from posecast.training.feeding import ScheduledSampling
from posecast.training.sampling import Windows
from posecast.training.schedules import derived_generator
from posecast.training.state import read_state
from posecast.training.step import training_loss

ADVERSARY = Adversary(fidelity=0.3, continuity=0.2, hidden=6, learning_rate=0.004)
EPOCHS = 16


def rows(folder: Path, table: str = "log.csv") -> list[dict[str, str]]:
    """A table without the column that depends on the clock."""
    with (folder / table).open(newline="") as file:
        found = list(csv.DictReader(file))
    return [{name: value for name, value in row.items() if name != "seconds"} for row in found]


def tensors(folder: Path) -> dict[str, torch.Tensor]:
    """Everything in a state, discriminators and moments of both optimizers included."""
    return load_file(folder / STATE)


def same_tensors(one: dict[str, torch.Tensor], other: dict[str, torch.Tensor]) -> bool:
    """Whether the same names have the same numbers, bit by bit."""
    return one.keys() == other.keys() and all(torch.equal(one[name], other[name]) for name in one)


@pytest.fixture(scope="module")
def whole(tiny, tmp_path_factory):
    """The folder of an uninterrupted run, and how it ended."""
    folder = tmp_path_factory.mktemp("whole")
    return folder, tiny.train(folder, epochs=EPOCHS, adversary=ADVERSARY)


class ByHand(nn.Module):
    """A discriminator of PyTorch's own parts."""

    def __init__(self, features: int, hidden: int) -> None:
        super().__init__()
        self.input = nn.Linear(features, hidden)
        self.recurrent = nn.ModuleDict({"gru": nn.GRU(hidden, hidden, batch_first=True)})
        self.output = nn.Linear(hidden, 1)

    def forward(self, frames: torch.Tensor) -> torch.Tensor:
        _, last = self.recurrent["gru"](self.input(frames).clamp(min=0))
        return self.output(last[0])[:, 0]


def clip(weights: list[nn.Parameter], limit: float) -> None:
    """Shorten the gradient of all weights together."""
    norm = torch.stack([weight.grad.square().sum() for weight in weights]).sum().sqrt()
    for weight in weights:
        weight.grad.mul_(min(1.0, limit / float(norm)))


@pytest.mark.parametrize("every", [None, 4])
def test_each_update_is_that_of_two_losses_written_by_hand(every, tiny, tmp_path):
    limit, decay, epochs = 0.1, 0.5, 3
    schedule = {"decay": decay, "decay_every": every}
    # The run's own first discriminators: nothing has moved them when the rate is next to none.
    still = Adversary(**{**asdict(ADVERSARY), "learning_rate": 1e-30})
    tiny.train(tmp_path / "first", epochs=1, adversary=still)
    first = read_state(tmp_path / "first" / STATE).discriminators
    trained, by_hand = tiny.tiny_forecaster(), tiny.tiny_forecaster()
    folder = tmp_path / "run"
    tiny.train(
        folder, epochs=epochs, forecaster=trained, adversary=ADVERSARY, clip=limit, **schedule
    )
    rivals = nn.ModuleDict(
        {name: ByHand(by_hand.codec.feature_dim, 6) for name in ("fidelity", "continuity")}
    )
    rivals.load_state_dict(dict(first))
    windows = Windows(
        tiny.tiny_corpus(), length=tiny.PREFIX + tiny.HORIZON, batch=3, seed=0, turn=True
    )
    own, theirs = list(by_hand.parameters()), list(rivals.parameters())
    optimizers = [torch.optim.Adam(own), torch.optim.Adam(theirs)]
    objective, feed = Objective({"euler": 1.0, "penalty": 0.01}), ScheduledSampling(0.98)
    logged, counted = {"loss": 0.0, "fidelity/loss": 0.0, "continuity/accuracy": 0.0}, 0
    for epoch in range(epochs):
        for step in range(windows.steps):
            motion = windows.share(epoch, step).motion
            mask = feed.mask(tiny.HORIZON, epoch, derived_generator(0, "feed", epoch, step))
            objective_loss = training_loss(
                by_hand, motion, prefix=tiny.PREFIX, mask=mask, objective=objective
            ).total
            features = by_hand.codec.encode(motion)
            given, true = features[:, : tiny.PREFIX], features[:, tiny.PREFIX :]
            found = rollout(by_hand, given, tiny.HORIZON, truth=true, truth_mask=mask).features
            views = {
                "fidelity": (true, found),
                "continuity": (torch.cat([given, true], 1), torch.cat([given, found], 1)),
            }
            total, judged, right = objective_loss, {}, {}
            for name, (real, made) in views.items():
                ones = torch.ones(len(real))
                entropy = binary_cross_entropy_with_logits
                weight = getattr(ADVERSARY, name)
                total = total + weight * entropy(rivals[name](made), ones)
                logits = rivals[name](real), rivals[name](made.detach())
                judged[name] = entropy(logits[0], ones) + entropy(logits[1], 1 - ones)
                right[name] = torch.cat([logits[0] > 0, logits[1] <= 0]).float().mean()
            gradients = torch.autograd.grad(total, own)
            their_gradients = torch.autograd.grad(sum(judged.values()), theirs)
            for optimizer, weights, new, rate in zip(
                optimizers,
                (own, theirs),
                (gradients, their_gradients),
                (0.001, 0.004),
                strict=True,
            ):
                for weight, gradient in zip(weights, new, strict=True):
                    weight.grad = gradient.clone()
                clip(weights, limit)
                update = epoch * windows.steps + step
                decays = epoch if every is None else update // every
                optimizer.param_groups[0]["lr"] = rate * decay**decays
                optimizer.step()
            if epoch == epochs - 1:
                values = total, judged["fidelity"], right["continuity"]
                for name, value in zip(logged, values, strict=True):
                    logged[name] += len(given) * float(value.detach())
                counted += len(given)
    # A step is 1e-3 at first; sums in another order differ by float32's last places.
    for found, expected in zip(trained.parameters(), own, strict=True):
        torch.testing.assert_close(found, expected, rtol=1e-5, atol=5e-6)
    ended = read_state(folder / STATE).discriminators
    assert len(ended) == 16
    for name, value in rivals.state_dict().items():
        torch.testing.assert_close(ended[name], value, rtol=1e-5, atol=2e-5, msg=name)
        assert not torch.equal(first[name], value)
    last = rows(folder)[-1]
    for name, value in logged.items():
        assert float(last[name]) == pytest.approx(value / counted, rel=1e-4)


def test_a_run_logs_both_sides_and_keeps_discriminators_in_its_state_alone(whole):
    folder, _ = whole
    assert list(rows(folder)[0]) == [
        *("epoch", "updates", "loss", "loss/euler", "loss/penalty"),
        *("loss/fidelity", "loss/continuity", "fidelity/loss", "fidelity/accuracy"),
        *("continuity/loss", "continuity/accuracy"),
        *("gradient_norm", "learning_rate", "teacher_forcing"),
    ]
    row = {name: float(value) for name, value in rows(folder)[-1].items()}
    assert row["loss"] == pytest.approx(
        row["loss/euler"]
        + 0.01 * row["loss/penalty"]
        + 0.3 * row["loss/fidelity"]
        + 0.2 * row["loss/continuity"]
    )
    assert 0 < row["fidelity/accuracy"] <= 1
    state = read_state(folder / STATE)
    assert {name.split(".")[0] for name in state.discriminators} == {"fidelity", "continuity"}
    # Adam: a mean, a square and a count for each tensor.
    assert len(state.discriminator_moments) == 3 * len(state.discriminators)
    for checkpoint in ("best", "last"):
        saved = load_file(folder / checkpoint / "weights.safetensors")
        assert saved.keys() == state.weights.keys()
    assert "fidelity" not in {name.split(".")[0] for name in state.weights}


def test_a_killed_run_with_discriminators_goes_on_as_if_nothing_had_happened(tiny, whole, tmp_path):
    folder = tmp_path / "run"
    worker = Path(__file__).with_name("worker.py")
    adversary = json.dumps(asdict(ADVERSARY))
    arguments = [sys.executable, worker, folder, str(EPOCHS), "0.15", "auto", adversary]
    run = subprocess.Popen(arguments)
    try:
        deadline = time.monotonic() + 120
        while not ((folder / STATE).exists() and len(rows(folder)) >= 4):
            assert run.poll() is None
            assert time.monotonic() < deadline
            time.sleep(0.02)
    finally:
        run.send_signal(signal.SIGKILL)
        run.wait()
    assert len(rows(folder)) < EPOCHS
    forecaster = tiny.tiny_forecaster(seed=99)  # other weights, to be replaced by the state's
    result = tiny.train(
        folder, epochs=EPOCHS, forecaster=forecaster, adversary=ADVERSARY, resume=True
    )
    assert rows(folder) == rows(whole[0])
    assert rows(folder, "validation.csv") == rows(whole[0], "validation.csv")
    assert same_tensors(tensors(folder), tensors(whole[0]))
    assert result == whole[1]._replace(folder=folder)


@pytest.mark.parametrize("optimizer", ["adam", "sgd"])
def test_a_run_with_discriminators_can_be_made_longer(optimizer, tiny, tmp_path):
    straight, halted = (tiny.tiny_forecaster(dropout=0.3) for _ in range(2))
    plan = {"adversary": ADVERSARY, "optimizer": optimizer}
    tiny.train(tmp_path / "straight", epochs=6, forecaster=straight, **plan)
    tiny.train(tmp_path / "halted", epochs=3, forecaster=halted, **plan)
    tiny.train(tmp_path / "halted", epochs=6, forecaster=halted, resume=True, **plan)
    assert rows(tmp_path / "halted") == rows(tmp_path / "straight")
    assert same_tensors(tensors(tmp_path / "halted"), tensors(tmp_path / "straight"))


def test_discriminators_that_weigh_nothing_change_nothing(tiny, tmp_path):
    # So small that a float32 that it is added to stays what it is.
    nothing = Adversary(fidelity=1e-30, continuity=1e-30, hidden=6)
    alone, opposed, pushed = (tiny.tiny_forecaster(dropout=0.3) for _ in range(3))
    tiny.train(tmp_path / "alone", epochs=4, forecaster=alone)
    tiny.train(tmp_path / "opposed", epochs=4, forecaster=opposed, adversary=nothing)
    tiny.train(tmp_path / "pushed", epochs=4, forecaster=pushed, adversary=ADVERSARY)
    assert same_tensors(alone.state_dict(), opposed.state_dict())
    assert not same_tensors(alone.state_dict(), pushed.state_dict())
    names = rows(tmp_path / "alone")[0].keys()
    shared = [{name: row[name] for name in names} for row in rows(tmp_path / "opposed")]
    assert shared == rows(tmp_path / "alone")


def test_a_run_without_an_adversary_says_nothing_of_one(tiny, tmp_path):
    tiny.train(tmp_path, epochs=1)
    state = read_state(tmp_path / STATE)
    assert "adversary" not in state.settings
    assert not state.discriminators
    assert not state.discriminator_moments
    assert not [name for name in rows(tmp_path)[0] if "fidelity" in name or "continuity" in name]


@pytest.mark.parametrize("other", [None, Adversary(fidelity=0.3, hidden=6)])
def test_a_run_is_not_resumed_against_others(other, tiny, whole):
    with pytest.raises(ConfigError, match=r"adversary was \{'fidelity': 0.3, 'cont.*, now "):
        tiny.train(whole[0], epochs=EPOCHS, resume=True, adversary=other)


def test_training_against_discriminators_leaves_the_global_random_state_alone(tiny, tmp_path):
    forecaster = tiny.tiny_forecaster(dropout=0.3)
    before = torch.get_rng_state()
    tiny.train(tmp_path, epochs=2, forecaster=forecaster, adversary=ADVERSARY)
    assert torch.equal(torch.get_rng_state(), before)


def test_early_stopping_looks_at_validation_alone(tiny, tmp_path, monkeypatch):
    values = iter([5.0, 4.0, 4.5, 4.4, 1.0, 1.0])
    monkeypatch.setattr(tiny, "forecast_error", lambda model, corpus: {"forecast": next(values)})
    found = tiny.train(tmp_path, epochs=6, adversary=ADVERSARY, patience=2)
    assert (found.epochs, found.best.epoch) == (4, 2)


@pytest.mark.gpu
def test_a_gpu_learns_against_discriminators_what_a_cpu_learns(tiny, whole, tmp_path):
    tiny.train(tmp_path, epochs=EPOCHS, adversary=ADVERSARY, accelerator="gpu")
    for on_gpu, on_cpu in zip(rows(tmp_path), rows(whole[0]), strict=True):
        for name in ("loss", "fidelity/loss", "continuity/loss"):
            assert float(on_gpu[name]) == pytest.approx(float(on_cpu[name]), rel=0.02)
