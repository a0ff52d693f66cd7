"""Writing one step of a forecaster as a file, with what its numbers are and how exact it is."""

from __future__ import annotations

import json
from collections.abc import Sequence
from os import PathLike
from pathlib import Path

import torch

from posecast.errors import ConfigError
from posecast.export.extra import onnx_module, require_extra
from posecast.export.graph import StepNetwork
from posecast.export.layout import Mode, describe
from posecast.export.parity import Parity, measure_parity
from posecast.export.stepper import check_mode, runner, step_model, versions
from posecast.io.atomic import atomic_write, check_target
from posecast.model import Forecaster

PROPERTY = "posecast"
"""Key of the model's metadata under which the description is."""


def export_step(
    forecaster: Forecaster,
    path: str | PathLike[str],
    *,
    offsets: Sequence[Sequence[float]],
    fps: float,
    mode: Mode = "exact",
) -> Parity:
    """Write one step as ONNX, and a JSON record of the same name beside it.

    The file takes any batch size. Its metadata say what its numbers are, as ``describe`` does; the
    record says the same, and how far the step is from the network, as ONNX Runtime runs it here.

    Args:
        forecaster: what steps.
        path: ends in ``.onnx``.
        offsets: a body for the skeleton, metres, one row a joint.
        fps: frames per second of the steps.
        mode: ``exact``, or ``fast`` with large weights in eight bits, which ONNX Runtime alone can
            read.

    Raises:
        ConfigError: another ending, an unknown mode, the extra ``onnx`` is missing, the network
            cannot be exported, or what was exported is not the network.
        DataError: the file cannot be written.
    """
    target = Path(path)
    if target.suffix != ".onnx":
        raise ConfigError(f"{target}: a step is written as ONNX; choose a name that ends in .onnx")
    check_mode(mode)
    require_extra()
    for written in (target, record_of(target)):
        check_target(written)
    network = StepNetwork(forecaster)
    description = describe(network, mode, offsets=offsets, fps=fps)
    body = network.forecaster.codec.choose(torch.tensor(offsets, dtype=torch.float32))
    model = step_model(network, mode)
    onnx_module("onnx").helper.set_model_props(model, {PROPERTY: json.dumps(description)})
    content: bytes = model.SerializeToString()
    parity = measure_parity(network, runner(content, network), body, versions())
    if mode == "exact":
        parity.check()
    record = {**description, "parity": parity.record()}
    lines = [f" {json.dumps(key)}: {json.dumps(value)}" for key, value in record.items()]
    with atomic_write(target) as temporary:
        temporary.write_bytes(content)
    with atomic_write(record_of(target)) as temporary:
        temporary.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")
    return parity


def record_of(path: Path) -> Path:
    """Where the record of an exported step is."""
    return path.with_suffix(".json")
