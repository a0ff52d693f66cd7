"""The forecaster: its size, its inputs, its residuals, its statistics."""

from __future__ import annotations

import math
import subprocess
import sys
from functools import partial

import pytest
import torch

from posecast.errors import ConfigError
from posecast.geometry import quaternion
from posecast.model import ControlLayers, DenseHead, Forecaster, GRUBackbone, rollout
from posecast.representation import Codec, Quaternion, Statistics
from posecast.skeleton import Skeleton

TWO = Skeleton(("hips", "spine"), (-1, 0))


def size(network):
    return sum(weight.numel() for weight in network.parameters())


def test_quaternet_has_as_many_parameters_as_published():
    # 32 joints, two layers of 1000, learned first states, no root channels: models.md, section 1.
    skeleton = Skeleton(tuple(map(str, range(32))), tuple(range(-1, 31)))
    backbone = partial(GRUBackbone, hidden=1000, layers=2)
    make = partial(Forecaster, backbone=backbone, head=DenseHead, residual="compose")
    assert size(make(Codec(skeleton, Quaternion()))) == 9_526_128
    # Three root channels add three inputs of 3000 gates and three outputs with their biases.
    extra = 3 * 3000 + 3 * 1001
    assert size(make(Codec(skeleton, Quaternion(), root="displacement"))) == 9_526_128 + extra


def test_the_controlled_quaternet_has_as_many_parameters_as_published():
    # 26 joints and two translations; two control layers of 30: models.md, section 3. The third
    # root channel, with 3000 gates and 1001 weights of the output, is not in the published one.
    skeleton = Skeleton(tuple(map(str, range(26))), tuple(range(-1, 25)))
    forecaster = Forecaster(
        Codec(skeleton, Quaternion(), root="displacement"),
        backbone=partial(GRUBackbone, hidden=1000, layers=2),
        head=DenseHead,
        controls=ControlLayers(6),
    )
    assert size(forecaster) == 9_529_246 + 3000 + 1001


def silence(forecaster):
    """Let the network put out zeros."""
    with torch.no_grad():
        for layer in (forecaster.head.output, forecaster.root):
            layer.weight.zero_()
            layer.bias.zero_()


def read(forecaster, features, **options):
    return forecaster(features, forecaster.initial_state(len(features)), **options)


def test_adding_nothing_repeats_the_frame(make_forecaster, features):
    forecaster = make_forecaster(residual="add")
    silence(forecaster)
    found = read(forecaster, features)
    torch.testing.assert_close(found.features, features)
    torch.testing.assert_close(found.raw, forecaster.codec.split(features).joints)


def test_composing_the_identity_repeats_the_frame(make_forecaster, features):
    forecaster = make_forecaster(residual="compose")
    silence(forecaster)
    with torch.no_grad():
        forecaster.head.output.bias.view(5, 4)[:, 0] = 1
    torch.testing.assert_close(read(forecaster, features).features, features)


def test_composing_turns_from_the_left_and_the_raw_output_is_the_turn(forecaster, features):
    found = read(forecaster, features)
    before = forecaster.codec.split(features).joints
    after = quaternion.normalize(quaternion.product(found.raw, before))
    torch.testing.assert_close(forecaster.codec.split(found.features).joints, after)
    lengths = found.raw.norm(dim=-1)
    assert (lengths - 1).abs().min() > 1e-3


def test_without_residual_the_frame_has_no_part_in_the_output(make_forecaster, features):
    forecaster = make_forecaster(residual="none")
    silence(forecaster)
    with torch.no_grad():
        forecaster.head.output.bias.view(5, 4)[:, 1] = 2
        forecaster.root.bias[1] = 0.9
    found = forecaster.codec.split(read(forecaster, features).features)
    torch.testing.assert_close(
        found.joints, torch.tensor([0.0, 1, 0, 0]).double().expand(2, 12, 5, 4)
    )
    torch.testing.assert_close(found.root, torch.tensor([0, 0.9, 0]).double().expand(2, 12, 3))


def test_only_the_newest_frames_are_answered_if_asked(forecaster, features):
    whole, part = read(forecaster, features), read(forecaster, features, last=3)
    assert part.features.shape[1] == part.raw.shape[1] == 3
    torch.testing.assert_close(part.features, whole.features[:, -3:])
    torch.testing.assert_close(part.raw, whole.raw[:, -3:])


@pytest.mark.parametrize("residual", ["none", "add", "compose"])
def test_a_standardized_network_sees_and_puts_out_standardized_values(
    residual, make_forecaster, motion, generator
):
    plain = Codec(make_forecaster().codec.skeleton, Quaternion(), root="displacement")
    mean = torch.randn(23, generator=generator, dtype=torch.float64)
    scale = torch.rand(23, generator=generator, dtype=torch.float64) + 0.5
    codec = Codec(plain.skeleton, Quaternion(), "displacement", Statistics(mean, scale))
    forecaster = make_forecaster(codec=codec, residual=residual)
    features = codec.encode(motion)
    torch.testing.assert_close(forecaster.standardize(features), (features - mean) / scale)

    context, _ = forecaster.backbone((features - mean) / scale, forecaster.initial_state(2))
    output = torch.cat([forecaster.head(context).flatten(-2), forecaster.root(context)], dim=-1)
    expected = output * scale + (mean if residual == "none" else features)
    found = read(forecaster, features)
    torch.testing.assert_close(found.features[..., 20:], expected[..., 20:])
    if residual == "compose":  # a turn is a turn, whatever the statistics
        expected = output
    torch.testing.assert_close(found.raw.flatten(-2), expected[..., :20])


