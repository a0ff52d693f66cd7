"""The LSTM stack against plain equations, in both wirings."""

from __future__ import annotations

import pytest
import torch

from posecast.errors import ConfigError
from posecast.model import LSTMBackbone

INPUTS, HIDDEN, LAYERS = 5, 4, 3


def plain(backbone, frames, *, delayed):
    """Frame by frame and layer by layer (Hochreiter and Schmidhuber 1997, with forget gates)."""
    weights = [list(layer.parameters()) for layer in backbone.layers]
    state = backbone.initial_state(len(frames))
    outputs = [state[2 * layer] for layer in range(LAYERS)]
    cells = [state[2 * layer + 1] for layer in range(LAYERS)]
    context = []
    for frame in frames.unbind(1):
        before = list(outputs)
        for layer, (from_input, from_output, bias, other_bias) in enumerate(weights):
            below = frame if layer == 0 else (before if delayed else outputs)[layer - 1]
            gates = below @ from_input.T + before[layer] @ from_output.T + bias + other_bias
            entry, forget, new, out = gates.chunk(4, dim=-1)
            cells[layer] = forget.sigmoid() * cells[layer] + entry.sigmoid() * new.tanh()
            outputs[layer] = out.sigmoid() * cells[layer].tanh()
        context.append(outputs[-1])
    return torch.stack(context, dim=1)


def make(wiring, initial_state="zero"):
    backbone = LSTMBackbone(INPUTS, HIDDEN, LAYERS, wiring, initial_state)
    backbone.reset_parameters(torch.Generator().manual_seed(3))
    return backbone.double()


@pytest.mark.parametrize("initial_state", ["zero", "learned"])
@pytest.mark.parametrize("wiring", ["stacked", "delayed"])
@pytest.mark.parametrize("length", [1, 2, 9])
def test_the_stack_computes_the_plain_equations_and_their_gradient(
    wiring, initial_state, length, generator
):
    backbone = make(wiring, initial_state)
    frames = torch.randn(2, length, INPUTS, dtype=torch.float64, generator=generator)
    found = backbone(frames, backbone.initial_state(2)).context
    expected = plain(backbone, frames, delayed=wiring == "delayed")
    torch.testing.assert_close(found, expected)
    weight = torch.randn(found.shape, dtype=torch.float64, generator=generator)
    gradients = [
        torch.autograd.grad((each * weight).sum(), list(backbone.parameters()), allow_unused=True)
        for each in (found, expected)
    ]
    for one, other in zip(*gradients, strict=True):
        if one is not None and other is not None:
            torch.testing.assert_close(one, other)


@pytest.mark.parametrize(("wiring", "delay"), [("stacked", 0), ("delayed", LAYERS - 1)])
def test_an_input_reaches_the_output_after_the_delay_of_the_wiring(wiring, delay, generator):
    backbone = make(wiring)
    frames = torch.randn(1, 8, INPUTS, dtype=torch.float64, generator=generator)
    other = frames.clone()
    other[:, 2] += 1
    contexts = [backbone(each, backbone.initial_state(1)).context for each in (frames, other)]
    changed = (contexts[0] - contexts[1]).abs().amax((0, 2)) > 1e-12
    assert changed.tolist() == [frame >= 2 + delay for frame in range(8)]


def test_cells_have_two_biases_as_the_papers_count_them():
    per_layer = [4 * HIDDEN * (inputs + HIDDEN + 2) for inputs in (INPUTS, HIDDEN, HIDDEN)]
    assert sum(weight.numel() for weight in make("stacked").parameters()) == sum(per_layer)
    assert sum(weight.numel() for weight in make("delayed").parameters()) == sum(per_layer)


def test_an_empty_batch_has_an_empty_summary():
    backbone = make("delayed")
    nothing = torch.empty(0, 5, INPUTS, dtype=torch.float64)
    assert backbone(nothing, backbone.initial_state(0)).context.shape == (0, 5, HIDDEN)


def test_a_wrong_number_of_layers_is_refused():
    for layers in (0, 101):
        with pytest.raises(ConfigError, match=f"layers: {layers}; expected 1 to 100"):
            LSTMBackbone(3, 4, layers)
