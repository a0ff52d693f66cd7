"""How far an exported step is from the network it was made of, measured before it is used."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from posecast.errors import ConfigError
from posecast.export.graph import StepNetwork
from posecast.geometry import quaternion

BATCHES = (1, 3, 8)
STEPS = 10
LARGEST = 1e-4
"""What single precision may differ by, in units of the largest number of an output."""

_TURN, _STEP = 0.3, 0.1  # radians and metres by which the first poses differ from that at rest

Run = Callable[[Sequence[Tensor]], list[Tensor]]
"""One step: inputs in, outputs out, in the order of ``StepNames``."""


@dataclass(frozen=True)
class Parity:
    """Largest difference of any number that a step gives, frames and states, by batch size.

    Args:
        steps: how many steps were compared.
        differences: for each batch size the largest difference.
        versions: of what was compared, by package.
    """

    steps: int
    differences: Mapping[int, float]
    versions: Mapping[str, str]

    def record(self) -> dict[str, Any]:
        """The same, ready for JSON."""
        return {
            "steps": self.steps,
            "largest_difference": {str(batch): each for batch, each in self.differences.items()},
            "versions": dict(self.versions),
        }

    def check(self) -> None:
        """Refuse a step in single precision that is not the network's.

        Raises:
            ConfigError: naming the first batch size at which it is not.
        """
        for batch, difference in self.differences.items():
            if difference <= LARGEST:  # what is no number is not
                continue
            versions = ", ".join(f"{name} {version}" for name, version in self.versions.items())
            raise ConfigError(
                f"the exported step differs from the network by {difference:.2g} at batch size "
                f"{batch}; expected at most {LARGEST:g}. These versions do not export it rightly: "
                f"{versions}; install those of constraints.txt"
            )


def measure_parity(
    network: StepNetwork,
    run: Run,
    offsets: Float[Tensor, "joints 3"],
    versions: Mapping[str, str],
) -> Parity:
    """Compare steps along rollouts of the network: both read the same, step by step.

    Rollouts begin near the pose at rest; controls are random in every step.

    Args:
        network: what was exported.
        run: what came of it.
        offsets: a body for the joints that features write, metres.
        versions: to be noted.
    """
    differences = {batch: _largest_difference(network, run, offsets, batch) for batch in BATCHES}
    return Parity(STEPS, differences, versions)


@torch.no_grad()
def _largest_difference(network: StepNetwork, run: Run, offsets: Tensor, batch: int) -> float:
    """The largest difference over the steps of one batch, large numbers by their own size."""
    generator = torch.Generator().manual_seed(batch)
    forecaster = network.forecaster
    codec, controls = forecaster.codec, forecaster.controls
    turned = quaternion.exp(_TURN * torch.randn(batch, len(offsets), 3, generator=generator))
    joints = codec.representation.encode(turned, offsets.expand(batch, -1, -1))
    root = _STEP * torch.randn(batch, codec.root_dim, generator=generator)
    action = torch.zeros(batch, len(codec.actions)) if codec.actions else None
    features = codec.merge(joints, root, action)
    state = network.initial_state(batch)
    feed_back = network.names.outputs.index(
        "emitted" if forecaster.feedback == "emitted" else "next_features"
    )
    largest = 0.0
    for _ in range(STEPS):
        steered: list[Tensor] = []
        if controls is not None:
            steered = [torch.randn(batch, controls.input_dim, generator=generator)]
        inputs = [features, *steered, *state]
        wanted, found = list(network(*inputs)), run(inputs)
        for own, other in zip(wanted, found, strict=True):
            size = max(1.0, own.abs().max().item())
            difference = (own - other).abs().max().item() / size
            largest = difference if math.isnan(difference) else max(largest, difference)
        features, state = wanted[feed_back], wanted[len(wanted) - len(state) :]
    return largest
