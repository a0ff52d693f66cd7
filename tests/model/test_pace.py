"""The pace network: published sizes, what it may see, and reading a path as it grows."""

from __future__ import annotations

from itertools import pairwise

import pytest
import torch

from posecast.errors import ConfigError
from posecast.model.pace import INPUTS, OUTPUTS, PaceNetwork


def drawn(generator, delay=None, hidden=6) -> PaceNetwork:
    network = PaceNetwork(hidden=hidden, delay=delay).double()
    network.reset_parameters(generator)
    with torch.no_grad():
        if network.end is not None:
            network.end.copy_(torch.tensor([0.3, -0.2]))
    return network


@pytest.mark.parametrize(("delay", "parameters"), [(None, 6424), (100, 3216)])
def test_pace_networks_have_the_published_size(delay, parameters):
    network = PaceNetwork(delay=delay)
    assert sum(weight.numel() for weight in network.parameters()) == parameters


@pytest.mark.parametrize("delay", [None, 0, 3, 40])
def test_every_point_of_a_path_has_a_pace(delay, generator):
    points = torch.randn(2, 25, len(INPUTS), generator=generator, dtype=torch.float64)
    assert drawn(generator, delay)(points).shape == (2, 25, len(OUTPUTS))


def sensitivity(network: PaceNetwork, point: int, length: int = 20) -> set[int]:
    """The points that what is said of one depends on."""
    points = torch.zeros(1, length, len(INPUTS), dtype=torch.float64, requires_grad=True)
    network(points)[0, point].sum().backward()
    return set(points.grad[0].abs().sum(-1).nonzero()[:, 0].tolist())


def test_without_a_delay_the_whole_path_is_seen_from_every_point(generator):
    network = drawn(generator)
    assert all(sensitivity(network, point) == set(range(20)) for point in (0, 7, 19))


@pytest.mark.parametrize("delay", [0, 1, 5])
def test_a_delayed_network_sees_as_far_ahead_as_its_delay(delay, generator):
    network = drawn(generator, delay)
    for point in (0, 7, 19):
        assert sensitivity(network, point) == set(range(min(point + delay + 1, 20)))


@pytest.mark.parametrize("delay", [0, 4, 30])
@pytest.mark.parametrize("cuts", [(5,), (1, 2, 3), (12, 19), (0, 20)])
def test_a_path_may_be_read_in_pieces(delay, cuts, generator):
    network = drawn(generator, delay)
    points = torch.randn(3, 20, len(INPUTS), generator=generator, dtype=torch.float64)
    state, said = network.start(3), []
    edges = (0, *cuts, 20)
    for first, last in pairwise(edges):
        piece, state = network.read(points[:, first:last], state)
        said.append(piece)
        # Nothing is said of a point before as many after it were read.
        assert sum(each.shape[1] for each in said) == max(last - delay, 0)
    rest, _ = network.read(points[:, :0], state, ends=True)
    torch.testing.assert_close(torch.cat([*said, rest], dim=1), network(points))


def test_a_network_that_needs_the_whole_path_reads_no_pieces(generator):
    with pytest.raises(ConfigError, match="take a delayed one for paths that grow"):
        drawn(generator).start(1)


@pytest.mark.parametrize(("hidden", "delay"), [(0, None), (3, -1)])
def test_sizes_that_no_network_has_are_refused(hidden, delay):
    with pytest.raises(ConfigError, match="expected a unit or more, and no negative delay"):
        PaceNetwork(hidden=hidden, delay=delay)


def test_the_first_state_is_learned_and_drawn_as_published(generator):
    network = PaceNetwork(hidden=4000)
    network.reset_parameters(generator)
    assert network.initial.std().item() == pytest.approx(0.01, rel=0.05)
    points = torch.zeros(1, 3, len(INPUTS))
    network(points).sum().backward()
    assert (network.initial.grad != 0).any()
