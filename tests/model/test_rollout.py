"""Sessions and rollouts: one loop over time, and it is the network's own recursion."""

from __future__ import annotations

import pytest
import torch
from tests.references.plain_gru import velocity_rollout

from posecast.errors import ConfigError
from posecast.geometry import quaternion
from posecast.model import ControlLayers, ForecasterPredictor, Session, rollout
from posecast.representation import Codec, Quaternion, build_representation

MASKS = [
    [False] * 6,
    [True] * 6,
    [True, False, True, True, False, False],
    [False, True, True, False, True, False],
]


class Counting(torch.nn.Module):
    """A backbone that notes how many frames each call reads."""

    def __init__(self, inner):
        super().__init__()
        self.inner, self.lengths = inner, []
        self.context_dim, self.initial_state = inner.context_dim, inner.initial_state
        self.reset_parameters = inner.reset_parameters

    def forward(self, frames, state):
        self.lengths.append(frames.shape[1])
        return self.inner(frames, state)


@pytest.mark.parametrize("mask", MASKS, ids=str)
@pytest.mark.parametrize("tensor", [False, True])
def test_a_rollout_is_the_plain_loop_over_a_gru(mask, tensor, make_forecaster, motion):
    codec = Codec(make_forecaster().codec.skeleton, Quaternion())
    forecaster = make_forecaster(codec=codec)
    features = codec.encode(motion)
    prefix, truth = features[:, :6], features[:, 6:]
    given = torch.tensor(mask) if tensor else mask
    found = rollout(forecaster, prefix, 6, truth=truth, truth_mask=given)
    wanted, raw = velocity_rollout(forecaster, prefix, truth, mask)
    torch.testing.assert_close(found.features, wanted, atol=1e-12, rtol=0)
    torch.testing.assert_close(found.raw, raw, atol=1e-12, rtol=0)
    parameters = list(forecaster.parameters())
    assert len(parameters) == 11
    for one, other in zip(
        torch.autograd.grad(found.features.sin().sum(), parameters),
        torch.autograd.grad(wanted.sin().sum(), parameters),
        strict=True,
    ):
        torch.testing.assert_close(one, other, atol=1e-10, rtol=0)


@pytest.mark.parametrize(
    ("mask", "lengths"),
    list(zip(MASKS, [[6, 1, 1, 1, 1, 1], [11], [6, 3, 1, 1], [8, 2, 1]], strict=True)),
    ids=str,
)
def test_each_run_of_true_frames_is_one_call(mask, lengths, make_forecaster, features):
    forecaster = make_forecaster()
    forecaster.backbone = Counting(forecaster.backbone)
    rollout(forecaster, features[:, :6], 6, truth=features[:, 6:], truth_mask=mask)
    assert forecaster.backbone.lengths == lengths


def test_a_rollout_is_a_loop_of_steps(forecaster, features):
    session = Session.start(forecaster, features[:, :6])
    steps = torch.stack([session.step() for _ in range(5)], dim=1)
    torch.testing.assert_close(steps, rollout(forecaster, features[:, :6], 5).features)


@pytest.mark.parametrize("cut", [1, 4])
def test_frames_may_be_read_as_they_come(cut, forecaster, features):
    at_once = Session.start(forecaster, features[:, :6]).step()
    session = Session.start(forecaster, features[:, :cut])
    for frame in features[:, cut:6].unbind(1):
        session.read(frame[:, None])
    torch.testing.assert_close(session.step(), at_once)


def test_a_session_can_go_back_to_a_moment(forecaster, features):
    session = Session.start(forecaster, features[:, :6])
    session.step()
    kept = Session(forecaster, session.state, session.unread)
    first = torch.stack([session.step() for _ in range(3)])
    assert torch.equal(torch.stack([kept.step() for _ in range(3)]), first)


def test_what_is_predicted_does_not_depend_on_truth_that_is_not_read(forecaster, features):
    mask = [True, True, False, False]
    truth = features[:, 6:10]
    other = truth.clone()
    other[:, 1:] += 1
    one, two = (
        rollout(forecaster, features[:, :6], 4, truth=each, truth_mask=mask).features
        for each in (truth, other)
    )
    assert torch.equal(one, two)


def test_gradients_through_own_predictions_can_be_stopped(forecaster, features):
    def gradient(flag):
        prefix = features[:, :6].clone().requires_grad_()
        found = rollout(forecaster, prefix, 3, feedback_gradient=flag)
        (one,) = torch.autograd.grad(found.features[:, 2].sin().sum(), forecaster.root.weight)
        return found.features.detach(), one

    flowing, stopped = gradient(True), gradient(False)
    assert torch.equal(flowing[0], stopped[0])
    # Stopped, the last output is the only one that the root's weights reach it by.
    assert not torch.allclose(flowing[1], stopped[1])


def test_controls_belong_to_the_frames_that_are_read(make_forecaster, features, generator):
    forecaster = make_forecaster(controls=ControlLayers(6))
    controls = torch.randn(2, 10, 6, generator=generator, dtype=torch.float64)
    mask = [False, True, False, True, True]
    whole = rollout(
        forecaster,
        features[:, :6],
        5,
        truth=features[:, 6:],
        truth_mask=mask,
        controls=controls,
    )
    session = Session.start(forecaster, features[:, :6], controls[:, :5])
    frames = []
    for step in range(5):
        if mask[step]:
            session.unread = features[:, 5 + step : 6 + step]
        frames.append(session.step(controls[:, 5 + step]))
    torch.testing.assert_close(torch.stack(frames, dim=1), whole.features)


