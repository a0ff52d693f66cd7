"""Whole runs: learning by heart, killing and resuming, what is kept and what is refused."""

from __future__ import annotations

import csv
import json
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import pytest
import torch
from safetensors.torch import load_file

from posecast.errors import ConfigError, DataError, SkeletonError
from posecast.model import Forecaster
from posecast.skeleton import Skeleton
from posecast.training import STATE, Objective, Plan, fit, keeping
from posecast.training.feeding import ScheduledSampling
from posecast.training.state import read_state

EPOCHS = 40


def rows(folder: Path, table: str = "log.csv") -> list[dict[str, str]]:
    """A table without the column that depends on the clock."""
    with (folder / table).open(newline="") as file:
        found = list(csv.DictReader(file))
    return [{name: value for name, value in row.items() if name != "seconds"} for row in found]


@pytest.fixture(scope="module")
def whole(tiny, tmp_path_factory):
    """An uninterrupted run: its folder and the forecaster it ended with."""
    folder, forecaster = tmp_path_factory.mktemp("whole"), tiny.tiny_forecaster()
    return folder, forecaster, tiny.train(folder, epochs=EPOCHS, forecaster=forecaster)


def same_weights(first: Forecaster, second: Forecaster) -> bool:
    """Whether two forecasters are equal bit by bit."""
    pairs = zip(first.state_dict().items(), second.state_dict().items(), strict=True)
    return all(one[0] == two[0] and torch.equal(one[1], two[1]) for one, two in pairs)


def test_a_run_learns_four_windows_by_heart(tiny, tmp_path):
    length = tiny.PREFIX + tiny.HORIZON
    corpus = tiny.tiny_corpus((length,) * 4)
    forecaster = tiny.tiny_forecaster()
    fit(
        forecaster,
        corpus,
        Plan(
            epochs=150,
            batch=4,
            prefix=tiny.PREFIX,
            horizon=tiny.HORIZON,
            learning_rate=0.02,
            decay=0.99,
            clip=1.0,
        ),
        objective=Objective({"euler": 1.0, "penalty": 0.01}),
        feed=ScheduledSampling(0.97),
        folder=tmp_path,
        progress=False,
        loggers=(),
    )
    losses = [float(row["loss"]) for row in rows(tmp_path)]
    assert len(losses) == 150
    with torch.no_grad():
        found = tiny.forecast_error(forecaster, corpus, "train")
    assert found["forecast"] < 0.25 * found["still"]


def test_a_run_writes_its_logs_its_checkpoints_and_its_state(whole):
    folder, forecaster, result = whole
    assert {path.name for path in folder.iterdir()} == {
        *("best", "last", "log.csv", "state.safetensors", "validation.csv")
    }
    log, validations = rows(folder), rows(folder, "validation.csv")
    assert [int(row["epoch"]) for row in log] == list(range(1, EPOCHS + 1))
    assert list(log[0]) == [
        *("epoch", "updates", "loss", "loss/euler", "loss/penalty"),
        *("gradient_norm", "learning_rate", "teacher_forcing"),
    ]
    assert [float(log[k]["learning_rate"]) for k in (0, 10)] == [0.001, 0.001 * 0.999**10]
    assert [float(log[k]["teacher_forcing"]) for k in (0, 10)] == [1.0, 0.98**10]
    assert result.updates == int(log[-1]["updates"]) == 2 * EPOCHS
    assert result.skipped == 1
    errors = [float(row["forecast"]) for row in validations]
    assert len(errors) == EPOCHS
    assert result.best.metric == "forecast"
    assert result.best.metrics["forecast"] == min(errors)
    assert result.best.epoch == errors.index(min(errors)) + 1
    best, last = (json.loads((folder / x / "progress.json").read_text()) for x in ("best", "last"))
    assert (best["epoch"], last["epoch"]) == (result.best.epoch, EPOCHS)
    assert best["validation"] == result.best.metrics
    saved = load_file(folder / "last" / "weights.safetensors")
    assert all(torch.equal(saved[name], value) for name, value in forecaster.state_dict().items())


