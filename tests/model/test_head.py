"""The dense head."""

from __future__ import annotations

import pytest
import torch

from posecast.model import DenseHead
from posecast.skeleton import Skeleton

SKELETON = Skeleton(("hips", "spine", "head"), (-1, 0, 1))


def test_a_dense_head_is_one_linear_layer(generator):
    head = DenseHead(7, SKELETON, 4)
    context = torch.randn(2, 5, 7, generator=generator)
    flat = context @ head.output.weight.T + head.output.bias
    torch.testing.assert_close(head(context), flat.view(2, 5, 3, 4))
    assert sum(weight.numel() for weight in head.parameters()) == 7 * 12 + 12


@pytest.mark.parametrize("units", [11, [11], [11, 6]])
def test_hidden_layers_are_rectified(units, generator):
    head = DenseHead(7, SKELETON, 3, hidden=units)
    context = torch.randn(2, 7, generator=generator)
    hidden = context
    for layer in head.hidden:
        hidden = (hidden @ layer.weight.T + layer.bias).clamp(min=0)
    assert [layer.out_features for layer in head.hidden] == ([units] if units == 11 else units)
    wanted = hidden @ head.output.weight.T + head.output.bias
    torch.testing.assert_close(head(context), wanted.view(2, 3, 3))


def test_weights_follow_the_generator_and_have_the_spread_of_pytorch():
    head = DenseHead(400, SKELETON, 4, hidden=300)
    head.reset_parameters(torch.Generator().manual_seed(1))
    first = head.hidden[0].weight.detach().clone()
    # Uniform within 1 / sqrt(400).
    assert 0.0499 < first.abs().max() <= 0.05
    head.reset_parameters(torch.Generator().manual_seed(1))
    assert torch.equal(head.hidden[0].weight, first)
