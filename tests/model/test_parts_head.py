"""The head of a network a part: against its equations, what is shared, and where it can start."""

from __future__ import annotations

import pytest
import torch

from posecast.errors import ConfigError
from posecast.model import BodyParts, PartsHead
from posecast.skeleton import Skeleton

SKELETON = Skeleton(
    ("hips", "left_hip", "left_foot", "right_hip", "right_foot", "head", "left_arm", "right_arm"),
    (-1, 0, 1, 0, 3, 0, 5, 5),
)
PARTS = ([0, 5], [6], [7], [1, 2], [3, 4])


def make(hidden=None):
    head = PartsHead(20, SKELETON, 3, body=BodyParts.of(SKELETON), hidden=hidden)
    head.reset_parameters(torch.Generator().manual_seed(3))
    return head.double()


@pytest.mark.parametrize("hidden", [None, 7, [7, 6]])
def test_it_is_one_network_a_part_and_both_sides_have_the_same(hidden, generator):
    head = make(hidden)
    context = torch.randn(2, 5, 20, generator=generator, dtype=torch.float64)
    wanted = torch.empty(2, 5, 8, 3, dtype=torch.float64)
    for number, joints in enumerate(PARTS):
        kind, rows = (number + 1) // 2, context[..., 4 * number : 4 * number + 4]
        for layer in head.hidden[kind]:
            rows = (rows @ layer.weight.T + layer.bias).clamp(min=0)
        output = head.output[kind]
        wanted[..., joints, :] = (rows @ output.weight.T + output.bias).unflatten(-1, (-1, 3))
    torch.testing.assert_close(head(context), wanted)
    assert (len(head.hidden), len(head.output)) == (3, 3)


def test_weights_follow_the_generator_and_have_the_spread_of_pytorch():
    head = PartsHead(2000, SKELETON, 3, body=BodyParts.of(SKELETON), hidden=300)
    head.reset_parameters(torch.Generator().manual_seed(1))
    first = [weight.detach().clone() for weight in head.parameters()]
    # A part reads 400 of the 2000 numbers.
    for layers in head.hidden:
        assert 0.0499 < layers[0].weight.abs().max() <= 0.05
    head.reset_parameters(torch.Generator().manual_seed(1))
    assert all(map(torch.equal, head.parameters(), first))


def test_it_can_start_at_given_joints_and_at_the_mean_of_both_sides(generator):
    head = make(64)
    wanted = torch.randn(8, 3, generator=generator, dtype=torch.float64)
    head.start_at(wanted)
    found = head(torch.randn(50, 20, generator=generator, dtype=torch.float64))
    mirrored = wanted[[0, 3, 4, 1, 2, 5, 7, 6]]
    assert (found - (wanted + mirrored) / 2).abs().max() < 0.2


@pytest.mark.parametrize("hidden", [0, [8, 0]])
def test_a_hidden_layer_without_units_is_refused(hidden):
    with pytest.raises(ConfigError, match=r"head\.hidden is"):
        make(hidden)
