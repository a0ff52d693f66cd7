"""Laws that hold for every backbone."""

from __future__ import annotations

import pytest
import torch

from posecast.model import BACKBONES
from posecast.skeleton import Skeleton

BODY = Skeleton(("hips", "left_arm", "right_arm", "left_leg", "right_leg"), (-1, 0, 0, 0, 0))
OPTIONS = {
    "convolutional": [
        {"channels": 6},
        {"channels": 6, "widths": [3, 1, 2], "dilations": [1, 1, 3]},
        {"channels": 6, "widths": [2, 4], "dilations": [2, 1]},
    ],
    "early_reset_gru": [
        {"hidden": 6, "layers": layers, "initial_state": initial}
        for layers in (1, 3)
        for initial in ("learned", "zero")
    ],
    "gru": [
        {"hidden": 6, "layers": layers, "initial_state": initial}
        for layers in (1, 3)
        for initial in ("learned", "zero")
    ]
    # Of this size on, it has a kernel of its own.
    + [{"hidden": 256, "layers": 2, "initial_state": "learned"}],
    "lstm": [
        {"hidden": 7, "layers": layers, "wiring": wiring, "initial_state": initial}
        for layers in (1, 3)
        for wiring in ("stacked", "skip", "delayed")
        for initial in ("learned", "zero")
    ]
    + [{"hidden": 7, "layers": 2, "biases": 1, "forget_bias": 1.0}],
    "structural_rnn": [
        {"temporal": temporal, "hidden": 4, "encoder": 6, "joint_dim": 1, "skeleton": BODY}
        for temporal in ("linear", "lstm")
    ],
}
"""Small members of every kind; a kind that is missing here fails the tests below."""

CASES = [(kind, options) for kind in BACKBONES for options in OPTIONS[kind]]
CUTS = [[1, 9], [4, 6], [9, 1], [3, 3, 4], [1] * 10]


def _name(case):
    kind, options = case
    return "-".join(map(str, (kind, *(each for each in options.values() if each is not BODY))))


@pytest.fixture(params=CASES, ids=_name)
def case(request):
    return request.param


@pytest.fixture
def backbone(case):
    kind, options = case
    made = BACKBONES[kind](5, **options).double()
    made.reset_parameters(torch.Generator().manual_seed(2))
    return made


@pytest.fixture
def frames(generator):
    return torch.randn(4, 10, 5, generator=generator, dtype=torch.float64)


def test_every_backbone_is_tested():
    assert len(CASES) >= 5
    assert set(OPTIONS) == set(BACKBONES)


@pytest.mark.parametrize("lengths", CUTS, ids=str)
def test_a_backbone_does_not_care_how_frames_are_chunked(backbone, lengths, frames):
    whole, last = backbone(frames, backbone.initial_state(4))
    state, contexts = backbone.initial_state(4), []
    for piece in frames.split(lengths, dim=1):
        context, state = backbone(piece, state)
        contexts.append(context)
    assert whole.shape == (4, 10, backbone.context_dim)
    torch.testing.assert_close(torch.cat(contexts, dim=1), whole, atol=1e-12, rtol=0)
    for one, other in zip(state, last, strict=True):
        torch.testing.assert_close(one, other, atol=1e-12, rtol=0)


@pytest.mark.parametrize("lengths", CUTS, ids=str)
def test_gradients_do_not_care_how_frames_are_chunked(backbone, lengths, frames):
    def gradients(pieces):
        state, total = backbone.initial_state(4), torch.zeros(())
        for piece in pieces:
            context, state = backbone(piece, state)
            total = total + context.sin().sum()
        return torch.autograd.grad(total, list(backbone.parameters()))

    assert len(list(backbone.parameters())) > 0
    whole, cut = gradients([frames]), gradients(frames.split(lengths, dim=1))
    for one, other in zip(cut, whole, strict=True):
        torch.testing.assert_close(one, other, atol=1e-11, rtol=0)


def test_no_frame_has_an_influence_on_an_earlier_one(case, backbone, frames):
    _, options = case
    # In this wiring a frame needs one more for every layer above the first.
    delay = options["layers"] - 1 if options.get("wiring") == "delayed" else 0
    context, _ = backbone(frames, backbone.initial_state(4))
    changed = frames.clone()
    changed[:, 6:] += 1
    after, _ = backbone(changed, backbone.initial_state(4))
    reached = 6 + delay
    torch.testing.assert_close(after[:, :reached], context[:, :reached], atol=0, rtol=0)
    assert not torch.allclose(after[:, reached], context[:, reached])


def test_sequences_of_a_batch_do_not_mix(backbone, frames):
    context, state = backbone(frames, backbone.initial_state(4))
    alone, alone_state = backbone(frames[2:3], backbone.initial_state(1))
    torch.testing.assert_close(alone[0], context[2], atol=1e-12, rtol=0)
    for one, all_ in zip(alone_state, state, strict=True):
        torch.testing.assert_close(one[0], all_[2], atol=1e-12, rtol=0)


def test_a_state_is_a_value_that_can_be_gone_back_to(backbone, frames):
    _, state = backbone(frames[:, :5], backbone.initial_state(4))
    kept = tuple(part.clone() for part in state)
    first, _ = backbone(frames[:, 5:], state)
    second, _ = backbone(frames[:, 5:], state)
    assert torch.equal(first, second)
    for part, copy in zip(state, kept, strict=True):
        assert torch.equal(part, copy)


def test_weights_follow_the_generator(backbone):
    def drawn(seed, dims):
        with torch.no_grad():
            for weight in backbone.parameters():
                weight.fill_(7.0)
        backbone.reset_parameters(torch.Generator().manual_seed(seed))
        kept = [weight for weight in backbone.parameters() if weight.ndim >= dims]
        return torch.cat([weight.detach().flatten() for weight in kept])

    torch.testing.assert_close(drawn(1, 1), drawn(1, 1), atol=0, rtol=0)
    # No entry of any weight keeps its old value; biases may always be the same.
    assert (drawn(1, 1) != 7.0).all()
    assert (drawn(1, 2) != drawn(2, 2)).all()


@pytest.mark.parametrize(("kind", "parts"), [("gru", 1), ("lstm", 2)])
def test_a_learned_first_state_is_small_and_shared_by_the_batch(kind, parts):
    backbone = BACKBONES[kind](5, hidden=1500, layers=2, initial_state="learned")
    backbone.reset_parameters(torch.Generator().manual_seed(0))
    states = backbone.initial_state(3)
    assert len(states) == 2 * parts
    for state in states:
        assert state.shape == (3, 1500)
        assert torch.equal(state[0], state[2])
        # Standard deviation 0.01, estimated from 1500 draws: 2 % of it is one standard error.
        assert state[0].std().item() == pytest.approx(0.01, rel=0.07)


@pytest.mark.parametrize(("kind", "parts"), [("gru", 1), ("lstm", 2)])
def test_a_first_state_of_zeros_is_not_trained(kind, parts):
    backbone = BACKBONES[kind](5, hidden=6, layers=2, initial_state="zero")
    states = backbone.initial_state(3)
    assert [state.shape for state in states] == [(3, 6)] * (2 * parts)
    assert all((state == 0).all() for state in states)
    assert len(list(backbone.parameters())) == 8
