"""Forward kinematics one joint after another: the slow twin of ``posecast.skeleton.kinematics``.

Written the way QuaterNet-type code usually is (an outer product per quaternion product, a list
of joints, one stack at the end) and without anything from the library, so that an error there
cannot hide here. Also the reference that ``benchmarks/kinematics.py`` measures against.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor


def multiply(left: Tensor, right: Tensor) -> Tensor:
    """Hamilton product read off the 4 x 4 table of all products of components."""
    table = torch.bmm(left.reshape(-1, 4, 1), right.reshape(-1, 1, 4))
    w = table[:, 0, 0] - table[:, 1, 1] - table[:, 2, 2] - table[:, 3, 3]
    x = table[:, 0, 1] + table[:, 1, 0] + table[:, 2, 3] - table[:, 3, 2]
    y = table[:, 0, 2] + table[:, 2, 0] + table[:, 3, 1] - table[:, 1, 3]
    z = table[:, 0, 3] + table[:, 3, 0] + table[:, 1, 2] - table[:, 2, 1]
    return torch.stack([w, x, y, z], dim=1).reshape(left.shape)


def turn(rotation: Tensor, vector: Tensor) -> Tensor:
    """Vector part of q v q*, by two cross products."""
    axis = rotation[..., 1:]
    inner = torch.cross(axis, vector, dim=-1)
    return vector + 2 * (rotation[..., :1] * inner + torch.cross(axis, inner, dim=-1))


def plain_kinematics(
    parents: Sequence[int],
    rotations: Tensor,
    offsets: Tensor,
    root_positions: Tensor | None = None,
) -> tuple[Tensor, Tensor]:
    """World positions and rotations; ``rotations`` (*b, J, 4), ``offsets`` broadcast to it."""
    offsets = offsets.expand(*rotations.shape[:-1], 3)
    positions: list[Tensor] = []
    turned: list[Tensor] = []
    for joint, parent in enumerate(parents):
        own, offset = rotations[..., joint, :], offsets[..., joint, :]
        if parent == -1:
            positions.append(offset if root_positions is None else offset + root_positions)
            turned.append(own)
        else:
            positions.append(positions[parent] + turn(turned[parent], offset))
            turned.append(multiply(turned[parent], own))
    return torch.stack(positions, dim=-2), torch.stack(turned, dim=-2)


def plain_positions(
    parents: Sequence[int],
    rotations: Tensor,
    offsets: Tensor,
    root_positions: Tensor | None = None,
) -> Tensor:
    """World positions only; joints without children are not turned."""
    offsets = offsets.expand(*rotations.shape[:-1], 3)
    above = set(parents)
    positions: list[Tensor] = []
    turned: dict[int, Tensor] = {}
    for joint, parent in enumerate(parents):
        own, offset = rotations[..., joint, :], offsets[..., joint, :]
        if parent == -1:
            positions.append(offset if root_positions is None else offset + root_positions)
        else:
            positions.append(positions[parent] + turn(turned[parent], offset))
        if joint in above:
            turned[joint] = own if parent == -1 else multiply(turned[parent], own)
    return torch.stack(positions, dim=-2)
