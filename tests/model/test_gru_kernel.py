"""The written-out layer agrees with ``torch.nn.GRU`` and with the plain equations."""

from __future__ import annotations

import copy
import io

import pytest
import torch
from tests.references.plain_gru import gru_frame_by_frame

from posecast.model import GRUBackbone, gru_kernel, products, recurrent
from posecast.model.products import FEW_ROWS, Weight, can_pack, exact_products

HIDDEN = 9


@pytest.fixture(autouse=True)
def the_kernel_for_every_layer(monkeypatch):
    """Small layers are left to PyTorch otherwise, and so is most inference."""
    monkeypatch.setattr(recurrent, "_LEAST_UNITS", 1)
    monkeypatch.setattr(recurrent, "packing_pays", lambda rows, like: True)


def make_backbone(dtype=torch.float64, layers=2):
    backbone = GRUBackbone(5, hidden=HIDDEN, layers=layers)
    backbone.reset_parameters(torch.Generator().manual_seed(1))
    return backbone.to(dtype)


def make_frames(batch, frames, generator, dtype=torch.float64):
    drawn = torch.randn(batch, frames, 5, generator=generator, dtype=dtype)
    return drawn.requires_grad_()


def in_pieces(backbone, frames, lengths):
    """Context and last state, with as many calls as there are lengths."""
    state = backbone.initial_state(len(frames))
    contexts = []
    for piece in frames.split(lengths, dim=1):
        context, state = backbone(piece, state)
        contexts.append(context)
    return torch.cat(contexts, dim=1), torch.stack(state)


def values_and_gradients(backbone, frames, result):
    context, state = result
    loss = context.sin().sum() + state.square().sum()
    gradients = torch.autograd.grad(loss, [frames, *backbone.parameters()])
    return [context, state, *gradients]


def test_the_slow_reference_is_a_gru(generator):
    network, frames = make_backbone().gru, make_frames(3, 6, generator)
    state = torch.randn(2, 3, HIDDEN, generator=generator, dtype=torch.float64)
    for found, expected in zip(
        gru_frame_by_frame(network, frames, state), network(frames, state), strict=True
    ):
        torch.testing.assert_close(found, expected)


@pytest.mark.parametrize("batch", [1, 3, 40])
@pytest.mark.parametrize("lengths", [[10], [4, 6], [7, 1, 1, 1], [1] * 10])
@pytest.mark.parametrize("reference", ["nn.GRU", "equations"])
def test_values_and_gradients_agree_in_double_precision(batch, lengths, reference, generator):
    backbone, frames = make_backbone(), make_frames(batch, 10, generator)
    # 40 sequences of 7 or 10 frames are more rows than are packed, the others fewer.
    assert 3 * 10 < FEW_ROWS < 40 * 7
    first = torch.stack(backbone.initial_state(batch))
    if reference == "nn.GRU":
        expected = backbone.gru(frames, first)
    else:
        expected = gru_frame_by_frame(backbone.gru, frames, first)
    wanted = values_and_gradients(backbone, frames, expected)
    found = values_and_gradients(backbone, frames, in_pieces(backbone, frames, lengths))
    assert len(found) == 2 + 1 + 1 + 8
    for one, other in zip(found, wanted, strict=True):
        torch.testing.assert_close(one, other, atol=1e-10, rtol=0)


@pytest.mark.parametrize("rows", [1, 90, 150])
def test_a_long_run_goes_through_backward_in_blocks(rows, generator, monkeypatch):
    backbone, frames = make_backbone(), make_frames(40, 10, generator)
    wanted = values_and_gradients(backbone, frames, in_pieces(backbone, frames, [10]))
    # Nine frames in blocks of one, of three, and of five and four.
    monkeypatch.setattr(gru_kernel, "_BLOCK_ROWS", rows)
    found = values_and_gradients(backbone, frames, in_pieces(backbone, frames, [9, 1]))
    for one, other in zip(found, wanted, strict=True):
        torch.testing.assert_close(one, other, atol=1e-11, rtol=0)


def test_without_the_number_of_a_backward_pass_gradients_are_the_same(generator, monkeypatch):
    backbone, frames = make_backbone(), make_frames(3, 10, generator)
    wanted = values_and_gradients(backbone, frames, in_pieces(backbone, frames, [8, 1, 1]))
    assert gru_kernel._current_pass() is not None
    monkeypatch.delattr(torch._C, "_current_graph_task_id")
    assert gru_kernel._current_pass() is None
    found = values_and_gradients(backbone, frames, in_pieces(backbone, frames, [8, 1, 1]))
    for one, other in zip(found, wanted, strict=True):
        torch.testing.assert_close(one, other, atol=1e-11, rtol=0)


