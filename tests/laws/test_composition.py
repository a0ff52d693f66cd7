"""Every combination of parts builds, trains and rolls out, or says what would fit."""

from __future__ import annotations

from functools import partial
from itertools import product

import pytest
import torch

from posecast.errors import ConfigError
from posecast.geometry import quaternion
from posecast.model import (
    BACKBONES,
    HEADS,
    ControlLayers,
    Forecaster,
    ForecasterPredictor,
    RunningAverage,
    ZeroVelocity,
    rollout,
)
from posecast.model.forecaster import Residual
from posecast.motion import Clip, Motion
from posecast.representation import REPRESENTATIONS, Codec, build_representation
from posecast.skeleton import Skeleton, joint_positions
from posecast.training.feeding import FEEDS

SKELETON = Skeleton(("hips", "spine", "head", "left", "right"), (-1, 0, 1, 1, 1))
PARTS = {
    "torso": ["spine"],
    "left_arm": ["left"],
    "right_arm": ["right"],
    "left_leg": ["head"],
    "right_leg": ["hips"],
}
PREFIX, TRAINED, HORIZON, CONTROLS = 4, 2, 10, 6

BACKBONE_OPTIONS = {
    "convolutional": [{"channels": 6}, {"channels": 6, "widths": [2, 3], "dilations": [1, 2]}],
    "early_reset_gru": [{"hidden": 6}],
    "gru": [
        {"hidden": 8, "layers": 1, "initial_state": initial} for initial in ("learned", "zero")
    ],
    "lstm": [
        {"hidden": 6, "layers": 2, "wiring": "stacked"},
        {"hidden": 6, "layers": 2, "wiring": "delayed"},
        {"hidden": 6, "layers": 2, "wiring": "skip", "biases": 1},
    ],
    "structural_rnn": [{"hidden": 5, "encoder": 4, "parts": PARTS}],
}
HEAD_OPTIONS = {
    "dense": [{}, {"hidden": 12}],
    "parts": [{"hidden": [6, 4]}],
    "structured": [
        {"hidden": 7},
        {"hidden": 7, "ancestors": "parent", "tree": "reverse"},
        {"hidden": 7, "tree": "random"},
        {"hidden": 7, "ancestors": "none"},
    ],
}
FEED_OPTIONS = {
    "teacher_forcing": {},
    "free_running": {},
    "scheduled_sampling": {"decay": 0.5},
    "auto_conditioning": {"true_frames": 1, "own_frames": 1},
}
INPUTS = ("plain", "projected", "steered")
RESIDUALS = Residual.__args__
ROOTS = ("none", "displacement")
STANDARDIZE = (False, True)

# The law: every kind of part with every other, at the first of its options, with and without root
# channels and statistics.
KINDS = [
    (
        (backbone, BACKBONE_OPTIONS[backbone][0]),
        (head, HEAD_OPTIONS[head][0]),
        residual,
        "plain",
        feed,
    )
    for backbone in BACKBONES
    for head in HEADS
    for residual in RESIDUALS
    for feed in FEEDS
]
CODECS = [
    (kind, *rest) for kind in REPRESENTATIONS for rest in (("none", False), ("displacement", True))
]
# What does not depend on the representation, in full, on one of them.
OPTIONS = list(
    product(
        [(kind, options) for kind in BACKBONES for options in BACKBONE_OPTIONS[kind]],
        [(kind, options) for kind in HEADS for options in HEAD_OPTIONS[kind]],
        RESIDUALS,
        INPUTS,
        ["scheduled_sampling"],
    )
)


CLIP = Clip(SKELETON, torch.zeros(5, 3), 25.0, torch.zeros(1, 3), torch.eye(4)[:1].expand(1, 5, 4))


def make_motion(generator):
    start, speed = torch.randn(2, 3, 1, 5, 3, generator=generator)
    time = torch.arange(PREFIX + HORIZON)[:, None, None] / 10
    return Motion(
        quaternion.exp(start + speed * time),
        torch.randn(3, PREFIX + HORIZON, 3, generator=generator),
        torch.randn(3, 5, 3, generator=generator),
    )


