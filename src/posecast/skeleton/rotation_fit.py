"""Rotations that fit joint positions: every bone points where it should, twist is inferred."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor

from posecast.errors import SkeletonError
from posecast.geometry import conversions, quaternion
from posecast.skeleton.skeleton import Skeleton

_UNDECIDED = 1e3
"""Weight of the shortest turn against what the bones say, where they do not say everything, in
units of the last digit."""


def fit_rotations(
    skeleton: Skeleton,
    positions_root: Float[Tensor, "*batch joints 3"],
    offsets: Float[Tensor, "*#batch joints 3"],
) -> Float[Tensor, "*batch joints 4"]:
    """Local rotations with which the bones of a body point at the joints' positions.

    From the root outwards. A joint with one bone below it takes the shortest turn from where the
    body at rest points: how the bone is twisted about itself cannot be seen, and is inferred to be
    not at all. A joint with several bones takes the rotation that fits them best, longer ones
    weighing more. End joints, and bones of zero length, turn nothing. Bones may be of other lengths
    than the body's; only directions count.

    Args:
        skeleton: whose joints.
        positions_root: metres, from anywhere; only differences count.
        offsets: the body, metres.

    Raises:
        SkeletonError: the number of joints is not that of the skeleton.

    Source: least squares over bones b and their rest r, maximizing the sum of b . R r: the
    rotation nearest to the sum of b r^T (Kabsch 1976).
    """
    if positions_root.shape[-2] != len(skeleton):
        raise SkeletonError(
            f"positions of {positions_root.shape[-2]} joints; the skeleton has {len(skeleton)}"
        )
    bodies = offsets.expand_as(positions_root)
    local: list[Tensor] = []
    turned: list[Tensor] = []
    for joint, parent in enumerate(skeleton.parents):
        below = list(skeleton.children[joint])
        above = (
            quaternion.identity(*positions_root.shape[:-2], like=positions_root)
            if parent == -1
            else turned[parent]
        )
        if below:
            bones = positions_root[..., below, :] - positions_root[..., joint, None, :]
            seen = quaternion.rotate(quaternion.conjugate(above)[..., None, :], bones)
            own = _fit(seen, bodies[..., below, :])
        else:
            own = quaternion.identity(*positions_root.shape[:-2], like=positions_root)
        local.append(own)
        turned.append(quaternion.product(above, own))
    return torch.stack(local, dim=-2)


def _fit(
    bones: Float[Tensor, "*batch bones 3"], rest: Float[Tensor, "*batch bones 3"]
) -> Float[Tensor, "*batch 4"]:
    """The rotation that brings bones at rest as near as possible to where they are."""
    length = torch.linalg.vector_norm(rest.detach(), dim=-1)
    longest = length.argmax(-1)[..., None, None]
    shortest = quaternion.between(
        torch.take_along_dim(rest, longest, dim=-2).squeeze(-2),
        torch.take_along_dim(bones, longest, dim=-2).squeeze(-2),
    )
    if rest.shape[-2] == 1:
        return shortest
    weighted = bones.mT @ rest
    size = torch.linalg.vector_norm(weighted.detach(), dim=(-2, -1), keepdim=True)
    scale = (
        _UNDECIDED
        * torch.finfo(size.dtype).eps
        * torch.where(size == 0, torch.ones_like(size), size)
    )
    whole = weighted + scale * conversions.quaternion_to_matrix(shortest)
    return conversions.matrix_to_quaternion(conversions.nearest_rotation(whole))
