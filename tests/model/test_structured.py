"""The structured head: its trees, its size, and the same numbers as a network per joint."""

from __future__ import annotations

import pytest
import torch
from torch import nn

from posecast.errors import ConfigError
from posecast.model import StructuredHead
from posecast.model.reading_order import ReadingOrder
from posecast.skeleton import Skeleton
from posecast.skeleton.catalog import named_skeleton

# Two roots; joints of one level with different numbers of children.
FOREST = Skeleton(
    ("hips", "spine", "thigh", "head", "shoulder", "shin", "prop"), (-1, 0, 0, 1, 1, 2, -1)
)
ORDERS = [
    {"ancestors": "none"},
    {"ancestors": "parent"},
    {"ancestors": "all"},
    {"ancestors": "parent", "tree": "reverse"},
    {"ancestors": "all", "tree": "reverse"},
    {"ancestors": "parent", "tree": "random", "tree_seed": 3},
    {"ancestors": "all", "tree": "random"},
]


def named(reads, skeleton=FOREST):
    return {
        skeleton.names[joint]: [skeleton.names[each] for each in above]
        for joint, above in enumerate(reads)
    }


def by_hand(head, context):
    """One ``nn.Sequential`` a joint, in a loop."""
    units, order, found = head.units, head.order, {}
    slot = 0
    for number, joints in enumerate(order.groups):
        for place, joint in enumerate(joints):
            rows = slice(slot * units, (slot + 1) * units)
            parts = [
                head.context.weight[rows],
                *(head.above[number - 1][place : place + 1] if number else ()),
            ]
            weight = torch.cat(parts, dim=1)
            first = nn.Linear(weight.shape[1], units, dtype=weight.dtype)
            last = nn.Linear(units, head.joint_dim, dtype=weight.dtype)
            first.weight, first.bias = nn.Parameter(weight), nn.Parameter(head.context.bias[rows])
            last.weight = nn.Parameter(head.output[number][place])
            last.bias = nn.Parameter(head.output_bias[slot])
            read = [found[above] for above in order.reads[joint]]
            network = nn.Sequential(first, nn.ReLU(), last)
            found[joint] = network(torch.cat([context, *read], dim=-1))
            slot += 1
    return torch.stack([found[joint] for joint in sorted(found)], dim=-2)


@pytest.mark.parametrize("order", ORDERS)
def test_it_is_one_small_network_a_joint(order, generator):
    head = StructuredHead(11, FOREST, 3, hidden=5, **order).double()
    context = torch.randn(2, 4, 11, generator=generator, dtype=torch.float64)
    torch.testing.assert_close(head(context), by_hand(head, context))


@pytest.mark.parametrize("order", ORDERS)
def test_a_joint_depends_on_the_context_and_on_what_it_reads_alone(order, generator):
    head = StructuredHead(11, FOREST, 3, hidden=64, **order).double()
    context = torch.randn(4, 11, generator=generator, dtype=torch.float64)
    before = head(context)

    def reaches(joint):
        found = {joint}
        for _ in FOREST.names:
            found |= {j for j, reads in enumerate(head.order.reads) if found & set(reads)}
        return found

    slots = head._slots.tolist()
    for joint in range(len(FOREST)):
        with torch.no_grad():
            head.output_bias[slots[joint]] += 0.1
        after = head(context)
        with torch.no_grad():
            head.output_bias[slots[joint]] -= 0.1
        moved = (after - before).abs().amax((0, 2)) > 1e-9
        assert {j for j in range(len(FOREST)) if moved[j]} == reaches(joint)


def test_the_wirings_of_the_kinematic_tree():
    assert named(ReadingOrder.of(FOREST, ancestors="all").reads) == {
        "hips": [],
        "spine": ["hips"],
        "thigh": ["hips"],
        "head": ["spine", "hips"],
        "shoulder": ["spine", "hips"],
        "shin": ["thigh", "hips"],
        "prop": [],
    }
    assert named(ReadingOrder.of(FOREST, ancestors="parent").reads)["head"] == ["spine"]
    assert not any(ReadingOrder.of(FOREST, ancestors="none").reads)


def test_the_reversed_tree_runs_towards_the_root():
    assert named(ReadingOrder.of(FOREST, ancestors="parent", tree="reverse").reads) == {
        "hips": ["spine", "thigh"],
        "spine": ["head", "shoulder"],
        "thigh": ["shin"],
        "head": [],
        "shoulder": [],
        "shin": [],
        "prop": [],
    }
    dense = named(ReadingOrder.of(FOREST, ancestors="all", tree="reverse").reads)
    assert dense["hips"] == ["spine", "thigh", "head", "shoulder", "shin"]


def test_a_random_tree_has_the_shape_of_the_skeleton_and_follows_its_seed():
    def drawn(seed):
        return ReadingOrder.of(FOREST, ancestors="all", tree="random", tree_seed=seed).reads

    kinematic = ReadingOrder.of(FOREST, ancestors="all").reads
    assert drawn(1) == drawn(1)
    assert len({drawn(seed) for seed in range(10)}) > 5
    for seed in range(10):
        assert sorted(map(len, drawn(seed))) == sorted(map(len, kinematic))
        for joint, above in enumerate(drawn(seed)):
            assert joint not in above
            if above:  # what is above the parent is what the parent reads
                assert above[1:] == drawn(seed)[above[0]]


