"""Structural-RNN: against its equations, its size, what is shared, and what reaches what."""

from __future__ import annotations

from functools import partial

import pytest
import torch

from posecast.errors import ConfigError
from posecast.model import Forecaster, GRUBackbone, PartsHead, StructuralRNNBackbone
from posecast.representation import Codec, Quaternion
from posecast.skeleton import Skeleton

SKELETON = Skeleton(
    ("hips", "left_hip", "left_foot", "right_hip", "right_foot", "head", "left_arm", "right_arm"),
    (-1, 0, 1, 0, 3, 0, 5, 5),
)
JOINT_DIM, OTHERS = 3, 2
INPUTS = len(SKELETON) * JOINT_DIM + OTHERS
JOINTS = {
    "torso": [0, 5],
    "left_arm": [6],
    "right_arm": [7],
    "left_leg": [1, 2],
    "right_leg": [3, 4],
}
OTHER_SIDE = {"left_arm": "right_arm", "left_leg": "right_leg"}
OTHER_SIDE |= {right: left for left, right in OTHER_SIDE.items()}
MIRRORED = [0, 3, 4, 1, 2, 5, 7, 6]


def make(temporal="linear"):
    backbone = StructuralRNNBackbone(
        INPUTS, SKELETON, JOINT_DIM, hidden=4, encoder=6, temporal=temporal
    )
    backbone.reset_parameters(torch.Generator().manual_seed(3))
    return backbone.double()


def own_numbers(frame):
    """What every part has to say of itself in one frame; what is no joint's is the torso's."""
    joints = frame[:, :-OTHERS].unflatten(-1, (-1, JOINT_DIM))
    found = {part: joints[:, chosen].flatten(1) for part, chosen in JOINTS.items()}
    found["torso"] = torch.cat([found["torso"], frame[:, -OTHERS:]], dim=-1)
    return found


def lstm(memory, inputs, remembered, key):
    """One step of a cell with a state of its own for every ``key``; its input goes on beside it."""
    from_input, from_output, bias = memory.lstm.layers[0].parameters()
    nothing = inputs.new_zeros(len(inputs), memory.lstm.hidden)
    output, cell = remembered.get(key, (nothing, nothing))
    gates = inputs @ from_input.T + output @ from_output.T + bias
    entry, forget, new, out = gates.chunk(4, dim=-1)
    cell = forget.sigmoid() * cell + entry.sigmoid() * new.tanh()
    remembered[key] = (out.sigmoid() * cell.tanh(), cell)
    return torch.cat([remembered[key][0], inputs], dim=-1)


def plain(backbone, frames):
    """Frame by frame, part by part, edge by edge."""
    remembered, contexts = {}, []

    def edge(kind, part, inputs):
        module = backbone.edges[kind]
        first, second = module.layers
        hidden = (inputs @ first.weight.T + first.bias).clamp(min=0)
        said = hidden @ second.weight.T + second.bias
        if module.memory is None:
            return said
        return lstm(module.memory, said, remembered, (kind, part))

    for frame in frames.unbind(1):
        own, found = own_numbers(frame), []
        for part in JOINTS:
            limb = part.rpartition("_")[2]
            said = [edge(limb, part, own[part])]
            if part == "torso":
                for limbs in ("arm", "leg"):
                    both = [
                        torch.cat([own[part], own[f"{side}_{limbs}"]], dim=-1) for side in SIDES
                    ]
                    said.append(edge(f"torso_{limbs}", part, both[0] + both[1]))
            else:
                for kind, pair in (
                    (f"torso_{limb}", ["torso", part]),
                    (f"{limb}_{limb}", [part, OTHER_SIDE[part]]),
                ):
                    said.append(edge(kind, part, torch.cat([own[each] for each in pair], dim=-1)))
            found.append(lstm(backbone.nodes[limb], torch.cat(said, -1), remembered, part))
        contexts.append(torch.cat(found, dim=-1))
    return torch.stack(contexts, dim=1)


SIDES = ("left", "right")


# In single precision PyTorch hands the layers to oneDNN, another implementation.
@pytest.mark.parametrize(("dtype", "atol"), [(torch.float64, 1e-12), (torch.float32, 1e-5)])
@pytest.mark.parametrize("temporal", ["linear", "lstm"])
@pytest.mark.parametrize("length", [1, 5])
def test_it_computes_the_equations_of_every_edge_and_part_and_their_gradient(
    temporal, length, dtype, atol, generator
):
    backbone = make(temporal)
    frames = torch.randn(3, length, INPUTS, dtype=torch.float64, generator=generator)
    slow = frames.clone().requires_grad_()
    expected = plain(backbone, slow)
    pull = torch.randn(expected.shape, dtype=torch.float64, generator=generator)
    wanted = torch.autograd.grad((expected * pull).sum(), [slow, *backbone.parameters()])
    backbone.to(dtype)
    frames = frames.to(dtype).requires_grad_()
    context, _ = backbone(frames, backbone.initial_state(3))
    assert context.shape == (3, length, backbone.context_dim)
    torch.testing.assert_close(context, expected.to(dtype), atol=atol, rtol=0)
    weights = [frames, *backbone.parameters()]
    found = torch.autograd.grad((context * pull.to(dtype)).sum(), weights)
    for one, other in zip(found, wanted, strict=True):
        torch.testing.assert_close(one, other.to(dtype), atol=10 * atol, rtol=0)