def make_codec(kind, root, standardize, motion):
    representation = build_representation(kind, SKELETON)
    plain = Codec(SKELETON, representation, root=root)
    statistics = plain.measure([motion]) if standardize else None
    return Codec(SKELETON, representation, root=root, statistics=statistics)


def make_forecaster(codec, network, generator):
    (backbone, backbone_options), (head, head_options), residual, inputs, _ = network
    projected = {
        "input_dropout": 0.2,
        "input_noise": 0.1,
        "projection": 9,
        "projection_activation": "relu",
    }
    forecaster = Forecaster(
        codec,
        backbone=partial(BACKBONES[backbone], **backbone_options),
        head=partial(HEADS[head], **head_options),
        residual=residual,
        controls=ControlLayers(CONTROLS) if inputs == "steered" else None,
        **(projected if inputs == "projected" else {}),
    )
    forecaster.reset_parameters(generator)
    return forecaster


def train(run, forecaster, truth, feed, generator):
    """Two steps of training, in which every weight gets a finite gradient."""
    penalty = forecaster.codec.representation.penalty
    optimizer = torch.optim.Adam(forecaster.parameters(), lr=1e-3)
    schedule = FEEDS[feed](**FEED_OPTIONS[feed])
    for epoch in range(2):
        mask = schedule.mask(TRAINED, epoch, generator)
        found = run(TRAINED, truth=truth, truth_mask=mask)
        loss = (found.features - truth[:, :TRAINED]).abs().mean() + 0.01 * penalty(found.raw)
        optimizer.zero_grad()
        loss.backward()
        for name, weight in forecaster.named_parameters():
            assert weight.grad is not None, f"{name} has no gradient"
            assert weight.grad.isfinite().all(), f"{name} has a gradient that is not finite"
        optimizer.step()


def try_combination(codec, network, motion, generator, *, all_joints=True):
    """Build, train two steps and roll out; true, or false after an error that names what fits."""
    *_, inputs, feed = network
    features = codec.encode(motion)
    controls = torch.randn(3, PREFIX + HORIZON, CONTROLS, generator=generator)
    try:
        forecaster = make_forecaster(codec, network, generator)
        run = partial(
            rollout,
            forecaster,
            features[:, :PREFIX],
            controls=controls if inputs == "steered" else None,
            generator=generator,
        )
        train(run, forecaster, features[:, PREFIX:], feed, generator)
        with torch.no_grad():
            predicted = run(HORIZON).features
        decoded = codec.decode(
            predicted, offsets=motion.offsets, anchor=motion.root_positions[:, PREFIX - 1]
        )
    except ConfigError as error:
        assert "choose" in str(error), f"{error} does not name what would fit"  # noqa: PT017
        return False
    assert decoded.rotations_local.shape == (3, HORIZON, 5, 4)
    assert decoded.root_positions.shape == (3, HORIZON, 3)
    lengths = decoded.rotations_local.norm(dim=-1)
    torch.testing.assert_close(lengths, torch.ones_like(lengths), atol=1e-5, rtol=0)
    assert decoded.root_positions.isfinite().all()
    clip = decoded.rigid.clip(CLIP, name="forecast")
    if all_joints:
        assert_round_trip(codec, clip.motion())
    return True


def goes_together(network):
    """Only one backbone speaks of parts, and it does not read what a projection has mixed."""
    (backbone, _), (head, _), _, inputs, _ = network
    if backbone == "structural_rnn":
        return inputs != "projected"
    return head != "parts"


def assert_round_trip(codec, motion):
    """Writing a motion as features and reading it back leaves every joint where it was."""
    features = codec.encode(motion)
    assert features.shape == (*motion.root_positions.shape[:2], codec.feature_dim)
    # The first displacement, from a frame that the motion has not, repeats the second.
    anchor = 2 * motion.root_positions[:, 0] - motion.root_positions[:, 1]
    again = codec.decode(features, offsets=motion.offsets, anchor=anchor)
    # Bones of meters, in float32; rotations that are fitted to positions lose some digits.
    torch.testing.assert_close(placed(again.rigid), placed(motion), atol=2e-3, rtol=0)
    if codec.root_dim:
        torch.testing.assert_close(again.root_positions, motion.root_positions, atol=1e-4, rtol=0)


