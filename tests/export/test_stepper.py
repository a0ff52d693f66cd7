"""A stepper goes on as the forecaster does: driven by a session, or step by step."""

from __future__ import annotations

import sys

import pytest
import torch

from posecast.errors import ConfigError
from posecast.export import Stepper
from posecast.export.eight_bits import BLOCK, Blocks
from posecast.export.stepper import check_mode
from posecast.model import Session, Steppable, rollout

FRAMES = 30
NETWORKS = {
    # Near the identity: changes at random are multiplied, and differences with them.
    "gru": {"residual": "compose", "still_start": True},
    "steered gru": {"steered": True},
    "emitted": {"feedback": "emitted", "residual": "add"},
    "learned lstm": {"backbone": "lstm"},
    "empty states": {
        "backbone": "convolutional",
        "backbone_options": {"channels": 6, "widths": [2, 2, 1], "dilations": [1, 2, 4]},
    },
    "structured": {"head": "structured"},
}
LARGE = {"backbone_options": {"hidden": 160, "layers": 2}}


@pytest.fixture
def features(make, motion):
    """Frames of both motions."""
    return make().codec.encode(motion)


def walk(stepping, features, controls):
    """Frames after a prefix, the session driven as a stream is."""
    steered = None if controls is None else controls[:, : features.shape[1] - 1]
    session = Session.start(stepping, features, steered)
    later = [None] * FRAMES if controls is None else controls[:, features.shape[1] - 1 :].unbind(1)
    with torch.no_grad():
        return torch.stack([session.step(each) for each in later[:FRAMES]], dim=1)


def controls_for(forecaster, generator):
    """Controls of the prefix and of all frames, where there are any."""
    if forecaster.controls is None:
        return None
    return torch.randn(2, 16 + FRAMES, forecaster.controls.input_dim, generator=generator)


@pytest.mark.parametrize("name", NETWORKS)
def test_a_session_of_an_exact_stepper_gives_the_frames_of_the_forecaster(
    name, make, features, generator, onnx_extra
):
    forecaster = make(**NETWORKS[name])
    stepper = Stepper(forecaster)
    assert isinstance(stepper, Steppable)
    assert stepper.runtime == "ONNX Runtime"
    controls = controls_for(forecaster, generator)
    found = walk(stepper, features, controls)
    torch.testing.assert_close(found, walk(forecaster, features, controls), atol=1e-5, rtol=0)


def test_a_rollout_of_a_stepper_is_that_of_the_forecaster(make, features, onnx_extra):
    forecaster = make(residual="add")
    wanted, found = (rollout(each, features, FRAMES) for each in (forecaster, Stepper(forecaster)))
    pairs = zip((*found[:3], *found.state), (*wanted[:3], *wanted.state), strict=True)
    for own, other in pairs:
        torch.testing.assert_close(own, other, atol=1e-5, rtol=0)
        assert not own.requires_grad


def test_single_steps_change_no_state_that_was_kept(make, features, onnx_extra):
    stepper = Stepper(make())
    state = stepper.initial_state(2)
    kept = [part.clone() for part in state]
    first = stepper.step(features[:, 0], state)
    again = stepper.step(features[:, 0], state)
    assert all(torch.equal(own, other) for own, other in zip(state, kept, strict=True))
    assert torch.equal(first.features, again.features)
    assert first.features.shape == (2, 1, 23)


def test_a_stepper_keeps_the_weights_it_was_made_with(make, features, onnx_extra):
    forecaster = make().double().train()
    stepper = Stepper(forecaster)
    before = walk(stepper, features, None)
    forecaster.reset_parameters(torch.Generator().manual_seed(4))
    assert torch.equal(walk(stepper, features, None), before)
    assert forecaster.training
    assert next(forecaster.parameters()).dtype == torch.float64


def test_a_fast_stepper_reads_less_than_half_and_stays_near(make, features, onnx_extra):
    forecaster = make(**LARGE)
    exact, fast = Stepper(forecaster), Stepper(forecaster, "fast")
    assert fast.weight_bytes < exact.weight_bytes / 2
    wanted, found = (walk(each, features, None) for each in (exact, fast))
    assert 1e-5 < (found - wanted).abs().max() < 0.05


def test_eight_bits_are_refused_for_networks_that_are_small_anyway(make, onnx_extra):
    with pytest.raises(ConfigError, match="no product of the backbone has 65536 weights or more"):
        Stepper(make(), "fast")


@pytest.mark.parametrize("inputs", [1, BLOCK - 1, BLOCK, 3 * BLOCK + 5])
def test_weights_in_eight_bits_are_the_nearest_there_are(inputs, generator):
    matrix = torch.randn(5, inputs, generator=generator).numpy()
    matrix[2] = 0
    blocks = Blocks.of(matrix)
    count = -(-inputs // BLOCK)
    assert blocks.numbers.shape == (5, count, BLOCK)
    scales = blocks.scales.reshape(5, count, 1)
    written = (scales * (blocks.numbers.astype("float32") - 128)).reshape(5, -1)
    assert (written[:, inputs:] == 0).all()
    assert (written[2] == 0).all()
    reach = (scales / 2).repeat(BLOCK, axis=2).reshape(5, -1)[:, :inputs]
    assert (abs(written[:, :inputs] - matrix) <= reach * 1.0001).all()


def test_without_the_extra_exact_steps_are_pytorchs_and_fast_ones_are_refused(
    make, features, monkeypatch
):
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    forecaster = make()
    stepper = Stepper(forecaster)
    assert stepper.runtime == "PyTorch"
    assert stepper.weight_bytes == 4 * sum(each.numel() for each in forecaster.parameters())
    found, wanted = (walk(each, features, None) for each in (stepper, forecaster))
    torch.testing.assert_close(found, wanted, atol=1e-6, rtol=0)
    with pytest.raises(ConfigError, match=r"steps need onnx.* pip install posecast\[onnx\]"):
        Stepper(forecaster, "fast")


def test_what_cannot_be_exported_steps_exactly_in_pytorch(make, motion):
    forecaster = make(representation="matrix")
    features = forecaster.codec.encode(motion)
    stepper = Stepper(forecaster)
    assert stepper.runtime == "PyTorch"
    found, wanted = (walk(each, features, None) for each in (stepper, forecaster))
    torch.testing.assert_close(found, wanted, atol=1e-6, rtol=0)
    with pytest.raises(ConfigError, match="representation 'matrix'"):
        Stepper(forecaster, "fast")


def test_a_stepper_asks_for_controls_as_the_forecaster_does(make, features, onnx_extra):
    steered, free = Stepper(make(steered=True)), Stepper(make())
    with pytest.raises(ConfigError, match="takes 6 controls a frame"):
        steered.step(features[:, 0], steered.initial_state(2))
    with pytest.raises(ConfigError, match="this forecaster takes none"):
        free.step(features[:, 0], free.initial_state(2), torch.zeros(2, 6))


def test_unknown_modes_and_threads_are_refused(make):
    with pytest.raises(ConfigError, match="mode: 'quick' is not known; choose 'exact' or 'fast'"):
        check_mode("quick")
    with pytest.raises(ConfigError, match="threads: 0; expected 1 or more"):
        Stepper(make(), threads=0)