@pytest.mark.parametrize("temporal", ["linear", "lstm"])
def test_swapping_left_and_right_swaps_what_is_said_of_them(temporal, generator):
    backbone = make(temporal)
    frames = torch.randn(2, 6, INPUTS, dtype=torch.float64, generator=generator)
    joints = frames[..., :-OTHERS].unflatten(-1, (-1, JOINT_DIM))[:, :, MIRRORED].flatten(-2)
    mirrored = torch.cat([joints, frames[..., -OTHERS:]], dim=-1)
    context, swapped = (
        backbone(each, backbone.initial_state(2)).context.unflatten(-1, (5, -1))
        for each in (frames, mirrored)
    )
    torch.testing.assert_close(swapped, context[:, :, [0, 2, 1, 4, 3]], atol=1e-12, rtol=0)
    assert not torch.allclose(context[:, :, 1], context[:, :, 2])


def test_a_part_hears_of_itself_and_of_those_it_has_an_edge_with_alone(generator):
    backbone = make()
    frames = torch.randn(1, 4, INPUTS, dtype=torch.float64, generator=generator)
    frames.requires_grad_()
    context = backbone(frames, backbone.initial_state(1)).context.unflatten(-1, (5, -1))
    reached = {}
    for number, part in enumerate(JOINTS):
        (slope,) = torch.autograd.grad(context[:, -1, number].sum(), frames, retain_graph=True)
        for frame in (0, 3):
            numbers = own_numbers(slope[:, frame])
            assert all((each != 0).all() for each in numbers.values() if each.any())
            reached[part] = {other for other, each in numbers.items() if each.any()}
    arms, legs = {"left_arm", "right_arm"}, {"left_leg", "right_leg"}
    assert reached == {
        "torso": set(JOINTS),
        **{part: {"torso", *limbs} for limbs in (arms, legs) for part in limbs},
    }


def test_a_network_of_54_numbers_has_the_size_of_the_published_layers():
    # Jain et al. have 18 numbers of the torso, 10 of an arm, 8 of a leg: pairs, here. Edges have
    # layers of 256 and 256, spatial ones an LSTM of 512 besides; nodes an LSTM of 512, then layers
    # of 256 and 100.
    names = [f"torso{k}" for k in range(9)]
    names += [f"{side}_arm{k}" for side in SIDES for k in range(5)]
    names += [f"{side}_leg{k}" for side in SIDES for k in range(4)]
    skeleton = Skeleton(tuple(names), tuple(range(-1, 26)))
    backbone = StructuralRNNBackbone(54, skeleton, 2)
    head = PartsHead(backbone.context_dim, skeleton, 2, body=backbone.body, hidden=[256, 100])
    first = sum((read + 1) * 256 for read in (18, 10, 8, 28, 26, 20, 16))
    edges = first + 7 * 257 * 256 + 4 * 4 * 512 * (256 + 512 + 1)
    heard = 256 + 2 * (256 + 512)
    nodes = 3 * 4 * 512 * (heard + 512 + 1)
    layers = 3 * ((heard + 512 + 1) * 256 + 257 * 100) + 101 * (18 + 10 + 8)
    assert edges + nodes + layers == 22_807_136
    found = sum(weight.numel() for part in (backbone, head) for weight in part.parameters())
    assert found == 22_807_136


@pytest.mark.parametrize("temporal", ["linear", "lstm"])
@pytest.mark.parametrize("length", [1, 3])
def test_an_empty_batch_has_an_empty_summary(temporal, length):
    backbone = make(temporal)
    frames = torch.zeros(0, length, INPUTS, dtype=torch.float64)
    context, state = backbone(frames, backbone.initial_state(0))
    assert context.shape == (0, length, backbone.context_dim)
    assert all(len(part) == 0 for part in state)


@pytest.mark.parametrize(
    ("inputs", "options", "message"),
    [
        (INPUTS, {"hidden": 0}, "hidden: 0, encoder: 256; expected 1 or more"),
        (INPUTS, {"encoder": 0}, "hidden: 512, encoder: 0; expected 1 or more"),
        (INPUTS, {"parts": {"torso": ["hips"]}}, "in none; every joint"),
        (23, {}, "23 numbers a frame; 8 joints of 3 have 24"),
    ],
)
def test_what_makes_no_sense_is_refused(inputs, options, message):
    with pytest.raises(ConfigError, match=message):
        StructuralRNNBackbone(inputs, SKELETON, JOINT_DIM, **options)


def test_a_forecaster_tells_it_the_joints_and_refuses_what_mixes_them():
    small = partial(StructuralRNNBackbone, hidden=4, encoder=6)
    make_forecaster = partial(
        Forecaster, Codec(SKELETON, Quaternion(), root="displacement"), head=PartsHead
    )
    backbone = make_forecaster(backbone=small).backbone
    # Hips and head, and three channels of the root.
    assert backbone.edges["torso"].layers[0].in_features == 2 * 4 + 3
    assert backbone.edges["arm"].layers[0].in_features == 4
    with pytest.raises(ConfigError, match="leave projection out, or choose another backbone"):
        make_forecaster(backbone=small, projection=9)
    with pytest.raises(ConfigError, match="choose backbone structural_rnn, or another head"):
        make_forecaster(backbone=partial(GRUBackbone, hidden=4))


def test_frame_by_frame_a_forecaster_says_what_it_says_of_the_whole(generator):
    forecaster = Forecaster(
        Codec(SKELETON, Quaternion(), root="displacement"),
        backbone=partial(StructuralRNNBackbone, hidden=4, encoder=6),
        head=partial(PartsHead, hidden=5),
        residual="add",
    ).double()
    frames = torch.randn(2, 6, 35, dtype=torch.float64, generator=generator)
    whole = forecaster(frames, forecaster.initial_state(2)).features
    state = forecaster.initial_state(2)
    for number in range(6):
        features, _, _, state = forecaster(frames[:, number : number + 1], state)
        torch.testing.assert_close(features[:, 0], whole[:, number], atol=1e-12, rtol=0)