def placed(motion):
    """Joints from the root on the motion's body."""
    return joint_positions(SKELETON, motion.rotations_local, motion.offsets[:, None], None)


@pytest.mark.parametrize(("kind", "root", "standardize"), CODECS)
def test_every_combination_works_or_names_what_would_fit(kind, root, standardize, generator):
    motion = make_motion(generator)
    codec = make_codec(kind, root, standardize, motion)
    outcomes = [try_combination(codec, network, motion, generator) for network in KINDS]
    print(f"{kind}, root {root}: {len(outcomes)} combinations")
    assert len(outcomes) == len(BACKBONES) * len(HEADS) * len(RESIDUALS) * len(FEEDS) == 180
    assert outcomes == [goes_together(network) for network in KINDS]
    assert sum(outcomes) == 132


@pytest.mark.parametrize(("root", "standardize"), list(product(ROOTS, STANDARDIZE)))
def test_every_option_of_a_network_works_with_every_other(root, standardize, generator):
    motion = make_motion(generator)
    codec = make_codec("quaternion", root, standardize, motion)
    outcomes = [try_combination(codec, network, motion, generator) for network in OPTIONS]
    assert len(outcomes) == 567
    assert outcomes == [goes_together(network) for network in OPTIONS]
    assert sum(outcomes) == 474


@pytest.mark.parametrize("kind", REPRESENTATIONS)
def test_some_joints_and_actions_go_with_every_head_and_residual(kind, generator):
    motion = make_motion(generator)._replace(actions=("walk", "sit", "walk"))
    representation = build_representation(kind, SKELETON.select((1, 2, 3)))
    make = partial(
        *(Codec, SKELETON, representation, "displacement"),
        joints=(1, 2, 3),
        actions=("run", "sit", "walk"),
    )
    codec = make(statistics=make().measure([motion]))
    networks = [
        ((backbone, BACKBONE_OPTIONS[backbone][0]), (head, HEAD_OPTIONS[head][0]), *rest)
        for backbone in ("convolutional", "early_reset_gru", "lstm")
        for head in ("dense", "structured")
        for rest in product(RESIDUALS, ["plain"], ["scheduled_sampling"])
    ]
    outcomes = [
        try_combination(codec, network, motion, generator, all_joints=False) for network in networks
    ]
    assert outcomes == [True] * 18


def test_all_combinations_are_tried():
    assert set(BACKBONE_OPTIONS) == set(BACKBONES)
    assert set(HEAD_OPTIONS) == set(HEADS)
    assert set(FEED_OPTIONS) == set(FEEDS)
    assert (len(REPRESENTATIONS), len(BACKBONES), len(RESIDUALS), len(FEEDS)) == (11, 5, 3, 4)
    count = len(CODECS) * len(KINDS) + 4 * len(OPTIONS)
    print(f"{len(CODECS) * len(KINDS)} combinations of kinds and {4 * len(OPTIONS)} of options")
    assert count == 3960 + 2268


@pytest.mark.parametrize("root", ROOTS)
@pytest.mark.parametrize("kind", REPRESENTATIONS)
def test_all_predictors_are_called_alike(kind, root, generator):
    motion = make_motion(generator)
    codec = make_codec(kind, root, False, motion)
    forecaster = Forecaster(
        codec, backbone=partial(BACKBONES["gru"], hidden=8), head=HEADS["dense"]
    )
    predictors = [ZeroVelocity(), RunningAverage(4), ForecasterPredictor(forecaster)]
    for predictor in predictors:
        found = predictor.predict(motion, 7)
        assert found.rotations_local.shape == (3, 7, 5, 4)
        assert found.root_positions.shape == (3, 7, 3)
        assert torch.equal(found.offsets, motion.offsets)
