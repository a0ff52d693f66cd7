"""Every network that can be stepped is exported as it is, at any batch size, or refused."""

from __future__ import annotations

from itertools import product

import pytest
import torch
from tests.export.conftest import BACKBONE_OPTIONS, OFFSETS

from posecast.errors import ConfigError
from posecast.export.graph import StepNames, StepNetwork, step_graph
from posecast.export.parity import BATCHES, STEPS, Parity, measure_parity
from posecast.export.stepper import runner, step_model
from posecast.model import BACKBONES, HEADS
from posecast.representation import REPRESENTATIONS

HIDDEN_LOOPS = {"GRU", "LSTM", "RNN", "Loop", "Scan", "If"}


def goes_together(backbone, head):
    """Only one backbone speaks of parts of the body."""
    return head != "parts" or backbone == "structural_rnn"


PAIRS = [pair for pair in product(BACKBONES, HEADS) if goes_together(*pair)]


def parity_of(forecaster):
    """The exported step beside the network."""
    network = StepNetwork(forecaster)
    model = step_model(network, "exact")
    assert not HIDDEN_LOOPS & {node.op_type for node in model.graph.node}
    run = runner(model.SerializeToString(), network)
    return measure_parity(network, run, torch.tensor(OFFSETS), {})


def test_all_pairs_of_backbone_and_head_are_tried():
    assert set(BACKBONE_OPTIONS) == set(BACKBONES)
    assert len(PAIRS) == 11


@pytest.mark.parametrize(("backbone", "head"), PAIRS)
def test_a_step_of_every_backbone_with_every_head_is_the_network_at_any_batch_size(
    backbone, head, make, onnx_extra
):
    forecaster = make(backbone, head, steered=True, residual="add", projection=None)
    parity = parity_of(forecaster)
    assert (tuple(parity.differences), parity.steps) == (BATCHES, STEPS) == ((1, 3, 8), 10)
    assert max(parity.differences.values()) < 1e-5


@pytest.mark.slow
@pytest.mark.parametrize("residual", ["none", "add", "compose"])
@pytest.mark.parametrize("representation", [name for name in REPRESENTATIONS if name != "matrix"])
def test_a_step_of_every_representation_and_residual_is_the_network(
    representation, residual, make, onnx_extra
):
    parity = parity_of(make(representation=representation, residual=residual))
    # Dual quaternions of random joints are metres from each other, and are multiplied.
    assert max(parity.differences.values()) < 2e-5


@pytest.mark.parametrize(
    "options",
    [
        {"feedback": "emitted", "projection": [9, 8], "projection_activation": "relu"},
        {"codec_options": {"actions": ("run", "walk")}, "input_dropout": 0.5},
        {"backbone_options": {"hidden": 7, "initial_state": "zero"}, "input_noise": 0.1},
    ],
    ids=["emitted", "actions", "zeros"],
)
def test_a_step_with_other_options_is_the_network(options, make, onnx_extra):
    forecaster = make(residual="compose", **options).train()
    assert max(parity_of(forecaster).differences.values()) < 1e-5
    assert forecaster.training


def test_matrices_are_refused_with_what_would_fit(make):
    forecaster = make(representation="matrix")
    with pytest.raises(ConfigError, match=r"singular value .* no operator; .* such as ortho6d"):
        step_graph(StepNetwork(forecaster))


def test_inputs_and_outputs_are_named_and_have_any_batch_size(make, onnx_extra):
    network = StepNetwork(make("lstm", steered=True))
    graph = step_model(network, "exact").graph

    def shapes(values):
        return {
            each.name: [dim.dim_param or dim.dim_value for dim in each.type.tensor_type.shape.dim]
            for each in values
        }

    state = {f"state_{number}": ["batch", 6] for number in range(4)}
    after = {f"next_{name}": shape for name, shape in state.items()}
    frame = ["batch", 23]
    assert shapes(graph.input) == {"features": frame, "controls": ["batch", 6], **state}
    assert shapes(graph.output) == {
        "next_features": frame,
        "emitted": frame,
        "raw": ["batch", 5, 4],
        **after,
    }


def test_states_without_numbers_are_no_inputs(make):
    options = {"channels": 6, "widths": [1, 2, 1], "dilations": [1, 3, 1]}
    names = StepNames.of(make("convolutional", backbone_options=options))
    assert names.kept == (1,)
    assert names.inputs == ("features", "state_0")


def test_a_step_that_is_another_is_noticed(make):
    network = StepNetwork(make())

    def slightly_off(inputs):
        return [value + 1e-3 for value in network(*inputs)]

    parity = measure_parity(network, slightly_off, torch.tensor(OFFSETS), {"onnx": "0.1"})
    assert min(parity.differences.values()) > 5e-4
    with pytest.raises(ConfigError, match=r"differs from the network by 0\.001 at batch .*onnx 0"):
        parity.check()


@pytest.mark.parametrize("difference", [2e-4, float("nan")])
def test_differences_beyond_single_precision_are_refused(difference):
    Parity(3, {1: 9e-5, 3: 0.0}, {}).check()
    with pytest.raises(ConfigError, match=r"expected at most 0\.0001"):
        Parity(3, {1: 0.0, 3: difference}, {}).check()
