"""Random streams addressed by epoch, the learning rate, and what a plan refuses."""

from __future__ import annotations

import itertools

import pytest
import torch

from posecast.errors import ConfigError
from posecast.training.plan import Machines, Plan
from posecast.training.schedules import LearningRate, derived_generator, derived_seed


def test_every_place_of_a_run_has_a_seed_of_its_own():
    places = itertools.product((0, 1), ("windows", "feed"), range(50), range(4))
    seeds = {derived_seed(*place) for place in places}
    assert len(seeds) == 2 * 2 * 50 * 4
    assert derived_seed(1, 23) != derived_seed(12, 3)


def test_a_derived_generator_gives_the_same_numbers_again():
    first, second, other = (
        torch.rand(5, generator=derived_generator(7, "feed", epoch)) for epoch in (3, 3, 4)
    )
    assert torch.equal(first, second)
    assert not torch.equal(first, other)


def test_the_learning_rate_decays_once_an_epoch():
    rate = LearningRate(0.001, 0.999)
    assert rate.at(epoch=0, update=5) == 0.001
    assert rate.at(epoch=7, update=42) == pytest.approx(0.001 * 0.999**7)
    # After the 3000 epochs of Pavllo et al. 2018 it is 5.0e-5.
    assert rate.at(epoch=2999, update=17_999) == pytest.approx(5.0e-5, abs=0.05e-5)


def test_the_learning_rate_decays_once_in_so_many_updates():
    rate = LearningRate(0.005, 0.95, every=10_000)  # Martinez et al. 2017
    assert rate.at(epoch=99, update=9_999) == 0.005
    assert rate.at(epoch=0, update=20_000) == pytest.approx(0.005 * 0.95**2)


def test_the_learning_rate_decays_before_given_updates():
    rate = LearningRate(0.001, 0.1, points=(1500, 4500))  # Jain et al. 2016
    assert [rate.at(epoch=0, update=update) for update in (0, 1499)] == [0.001, 0.001]
    assert rate.at(epoch=0, update=1500) == pytest.approx(1e-4)
    assert rate.at(epoch=0, update=9999) == pytest.approx(1e-5)
    assert Plan(decay=0.1, decay_at=[1500, 4500], learning_rate=0.001).rate == rate


def test_noise_grows_at_given_updates():
    noise = Plan(noise_at=[[250, 0.01], [500, 0.05]]).noise
    assert [noise.at(update) for update in (0, 249, 250, 499, 500, 9999)] == [
        *(0, 0, 0.01, 0.01, 0.05, 0.05)
    ]
    assert Plan().noise is None


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"decay_at": []}, r"at updates \[\]: expected at least one"),
        ({"decay_at": [500, 200]}, "expected at least one, 0 or more, ascending"),
        ({"decay_at": [500], "decay_every": 10}, "choose one"),
        ({"noise_at": [[500, 0.1], [200, 0.2]]}, r"noise changes at updates \[500, 200\]"),
        ({"noise_at": [[500, -0.1]]}, "expected standard deviations"),
        ({"noise_at": [[500]]}, "expected pairs of updates"),
        ({"patience": 0}, "patience is 0"),
        ({"patience": 3, "least_improvement": 1.0}, "least_improvement is 1.0"),
        ({"least_improvement": 0.01}, "changes nothing without patience"),
        ({"epochs": 0}, "epochs is 0"),
        ({"prefix": 0}, "prefix is 0"),
        ({"save_every": 0}, "save_every is 0"),
        ({"skip_start": -1}, "skip_start is -1"),
        ({"skip_end": -1}, "skip_end is -1"),
        ({"learning_rate": 0.0}, "learning rate 0.0"),
        ({"decay": 1.5}, "decay 1.5"),
        ({"decay_every": 0}, "every 0 updates"),
        ({"clip": 0.0}, "clip is 0.0"),
        ({"optimizer": "adamw"}, "choose adam or sgd"),
    ],
)
def test_a_plan_refuses_numbers_out_of_range(wrong, said):
    with pytest.raises(ConfigError, match=said):
        Plan(**wrong)


def test_a_strategy_that_would_split_the_weights_is_refused():
    with pytest.raises(ConfigError, match="choose among"):
        Machines(strategy="fsdp")


@pytest.mark.parametrize("count", [0, -1])
def test_fewer_than_one_device_or_machine_is_refused(count):
    with pytest.raises(ConfigError, match=f"devices is {count}; expected 1 or more"):
        Machines(devices=count)
    with pytest.raises(ConfigError, match=f"nodes is {count}; expected 1 or more"):
        Machines(nodes=count)


def test_devices_and_nodes_are_those_that_torchrun_started(monkeypatch):
    for name in ("TORCHELASTIC_RUN_ID", "WORLD_SIZE", "LOCAL_WORLD_SIZE"):
        monkeypatch.delenv(name, raising=False)
    assert (Machines().processes, Machines().machines) == ("auto", 1)
    for name, value in {
        "TORCHELASTIC_RUN_ID": "x",
        "WORLD_SIZE": "8",
        "LOCAL_WORLD_SIZE": "4",
    }.items():
        monkeypatch.setenv(name, value)
    assert (Machines().processes, Machines().machines) == (4, 2)
    assert (Machines(devices=1, nodes=8).processes, Machines(nodes=8).machines) == (1, 8)
