"""Units that reset before the product: plain equations, and sizes of Martinez et al. 2017."""

from __future__ import annotations

import pytest
import torch

from posecast.errors import ConfigError
from posecast.model import DenseHead, EarlyResetGRUBackbone
from posecast.skeleton import Skeleton


def plain(backbone, frames, state):
    states = list(state)
    contexts = []
    for frame in frames.unbind(1):
        below = frame
        for layer, bias in enumerate(backbone.bias):
            inputs, own = backbone.from_below[layer], backbone.from_state[layer]
            before = states[layer]
            w_r, w_z, w_n = torch.cat([inputs, own], dim=1).chunk(3)
            b_r, b_z, b_n = bias.chunk(3)
            both = torch.cat([below, before], dim=1)
            reset = (both @ w_r.T + b_r).sigmoid()
            keep = (both @ w_z.T + b_z).sigmoid()
            new = (torch.cat([below, reset * before], dim=1) @ w_n.T + b_n).tanh()
            below = states[layer] = keep * before + (1 - keep) * new
        contexts.append(below)
    return torch.stack(contexts, dim=1), states


@pytest.mark.parametrize(("dtype", "atol"), [(torch.float64, 1e-12), (torch.float32, 2e-6)])
def test_it_computes_the_plain_equations_and_their_gradient(dtype, atol, generator):
    backbone = EarlyResetGRUBackbone(5, 4, 2, "learned").to(dtype)
    with torch.no_grad():
        for bias in backbone.bias:
            bias.add_(torch.randn(bias.shape, generator=generator))
    frames = torch.randn(3, 7, 5, generator=generator).to(dtype).requires_grad_()
    weights = [frames, *backbone.parameters()]
    found, after = backbone(frames, backbone.initial_state(3))
    wanted, last = plain(backbone, frames, backbone.initial_state(3))
    for one, other in zip((found, *after), (wanted, *last), strict=True):
        torch.testing.assert_close(one, other, atol=atol, rtol=0)
    slopes = [torch.autograd.grad(each.sin().sum(), weights) for each in (found, wanted)]
    for one, other in zip(*slopes, strict=True):
        torch.testing.assert_close(one, other, atol=20 * atol, rtol=0)


@pytest.mark.parametrize(("numbers", "parameters"), [(54, 3_370_038), (69, 3_431_493)])
def test_the_network_of_martinez_et_al_has_as_many_weights_as_theirs(numbers, parameters):
    # Without and with fifteen actions, in and out.
    pose = Skeleton(("all",), (-1,))
    parts = (EarlyResetGRUBackbone(numbers), DenseHead(1024, pose, numbers))
    assert sum(weight.numel() for part in parts for weight in part.parameters()) == parameters


def test_weights_are_drawn_as_tensorflow_draws_them(generator):
    backbone = EarlyResetGRUBackbone(100, 300)
    backbone.reset_parameters(generator)
    bounds = [(6 / (400 + 600)) ** 0.5, (6 / (400 + 300)) ** 0.5]
    for weight in (backbone.from_below[0], backbone.from_state[0]):
        for rows, bound in zip((weight[:600], weight[600:]), bounds, strict=True):
            assert 0.998 * bound < rows.abs().max() <= bound
    assert torch.equal(backbone.bias[0], torch.ones(900).index_fill(0, torch.arange(600, 900), 0))


def test_layers_that_make_no_sense_are_refused():
    with pytest.raises(ConfigError, match="layers: 0"):
        EarlyResetGRUBackbone(5, layers=0)