def test_a_tree_of_ones_own():
    tree = dict.fromkeys(FOREST.names) | {"hips": "prop", "spine": "hips"}
    reads = named(ReadingOrder.of(FOREST, ancestors="all", tree=tree).reads)
    assert reads["spine"] == ["hips", "prop"]
    assert reads["prop"] == reads["head"] == []


# Aksan et al. 2019: 1024 numbers of context, 64 hidden units, rotation matrices.
@pytest.mark.parametrize(
    ("skeleton", "ancestors", "parameters"),
    [
        ("smpl-15", "all", 1_013_511),
        ("smpl-15", "parent", 999_687),
        ("smpl-15", "none", 992_775),
        ("h36m-21", "all", 1_427_901),
        ("h36m-21", "parent", 1_401_405),
        ("h36m-21", "none", 1_389_885),
    ],
)
def test_sizes_are_those_of_the_paper(skeleton, ancestors, parameters):
    joints = named_skeleton(skeleton).skeleton
    head = StructuredHead(1024, joints, 9, hidden=64, ancestors=ancestors)
    assert sum(weight.numel() for weight in head.parameters()) == parameters


def test_a_random_tree_has_as_many_weights():
    joints = named_skeleton("smpl-15").skeleton
    head = StructuredHead(1024, joints, 9, hidden=64, tree="random", tree_seed=5)
    assert sum(weight.numel() for weight in head.parameters()) == 1_013_511


def test_weights_follow_the_generator_and_have_the_spread_of_a_layer_a_joint(generator):
    head = StructuredHead(391, FOREST, 3, hidden=100, ancestors="parent")
    head.reset_parameters(torch.Generator().manual_seed(1))
    first = [weight.detach().clone() for weight in head.parameters()]
    slots, rows = head._slots.tolist(), head.context.weight.unflatten(0, (-1, 100))
    # hips reads 391 numbers, its child three more.
    assert 0.999 < rows[slots[0]].abs().max() * 391**0.5 <= 1
    assert 0.999 < rows[slots[1]].abs().max() * 394**0.5 <= 1
    assert 0.99 < head.above[0].abs().max() * 394**0.5 <= 1
    assert 0.99 < head.output[0].abs().max() * 10 <= 1
    head.reset_parameters(torch.Generator().manual_seed(1))
    for weight, before in zip(head.parameters(), first, strict=True):
        assert torch.equal(weight, before)


def test_a_head_can_start_at_given_joints(generator):
    head = StructuredHead(11, FOREST, 3, hidden=64).double()
    wanted = torch.randn(7, 3, generator=generator, dtype=torch.float64)
    head.start_at(wanted)
    found = head(torch.randn(50, 11, generator=generator, dtype=torch.float64))
    assert (found - wanted).abs().max() < 0.2


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_gradients_are_those_of_a_network_a_joint(dtype, generator):
    head = StructuredHead(11, FOREST, 3, hidden=5).to(dtype)
    context = torch.randn(6, 11, generator=generator, dtype=dtype, requires_grad=True)
    weights = [context, *head.parameters()]
    pull = torch.randn(6, 7, 3, generator=generator, dtype=dtype)
    found = torch.autograd.grad((head(context) * pull).sum(), weights)
    plain = (context @ head.context.weight.T + head.context.bias).unflatten(-1, (7, 5))
    done: list[torch.Tensor] = []
    slots = {joint: slot for slot, joint in enumerate(j for g in head.order.groups for j in g)}
    slot = 0
    for number, joints in enumerate(head.order.groups):
        for place, joint in enumerate(joints):
            read = [done[slots[each]] for each in head.order.reads[joint]]
            first = plain[:, slot]
            if read:
                first = first + torch.cat(read, dim=-1) @ head.above[number - 1][place].T
            done.append(first.relu() @ head.output[number][place].T + head.output_bias[slot])
            slot += 1
    joints = torch.stack([done[slots[joint]] for joint in range(7)], dim=1)
    wanted = torch.autograd.grad((joints * pull).sum(), weights)
    for got, want in zip(found, wanted, strict=True):
        torch.testing.assert_close(got, want)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"hidden": 0}, "head.hidden is 0"),
        ({"tree": {"hips": None}}, "says nothing of spine, thigh"),
        ({"tree": dict.fromkeys((*FOREST.names, "tail"))}, "no joint is called 'tail'"),
        ({"tree": dict.fromkeys(FOREST.names, "hip")}, "no joint is called 'hip'; did you mean"),
        ({"tree": dict.fromkeys(FOREST.names, "hips")}, "runs in a circle"),
        ({"tree_seed": 4}, "set tree to random"),
        ({"tree": "random", "tree_seed": -1}, "expected 0 or more"),
        ({"ancestors": "none", "tree": "random"}, "read by nobody"),
    ],
)
def test_what_makes_no_sense_is_refused(options, message):
    with pytest.raises(ConfigError, match=message):
        StructuredHead(8, FOREST, 3, **options)