def test_statistics_are_not_among_the_weights(make_forecaster):
    codec = Codec(TWO, Quaternion(), statistics=Statistics(torch.zeros(8), torch.ones(8)))
    assert set(make_forecaster(codec=codec).state_dict()) == set(
        make_forecaster(codec=Codec(TWO, Quaternion())).state_dict()
    )


@pytest.mark.parametrize("spoiled", [{"input_dropout": 0.5}, {"input_noise": 0.5}])
def test_inputs_are_spoiled_in_training_only_and_as_the_generator_says(
    spoiled, make_forecaster, features
):
    forecaster = make_forecaster(**spoiled)

    def drawn(seed):
        return read(
            forecaster, features, generator=torch.Generator().manual_seed(seed)
        ).features.detach()

    assert torch.equal(drawn(1), drawn(1))
    assert not torch.allclose(drawn(1), drawn(2))
    forecaster.eval()
    assert torch.equal(drawn(1), drawn(2))


def test_input_dropout_keeps_the_mean_of_the_inputs(make_forecaster):
    forecaster = make_forecaster(input_dropout=0.25)
    ones = torch.ones(100, 50, 23, dtype=torch.float64)
    dropped = forecaster._inputs(ones, None, torch.Generator().manual_seed(0))
    assert set(dropped.unique().tolist()) == {0.0, 1 / 0.75}
    # 115 000 draws: the mean is within 0.01 of one, seven standard errors.
    assert dropped.mean().item() == pytest.approx(1, abs=0.01)


def test_input_noise_has_its_standard_deviation_in_every_feature_of_every_frame(make_forecaster):
    forecaster = make_forecaster(input_noise=0.25)
    ones = torch.ones(100, 50, 23, dtype=torch.float64)
    noise = forecaster._inputs(ones, None, torch.Generator().manual_seed(0)) - ones
    # 5000 draws a feature: within 5 standard errors of the mean, of the deviation about as close.
    torch.testing.assert_close(
        noise.mean((0, 1)), torch.zeros_like(noise[0, 0]), atol=0.018, rtol=0
    )
    assert noise.std((0, 1)).sub(0.25).abs().max() < 0.013
    neighbours = (noise[:, 1:] * noise[:, :-1]).mean() / 0.25**2
    assert abs(neighbours) < 0.015


@pytest.mark.parametrize("share", [0.25, 0.5])
def test_only_a_share_of_the_frames_gets_noise_if_asked(make_forecaster, share):
    forecaster = make_forecaster(input_noise=0.25, input_noise_share=share)
    ones = torch.ones(100, 50, 23, dtype=torch.float64)
    noise = forecaster._inputs(ones, None, torch.Generator().manual_seed(0)) - ones
    touched = noise.abs().amax(-1) > 0
    assert torch.equal(touched, noise.abs().amin(-1) > 0)  # all features of a frame, or none
    # 5000 draws: five standard errors.
    assert touched.double().mean().item() == pytest.approx(share, abs=0.036)
    assert noise[touched].std().item() == pytest.approx(0.25, abs=0.005)


def test_the_residual_reads_what_was_there_without_noise(make_forecaster, features):
    forecaster = make_forecaster(input_noise=0.5, residual="add")
    with torch.no_grad():
        for part in (forecaster.head, forecaster.root):
            for weight in part.parameters():
                weight.zero_()
    found = read(forecaster, features, generator=torch.Generator().manual_seed(0)).features
    torch.testing.assert_close(found, features)


def test_noise_is_in_units_of_the_standardized_inputs(make_forecaster):
    wide = Codec(TWO, Quaternion(), statistics=Statistics(torch.zeros(8), 100 * torch.ones(8)))
    forecaster = make_forecaster(codec=wide, input_noise=0.25)
    zeros = torch.zeros(100, 50, 8, dtype=torch.float64)
    noise = forecaster._inputs(zeros, None, torch.Generator().manual_seed(0))
    assert noise.std().item() == pytest.approx(0.25, abs=0.005)


@pytest.mark.parametrize("activation", ["none", "relu"])
@pytest.mark.parametrize("sizes", [9, [9], [9, 6]])
def test_layers_before_the_backbone_are_rectified_between(
    sizes, activation, make_forecaster, features
):
    forecaster = make_forecaster(projection=sizes, projection_activation=activation)
    inputs = forecaster._inputs(features, None, None)
    wanted = features
    for number, layer in enumerate(forecaster.projection):
        wanted = wanted @ layer.weight.T + layer.bias
        if number + 1 < len(forecaster.projection) or activation == "relu":
            wanted = wanted.clamp(min=0)
    torch.testing.assert_close(inputs, wanted)
    assert forecaster.backbone.gru.input_size == (6 if sizes == [9, 6] else 9)