@pytest.mark.parametrize("lengths", [[10], [4, 6], [1] * 10])
@pytest.mark.parametrize("mode", [torch.no_grad, torch.inference_mode])
def test_values_agree_where_no_gradient_is_wanted(lengths, mode, generator):
    backbone, frames = make_backbone(), make_frames(3, 10, generator)
    with mode():
        found = in_pieces(backbone, frames, lengths)
        wanted = backbone.gru(frames, torch.stack(backbone.initial_state(3)))
    for one, other in zip(found, wanted, strict=True):
        assert not one.requires_grad
        torch.testing.assert_close(one, other, atol=1e-10, rtol=0)


@pytest.mark.parametrize(
    ("hidden", "gradient", "packs", "used"),
    [
        (255, True, True, False),
        (256, True, False, True),
        (256, False, False, False),
        (256, False, True, True),
    ],
)
def test_the_kernel_is_used_where_it_pays(hidden, gradient, packs, used, generator, monkeypatch):
    monkeypatch.undo()
    monkeypatch.setattr(recurrent, "packing_pays", lambda rows, like: packs)
    backbone = GRUBackbone(5, hidden=hidden, layers=2).double()
    frames, calls = make_frames(3, 4, generator), []
    kernel = backbone._read_by_kernel
    monkeypatch.setattr(
        backbone, "_read_by_kernel", lambda *given: calls.append(1) or kernel(*given)
    )
    with torch.set_grad_enabled(gradient):
        found = in_pieces(backbone, frames, [2, 1, 1])
        wanted = backbone.gru(frames, torch.stack(backbone.initial_state(3)))
    assert len(calls) == (3 if used else 0)
    for one, other in zip(found, wanted, strict=True):
        torch.testing.assert_close(one, other, atol=1e-10, rtol=0)


@pytest.mark.parametrize("batch", [1, 40])
def test_values_and_gradients_agree_in_single_precision(batch, generator):
    backbone = make_backbone(torch.float32)
    frames = make_frames(batch, 10, generator, torch.float32)
    first = torch.stack(backbone.initial_state(batch))
    wanted = values_and_gradients(backbone, frames, backbone.gru(frames, first))
    found = values_and_gradients(backbone, frames, in_pieces(backbone, frames, [7, 1, 2]))
    for one, other in zip(found, wanted, strict=True):
        # Rounding of sums of up to 400 terms of size one.
        torch.testing.assert_close(one, other, atol=1e-4, rtol=1e-5)


def test_the_gradient_agrees_with_finite_differences(generator):
    backbone, frames = make_backbone(layers=1), make_frames(2, 3, generator)
    assert torch.autograd.gradcheck(lambda x: in_pieces(backbone, x, [2, 1]), [frames])


def test_gradients_of_several_rollouts_add_up(generator):
    backbone, frames = make_backbone(), make_frames(3, 6, generator)
    in_pieces(backbone, frames, [6])[0].sum().backward()
    once = backbone.gru.weight_hh_l0.grad.clone()
    in_pieces(backbone, frames, [3, 3])[0].sum().backward()
    torch.testing.assert_close(backbone.gru.weight_hh_l0.grad, 2 * once)


def test_a_session_can_go_through_backward_twice(generator):
    backbone, frames = make_backbone(), make_frames(3, 6, generator)
    context, _ = in_pieces(backbone, frames, [3, 3])
    weight = backbone.gru.weight_ih_l1
    (first,) = torch.autograd.grad(context[:, 1].sum(), weight, retain_graph=True)
    (second,) = torch.autograd.grad(context[:, 5].sum(), weight, retain_graph=True)
    (both,) = torch.autograd.grad(context[:, [1, 5]].sum(), weight)
    torch.testing.assert_close(first + second, both)


def test_a_gradient_of_the_frames_alone_leaves_nothing_for_the_next(generator):
    backbone, frames = make_backbone(), make_frames(3, 6, generator)
    context, _ = in_pieces(backbone, frames, [6])
    torch.autograd.grad(context.sum(), frames, retain_graph=True)
    (found,) = torch.autograd.grad(context.sum(), backbone.gru.weight_hh_l0)
    expected, _ = backbone.gru(frames, torch.stack(backbone.initial_state(3)))
    (wanted,) = torch.autograd.grad(expected.sum(), backbone.gru.weight_hh_l0)
    torch.testing.assert_close(found, wanted)


def test_frozen_weights_get_no_gradient_and_let_it_through(generator):
    backbone, frames = make_backbone(), make_frames(3, 6, generator)
    expected, _ = backbone.gru(frames, torch.stack(backbone.initial_state(3)))
    (wanted,) = torch.autograd.grad(expected.sum(), frames)
    backbone.requires_grad_(False)
    in_pieces(backbone, frames, [4, 2])[0].sum().backward()
    torch.testing.assert_close(frames.grad, wanted)
    assert all(weight.grad is None for weight in backbone.parameters())


