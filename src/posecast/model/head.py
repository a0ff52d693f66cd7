"""Heads: the summary of the past turned into the joints of one pose."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Protocol

import torch
from jaxtyping import Float
from torch import Tensor, nn

from posecast.errors import ConfigError
from posecast.skeleton import Skeleton


class Head(Protocol):
    """Turns a context into what is predicted for every joint.

    Law: a joint depends on the context, and on those joints alone that the head says it reads.
    """

    def __call__(
        self, context: Float[Tensor, "*batch context"]
    ) -> Float[Tensor, "*batch joints joint_dim"]:
        """Numbers for every joint, as they are; nothing is projected."""
        ...

    def reset_parameters(self, generator: torch.Generator | None = None) -> None:
        """Draw all weights anew."""
        ...

    def start_at(self, joints: Float[Tensor, "joints joint_dim"]) -> None:
        """Change the weights so that the head puts out nearly ``joints``, whatever the context."""
        ...


class DenseHead(nn.Module):
    """All joints at once by a linear layer, with hidden layers of rectified units if asked for.

    Args:
        context_dim: size of the context.
        skeleton: whose joints are predicted.
        joint_dim: numbers a joint.
        hidden: units of each hidden layer, or of the only one (Aksan et al. 2019 use 960);
            ``None``: no hidden layer (Pavllo et al. 2018).

    Raises:
        ConfigError: a hidden layer without units.
    """

    def __init__(
        self,
        context_dim: int,
        skeleton: Skeleton,
        joint_dim: int,
        *,
        hidden: int | list[int] | None = None,
    ) -> None:
        super().__init__()
        self.joint_dim = joint_dim
        sizes = layer_sizes(context_dim, hidden, "head.hidden")
        self.hidden = linear_layers(sizes)
        self.output = nn.Linear(sizes[-1], len(skeleton) * joint_dim)

    def reset_parameters(self, generator: torch.Generator | None = None) -> None:
        """Draw all weights anew, as PyTorch does."""
        for layer in (*self.hidden, self.output):
            reset_linear(layer, generator)

    def start_at(self, joints: Float[Tensor, "joints joint_dim"]) -> None:
        """Change the weights so that the head puts out nearly ``joints``, whatever the context."""
        start_linear_at(self.output, joints.flatten())

    def forward(
        self, context: Float[Tensor, "*batch context"]
    ) -> Float[Tensor, "*batch joints joint_dim"]:
        """Numbers for every joint."""
        for layer in self.hidden:
            context = torch.relu(layer(context))
        return self.output(context).unflatten(-1, (-1, self.joint_dim))


def layer_sizes(inputs: int, units: int | list[int] | None, name: str) -> list[int]:
    """Sizes from the inputs on upwards; ``units`` are those of layers, of the only one, or none.

    Raises:
        ConfigError: a layer without units; ``name`` says where.
    """
    sizes = [] if units is None else [units] if isinstance(units, int) else list(units)
    if any(size < 1 for size in sizes):
        raise ConfigError(f"{name} is {units}; expected 1 or more, or null for no layer")
    return [inputs, *sizes]


def linear_layers(sizes: list[int]) -> nn.ModuleList:
    """Linear layers on top of each other."""
    return nn.ModuleList(nn.Linear(below, above) for below, above in pairwise(sizes))


def reset_linear(layer: nn.Module, generator: torch.Generator | None = None) -> None:
    """Draw a linear layer anew from PyTorch's own distribution."""
    assert isinstance(layer, nn.Linear)
    bound = 1 / math.sqrt(layer.in_features)
    nn.init.uniform_(layer.weight, -bound, bound, generator=generator)
    if layer.bias is not None:
        nn.init.uniform_(layer.bias, -bound, bound, generator=generator)


def start_linear_at(layer: nn.Linear, values: Float[Tensor, " outputs"]) -> None:
    """Set the bias of a linear layer to ``values`` and make its weights ten times smaller."""
    with torch.no_grad():
        layer.weight.mul_(0.1)
        layer.bias.copy_(values)