def test_a_killed_run_goes_on_as_if_nothing_had_happened(tiny, whole, tmp_path):
    folder = tmp_path / "run"
    worker = Path(__file__).with_name("worker.py")
    run = subprocess.Popen([sys.executable, worker, folder, str(EPOCHS), "0.1"])
    try:
        deadline = time.monotonic() + 120
        while not ((folder / STATE).exists() and len(rows(folder)) >= 7):
            assert run.poll() is None
            assert time.monotonic() < deadline
            time.sleep(0.02)
    finally:
        run.send_signal(signal.SIGKILL)
        run.wait()
    assert not (folder / "done").exists()
    interrupted = len(rows(folder))
    assert interrupted < EPOCHS
    (folder / ".state.0123456789ab.safetensors").write_bytes(b"half")
    forecaster = tiny.tiny_forecaster(seed=99)  # other weights, to be replaced by the state's
    result = tiny.train(folder, epochs=EPOCHS, forecaster=forecaster, resume=True)
    assert rows(folder) == rows(whole[0])
    assert rows(folder, "validation.csv") == rows(whole[0], "validation.csv")
    assert same_weights(forecaster, whole[1])
    assert result == whole[2]._replace(folder=folder)
    assert not list(folder.glob(".*"))


def test_a_finished_run_can_be_made_longer(tiny, whole, tmp_path):
    forecaster = tiny.tiny_forecaster()
    tiny.train(tmp_path, epochs=10, forecaster=forecaster)
    again = tiny.train(tmp_path, epochs=10, forecaster=forecaster, resume=True)
    assert (again.updates, again.averages) == (20, {})
    tiny.train(tmp_path, epochs=EPOCHS, forecaster=forecaster, resume=True)
    assert rows(tmp_path) == rows(whole[0])
    assert same_weights(forecaster, whole[1])


def test_dropout_too_is_resumed_exactly(tiny, tmp_path):
    straight, halted = (tiny.tiny_forecaster(dropout=0.3) for _ in range(2))
    tiny.train(tmp_path / "straight", epochs=6, forecaster=straight)
    tiny.train(tmp_path / "halted", epochs=3, forecaster=halted)
    tiny.train(tmp_path / "halted", epochs=6, forecaster=halted, resume=True)
    assert rows(tmp_path / "halted") == rows(tmp_path / "straight")
    assert same_weights(straight, halted)


@pytest.mark.parametrize("left", ["log.csv", "best"])
def test_a_run_killed_before_its_first_state_is_not_overwritten_either(tiny, tmp_path, left):
    (tmp_path / left).mkdir() if left == "best" else (tmp_path / left).write_text("epoch,loss\n")
    with pytest.raises(ConfigError, match="a training run already"):
        tiny.train(tmp_path, epochs=1)
    assert [path.name for path in tmp_path.iterdir()] == [left]


@pytest.mark.parametrize("resume", [True, False])
def test_checkpoints_without_a_state_are_not_replaced(tiny, tmp_path, resume):
    tiny.train(tmp_path, epochs=2)
    (tmp_path / STATE).unlink()
    before = (tmp_path / "last" / "weights.safetensors").read_bytes()
    with pytest.raises(ConfigError, match=r"choose another folder") as caught:
        tiny.train(tmp_path, epochs=3, resume=resume)
    assert "resume" not in str(caught.value)
    assert (tmp_path / "last" / "weights.safetensors").read_bytes() == before


def test_the_state_is_open_to_whom_new_files_are(whole):
    folder = whole[0]
    assert (folder / STATE).stat().st_mode == (folder / "log.csv").stat().st_mode


def test_a_run_killed_while_it_writes_its_last_checkpoint_writes_it_when_resumed(
    tiny, whole, tmp_path, monkeypatch
):
    class Killed(BaseException):
        pass

    save = tiny.save_weights

    def stop(folder, forecaster, progress):
        if folder.name == "last" and progress["epoch"] == EPOCHS:
            raise Killed
        save(folder, forecaster, progress)

    monkeypatch.setattr(tiny, "save_weights", stop)
    with pytest.raises(Killed):
        tiny.train(tmp_path, epochs=EPOCHS)
    monkeypatch.setattr(tiny, "save_weights", save)
    tiny.train(tmp_path, epochs=EPOCHS, resume=True)
    found, expected = (
        load_file(folder / "last" / "weights.safetensors") for folder in (tmp_path, whole[0])
    )
    assert found.keys() == expected.keys()
    assert all(torch.equal(value, expected[name]) for name, value in found.items())