def test_controls_must_be_given_where_they_are_taken_and_only_there(make_forecaster, features):
    steered = make_forecaster(controls=ControlLayers(6))
    with pytest.raises(ConfigError, match="takes 6 controls a frame"):
        read(steered, features)
    with pytest.raises(ConfigError, match="takes none"):
        read(make_forecaster(), features, controls=torch.zeros(2, 12, 6).double())


def test_controls_steer(make_forecaster, features):
    forecaster = make_forecaster(controls=ControlLayers(6))
    left = torch.zeros(2, 12, 6, dtype=torch.float64)
    right = torch.ones_like(left)
    assert not torch.allclose(
        read(forecaster, features, controls=left).features,
        read(forecaster, features, controls=right).features,
    )


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"input_dropout": 1.0}, "input_dropout: 1.0 is no share"),
        ({"input_noise": -0.1}, "input_noise: -0.1 is no standard deviation"),
        ({"input_noise_share": 0.0}, "input_noise_share: 0.0 is no share"),
        ({"input_noise": math.inf}, "input_noise: inf is no standard deviation"),
        ({"projection_activation": "relu"}, "follows a projection, but there is none"),
    ],
)
def test_options_that_make_no_sense_are_refused(options, message, make_forecaster):
    with pytest.raises(ConfigError, match=message):
        make_forecaster(**options)


def test_misspelled_choices_are_refused_without_the_checks_of_the_suite():
    # In the suite, shapes and types are checked before a constructor can say so itself.
    code = """
from functools import partial
from posecast.errors import ConfigError
from posecast.model import DenseHead, Forecaster, GRUBackbone, LSTMBackbone
from posecast.representation import Codec, Quaternion
from posecast.skeleton import Skeleton
skeleton = Skeleton(("hips",), (-1,))
make = partial(Forecaster, Codec(skeleton, Quaternion()), backbone=GRUBackbone, head=DenseHead)
for call in (
    lambda: Codec(skeleton, Quaternion(), root="velocity"),
    lambda: GRUBackbone(3, initial_state="learnt"),
    lambda: LSTMBackbone(3, initial_state="learnt"),
    lambda: LSTMBackbone(3, wiring="delay"),
    lambda: make(residual="sum"),
    lambda: make(projection=3, projection_activation="tanh"),
):
    try:
        call()
    except ConfigError as error:
        print(error)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines() == [
        "codec.root: 'velocity' is not known; choose among: none, displacement, path, path_lateral",
        "initial_state: 'learnt' is not known; choose 'learned' or 'zero'",
        "initial_state: 'learnt' is not known; choose 'learned' or 'zero'",
        "wiring: 'delay' is not known; choose 'stacked', 'skip' or 'delayed'",
        "residual: 'sum' is not known; choose among: none, add, compose",
        "projection_activation: 'tanh' is not known; choose 'none' or 'relu'",
    ]


@pytest.mark.parametrize("hidden", [16, 256])
def test_an_empty_batch_has_an_empty_forecast(hidden):
    forecaster = Forecaster(
        Codec(TWO, Quaternion()),
        backbone=partial(GRUBackbone, hidden=hidden, layers=2),
        head=DenseHead,
        residual="compose",
    )
    nothing = torch.empty(0, 5, forecaster.codec.feature_dim)
    with torch.no_grad():
        assert rollout(forecaster, nothing, 3).features.shape == (
            0,
            3,
            forecaster.codec.feature_dim,
        )


@pytest.mark.parametrize("residual", ["none", "add", "compose"])
def test_actions_have_an_output_of_their_own_that_adds_where_there_is_a_residual(
    residual, make_forecaster, motion
):
    codec = Codec(make_forecaster().codec.skeleton, Quaternion(), actions=("walk", "sit", "run"))
    forecaster = make_forecaster(codec=codec, residual=residual)
    features = codec.encode(motion._replace(actions=("run", "walk")))
    context, _ = forecaster.backbone(features, forecaster.initial_state(2))
    expected = forecaster.action(context)
    if residual != "none":
        expected = codec.split(features).action + expected
    found = read(forecaster, features)
    torch.testing.assert_close(codec.split(found.features).action, expected)
    torch.testing.assert_close(codec.split(found.emitted).action, expected)
    # Three more inputs of 21 gates, three more outputs of seven units with their biases.
    plain = make_forecaster(codec=Codec(codec.skeleton, Quaternion()), residual=residual)
    assert size(forecaster) - size(plain) == 3 * 21 + 3 * 8


def test_a_still_start_repeats_the_action_too(make_forecaster, motion):
    codec = Codec(make_forecaster().codec.skeleton, Quaternion(), actions=("walk", "sit"))
    forecaster = make_forecaster(codec=codec, residual="add", still_start=True)
    features = codec.encode(motion._replace(actions=("sit", "walk")))
    change = codec.split(read(forecaster, features).features - features).action
    assert 0 < change.abs().max() < 0.1
