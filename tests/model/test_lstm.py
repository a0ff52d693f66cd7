"""The LSTM stack against plain equations, in both wirings."""

from __future__ import annotations

import copy

import pytest
import torch
from torch import nn

from posecast.errors import ConfigError
from posecast.model import LSTMBackbone

INPUTS, HIDDEN, LAYERS = 5, 4, 3


def plain(backbone, frames, state, *, wiring):
    """Frame by frame and layer by layer (Hochreiter and Schmidhuber 1997, with forget gates)."""
    weights = [(*layer.parameters(), torch.zeros(4 * HIDDEN))[:4] for layer in backbone.layers]
    outputs = [state[2 * layer] for layer in range(LAYERS)]
    cells = [state[2 * layer + 1] for layer in range(LAYERS)]
    context = []
    for frame in frames.unbind(1):
        before = list(outputs)
        for layer, (from_input, from_output, bias, other_bias) in enumerate(weights):
            below = frame
            if layer:
                below = (before if wiring == "delayed" else outputs)[layer - 1]
                below = torch.cat([frame, below], dim=-1) if wiring == "skip" else below
            gates = below @ from_input.T + before[layer] @ from_output.T + bias + other_bias
            entry, forget, new, out = gates.chunk(4, dim=-1)
            cells[layer] = forget.sigmoid() * cells[layer] + entry.sigmoid() * new.tanh()
            outputs[layer] = out.sigmoid() * cells[layer].tanh()
        context.append(torch.cat(outputs, dim=-1) if wiring == "skip" else outputs[-1])
    last = [part for pair in zip(outputs, cells, strict=True) for part in pair]
    return [torch.stack(context, dim=1), *last]


def make(wiring, initial_state="zero", **options):
    backbone = LSTMBackbone(INPUTS, HIDDEN, LAYERS, wiring, initial_state, **options)
    backbone.reset_parameters(torch.Generator().manual_seed(3))
    return backbone.double()


# In single precision PyTorch hands the layers to oneDNN, another implementation.
@pytest.mark.parametrize(("dtype", "atol"), [(torch.float64, 1e-12), (torch.float32, 2e-5)])
@pytest.mark.parametrize("initial_state", ["zero", "learned"])
@pytest.mark.parametrize("biases", [1, 2])
@pytest.mark.parametrize("wiring", ["stacked", "skip", "delayed"])
@pytest.mark.parametrize("length", [1, 2, 9])
def test_the_stack_computes_the_plain_equations_and_their_gradient(
    wiring, initial_state, length, biases, dtype, atol, generator
):
    backbone = make(wiring, initial_state, biases=biases)
    frames = torch.randn(2, length, INPUTS, dtype=torch.float64, generator=generator)
    slow = frames.clone().requires_grad_()
    expected = plain(backbone, slow, backbone.initial_state(2), wiring=wiring)
    weights = [torch.randn(each.shape, dtype=dtype, generator=generator) for each in expected]
    wanted = _gradients(expected, weights, [slow, *backbone.parameters()])
    backbone.to(dtype)
    frames = frames.to(dtype).requires_grad_()
    context, state = backbone(frames, backbone.initial_state(2))
    found = [context, *state]
    for one, other in zip(found, expected, strict=True):
        torch.testing.assert_close(one, other.to(dtype), atol=atol, rtol=0)
    gradients = _gradients(found, weights, [frames, *backbone.parameters()])
    # After one frame, weights that have met nothing but zeros have no gradient.
    assert length == 1 or all((gradient != 0).any() for gradient in wanted)
    for one, other in zip(gradients, wanted, strict=True):
        torch.testing.assert_close(one, other.to(dtype), atol=atol, rtol=0)


def _gradients(results, weights, of):
    total = sum((each * weight).sum() for each, weight in zip(results, weights, strict=True))
    return torch.autograd.grad(total, of)


@pytest.mark.parametrize(("wiring", "delay"), [("stacked", 0), ("delayed", LAYERS - 1)])
def test_an_input_reaches_the_output_after_the_delay_of_the_wiring(wiring, delay, generator):
    backbone = make(wiring)
    frames = torch.randn(1, 8, INPUTS, dtype=torch.float64, generator=generator)
    other = frames.clone()
    other[:, 2] += 1
    contexts = [backbone(each, backbone.initial_state(1)).context for each in (frames, other)]
    changed = (contexts[0] - contexts[1]).abs().amax((0, 2)) > 1e-12
    assert changed.tolist() == [frame >= 2 + delay for frame in range(8)]


def test_a_cell_of_one_bias_has_no_other_anywhere():
    backbone = make("stacked", biases=1)
    assert not any("bias_hh" in name for name in backbone.state_dict())
    twin = copy.deepcopy(backbone).float()
    frames = torch.randn(2, 3, INPUTS)
    found = twin(frames, twin.initial_state(2)).context
    again = make("stacked", biases=1).float()
    again.load_state_dict(twin.state_dict())
    assert torch.equal(again(frames, again.initial_state(2)).context, found)


