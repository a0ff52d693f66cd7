"""What follows a clip, in its own conventions: any predictor, on any clip of its skeleton."""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from posecast.config import did_you_mean
from posecast.errors import ConfigError, DataError, SkeletonError
from posecast.evaluation.prediction import Predictor
from posecast.geometry import quaternion
from posecast.motion import Clip
from posecast.motion.checks import check_motion
from posecast.motion.pruning import drop_joints
from posecast.motion.transforms import resample
from posecast.skeleton import Skeleton
from posecast.skeleton.kinematics import forward_kinematics


class Poses(NamedTuple):
    """Frames on a clip's own skeleton.

    Args:
        rotations_local: unit quaternions.
        root_positions: of the first root, metres.
        translations_local: of every joint from its parent, metres.
    """

    rotations_local: Float[Tensor, "frames joints 4"]
    root_positions: Float[Tensor, "frames 3"]
    translations_local: Float[Tensor, "frames joints 3"]


def forecast_clip(
    predictor: Predictor,
    clip: Clip,
    *,
    skeleton: Skeleton,
    fps: float,
    horizon_ms: float,
    prefix: int | None = None,
) -> Clip:
    """A clip followed by what the predictor expects, at the clip's own frame rate.

    Joints that the predictor does not know are folded away before it reads the clip; in the
    forecast they keep the pose they had last. The clip is read backwards from its last frame in
    steps of the predictor's rate, so the forecast begins exactly one frame after it.

    Args:
        predictor: what predicts.
        clip: any clip that has the predictor's joints; its tracks are not continued.
        skeleton: the joints of the predictor.
        fps: the rate of the predictor, frames per second.
        horizon_ms: how far to look ahead, milliseconds.
        prefix: read at most this many frames, at the predictor's rate; ``None``: the whole clip.

    Returns:
        The clip, then ``horizon_ms`` of forecast; ``source`` is kept, so it is written as read.

    Raises:
        ConfigError: a horizon shorter than a frame.
        DataError: fewer than two frames to start from, or a number of the clip that is no motion.
        SkeletonError: joints of the predictor that the clip does not have, or in another order.
    """
    wanted = math.floor(horizon_ms * clip.fps / 1000 + 1e-6) if math.isfinite(horizon_ms) else 0
    if wanted < 1:
        raise ConfigError(
            f"a horizon of {horizon_ms:g} ms is shorter than a frame of {1000 / clip.fps:.4g} ms, "
            "or no number; expected at least one frame"
        )
    if clip.frames < 2:
        raise DataError(clip.name or "clip", f"{clip.frames} frame; a forecast needs two or more")
    kept = match_joints(clip.skeleton, skeleton)
    check_motion(clip.name or "clip", clip)
    # Read backwards: the first frame of the reversed clip is the one everything counts from.
    known = _reverse(resample(_reverse(_fold(clip, kept)), fps, phases="first")[0])
    if known.frames < 2:
        raise DataError(
            clip.name or "clip",
            f"{clip.duration:.3g} s of motion; a forecast at {fps:g} frames per second needs two "
            f"frames, {2 / fps:.3g} s",
        )
    read = known if prefix is None else known.cut(max(known.frames - prefix, 0), known.frames)
    horizon = math.ceil(horizon_ms * fps / 1000 - 1e-6) + 1
    predicted = predictor.predict(read.motion(), horizon)
    joined = replace(
        read,
        root_positions=torch.cat([read.root_positions[-1:], predicted.root_positions[0]]),
        rotations_local=torch.cat([read.rotations_local[-1:], predicted.rotations_local[0]]),
        tracks={},
    )
    at_rate = resample(joined, clip.fps, phases="first")[0].cut(1, wanted + 1)
    return _append(clip, _unfold(clip, kept, at_rate))


def match_joints(found: Skeleton, wanted: Skeleton) -> tuple[int, ...]:
    """For each wanted joint its index in ``found``.

    Raises:
        SkeletonError: joints are missing, or the tree over them is another; names both.
    """
    missing = [name for name in wanted.names if name not in found.names]
    extra = [name for name in found.names if name not in wanted.names]
    if missing:
        renamed = guess_renames(missing, extra)
        lines = "; ".join(f"{old}: {new}" for old, new in renamed.items())
        raise SkeletonError(
            f"the clip lacks {len(missing)} of {len(wanted)} joints: {', '.join(missing)}; "
            f"it has besides: {', '.join(extra) or 'nothing'}; "
            + (f"perhaps renamed: {lines}; " if renamed else "")
            + "give a clip of the skeleton that the system was trained on, or a YAML file that "
            "names its joints for those of the system (--mapping FILE, a line 'Hips: pelvis' each)"
        )
    kept = tuple(sorted(found.index(name) for name in wanted.names))
    if found.select(kept) != wanted:
        raise SkeletonError(
            "the clip has all joints that are needed, but in another order or tree: "
            f"found {', '.join(found.select(kept).names)}; expected {', '.join(wanted.names)}"
        )
    return kept


