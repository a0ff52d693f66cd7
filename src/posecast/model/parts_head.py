"""A head of small networks for the parts of a body; left and right share theirs."""

from __future__ import annotations

import torch
from jaxtyping import Float, Int
from torch import Tensor, nn

from posecast.model.body_parts import BodyParts
from posecast.model.head import layer_sizes, linear_layers, reset_linear, start_linear_at
from posecast.skeleton import Skeleton


class PartsHead(nn.Module):
    """The joints of every part from what the backbone says of that part (Jain et al. 2016).

    Linear layers, rectified units after all but the last. There are three networks, one each for
    torso, arms and legs; both arms, and both legs, are rows of one product. Root channels do not
    come from here: like with any head, the forecaster has a linear layer for them.

    Args:
        context_dim: size of the context: summaries of all parts, equally long.
        skeleton: whose joints are predicted.
        joint_dim: numbers a joint.
        body: the parts, of a backbone that knows them.
        hidden: units of each hidden layer, or of the only one, (256, 100) as published; ``None``:
            no hidden layer.

    Raises:
        ConfigError: a hidden layer without units.

    Source: Jain et al., "Structural-RNN: Deep Learning on Spatio-Temporal Graphs", CVPR 2016.
    """

    def __init__(
        self,
        context_dim: int,
        skeleton: Skeleton,
        joint_dim: int,
        *,
        body: BodyParts,
        hidden: int | list[int] | None = None,
    ) -> None:
        super().__init__()
        assert len(body.joints) == len(skeleton), "parts are of the skeleton that is predicted"
        self.body, self.joint_dim = body, joint_dim
        self._counts = [len(kind) for kind in body.kinds]
        sizes = layer_sizes(context_dim // sum(self._counts), hidden, "head.hidden")
        self.hidden = nn.ModuleList(linear_layers(sizes) for _ in body.kinds)
        self.output = nn.ModuleList(
            nn.Linear(sizes[-1], len(kind[0]) * joint_dim) for kind in body.kinds
        )
        slots = torch.tensor(body.joints).argsort()
        self.register_buffer("_slots", slots, persistent=False)

    _slots: Int[Tensor, "joints"]

    def reset_parameters(self, generator: torch.Generator | None = None) -> None:
        """Draw all weights anew, as PyTorch does."""
        for layers in self.hidden:
            assert isinstance(layers, nn.ModuleList)
            for layer in layers:
                reset_linear(layer, generator)
        for layer in self.output:
            reset_linear(layer, generator)

    def start_at(self, joints: Float[Tensor, "joints joint_dim"]) -> None:
        """Change the weights so that the head puts out nearly ``joints``, whatever the context;
        for corresponding joints of both sides, which share weights, their mean."""
        for output, kind in zip(self.output, self.body.kinds, strict=True):
            assert isinstance(output, nn.Linear)
            start_linear_at(output, joints[torch.tensor(kind)].mean(0).flatten())

    def forward(
        self, context: Float[Tensor, "*batch context"]
    ) -> Float[Tensor, "*batch joints joint_dim"]:
        """Numbers for every joint."""
        parts = context.unflatten(-1, (sum(self._counts), -1)).split(self._counts, dim=-2)
        done: list[Tensor] = []
        for rows, hidden, output in zip(parts, self.hidden, self.output, strict=True):
            assert isinstance(hidden, nn.ModuleList)
            for layer in hidden:
                rows = layer(rows).relu()
            done.append(output(rows).flatten(-2))
        joints = torch.cat(done, dim=-1).unflatten(-1, (-1, self.joint_dim))
        return joints.index_select(-2, self._slots)
