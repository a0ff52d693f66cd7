"""Memories that relieve each other, so that a walker never walks on one of them for long.

A recurrent network that learned from short windows knows what its memory is like in the first
seconds after a start, and no longer: what it remembers drifts on, and the body with it. A walker
that goes on for minutes therefore begins anew at a step now and then, in the pose in which its
steps begin, walks both for a moment, and goes over from the old to the new.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor

from posecast.geometry import quaternion
from posecast.model.recurrent import State
from posecast.model.rollout import Steppable
from posecast.motion import Motion
from posecast.motion.tracks import MOVEMENT, turned
from posecast.representation import Codec

RENEW = 2.0
"""Seconds after which a memory is relieved, at the next step."""

WARM = 2 / 3
"""Seconds a new memory walks along before it is seen."""

FADE = 1 / 3
"""Seconds of going over to it."""

UPWARDS = (0.0, 1.0, 0.0)


@dataclass
class Memory:
    """What a network remembers and expects, in a frame of its own that faces ahead at its start.

    In that frame the walker has turned no farther than since its last start, however often it has
    gone round in the world.

    Args:
        expected: features of the next frame.
        state: of the backbone, before it has read them.
        turn: radians about the vertical from the world to its own frame.
        age: frames since its start.
    """

    expected: Float[Tensor, "1 1 features"]
    state: State
    turn: float
    age: int = 0


def begin(
    network: Steppable,
    pose: Float[Tensor, "1 1 features"],
    tracks: Mapping[str, Float[Tensor, "1 1 ..."]],
) -> Memory:
    """A memory of nothing but the pose in which a step begins, heading along the course."""
    x, z = tracks[MOVEMENT][0, 0].tolist()
    return Memory(pose, network.initial_state(1), -math.atan2(x, z))


def advance(
    network: Steppable,
    codec: Codec,
    memories: Sequence[Memory],
    tracks: Mapping[str, Float[Tensor, "1 1 ..."]],
) -> None:
    """Let all memories read the frame they expected, in one batch, and expect the next.

    Args:
        network: what predicts.
        codec: of its features and controls.
        memories: changed in place.
        tracks: what the course says of the frame they read, in the world.
    """
    assert codec.controls is not None
    frames = torch.cat([memory.expected for memory in memories])
    told = {name: tracks[name] for name in codec.controls.tracks}
    controls = torch.cat(
        [codec.controls.encode(turned(told, memory.turn)) for memory in memories]
    ).to(frames)
    state = tuple(map(torch.cat, zip(*(memory.state for memory in memories), strict=True)))
    said = network(frames, state, controls, last=1)
    read_again = said.emitted if network.feedback == "emitted" else said.features
    for number, memory in enumerate(memories):
        memory.expected = read_again[number : number + 1, -1:]
        memory.state = tuple(each[number : number + 1] for each in said.state)
        memory.age += 1


def expected(
    codec: Codec,
    memories: Sequence[Memory],
    tracks: Mapping[str, Float[Tensor, "1 1 ..."]],
    *,
    offsets: Float[Tensor, "joints 3"],
    fps: float,
) -> Motion:
    """The next frame in the world, between an old memory and a new one as the new one's age says.

    Args:
        codec: of the features.
        memories: one, or the older and the newer one.
        tracks: what the course says of the frame.
        offsets: the body, metres.
        fps: frames per second.
    """
    share = newer_share(memories[-1], fps)
    old = _in_world(codec, memories[0], tracks, offsets)
    if len(memories) == 1 or share == 0:
        return old
    new = _in_world(codec, memories[-1], tracks, offsets)
    side = torch.where((old.rotations_local * new.rotations_local).sum(-1, keepdim=True) < 0, -1, 1)
    rotations = torch.lerp(old.rotations_local, side * new.rotations_local, share)
    return old._replace(
        rotations_local=quaternion.normalize(rotations),
        root_positions=torch.lerp(old.root_positions, new.root_positions, share),
    )


def newer_share(memory: Memory, fps: float) -> float:
    """How much of a new memory is seen: 0 while it warms up, then more and more, and 1."""
    return min(1.0, max(0.0, (memory.age / fps - WARM) / FADE))


def _in_world(
    codec: Codec,
    memory: Memory,
    tracks: Mapping[str, Tensor],
    offsets: Float[Tensor, "joints 3"],
) -> Motion:
    """What a memory expects, turned back."""
    found = codec.decode(
        memory.expected.double(),
        offsets=offsets[None].double(),
        anchor=torch.zeros(1, 3, dtype=torch.float64),
        tracks=tracks,
    )
    roots = list(codec.skeleton.roots)
    rotations = found.rotations_local.clone()
    about = quaternion.about_axis(
        torch.tensor(UPWARDS).double(), torch.tensor(-memory.turn).double()
    )
    rotations[:, :, roots] = quaternion.product(
        about.expand_as(rotations[:, :, roots]), rotations[:, :, roots]
    )
    return found._replace(rotations_local=rotations)
