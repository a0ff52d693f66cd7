"""Mirror images of clips on the very skeleton they had, whatever the axes of its joints."""

from __future__ import annotations

import math
from dataclasses import replace

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from posecast.errors import SkeletonError
from posecast.geometry import quaternion
from posecast.motion.clip import Clip
from posecast.motion.transforms import mirror

_FITS = 0.05
"""Most that mirrored bones may miss those of the body by, in lengths of these bones."""


def mirror_on_own_axes(clip: Clip) -> Clip:
    """``mirror``, with bones along the axes on which they were.

    What ``mirror`` gives is exact in the world but on a reflected body: where the bones of the left
    arm lie along +x of their joints and those of the right arm along -x, all of its bones point
    the other way. Its rotations are then not those that the clip's own body would have. Here the
    axes of every joint are turned by half a turn about x, y or z, or not at all, whichever puts
    its bones where they are on the clip's body; where several do, as for a joint without bones,
    the one whose rotations are nearest to the clip's, and of a root the first. World positions stay
    those of ``mirror``.

    Raises:
        SkeletonError: no half turn does, as on a body that is not symmetric.
    """
    image = mirror(clip)
    changes = quaternion.identity(like=clip.rotations_local).repeat(len(clip.skeleton), 1)
    rotations, offsets = image.rotations_local.clone(), image.offsets.clone()
    for joint, parent in enumerate(clip.skeleton.parents):
        if parent >= 0:
            back = quaternion.conjugate(changes[parent])
            rotations[:, joint] = quaternion.product(back, rotations[:, joint])
            offsets[joint] = quaternion.rotate(back.to(offsets), offsets[joint])
        changes[joint] = _change(clip, image, joint, rotations[:, joint])
        rotations[:, joint] = quaternion.product(rotations[:, joint], changes[joint])
    return replace(image, rotations_local=rotations, offsets=offsets)


def _change(
    clip: Clip, image: Clip, joint: int, rotations: Float[Tensor, "frames 4"]
) -> Float[Tensor, "4"]:
    """How the axes of a joint are to be turned.

    Args:
        rotations: of the mirrored joint, on axes of its parent that are as they were.
    """
    turns = torch.eye(4).to(rotations)
    fits = _fits(clip, image, joint, turns.to(clip.offsets))
    if not fits.any():
        raise SkeletonError(
            f"clip {clip.name!r}: mirrored, the bones below joint {clip.skeleton.names[joint]!r} "
            "are not those of its body, whichever way its axes are turned; expected left and right "
            "of the same lengths: give a symmetric body, or do without mirrored clips"
        )
    if clip.skeleton.parents[joint] < 0:
        # Its rotations depend on where the clip heads, and hips have bones enough.
        return turns[int(fits.int().argmax())]
    turned = quaternion.product(rotations, turns[:, None])
    apart = quaternion.angle(turned, clip.rotations_local[:, joint]).mean(-1)
    return turns[int(torch.where(fits, apart, math.inf).argmin())]


def _fits(
    clip: Clip, image: Clip, joint: int, turns: Float[Tensor, "turns 4"]
) -> Bool[Tensor, "turns"]:
    """Which turns of its axes put the mirrored bones of a joint where those of the clip are."""
    children = list(clip.skeleton.children[joint])
    own, other = clip.offsets[children], image.offsets[children]
    apart = (quaternion.rotate(turns[:, None], own) - other).norm(dim=-1).sum(-1)
    return apart <= _FITS * own.norm(dim=-1).sum()