def guess_renames(missing: Sequence[str], extra: Sequence[str]) -> dict[str, str]:
    """For joints that are missing those that seem to be meant: the same letters, or nearly so."""
    plain = {_letters(name): name for name in extra}
    found: dict[str, str] = {}
    for name in missing:
        near = difflib.get_close_matches(_letters(name), list(plain), n=1, cutoff=0.75)
        if near:
            found[name] = plain.pop(near[0])
    return found


def _letters(name: str) -> str:
    """A name without what dialects add: prefixes such as ``mixamorig:``, case and underscores."""
    return re.sub(r"[^a-z0-9]", "", name.rpartition(":")[2].lower())


def rename_joints(clip: Clip, names: Mapping[str, str]) -> Clip:
    """The clip with other joint names; its motion stays.

    Args:
        clip: any clip.
        names: new name -> name in the clip.

    Raises:
        SkeletonError: a name that the clip does not have, or two joints that would be called alike.
    """
    absent = [old for old in names.values() if old not in clip.skeleton.names]
    if absent:
        raise SkeletonError(
            f"the mapping names joint {absent[0]!r}, which the clip does not have; "
            f"{did_you_mean(absent[0], clip.skeleton.names)}"
        )
    new = {old: name for name, old in names.items()}
    if len(new) < len(names):
        raise SkeletonError("the mapping gives one joint of the clip two names; give it one")
    called = tuple(new.get(name, name) for name in clip.skeleton.names)
    twice = [name for name in called if called.count(name) > 1]
    if twice:
        raise SkeletonError(
            f"with the mapping two joints of the clip are called {twice[0]!r}; map the other away"
        )
    return replace(clip, skeleton=Skeleton(called, clip.skeleton.parents))


def _fold(clip: Clip, kept: Sequence[int]) -> Clip:
    """The clip without the joints that are not kept, on rigid bones."""
    others = [joint for joint in range(len(clip.skeleton)) if joint not in set(kept)]
    if not others and clip.translations_local is None:
        return clip
    pruned = drop_joints(clip, others, moving="mean") if others else clip
    return replace(pruned, translations_local=None)


def _reverse(clip: Clip) -> Clip:
    """The clip backwards in time, without its tracks."""
    return replace(
        clip,
        root_positions=clip.root_positions.flip(0),
        rotations_local=clip.rotations_local.flip(0),
        tracks={},
    )


def _unfold(clip: Clip, kept: Sequence[int], forecast: Clip) -> Poses:
    """A forecast of the kept joints on the whole skeleton; the others keep their last pose."""
    frames, joints = forecast.frames, len(clip.skeleton)
    rotations = clip.rotations_local[-1].expand(frames, joints, 4).clone()
    last = clip.offsets if clip.translations_local is None else clip.translations_local[-1]
    translations = last.expand(frames, joints, 3).clone()
    for place, joint in enumerate(kept):
        above = quaternion.identity(like=rotations)
        for ancestor in clip.skeleton.ancestors(joint):
            if ancestor in kept:
                break
            above = quaternion.product(clip.rotations_local[-1, ancestor], above)
        turned = forecast.rotations_local[:, place].to(rotations)
        rotations[:, joint] = quaternion.product(
            quaternion.conjugate(above).expand_as(turned), turned
        )
    if kept[0] == 0:
        return Poses(rotations, forecast.root_positions.to(clip.root_positions), translations)
    # The first root was folded away: it stays, and the joint below it is where the forecast is.
    parent = clip.skeleton.parents[kept[0]]
    world = forward_kinematics(
        clip.skeleton, clip.rotations_local[-1], last, clip.root_positions[-1]
    )
    from_parent = forecast.root_positions.to(last) - world.positions[parent]
    back = quaternion.conjugate(world.rotations[parent]).expand(frames, 4)
    translations[:, kept[0]] = quaternion.rotate(back, from_parent)
    return Poses(rotations, clip.root_positions[-1].expand(frames, 3), translations)


def _append(clip: Clip, poses: Poses) -> Clip:
    """The clip, then more frames; bones move only if they did before or must now."""
    before = clip.translations_local
    if before is None and not torch.equal(poses.translations_local[-1], clip.offsets):
        before = clip.offsets.expand(clip.frames, -1, -1)
    return replace(
        clip,
        root_positions=torch.cat([clip.root_positions, poses.root_positions]),
        rotations_local=quaternion.unroll(torch.cat([clip.rotations_local, poses.rotations_local])),
        translations_local=(
            None if before is None else torch.cat([before, poses.translations_local])
        ),
        tracks={},
    )