def test_seconds_of_an_epoch_leave_validation_out(tiny, tmp_path, monkeypatch):
    clock = [0.0]
    monkeypatch.setattr(keeping, "time", SimpleNamespace(monotonic=lambda: clock[0]))

    def validated():
        clock[0] += 100

    tiny.train(tmp_path, epochs=3, validate_every=1, on_validation=validated)
    with (tmp_path / "log.csv").open(newline="") as file:
        assert [float(row["seconds"]) for row in csv.DictReader(file)] == [0, 0, 0]
    assert clock[0] == 300


def test_the_first_epoch_is_kept_at_once(tiny, tmp_path):
    kept = []

    def look():
        kept.append((tmp_path / STATE).exists())

    tiny.train(tmp_path, epochs=3, on_validation=look, save_every=None)
    assert kept == [False, True, True]


def test_training_leaves_the_global_random_state_alone(tiny, tmp_path):
    forecaster = tiny.tiny_forecaster(dropout=0.3)
    before = torch.get_rng_state()
    tiny.train(tmp_path, epochs=2, forecaster=forecaster)
    assert torch.equal(torch.get_rng_state(), before)


def test_a_run_with_root_channels_trains_them(tiny, tmp_path):
    forecaster = tiny.tiny_forecaster(root="displacement")
    before = forecaster.root.weight.detach().clone()
    fit(
        forecaster,
        tiny.tiny_corpus(),
        Plan(epochs=2, batch=2, prefix=8, horizon=4),
        objective=Objective({"euler": 1.0, "root": 1.0, "position": 1.0, "quaternion": 1.0}),
        feed=ScheduledSampling(),
        folder=tmp_path,
        progress=False,
        loggers=(),
    )
    assert not torch.equal(forecaster.root.weight, before)
    assert set(rows(tmp_path)[0]) > {"loss/root", "loss/position", "loss/quaternion"}


def test_without_loggers_named_tensorboard_gets_the_numbers(tiny, tmp_path):
    fit(
        tiny.tiny_forecaster(),
        tiny.tiny_corpus(),
        Plan(epochs=2, batch=2, prefix=8, horizon=4),
        objective=Objective({"euler": 1.0}),
        feed=ScheduledSampling(),
        folder=tmp_path,
        progress=False,
    )
    events = list((tmp_path / "tensorboard").glob("events.out.tfevents.*"))
    assert len(events) == 1
    assert b"gradient_norm" in events[0].read_bytes()


def test_a_folder_with_a_run_in_it_is_not_overwritten(tiny, whole):
    with pytest.raises(ConfigError, match=r"a training run already \(.*log\.csv.*\); resume it"):
        tiny.train(whole[0], epochs=EPOCHS)


def test_a_run_is_not_resumed_with_other_settings(tiny, whole):
    with pytest.raises(ConfigError, match="batch was 3, now 4; seed was 0, now 8"):
        tiny.train(whole[0], epochs=EPOCHS, resume=True, batch=4, seed=8)
    with pytest.raises(ConfigError, match=f"{EPOCHS} epochs are done"):
        tiny.train(whole[0], epochs=EPOCHS - 1, resume=True)


def test_a_run_is_not_resumed_with_another_network(tiny, whole):
    other = tiny.tiny_forecaster(hidden=7)
    with pytest.raises(ConfigError, match="weights of another forecaster"):
        tiny.train(whole[0], epochs=EPOCHS, resume=True, forecaster=other)


def test_an_accelerator_that_is_not_there_is_one_line_of_error(tiny, tmp_path):
    with pytest.raises(ConfigError, match=r"accelerator 'abacus'.*leave them out") as caught:
        tiny.train(tmp_path, epochs=2, accelerator="abacus")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("content", [b"", b"\x08\0\0\0\0\0\0\0{}      ", b"x" * 1000])
def test_a_damaged_state_is_named(tiny, tmp_path, content):
    (tmp_path / STATE).write_bytes(content)
    with pytest.raises(DataError, match=r"state\.safetensors: is not a training state"):
        tiny.train(tmp_path, epochs=2, resume=True)


def test_a_metric_that_is_not_measured_is_refused(tiny, tmp_path):
    with pytest.raises(ConfigError, match="did you mean 'forecast'"):
        tiny.train(tmp_path, epochs=2, select_best_by="forecasts")


def falling_then_rising(values, tiny, monkeypatch):
    """Validations that go as given, whatever the forecaster does."""
    rest = iter(values)
    monkeypatch.setattr(tiny, "forecast_error", lambda model, corpus: {"forecast": next(rest)})


VALUES = [5.0, 4.0, 3.99, 3.98, 3.5, 3.49, 3.48, 3.47, 1.0, 0.5]