def test_a_session_wants_the_controls_of_all_it_reads(make_forecaster, features):
    forecaster = make_forecaster(controls=ControlLayers(6))
    known = torch.zeros(2, 4, 6).double()
    session = Session.start(forecaster, features[:, :6], known)
    with pytest.raises(ConfigError, match="6 frames are unread, but the controls of 5 are known"):
        session.step(torch.zeros(2, 6).double())


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"horizon": 0}, "one to predict; found 6 and 0"),
        ({"truth_mask": [True] * 3}, "3 entries for a horizon of 4"),
        ({"truth_mask": [True] * 4}, "asks for 3 true frames; truth has 0"),
        ({"controls": torch.zeros(2, 8, 6).double()}, "9 frames will be read, but there are 8"),
    ],
)
def test_a_rollout_that_lacks_something_says_what(options, message, forecaster, features):
    options = {"horizon": 4, **options}
    with pytest.raises(ConfigError, match=message):
        rollout(forecaster, features[:, :6], **options)
    with pytest.raises(ConfigError, match="found 0 and 4"):
        rollout(forecaster, features[:, :0], 4)


@pytest.mark.parametrize("batch", [1, 2, 256])
def test_a_predictor_maps_motion_to_motion(batch, forecaster, motion):
    found = ForecasterPredictor(forecaster, batch=batch).predict(motion, 4)
    features = rollout(forecaster, forecaster.codec.encode(motion), 4).features
    joints, root, _ = forecaster.codec.split(features)
    torch.testing.assert_close(found.rotations_local, joints)
    torch.testing.assert_close(found.root_positions[..., 1], root[..., 1])
    last = motion.root_positions[:, -1]
    torch.testing.assert_close(found.root_positions[:, 0, 0], last[:, 0] + root[:, 0, 0])
    assert not found.rotations_local.requires_grad
    lengths = found.rotations_local.norm(dim=-1)
    torch.testing.assert_close(lengths, torch.ones_like(lengths))


def test_a_predictor_answers_in_the_precision_it_was_asked_in(make_forecaster, motion):
    forecaster = make_forecaster().float()
    predictor = ForecasterPredictor(forecaster)
    assert predictor.predict(motion, 2).rotations_local.dtype == torch.float64
    single = motion.map(torch.Tensor.float)
    assert predictor.predict(single, 2).root_positions.dtype == torch.float32


def test_a_predictor_uses_evaluation_mode_and_leaves_the_forecaster_as_it_was(
    make_forecaster, motion
):
    forecaster = make_forecaster(input_dropout=0.5)
    predictor = ForecasterPredictor(forecaster)
    for training in (True, False):
        forecaster.train(training)
        first, second = predictor.predict(motion, 3), predictor.predict(motion, 3)
        assert torch.equal(first.rotations_local, second.rotations_local)
        assert forecaster.training is training


def test_signs_of_what_a_predictor_reads_do_not_matter(forecaster, motion):
    predictor = ForecasterPredictor(forecaster)
    flipped = motion._replace(rotations_local=-motion.rotations_local)
    one, two = predictor.predict(motion, 5), predictor.predict(flipped, 5)
    assert quaternion.angle(one.rotations_local, two.rotations_local).max() < 1e-7


def test_statistics_follow_the_forecaster_into_another_precision(make_forecaster, motion):
    plain = Codec(make_forecaster().codec.skeleton, Quaternion())
    codec = Codec(plain.skeleton, Quaternion(), statistics=plain.measure([motion]))
    forecaster = make_forecaster(codec=codec).float()
    assert forecaster.mean.dtype == torch.float32
    assert ForecasterPredictor(forecaster).predict(motion, 2).root_positions.isfinite().all()


@pytest.mark.parametrize("kind", ["quaternion", "dual_quaternion"])
def test_what_is_replayed_goes_on_from_the_true_frame_before_it(kind, make_forecaster, motion):
    skeleton = make_forecaster().codec.skeleton
    codec = Codec(skeleton, build_representation(kind, skeleton), root="displacement")
    predictor = ForecasterPredictor(make_forecaster(codec=codec))
    replayed = predictor.replay(motion)
    for frame in (2, 4):  # of one frame alone the displacement is not known
        alone = predictor.predict(motion.cut(0, frame), 1)
        for one, other in zip(replayed.cut(frame - 1, frame)[:2], alone[:2], strict=True):
            torch.testing.assert_close(one, other)
    assert replayed.root_positions.shape[1] == motion.root_positions.shape[1] - 1


def test_what_was_emitted_is_read_where_it_is_not_to_be_projected(make_forecaster, motion):
    skeleton = make_forecaster().codec.skeleton
    codec = Codec(skeleton, build_representation("matrix", skeleton))
    features = codec.encode(motion)[:, :6]
    found = {}
    for feedback in ("valid", "emitted"):
        forecaster = make_forecaster(codec=codec, residual="add", feedback=feedback)
        found[feedback] = rollout(forecaster, features, 3)
        known, state = features, forecaster.initial_state(2)
        for step in range(3):
            prediction = forecaster(known, state, last=1)
            valid, emitted, state = prediction.features, prediction.emitted, prediction.state
            torch.testing.assert_close(found[feedback].features[:, step], valid[:, 0])
            torch.testing.assert_close(found[feedback].emitted[:, step], emitted[:, 0])
            known = emitted if feedback == "emitted" else valid
    first, last = (
        (found["valid"].features[:, step] - found["emitted"].features[:, step]).abs().max()
        for step in (0, 2)
    )
    assert first == 0
    assert last > 1e-4
