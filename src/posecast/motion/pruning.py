"""Dropping joints while everything that stays keeps its place in the world."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import torch
from jaxtyping import Float
from torch import Tensor

from posecast.errors import SkeletonError
from posecast.geometry import quaternion
from posecast.motion.clip import Clip

_STILL = 1e-6
"""Meters a translation may stray from its mean in time and still count as constant."""


def drop_joints(
    clip: Clip, joints: Sequence[str | int], *, moving: Literal["keep", "mean"] = "keep"
) -> Clip:
    """Remove joints; their rotation and offset are folded into the children.

    A child of a removed joint has rotation removed * child and is translated by the removed
    joint's offset + removed * the child's offset. If the removed joint turns in time, this
    translation changes in time. Where a root is removed, the joint below it becomes a root, and
    the first root's world position becomes ``root_positions``.

    Args:
        clip: any clip.
        joints: names or indices.
        moving: what to do with translations that change: ``"keep"`` every frame of them in
            ``translations_local``, and no joint that stays moves in the world; ``"mean"``: take
            their mean in time as the offset, for networks and formats with rigid bones.

    Raises:
        SkeletonError: no joint has such a name or index, or none would be left.

    Note:
        QuaterNet's preparation drops the offset of the removed joint, which lowers head and arms
        by 11.6 cm on its data; positions are comparable with it only up to that.
    """
    skeleton = clip.skeleton
    removed = {_index_of(clip, joint) for joint in joints}
    kept = [joint for joint in range(len(skeleton)) if joint not in removed]
    if not kept:
        raise SkeletonError(f"clip {clip.name!r}: all {len(skeleton)} joints would be dropped")
    if not removed:
        return clip
    untouched = {joint for joint in kept if skeleton.parents[joint] not in {-1, *removed}}
    rotations = clip.rotations_local.clone()
    translations = [_translation(clip, joint) for joint in range(len(skeleton))]
    for joint in range(len(skeleton)):  # parents come first, so a chain folds link by link
        parent = skeleton.parents[joint]
        if parent in removed:
            above = rotations[:, parent]
            rotations[:, joint] = quaternion.product(above, rotations[:, joint])
            turned = quaternion.rotate(above.to(translations[joint]), translations[joint])
            translations[joint] = translations[parent] + turned
    pruned = skeleton.select(kept)
    stay = [translations[joint] for joint in kept]
    root_positions = clip.root_positions
    if kept[0] != 0 or clip.translations_local is not None:
        # The first root may be another joint now, or move by itself: its place is the position.
        first = stay[0]
        root_positions = root_positions + first.to(root_positions)
        stay = [stay[j] - first if p == -1 else stay[j] for j, p in enumerate(pruned.parents)]
    changing = [bool((path - path.mean(0)).abs().max() > _STILL) for path in stay]
    keep_moving = moving == "keep" and any(changing)
    frames = torch.zeros(clip.frames, 1).to(clip.offsets)
    rest = [
        clip.offsets[joint] if keep_moving and joint in untouched else path.mean(0)
        for joint, path in zip(kept, stay, strict=True)
    ]
    return replace(
        clip,
        skeleton=pruned,
        offsets=torch.stack(rest),
        root_positions=root_positions,
        rotations_local=rotations[:, kept],
        translations_local=(
            torch.stack([path + frames for path in stay], dim=1) if keep_moving else None
        ),
    )


def _index_of(clip: Clip, joint: str | int) -> int:
    if isinstance(joint, str):
        return clip.skeleton.index(joint)
    if not 0 <= joint < len(clip.skeleton):
        raise SkeletonError(
            f"joint {joint} of clip {clip.name!r}, which has {len(clip.skeleton)} counted from 0"
        )
    return joint


def _translation(clip: Clip, joint: int) -> Float[Tensor, "some 3"]:
    """From the parent, one for each frame, or a single one if the bone is rigid."""
    if clip.translations_local is None:
        return clip.offsets[joint][None]
    return clip.translations_local[:, joint]