@pytest.mark.parametrize("counted", [True, False])
def test_changed_weights_are_noticed(counted, generator):
    backbone = make_backbone(torch.float32)
    frames = make_frames(3, 6, generator, torch.float32).detach()
    with torch.no_grad():
        before, _ = in_pieces(backbone, frames, [6])
        for weight in backbone.gru.parameters():
            # Through ``data`` PyTorch does not count a change; a new session sees it all the same.
            (weight if counted else weight.data).mul_(0.5)
        after, _ = in_pieces(backbone, frames, [6])
        wanted, _ = backbone.gru(frames, torch.stack(backbone.initial_state(3)))
    assert not torch.allclose(before, after, atol=1e-3)
    torch.testing.assert_close(after, wanted)


def test_weights_that_change_before_backward_are_an_error(generator):
    backbone, frames = make_backbone(), make_frames(3, 6, generator)
    context, _ = in_pieces(backbone, frames, [6])
    with torch.no_grad():
        backbone.gru.weight_hh_l0.mul_(0.5)
    with pytest.raises(RuntimeError, match="modified by an inplace operation"):
        context.sum().backward()


def test_inference_and_training_may_alternate(generator):
    backbone = make_backbone(torch.float32)
    frames = make_frames(3, 6, generator, torch.float32)
    with torch.inference_mode():
        forecast, _ = in_pieces(backbone, frames, [5, 1])
    context, _ = in_pieces(backbone, frames, [5, 1])
    context.sum().backward()
    torch.testing.assert_close(forecast.clone(), context.detach())
    assert backbone.gru.weight_hh_l0.grad is not None


def test_a_backbone_in_use_can_be_copied_and_pickled(generator):
    backbone, frames = make_backbone(), make_frames(3, 6, generator)
    context, _ = in_pieces(backbone, frames, [6])
    buffer = io.BytesIO()
    torch.save(backbone, buffer)
    buffer.seek(0)
    loaded = torch.load(buffer, weights_only=False)
    for twin in (copy.deepcopy(backbone), loaded):
        torch.testing.assert_close(in_pieces(twin, frames, [6])[0], context)


def test_parameters_are_named_as_those_of_a_gru():
    backbone = make_backbone()
    names = {name.removeprefix("gru.") for name in backbone.state_dict() if name != "first"}
    assert len(names) == 8
    assert names == set(torch.nn.GRU(5, HIDDEN, 2).state_dict())


def test_the_global_precision_of_products_is_left_as_it_was(generator):
    like = torch.zeros(1)
    for precision in ("highest", "high", "medium"):
        torch.set_float32_matmul_precision(precision)
        try:
            with exact_products(like):
                pass
            with pytest.raises(KeyError), exact_products(like):
                raise KeyError
            assert torch.get_float32_matmul_precision() == precision
        finally:
            torch.set_float32_matmul_precision("highest")


@pytest.mark.parametrize("rows", [1, 60, FEW_ROWS, FEW_ROWS + 1])
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("packs", [True, False])
def test_products_have_the_precision_of_their_factors(rows, dtype, packs, generator, monkeypatch):
    matrix = torch.randn(70, 300, generator=generator, dtype=torch.float64)
    left = torch.randn(rows, 300, generator=generator, dtype=torch.float64)
    bias = torch.randn(70, generator=generator, dtype=torch.float64)
    weight = Weight(matrix.to(dtype))
    # Whatever this processor would choose.
    packs = packs and can_pack(weight.matrix)
    monkeypatch.setattr(products, "packing_pays", lambda rows, like: packs and rows <= FEW_ROWS)
    weight._packs_back = packs
    found = weight.product(left.to(dtype), bias.to(dtype))
    # Sums of 300 products of size one; bfloat16 factors would be off by 0.1.
    tolerance = 1e-4 if dtype == torch.float32 else 1e-12
    torch.testing.assert_close(
        found.double(), left @ matrix.T + bias, atol=tolerance, rtol=tolerance
    )
    back = weight.back(found, onto=left.to(dtype, copy=True))
    wanted = left.to(dtype) + found @ matrix.to(dtype)
    torch.testing.assert_close(back, wanted, atol=100 * tolerance, rtol=tolerance)


@pytest.mark.filterwarnings("ignore:The tensor attributes:UserWarning")
def test_a_captured_graph_agrees(generator):
    backbone = make_backbone(torch.float32)
    frames = make_frames(3, 6, generator, torch.float32).detach()
    with torch.no_grad():
        state = backbone.initial_state(3)
        captured = torch.export.export(backbone, (frames, state)).module()
        found, wanted = captured(frames, state), backbone(frames, state)
    torch.testing.assert_close(found[0], wanted[0])
    for one, other in zip(found[1], wanted[1], strict=True):
        torch.testing.assert_close(one, other)
