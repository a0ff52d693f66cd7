"""Discriminators: what they learn, what they read, and whose weights a gradient reaches."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch
from torch.nn.functional import binary_cross_entropy_with_logits

from posecast.errors import ConfigError
from posecast.model import DenseHead, Discriminator, Forecaster, GRUBackbone, StructuredHead
from posecast.representation import REPRESENTATIONS, Codec, Statistics, build_representation
from posecast.training import Adversary, Objective, Plan
from posecast.training.adversary import (
    Discriminators,
    Pair,
    accuracy,
    discriminator_loss,
    forecaster_loss,
)
from posecast.training.sampling import Windows
from posecast.training.step import Example, attempt

BOTH = Adversary(fidelity=0.5, continuity=0.25, hidden=8)
PLAN = Plan(learning_rate=0.01, clip=None)
OBJECTIVE = Objective({"features": 1.0})


def started(forecaster, adversary=BOTH, plan=PLAN):
    """Discriminators that are ready to learn."""
    discriminators = Discriminators(adversary, forecaster, plan)
    discriminators.start(torch.device("cpu"))
    return discriminators


def attempted(tiny, forecaster, mask=None):
    """What a forecaster makes of four windows, predictions read again unless ``mask`` says else."""
    windows = Windows(tiny.tiny_corpus(), length=tiny.PREFIX + tiny.HORIZON, batch=4, seed=0)
    return attempt(
        forecaster,
        Example.of(forecaster.codec, windows.share(0, 0).motion),
        prefix=tiny.PREFIX,
        mask=[True] + [False] * (tiny.HORIZON - 1) if mask is None else mask,
        order="zyx",
    )


def learn(discriminators, pairs, updates=1):
    """Several updates on the same pairs, in one process; what the last of them found."""
    for update in range(updates):
        found = discriminators.learn(
            pairs, weight=1.0, epoch=0, update=update, average=lambda values: values
        )
    return found


def gliding_and_shaking(generator, features):
    """Smooth motions, and the same with something that shakes."""
    time = torch.arange(12.0)[None, :, None] / 12
    smooth = torch.sin(time + 6 * torch.rand(32, 1, features, generator=generator))
    return smooth, smooth + 0.5 * torch.randn(smooth.shape, generator=generator)


def test_a_discriminator_learns_to_tell_gliding_from_shaking(tiny, generator):
    forecaster = tiny.tiny_forecaster()
    discriminators = started(forecaster, Adversary(fidelity=1.0, hidden=16))

    def fresh():
        return Pair(*gliding_and_shaking(generator, forecaster.codec.feature_dim))

    before = learn(discriminators, {"fidelity": fresh()})
    assert before["fidelity/loss"].item() == pytest.approx(2 * math.log(2), abs=0.1)
    assert before["fidelity/accuracy"] < 0.7
    for _ in range(160):  # never the same motions again, so that none can be known by heart
        after = learn(discriminators, {"fidelity": fresh()})
    assert after["fidelity/loss"] < 0.4
    real, predicted = (discriminators.networks["fidelity"](frames) for frames in fresh())
    assert accuracy(real, predicted) > 0.9


def test_a_discriminator_cannot_tell_apart_what_is_the_same(tiny, generator):
    forecaster = tiny.tiny_forecaster()
    discriminators = started(forecaster, Adversary(continuity=1.0, hidden=16))
    smooth, _ = gliding_and_shaking(generator, forecaster.codec.feature_dim)
    found = learn(discriminators, {"continuity": Pair(smooth, smooth)}, updates=60)
    assert found["continuity/loss"] >= 2 * math.log(2) - 1e-6
    assert found["continuity/accuracy"] == 0.5


def test_losses_are_cross_entropies(generator):
    real, predicted = 3 * torch.randn(2, 7, dtype=torch.float64, generator=generator)
    ones, zeros = torch.ones_like(real), torch.zeros_like(real)
    entropy = binary_cross_entropy_with_logits
    torch.testing.assert_close(
        discriminator_loss(real, predicted), entropy(real, ones) + entropy(predicted, zeros)
    )
    torch.testing.assert_close(forecaster_loss(predicted), entropy(predicted, ones))


def test_a_forecaster_that_is_seen_through_still_has_a_gradient():
    logits = torch.full((3,), -50.0, requires_grad=True)
    forecaster_loss(logits).backward()
    torch.testing.assert_close(logits.grad, torch.full((3,), -1 / 3))


def test_only_the_continuity_discriminator_reads_what_was_given(tiny):
    forecaster = tiny.tiny_forecaster()
    seen = attempted(tiny, forecaster)
    pairs = started(forecaster).pairs(seen)
    assert list(pairs) == ["fidelity", "continuity"]
    assert torch.equal(pairs["fidelity"].real, seen.comparison.target)
    assert torch.equal(pairs["fidelity"].predicted, seen.comparison.predicted)
    for name in ("real", "predicted"):
        whole, part = (getattr(pairs[kind], name) for kind in ("continuity", "fidelity"))
        assert torch.equal(whole, torch.cat([seen.given, part], dim=1))
    assert list(started(forecaster, Adversary(continuity=1.0, hidden=4)).pairs(seen)) == [
        "continuity"
    ]


def test_discriminators_read_what_the_forecaster_reads(tiny, generator):
    plain = tiny.tiny_forecaster().codec
    statistics = Statistics(*torch.rand(2, plain.feature_dim, generator=generator) + 0.5)
    codec = Codec(tiny.SKELETON, plain.representation, statistics=statistics)
    forecaster = Forecaster(
        codec, backbone=lambda inputs: GRUBackbone(inputs, 4, 1), head=DenseHead, residual="add"
    )
    seen = attempted(tiny, forecaster)
    real = started(forecaster).pairs(seen)["fidelity"].real
    expected = (seen.comparison.target - statistics.mean) / statistics.scale
    torch.testing.assert_close(real, expected)


def test_what_is_done_is_not_told_to_discriminators(tiny):
    told = replace(tiny.tiny_forecaster(root="displacement").codec, actions=("", "sit"))
    forecaster = Forecaster(
        told, backbone=lambda inputs: GRUBackbone(inputs, 4, 1), head=DenseHead, residual="add"
    )
    seen = attempted(tiny, forecaster)
    discriminators = started(forecaster)
    pair = discriminators.pairs(seen)["fidelity"]
    assert pair.real.shape[-1] == told.feature_dim - 2 == 23
    assert torch.equal(pair.real, seen.comparison.target[..., :-2])
    assert torch.equal(pair.predicted, seen.comparison.predicted[..., :-2])
    learn(discriminators, discriminators.pairs(seen))


def test_the_forecasters_loss_is_the_objective_and_the_weighted_rest(tiny):
    forecaster = tiny.tiny_forecaster()
    discriminators = started(forecaster)
    seen = attempted(tiny, forecaster)
    objective = OBJECTIVE(seen.comparison)
    pairs = discriminators.pairs(seen)
    loss = discriminators.oppose(objective, pairs)
    assert list(loss.terms) == ["features", "fidelity", "continuity"]
    terms = {
        name: -torch.sigmoid(discriminators.networks[name](pair.predicted)).log().mean()
        for name, pair in pairs.items()
    }
    for name, value in terms.items():
        torch.testing.assert_close(loss.terms[name], value)
    expected = objective.total + 0.5 * terms["fidelity"] + 0.25 * terms["continuity"]
    torch.testing.assert_close(loss.total, expected)


def test_the_adversarial_terms_reach_the_forecasters_weights_and_no_others(tiny):
    forecaster = tiny.tiny_forecaster()
    discriminators = started(forecaster)
    before = {name: value.clone() for name, value in discriminators.networks.state_dict().items()}
    pairs = discriminators.pairs(attempted(tiny, forecaster))
    loss = discriminators.oppose(OBJECTIVE(attempted(tiny, forecaster).comparison), pairs)
    for name in ("fidelity", "continuity"):
        forecaster.zero_grad()
        loss.terms[name].backward(retain_graph=True)
        gradients = {name: weight.grad for name, weight in forecaster.named_parameters()}
        assert len(gradients) > 4
        assert all(gradient.abs().max() > 0 for gradient in gradients.values())
        assert all(weight.grad is None for weight in discriminators.networks.parameters())
    for name, value in discriminators.networks.state_dict().items():
        assert torch.equal(value, before[name])


def test_what_discriminators_learn_reaches_their_weights_and_no_others(tiny):
    forecaster = tiny.tiny_forecaster()
    discriminators = started(forecaster)
    before = {name: value.clone() for name, value in discriminators.networks.state_dict().items()}
    learn(discriminators, discriminators.pairs(attempted(tiny, forecaster)))
    assert len(before) == 2 * 8
    for name, value in discriminators.networks.state_dict().items():
        assert not torch.equal(value, before[name])
    assert all(weight.grad is None for weight in forecaster.parameters())
    # Nothing is left that the next loss of the forecaster could add to.
    assert all(weight.grad is None for weight in discriminators.networks.parameters())
    assert not any(weight.requires_grad for weight in discriminators.networks.parameters())


def test_the_gradient_of_all_discriminators_together_is_clipped(tiny):
    forecaster = tiny.tiny_forecaster()
    plan = Plan(learning_rate=1.0, clip=0.01, optimizer="sgd")
    discriminators = started(forecaster, plan=plan)
    before = {name: value.clone() for name, value in discriminators.networks.state_dict().items()}
    learn(discriminators, discriminators.pairs(attempted(tiny, forecaster)))
    after = discriminators.networks.state_dict()
    moved = torch.cat([(after[name] - value).flatten() for name, value in before.items()])
    assert moved.norm().item() == pytest.approx(0.01, rel=1e-3)


def test_the_rate_of_discriminators_decays_as_the_forecasters_does(tiny):
    plan = Plan(learning_rate=0.1, decay=0.5, decay_every=10)
    forecaster = tiny.tiny_forecaster()
    own = Discriminators(Adversary(fidelity=1.0, hidden=4, learning_rate=0.3), forecaster, plan)
    same = Discriminators(Adversary(fidelity=1.0, hidden=4), forecaster, plan)
    assert [own.rate.at(epoch=0, update=update) for update in (0, 10)] == [0.3, 0.15]
    assert [same.rate.at(epoch=0, update=update) for update in (0, 10)] == [0.1, 0.05]


def test_discriminators_start_alike_for_one_seed_and_leave_the_global_stream_alone(tiny):
    forecaster = tiny.tiny_forecaster()
    before = torch.get_rng_state()
    one, same, other = (
        Discriminators(BOTH, forecaster, Plan(seed=seed)).networks.state_dict()
        for seed in (3, 3, 4)
    )
    assert torch.equal(torch.get_rng_state(), before)
    for name, value in one.items():
        assert torch.equal(value, same[name])
        assert not torch.equal(value, other[name])
    weights = [one[f"{name}.output.weight"] for name in ("fidelity", "continuity")]
    assert not torch.equal(*weights)


def test_a_discriminator_is_a_linear_layer_a_recurrent_one_and_a_linear_one(generator):
    network = Discriminator(5, hidden=7)
    network.reset_parameters(generator)
    frames = torch.randn(3, 4, 5, generator=generator)
    states, _ = network.recurrent.gru(torch.relu(network.input(frames)))
    torch.testing.assert_close(network(frames), network.output(states[:, -1])[:, 0])
    sizes = [weight.numel() for weight in network.parameters()]
    assert sum(sizes) == (5 * 7 + 7) + (6 * 7 * 7 + 6 * 7) + (7 + 1)


@pytest.mark.parametrize("residual", ["none", "add", "compose"])
@pytest.mark.parametrize("kind", REPRESENTATIONS)
def test_every_representation_and_residual_has_an_adversary(kind, residual, tiny):
    codec = Codec(tiny.SKELETON, build_representation(kind, tiny.SKELETON), root="displacement")
    torch.manual_seed(4)
    forecaster = Forecaster(
        codec,
        backbone=lambda inputs: GRUBackbone(inputs, 6, 1),
        head=StructuredHead if residual == "add" else DenseHead,
        residual=residual,
    )
    discriminators = started(forecaster)
    mask = [step != 2 for step in range(tiny.HORIZON)]  # true frames, an own one, true ones
    pairs = discriminators.pairs(attempted(tiny, forecaster, mask))
    loss = discriminators.oppose(OBJECTIVE(attempted(tiny, forecaster, mask).comparison), pairs)
    torch.stack([loss.terms[name] for name in pairs]).sum().backward()
    for weight in forecaster.parameters():
        assert weight.grad.isfinite().all()
    assert sum(weight.grad.abs().sum() for weight in forecaster.parameters()) > 0
    found = learn(discriminators, pairs)
    assert all(value.isfinite() for value in found.values())


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ({}, "needs a weight for fidelity, for continuity, or both"),
        ({"fidelity": -0.1}, "fidelity has weight -0.1; expected more than 0"),
        ({"fidelity": 0.1, "continuity": 0.0}, "or null to leave it out"),
        ({"continuity": math.nan}, "continuity has weight nan"),
        ({"continuity": math.inf}, "continuity has weight inf"),
        ({"fidelity": 1.0, "hidden": 0}, "hidden is 0; expected 1 or more"),
        ({"fidelity": 1.0, "learning_rate": 0.0}, "learning_rate is 0.0; expected more than 0"),
    ],
)
def test_a_wrong_adversary_says_what_is_wrong(arguments, said):
    with pytest.raises(ConfigError, match=said):
        Adversary(**arguments)


def test_a_discriminator_without_units_is_refused():
    with pytest.raises(ConfigError, match="hidden is 0"):
        Discriminator(5, hidden=0)
