"""States carried from one update to the next: what is kept, and that a run stays one run."""

from __future__ import annotations

import pytest
import torch

from posecast.errors import ConfigError
from posecast.model import rollout
from posecast.model.rollout import gated_rollout
from posecast.training import Objective, Plan
from posecast.training.recording import Recorder
from posecast.training.sampling import Windows
from posecast.training.step import Carried, Example, attempt


def windows_of(tiny, forecaster, frames):
    windows = Windows(tiny.tiny_corpus((70, 70)), length=frames, batch=4, seed=0)
    return Example.of(forecaster.codec, windows.share(0, 0).motion)


@pytest.mark.parametrize("roll", [rollout, gated_rollout])
def test_a_rollout_goes_on_where_another_ended(tiny, roll):
    forecaster = tiny.tiny_forecaster()
    features = windows_of(tiny, forecaster, 30).features
    truth, mask = features[:, 10:], torch.ones(20, dtype=torch.bool)
    whole = roll(forecaster, features[:, :10], 20, truth=truth, truth_mask=mask)
    # Of the frames it predicted, a rollout has not read the last: the next one begins with it.
    first = roll(forecaster, features[:, :10], 8, truth=truth, truth_mask=mask[:8])
    then = roll(
        forecaster,
        features[:, 17:20],
        10,
        truth=features[:, 20:],
        truth_mask=mask[:10],
        state=first.state,
    )
    torch.testing.assert_close(then.features, whole.features[:, 10:])
    for found, expected in zip(then.state, whole.state, strict=True):
        torch.testing.assert_close(found, expected)


def test_kept_windows_remember_and_the_others_do_not(tiny):
    forecaster = tiny.tiny_forecaster()
    example = windows_of(tiny, forecaster, 15)
    state = tuple(torch.randn_like(each) for each in forecaster.initial_state(len(example[0])))
    kept = torch.tensor([True, False, True, False])[: len(example[0])]

    def predicted(carried):
        mask = torch.arange(5) == 0
        found = attempt(
            forecaster, example, prefix=10, mask=mask, order="zyx", carried=carried
        ).comparison
        return found.predicted

    plain, mixed = predicted(None), predicted(Carried(kept, state))
    every = predicted(Carried(torch.ones_like(kept), state))
    torch.testing.assert_close(mixed[~kept], plain[~kept])
    torch.testing.assert_close(mixed[kept], every[kept])
    assert (mixed[kept] - plain[kept]).abs().amax() > 1e-4


def test_what_is_recorded_carries_states_too(tiny):
    forecaster, objective = tiny.tiny_forecaster(), Objective({"euler": 1.0})
    example = windows_of(tiny, forecaster, 15)
    initial = forecaster.initial_state(len(example[0]))
    carried = Carried(
        torch.arange(len(example[0])) == 0, tuple(torch.randn_like(each) for each in initial)
    )
    mask = torch.arange(5) == 0
    plain = attempt(forecaster, example, prefix=10, mask=mask, order="zyx", carried=carried)
    step = Recorder(forecaster, objective, prefix=10).step()
    values = [value for value in example if value is not None]
    total, _, *state = step(mask, *values, carried.kept, *carried.state)
    torch.testing.assert_close(total, objective(plain.comparison).total)
    torch.testing.assert_close(tuple(state), plain.state)
    assert not any(each.requires_grad for each in state)


def test_a_run_that_carries_states_differs_and_is_resumed_exactly(tiny, tmp_path):
    weights = {}
    for name, carry in (("never", 0.0), ("always", 1.0), ("whole", 0.5), ("parts", 0.5)):
        forecaster = tiny.tiny_forecaster()
        if name == "parts":
            tiny.train(tmp_path / name, epochs=3, forecaster=forecaster, carry=carry)
            forecaster = tiny.tiny_forecaster()
        tiny.train(
            tmp_path / name, epochs=6, forecaster=forecaster, carry=carry, resume=name == "parts"
        )
        weights[name] = torch.cat([each.flatten() for each in forecaster.state_dict().values()])
    assert torch.equal(weights["whole"], weights["parts"])
    for one, other in (("never", "whole"), ("whole", "always"), ("never", "always")):
        assert (weights[one] - weights[other]).abs().amax() > 1e-5


@pytest.mark.parametrize("share", [-0.1, 1.1])
def test_a_share_is_a_share(share):
    with pytest.raises(ConfigError, match="expected a share, 0 to 1"):
        Plan(carry=share)
