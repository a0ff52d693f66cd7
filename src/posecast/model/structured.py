"""The structured head: joint by joint along a tree (Aksan et al. 2019)."""

from __future__ import annotations

import math
from collections.abc import Mapping

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn

from posecast.errors import ConfigError
from posecast.model.products import linear_columns
from posecast.model.reading_order import Ancestors, ReadingOrder, Tree
from posecast.skeleton import Skeleton


class StructuredHead(nn.Module):
    """Every joint by a small network of its own that reads the context and predictions above it.

    Joint k is ``W2 relu(W1 [h, joints that k reads] + b1) + b2`` with the context h; what is read
    are the numbers that were just predicted, before any residual. Weights are not shared.

    The context's part of all first layers is one product; joints that read nothing of each other
    are computed together.

    Args:
        context_dim: size of the context.
        skeleton: whose joints are predicted; several roots are allowed.
        joint_dim: numbers a joint.
        hidden: units of each joint's hidden layer, 64 and 128 in Aksan et al.
        ancestors: what a joint reads: ``all`` above it (dense), its ``parent`` (sparse), ``none``.
        tree: above in which sense, see ``ReadingOrder.of``.
        tree_seed: which of the random trees.

    Raises:
        ConfigError: a hidden layer without units, or a tree that does not fit the skeleton.

    Source: Aksan et al. 2019, "Structured Prediction Helps 3D Human Motion Modelling", eq. 2.
    """

    def __init__(
        self,
        context_dim: int,
        skeleton: Skeleton,
        joint_dim: int,
        *,
        hidden: int = 64,
        ancestors: Ancestors = "all",
        tree: Tree | Mapping[str, str | None] = "kinematic",
        tree_seed: int = 0,
    ) -> None:
        super().__init__()
        if hidden < 1:
            raise ConfigError(f"head.hidden is {hidden}; expected 1 or more")
        self.joint_dim, self.units = joint_dim, hidden
        self.order = ReadingOrder.of(skeleton, ancestors=ancestors, tree=tree, tree_seed=tree_seed)
        groups = self.order.groups
        self.context = nn.Linear(context_dim, len(skeleton) * hidden)
        # The joints of the first group read none, those of all others do.
        self.above = nn.ParameterList(
            torch.empty(len(joints), hidden, joint_dim * len(self.order.reads[joints[0]]))
            for joints in groups[1:]
        )
        self.output = nn.ParameterList(
            torch.empty(len(joints), joint_dim, hidden) for joints in groups
        )
        self.output_bias = nn.Parameter(torch.empty(len(skeleton), joint_dim))
        placed = [joint for joints in groups for joint in joints]
        slots = {joint: slot for slot, joint in enumerate(placed)}
        self._sizes = [len(joints) for joints in groups]
        self._keep("_placed", placed)
        self._keep("_slots", [slots[joint] for joint in range(len(skeleton))])
        for number, joints in enumerate(groups[1:]):
            read = [slots[joint] for reader in joints for joint in self.order.reads[reader]]
            self._keep(f"_read_{number}", read)
        self.reset_parameters()

    _placed: Int[Tensor, "joints"]
    _slots: Int[Tensor, "joints"]

    def _keep(self, name: str, indices: list[int]) -> None:
        """Indices that move with the weights and are not among them."""
        self.register_buffer(name, torch.tensor(indices, dtype=torch.long), persistent=False)

    def reset_parameters(self, generator: torch.Generator | None = None) -> None:
        """Draw all weights anew as PyTorch does for a linear layer of each joint."""
        rows = [size * self.units for size in self._sizes]
        weights, biases = self.context.weight.split(rows), self.context.bias.split(rows)
        for weight, bias, above in zip(weights, biases, (None, *self.above), strict=True):
            read = 0 if above is None else above.shape[-1]
            bound = 1 / math.sqrt(self.context.in_features + read)
            for part in (weight, bias, above):
                if part is not None:
                    nn.init.uniform_(part, -bound, bound, generator=generator)
        bound = 1 / math.sqrt(self.units)
        for weight in (*self.output, self.output_bias):
            nn.init.uniform_(weight, -bound, bound, generator=generator)

    def start_at(self, joints: Float[Tensor, "joints joint_dim"]) -> None:
        """Change the weights so that the head puts out nearly ``joints``, whatever the context."""
        with torch.no_grad():
            for weight in self.output:
                weight.mul_(0.1)
            self.output_bias.copy_(joints[self._placed])

    def forward(
        self, context: Float[Tensor, "*batch context"]
    ) -> Float[Tensor, "*batch joints joint_dim"]:
        """Numbers for every joint."""
        rows = context.flatten(0, -2)
        # (joints hidden, rows): the joints of a group lie side by side, and need no copies.
        firsts = linear_columns(rows, self.context.weight, self.context.bias)
        firsts = firsts.unflatten(0, (-1, self.units)).split(self._sizes)
        biases = self.output_bias[..., None].split(self._sizes)
        done: list[Tensor] = []
        for number, (first, output, bias) in enumerate(
            zip(firsts, self.output, biases, strict=True)
        ):
            if number:
                read = self.get_buffer(f"_read_{number - 1}")
                known = torch.cat(done).index_select(0, read).reshape(len(first), -1, rows.shape[0])
                first = torch.baddbmm(first, self.above[number - 1], known)
            done.append(torch.baddbmm(bias, output, first.relu()))
        joints = torch.cat(done).index_select(0, self._slots)
        return joints.permute(2, 0, 1).unflatten(0, context.shape[:-1])