@pytest.mark.parametrize(
    ("options", "epochs", "best"),
    [
        ({}, 10, 10),
        ({"patience": 2}, 10, 10),
        # 3.99 and 3.98 are lower than 4 by less than a hundredth, as the three after 3.5 are.
        ({"patience": 3, "least_improvement": 0.01}, 8, 8),
        ({"patience": 2, "least_improvement": 0.01}, 4, 4),
    ],
)
def test_training_ends_early_when_validation_has_not_improved_for_long(
    options, epochs, best, tiny, tmp_path, monkeypatch
):
    falling_then_rising(VALUES, tiny, monkeypatch)
    found = tiny.train(tmp_path, epochs=10, **options)
    assert (found.epochs, found.best.epoch) == (epochs, best)
    assert read_state(tmp_path / STATE).epoch == epochs
    assert len((tmp_path / "log.csv").read_text().splitlines()) == 1 + epochs


def test_a_run_that_creeps_downwards_ends(tiny, tmp_path, monkeypatch):
    # Each is lower than the best before it by less than a hundredth, the fourth than the first by
    # more.
    falling_then_rising([5.0, 4.98, 4.96, 4.94, 4.92, 4.9, 4.88], tiny, monkeypatch)
    found = tiny.train(tmp_path, epochs=7, patience=5, least_improvement=0.01)
    assert (found.epochs, found.best.epoch) == (6, 6)


def test_a_run_that_goes_on_has_not_forgotten_how_long_it_waited(tiny, tmp_path, monkeypatch):
    falling_then_rising(VALUES, tiny, monkeypatch)
    waiting = {"patience": 3, "least_improvement": 0.01}
    tiny.train(tmp_path, epochs=6, **waiting)
    found = tiny.train(tmp_path, epochs=10, resume=True, **waiting)
    assert found.epochs == 8
    # It is finished: nothing is trained, whatever validation would say.
    again = tiny.train(tmp_path, epochs=10, resume=True, **waiting)
    assert (again.epochs, again.averages) == (8, {})
    # With more patience it goes on.
    assert tiny.train(tmp_path, epochs=10, resume=True, patience=9).epochs == 10


def test_noise_is_set_before_every_update(tiny, tmp_path):
    forecaster = tiny.tiny_forecaster()
    seen = []
    forecaster.register_forward_pre_hook(lambda *_: seen.append(forecaster.input_noise))
    found = tiny.train(
        tmp_path, epochs=4, forecaster=forecaster, noise_at=[[2, 0.25], [3, 0.5]], validate_every=4
    )
    per_epoch = found.updates // 4
    by_update = {0: 0.0, 1: 0.0, 2: 0.25, 3: 0.5}
    assert list(dict.fromkeys(seen)) == list(
        dict.fromkeys(by_update.get(update, 0.5) for update in range(4 * per_epoch))
    )


def test_a_loss_that_explodes_stops_the_run(tiny, tmp_path):
    with pytest.raises(ConfigError, match="training diverged in epoch 1"):
        tiny.train(tmp_path, epochs=3, learning_rate=1e38, clip=None)
    assert not (tmp_path / STATE).exists()


def test_a_corpus_of_another_skeleton_is_refused(tiny, tmp_path):
    forecaster = tiny.tiny_forecaster()
    names = ("hips", "spine", "head", "larm", "rarm")
    object.__setattr__(forecaster.codec, "skeleton", Skeleton(names, tiny.SKELETON.parents))
    with pytest.raises(SkeletonError, match=r"larm.*left_arm"):
        tiny.train(tmp_path, epochs=1, forecaster=forecaster)


def test_a_forecaster_is_handed_back_in_the_mode_it_came_in(tiny, tmp_path):
    for name, mode in (("asleep", False), ("awake", True)):
        forecaster = tiny.tiny_forecaster().train(mode)
        tiny.train(tmp_path / name, epochs=1, forecaster=forecaster)
        assert forecaster.training is mode


@pytest.mark.gpu
def test_a_gpu_learns_what_a_cpu_learns(tiny, whole, tmp_path):
    tiny.train(tmp_path, epochs=EPOCHS, accelerator="gpu")
    for on_gpu, on_cpu in zip(rows(tmp_path), rows(whole[0]), strict=True):
        assert float(on_gpu["loss"]) == pytest.approx(float(on_cpu["loss"]), rel=0.02)
