"""Recorded steps: the same loss by operations that do not depend on the mask."""

from __future__ import annotations

import pytest
import torch

from posecast.errors import ConfigError
from posecast.model import ControlLayers, DenseHead, Forecaster, GRUBackbone, rollout
from posecast.model.rollout import gated_rollout
from posecast.representation import Codec, Controls, Quaternion
from posecast.training import Adversary, Objective, Plan
from posecast.training.recording import Recorder, check_recording
from posecast.training.sampling import Windows
from posecast.training.step import Example, attempt

OBJECTIVE = Objective({"euler": 1.0, "penalty": 0.01})
MASKS = ([True] * 4, [True, False, False, False], [True, False, True, False])


def example_of(tiny, forecaster):
    length = tiny.PREFIX + tiny.HORIZON
    windows = Windows(tiny.tiny_corpus(), length=length, batch=4, seed=0)
    return Example.of(forecaster.codec, windows.share(0, 0).motion)


@pytest.mark.parametrize("pattern", MASKS)
@pytest.mark.parametrize("feedback_gradient", [True, False])
def test_a_gated_rollout_is_the_rollout(tiny, pattern, feedback_gradient):
    forecaster = tiny.tiny_forecaster()
    mask = torch.tensor((pattern * tiny.HORIZON)[: tiny.HORIZON])
    example = example_of(tiny, forecaster)
    given, truth = example.features[:, : tiny.PREFIX], example.features[:, tiny.PREFIX :]
    found, gradients = [], []
    for roll in (rollout, gated_rollout):
        made = roll(
            forecaster,
            given,
            tiny.HORIZON,
            truth=truth,
            truth_mask=mask,
            feedback_gradient=feedback_gradient,
        )
        found.append(made)
        total = sum(part.square().sum() for part in (*made[:3], *made.state))
        gradients.append(torch.autograd.grad(total, list(forecaster.parameters())))
    for one, other in zip(*((*made[:3], *made.state) for made in found), strict=True):
        torch.testing.assert_close(one, other, rtol=1e-5, atol=1e-6)
    for one, other in zip(*gradients, strict=True):
        torch.testing.assert_close(one, other, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("pattern", MASKS)
def test_a_gated_rollout_steers_every_frame_with_its_own_controls(tiny, pattern):
    codec = Codec(tiny.SKELETON, Quaternion(), root="path", controls=Controls())
    forecaster = Forecaster(
        codec,
        backbone=lambda inputs: GRUBackbone(inputs, hidden=24, layers=1),
        head=DenseHead,
        controls=ControlLayers(codec.controls.dim),
    )
    generator = torch.Generator().manual_seed(3)
    forecaster.reset_parameters(generator)
    features = torch.randn(2, 9, codec.feature_dim, generator=generator)
    controls = torch.randn(2, 9, codec.controls.dim, generator=generator)
    found = [
        roll(
            forecaster,
            features[:, :5],
            4,
            truth=features[:, 5:],
            truth_mask=torch.tensor(pattern),
            controls=controls,
        ).features
        for roll in (rollout, gated_rollout)
    ]
    torch.testing.assert_close(*found, rtol=1e-5, atol=1e-6)


def test_what_is_recorded_is_the_loss_of_a_step(tiny):
    forecaster = tiny.tiny_forecaster()
    example = example_of(tiny, forecaster)
    mask = torch.arange(tiny.HORIZON) % 2 == 0
    plain = OBJECTIVE(
        attempt(
            forecaster, example, prefix=tiny.PREFIX, mask=mask, order=OBJECTIVE.order
        ).comparison
    )
    step = Recorder(forecaster, OBJECTIVE, prefix=tiny.PREFIX).step()
    total, *others = step(mask, *(value for value in example if value is not None))
    terms, state = others[: len(plain.terms)], others[len(plain.terms) :]
    assert [each.shape for each in state] == [(4, 24)]
    torch.testing.assert_close(total, plain.total)
    torch.testing.assert_close(terms, [term.detach() for term in plain.terms.values()])
    assert total.requires_grad
    assert not any(term.requires_grad for term in terms)


@pytest.mark.parametrize(
    ("device", "processes", "plan", "adversary", "words"),
    [
        ("cpu", 1, Plan(), None, "this run is on 'cpu'"),
        ("cuda", 2, Plan(), None, "2 processes"),
        ("cuda", 1, Plan(noise_at=[[0, 0.1]]), None, "training.noise_at"),
        ("cuda", 1, Plan(), Adversary(fidelity=1.0), "adversary"),
    ],
)
def test_a_run_that_cannot_be_recorded_is_refused(device, processes, plan, adversary, words):
    with pytest.raises(ConfigError, match=words):
        check_recording(torch.device(device), processes, plan, adversary=adversary)


def test_a_run_on_one_gpu_can_be_recorded():
    check_recording(torch.device("cuda"), 1, Plan(), adversary=None)


def test_training_on_a_cpu_says_that_it_records_nothing(tiny, tmp_path):
    with pytest.raises(ConfigError, match="leave --cuda-graphs out"):
        tiny.train(tmp_path, epochs=1, cuda_graphs=True)


@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs an NVIDIA GPU")
def test_recorded_training_is_the_training(tiny, tmp_path):
    weights = []
    for graphs in (False, True):
        forecaster = tiny.tiny_forecaster()
        tiny.train(
            tmp_path / str(graphs),
            epochs=4,
            forecaster=forecaster,
            accelerator="gpu",
            devices=1,
            cuda_graphs=graphs,
        )
        weights.append({name: value.cpu() for name, value in forecaster.state_dict().items()})
    for name, plain in weights[0].items():
        torch.testing.assert_close(weights[1][name], plain, rtol=1e-3, atol=1e-5, msg=name)
