"""Structural-RNN: recurrent layers for parts of a body and for the edges between them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import islice
from typing import Literal

import torch
from jaxtyping import Float
from torch import Tensor, nn

from posecast.errors import ConfigError
from posecast.model.body_parts import PARTS, BodyParts
from posecast.model.head import linear_layers, reset_linear
from posecast.model.lstm import LSTMBackbone
from posecast.model.recurrent import State, Summary
from posecast.skeleton import Skeleton


class StructuralRNNBackbone(nn.Module):
    """The spatio-temporal graph of a body as a network (Jain et al. 2016).

    The nodes are torso, left arm, right arm, left leg, right leg. Spatial edges join the torso to
    all limbs, the arms to each other and the legs to each other; a temporal edge joins every part
    to its own past. Edges of a kind (torso-arm, torso-leg, arm-arm, leg-leg, and a temporal one
    each for torso, arm and leg) share their weights, and so do the two arms and the two legs.

    With the numbers x of a part, an edge between p and q says

    - ``u = W2 relu(W1 [x_p, x_q] + b1) + b2``, then ``[LSTM(u), u]``,

    the torso first in what it reads, a limb itself before the other one. The torso has two edges of
    each kind, and reads the sum of what the two would read. A temporal edge says ``u`` of x_p
    alone. A node concatenates what its edges say, v, and the summary of the part is
    ``[LSTM(v), v]``. The summaries of all parts, in the order above, are the context; ``PartsHead``
    reads each for its own part, any other head reads all.

    What is no joint of the codec, root channels and controls, belongs to the torso.

    Parts that share weights are further rows of one product. Cells have one bias a gate; in the
    paper's code their gates see the cell as well. A temporal edge, as the settings of that code
    have it, reads one frame and has no memory besides that of its node; ``temporal="lstm"``, a
    variant there, gives it the layers of a spatial edge.

    Args:
        input_dim: numbers a frame: all joints, one after the other, then what belongs to the torso.
        skeleton: whose joints those are.
        joint_dim: numbers a joint.
        hidden: units of every LSTM, 512 as published.
        encoder: units of each of the two linear layers of an edge, 256 as published.
        temporal: what temporal edges are made of: their two linear layers alone, or an LSTM, too.
        parts: which joints are in which part, see ``BodyParts.of``; ``None``: by their names.

    Raises:
        ConfigError: a layer without units, an unknown choice, fewer numbers than the joints have,
            or parts that do not fit the skeleton.

    Source: Jain, Zamir, Savarese, Saxena, "Structural-RNN: Deep Learning on Spatio-Temporal
    Graphs", CVPR 2016; edges and layers as in the code published with it.
    """

    def __init__(
        self,
        input_dim: int,
        skeleton: Skeleton,
        joint_dim: int,
        *,
        hidden: int = 512,
        encoder: int = 256,
        temporal: Literal["linear", "lstm"] = "linear",
        parts: Mapping[str, list[str]] | None = None,
    ) -> None:
        super().__init__()
        if min(hidden, encoder) < 1:
            raise ConfigError(f"hidden: {hidden}, encoder: {encoder}; expected 1 or more")
        if temporal not in ("linear", "lstm"):
            raise ConfigError(f"temporal: {temporal!r} is not known; choose 'linear' or 'lstm'")
        if input_dim < len(skeleton) * joint_dim:
            raise ConfigError(
                f"{input_dim} numbers a frame; {len(skeleton)} joints of {joint_dim} have "
                f"{len(skeleton) * joint_dim}"
            )
        self.body = BodyParts.of(skeleton, parts)
        torso, arm, leg = self._keep_features(input_dim, joint_dim)
        memory = hidden if temporal == "lstm" else None
        self.edges = nn.ModuleDict(
            {
                "torso": _Edge(torso, encoder, memory, parts=1),
                "arm": _Edge(arm, encoder, memory, parts=2),
                "leg": _Edge(leg, encoder, memory, parts=2),
                "torso_arm": _Edge(torso + arm, encoder, hidden, parts=3),
                "torso_leg": _Edge(torso + leg, encoder, hidden, parts=3),
                "arm_arm": _Edge(2 * arm, encoder, hidden, parts=2),
                "leg_leg": _Edge(2 * leg, encoder, hidden, parts=2),
            }
        )
        # One temporal edge and two kinds of spatial edges, whatever the part.
        heard = encoder + (memory or 0) + 2 * (encoder + hidden)
        self.nodes = nn.ModuleDict(
            {
                name: _Memory(heard, hidden, parts=len(kind))
                for name, kind in zip(("torso", "arm", "leg"), self.body.kinds, strict=True)
            }
        )
        self.context_dim = len(PARTS) * (hidden + heard)

    def _keep_features(self, input_dim: int, joint_dim: int) -> list[int]:
        """Remember which numbers of a frame each part reads; how many, for each kind of part."""
        joints = len(self.body.joints)
        numbers = torch.arange(joints * joint_dim).unflatten(0, (joints, joint_dim))
        sizes: list[int] = []
        for number, kind in enumerate(self.body.kinds):
            features = numbers[torch.tensor(kind)].flatten(1)
            if number == 0:
                others = torch.arange(joints * joint_dim, input_dim)
                features = torch.cat([features, others[None]], dim=-1)
            self.register_buffer(f"_features_{number}", features, persistent=False)
            sizes.append(features.shape[-1])
        return sizes

    def reset_parameters(self, generator: torch.Generator | None = None) -> None:
        """Draw all weights anew, as PyTorch does."""
        for module in (*self.edges.values(), *self.nodes.values()):
            assert isinstance(module, _Edge | _Memory)
            module.reset_parameters(generator)

    def initial_state(self, batch: int) -> State:
        """For each LSTM its output, then its cell: zeros (batch, parts, hidden)."""
        memories = (module for module in self.modules() if isinstance(module, _Memory))
        return tuple(part for memory in memories for part in memory.initial_state(batch))

    def forward(self, frames: Float[Tensor, "batch frames inputs"], state: State) -> Summary:
        """Read frames, the oldest first."""
        torso, arms, legs = self._parts(frames)
        read = {
            "torso": torso,
            "arm": arms,
            "leg": legs,
            "torso_arm": _between(torso, arms),
            "torso_leg": _between(torso, legs),
            "arm_arm": _across(arms),
            "leg_leg": _across(legs),
        }
        before, after = iter(state), []
        said: dict[str, Tensor] = {}
        for name, edge in self.edges.items():
            said[name], *changed = _run(edge, read[name], before)
            after += changed
        to_arms, to_legs = said["torso_arm"], said["torso_leg"]
        heard = {
            "torso": [said["torso"], to_arms[:, :, :1], to_legs[:, :, :1]],
            "arm": [said["arm"], to_arms[:, :, 1:], said["arm_arm"]],
            "leg": [said["leg"], to_legs[:, :, 1:], said["leg_leg"]],
        }
        contexts: list[Tensor] = []
        for name, node in self.nodes.items():
            context, *changed = _run(node, torch.cat(heard[name], dim=-1), before)
            contexts.append(context)
            after += changed
        return Summary(torch.cat(contexts, dim=-2).flatten(-2), tuple(after))

    def _parts(self, frames: Tensor) -> list[Float[Tensor, "batch frames parts numbers"]]:
        """What torso, arms and legs read."""
        found: list[Tensor] = []
        for number in range(len(self.body.kinds)):
            features = self.get_buffer(f"_features_{number}")
            chosen = frames.index_select(-1, features.flatten())
            found.append(chosen.unflatten(-1, features.shape))
        return found


class _Memory(nn.Module):
    """LSTM cells that several parts share; what they read is put out beside what they say."""

    def __init__(self, inputs: int, hidden: int, *, parts: int) -> None:
        super().__init__()
        self.lstm = LSTMBackbone(inputs, hidden, layers=1, biases=1)
        self.parts = parts
        self.state_size = 2

    def reset_parameters(self, generator: torch.Generator | None = None) -> None:
        self.lstm.reset_parameters(generator)

    def initial_state(self, batch: int) -> State:
        rows = self.lstm.initial_state(batch * self.parts)
        return tuple(part.unflatten(0, (batch, self.parts)) for part in rows)

    def forward(
        self, inputs: Float[Tensor, "batch frames parts inputs"], state: State
    ) -> tuple[Float[Tensor, "batch frames parts outputs"], State]:
        rows = inputs.transpose(1, 2)
        batch_parts = rows.shape[:2]
        context, after = self.lstm(rows.flatten(0, 1), tuple(each.flatten(0, 1) for each in state))
        context = context.unflatten(0, batch_parts).transpose(1, 2)
        said = torch.cat([context, inputs], dim=-1)
        return said, tuple(each.unflatten(0, batch_parts) for each in after)


class _Edge(nn.Module):
    """Two linear layers, rectified units between them, and a memory of ``hidden`` units if any."""

    def __init__(self, inputs: int, encoder: int, hidden: int | None, *, parts: int) -> None:
        super().__init__()
        self.layers = linear_layers([inputs, encoder, encoder])
        self.memory = None if hidden is None else _Memory(encoder, hidden, parts=parts)
        self.state_size = 0 if self.memory is None else self.memory.state_size

    def reset_parameters(self, generator: torch.Generator | None = None) -> None:
        for layer in self.layers:
            reset_linear(layer, generator)
        if self.memory is not None:
            self.memory.reset_parameters(generator)

    def forward(
        self, inputs: Float[Tensor, "batch frames parts inputs"], state: State
    ) -> tuple[Float[Tensor, "batch frames parts outputs"], State]:
        first, second = self.layers
        said = second(first(inputs).relu())
        return (said, ()) if self.memory is None else self.memory(said, state)


def _run(module: nn.Module, inputs: Tensor, before: Iterator[Tensor]) -> tuple[Tensor, ...]:
    """What an edge or a node says, then its state; its state before is the next of ``before``."""
    assert isinstance(module, _Edge | _Memory)
    said, after = module(inputs, tuple(islice(before, module.state_size)))
    return (said, *after)


def _between(
    torso: Float[Tensor, "batch frames 1 numbers"], limbs: Float[Tensor, "batch frames 2 others"]
) -> Float[Tensor, "batch frames 3 both"]:
    """What the edges between the torso and two limbs read, for the torso and for each limb."""
    edges = torch.cat([torso.expand(-1, -1, 2, -1), limbs], dim=-1)
    return torch.cat([edges.sum(-2, keepdim=True), edges], dim=-2)


def _across(limbs: Float[Tensor, "batch frames 2 numbers"]) -> Float[Tensor, "batch frames 2 both"]:
    """What the edge between two limbs reads, for each of them."""
    return torch.cat([limbs, limbs.flip(-2)], dim=-1)