def test_forget_gates_start_open_by_as_much_as_they_are_told():
    plain_gates, open_gates = make("stacked"), make("stacked", forget_bias=1.0)
    for one, other in zip(plain_gates.parameters(), open_gates.parameters(), strict=True):
        change = (other - one).detach()
        if change.ndim == 1 and change.any():
            torch.testing.assert_close(
                change, torch.tensor([0.0, 1.0, 0.0, 0.0]).double().repeat_interleave(HIDDEN)
            )
        else:
            assert not change.any()
    moved = [
        a
        for a, b in zip(plain_gates.parameters(), open_gates.parameters(), strict=True)
        if not torch.equal(a, b)
    ]
    assert len(moved) == LAYERS


def test_cells_have_two_biases_as_the_papers_count_them():
    per_layer = [4 * HIDDEN * (inputs + HIDDEN + 2) for inputs in (INPUTS, HIDDEN, HIDDEN)]
    assert sum(weight.numel() for weight in make("stacked").parameters()) == sum(per_layer)
    assert sum(weight.numel() for weight in make("delayed").parameters()) == sum(per_layer)


@pytest.mark.parametrize("inputs", [96, 127, 251])
@pytest.mark.parametrize("wiring", ["stacked", "delayed"])
def test_the_network_of_the_papers_has_as_many_parameters_as_they_print(wiring, inputs):
    # Andreou et al. 2022, Table 4: Euler angles, quaternions and dual quaternions of 31 joints.
    printed = {96: 21_487_712, 127: 21_646_463, 251: 22_281_467}[inputs]
    with torch.device("meta"):
        network = nn.ModuleList([LSTMBackbone(inputs, wiring=wiring), nn.Linear(1024, inputs)])
    assert printed == 20_996_096 + 5121 * inputs
    assert sum(weight.numel() for weight in network.parameters()) == printed


@pytest.mark.parametrize("wiring", ["stacked", "delayed"])
def test_reading_goes_on_from_any_state(wiring, generator):
    backbone = make(wiring)
    shape = (2 * LAYERS, 2, HIDDEN)
    state = tuple(torch.randn(shape, dtype=torch.float64, generator=generator).tanh())
    frames = torch.randn(2, 4, INPUTS, dtype=torch.float64, generator=generator)
    context, after = backbone(frames, state)
    expected = plain(backbone, frames, state, wiring=wiring)
    for one, other in zip((context, *after), expected, strict=True):
        torch.testing.assert_close(one, other, atol=1e-12, rtol=0)


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("length", [1, 5])
@pytest.mark.parametrize("wiring", ["stacked", "delayed"])
def test_an_empty_batch_has_an_empty_summary_and_no_gradient(wiring, length, dtype):
    backbone = make(wiring, "learned").to(dtype)
    nothing = torch.empty(0, length, INPUTS, dtype=dtype)
    context, state = backbone(nothing, backbone.initial_state(0))
    assert context.shape == (0, length, HIDDEN)
    assert [part.shape for part in state] == [(0, HIDDEN)] * (2 * LAYERS)
    context.sum().backward()
    for weight in backbone.parameters():
        assert weight.grad is None or (weight.grad == 0).all()


def test_a_layer_is_given_a_contiguous_state(generator):
    """cuDNN refuses any other; the processor does not mind."""
    backbone = make("delayed", "learned")
    seen = []
    for layer in backbone.layers:
        layer.register_forward_pre_hook(lambda _, given: seen.extend(given[1]))
    frames = torch.randn(2, 4, INPUTS, dtype=torch.float64, generator=generator)
    backbone(frames, backbone.initial_state(2))
    assert len(seen) == 2 * LAYERS
    assert all(part.is_contiguous() for part in seen)


@pytest.mark.filterwarnings("ignore:The tensor attributes:UserWarning")
@pytest.mark.parametrize("length", [1, 4])
@pytest.mark.parametrize("wiring", ["stacked", "delayed"])
def test_a_captured_graph_agrees(wiring, length, generator):
    backbone = make(wiring, "learned")
    frames = torch.randn(2, length, INPUTS, dtype=torch.float64, generator=generator)
    with torch.no_grad():
        state = backbone.initial_state(2)
        captured = torch.export.export(backbone, (frames, state)).module()
        found, wanted = captured(frames, state), backbone(frames, state)
    for one, other in zip((found[0], *found[1]), (wanted[0], *wanted[1]), strict=True):
        torch.testing.assert_close(one, other, atol=1e-12, rtol=0)


@pytest.mark.parametrize("length", [1, 4])
def test_shapes_are_known_without_any_numbers(length):
    with torch.device("meta"):
        backbone = LSTMBackbone(INPUTS, HIDDEN, LAYERS, "delayed", "learned")
        context, state = backbone(torch.empty(2, length, INPUTS), backbone.initial_state(2))
    assert context.shape == (2, length, HIDDEN)
    assert context.is_meta
    assert [part.shape for part in state] == [(2, HIDDEN)] * (2 * LAYERS)


def test_a_wrong_number_of_layers_is_refused():
    for layers in (0, 101):
        with pytest.raises(ConfigError, match=f"layers: {layers}; expected 1 to 100"):
            LSTMBackbone(3, 4, layers)
