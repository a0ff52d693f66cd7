"""The convolutional backbone: its size, how far it looks back, and the same numbers as Conv1d."""

from __future__ import annotations

import pytest
import torch
from torch import nn

from posecast.errors import ConfigError
from posecast.model import ConvolutionalBackbone, DenseHead
from posecast.skeleton.catalog import named_skeleton

FIELDS = {
    1: [1, 1, 1, 1, 1],
    2: [2, 1, 1, 1, 1],
    4: [2, 2, 1, 1, 1],
    8: [2, 2, 2, 1, 1],
    16: [2, 2, 2, 2, 1],
    32: [2, 2, 2, 2, 2],
    48: [2, 2, 2, 2, 3],
}


def test_five_layers_with_a_dense_head_are_as_large_as_in_the_paper():
    backbone = ConvolutionalBackbone(128)
    head = DenseHead(backbone.context_dim, named_skeleton("h36m-32").skeleton, 4)
    weights = [*backbone.parameters(), *head.parameters()]
    assert sum(weight.numel() for weight in weights) == 6_819_968


@pytest.mark.parametrize(("field", "widths"), FIELDS.items())
def test_receptive_fields_of_the_paper(field, widths, generator):
    backbone = ConvolutionalBackbone(3, 16, widths).double()
    assert backbone.receptive_field == field
    frames = torch.randn(1, 60, 3, generator=generator, dtype=torch.float64, requires_grad=True)
    context, _ = backbone(frames, backbone.initial_state(1))
    (slope,) = torch.autograd.grad(context[0, 55].sum(), frames)
    reached = slope[0].abs().sum(-1) > 0
    assert reached.nonzero().flatten().tolist() == list(range(56 - field, 56))


def test_it_is_a_stack_of_dilated_convolutions(generator):
    widths, dilations = (2, 3, 2, 2), (1, 2, 4, 2)
    backbone = ConvolutionalBackbone(5, 7, widths, dilations).double()
    frames = torch.randn(2, 20, 5, generator=generator, dtype=torch.float64)
    below = frames.transpose(1, 2)
    for number, layer in enumerate(backbone.layers):
        width, dilation = widths[number], dilations[number]
        weight = layer.weight.unflatten(1, (width, -1)).transpose(1, 2)
        padded = nn.functional.pad(below, ((width - 1) * dilation, 0))
        made = nn.functional.conv1d(padded, weight, layer.bias, dilation=dilation).relu()
        below = below + made if number in (1, 3) else made
    last = nn.functional.pad(below, (2, 0))
    wanted = torch.cat([last[:, :, :-2], last[:, :, 2:]], dim=1).transpose(1, 2)
    context, _ = backbone(frames, backbone.initial_state(2))
    torch.testing.assert_close(context, wanted)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"channels": 0}, "channels: 0"),
        ({"widths": []}, "0 layers, dilations: 5"),
        ({"widths": [2, 2]}, "2 layers, dilations: 5"),
        ({"widths": [2, 2, 0, 2, 2]}, "expected 1 or more of each"),
        ({"widths": [2], "dilations": [1_000_000]}, "receptive field of 1000001 frames"),
    ],
)
def test_layers_that_make_no_sense_are_refused(options, message):
    with pytest.raises(ConfigError, match=message):
        ConvolutionalBackbone(4, **options)
