"""Another body for the same motion: parts of a body by name, their lengths, and who wears them."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import replace

import torch
from jaxtyping import Float
from torch import Tensor

from posecast.config import did_you_mean
from posecast.errors import ConfigError, SkeletonError
from posecast.motion.clip import Clip
from posecast.motion.tracks import LENGTHS
from posecast.skeleton import Skeleton

WHOLE = "all"
"""Instead of a part: every bone."""

_KNEE = re.compile(r"knee|shin|tibia|calf|(?<!up)(?<!upper)(?<!up_)(?<!upper_)leg")
_ELBOW = re.compile(r"elbow|radius|fore_?arm|low(er)?_?arm")

_STANDS = 0.5
"""Share of the way along its bones that a leg at rest must reach down for the body to stand."""


def reproportion(clip: Clip, offsets: Float[Tensor, "joints 3"], *, body: str) -> Clip:
    """Give a clip another body that turns its joints just as before, as character libraries do.

    The place of the first root in the world is scaled about the world's origin, which lies on the
    floor, by how much longer the legs are (``leg_ratio``): longer legs stand higher and step
    farther. Feet on the floor are then near it again, but not fixed to it: for that the rotations
    would have to change. Back on its old body the clip is what it was.

    The tracks ``path``, ``distance``, ``speed``, ``longitudinal``, ``lateral`` and ``height`` are
    scaled alike; ``contacts``, ``phase``, ``facing`` and all others are kept, as are name,
    rotations (the same tensor) and labels. ``source`` is not: the ends of limbs that a file states,
    which no joint marks, are those of the former body.

    Args:
        clip: any with rigid bones.
        offsets: translation of each joint from its parent in the rest pose, metres. Where the
            directions differ from those of the clip's body the rest pose does, and every pose.
        body: what to call the new body, for the label ``body``.

    Raises:
        SkeletonError: another number of joints, an offset that is not finite, or a clip whose
            bones move by themselves.
    """
    skeleton = clip.skeleton
    if clip.translations_local is not None:
        raise SkeletonError(
            f"clip {clip.name!r} has bones that move (translations_local); another body's bones "
            "are rigid: drop its moving joints with moving='mean', or set translations_local=None"
        )
    _check_offsets(skeleton, offsets, f"body {body!r} for clip {clip.name!r}")
    before, after = clip.offsets, offsets.to(clip.offsets)
    ratio = leg_ratio(skeleton, before, after)
    root = skeleton.roots[0]
    places = clip.root_positions
    scaled = (places + before[root].to(places)) * ratio.to(places) - after[root].to(places)
    return replace(
        clip,
        offsets=after,
        root_positions=scaled,
        labels={**clip.labels, "body": body},
        tracks={
            track: values * ratio.to(values) if track in LENGTHS else values
            for track, values in clip.tracks.items()
        },
        source=None,
    )


def leg_ratio(
    skeleton: Skeleton, before: Float[Tensor, "joints 3"], after: Float[Tensor, "joints 3"]
) -> Float[Tensor, ""]:
    """Leg length of one body over that of another.

    Leg length is how far the legs reach below the first root in the rest pose. Some rest poses do
    not stand, such as those with all bones along x: if in one of the two a leg reaches down less
    than half of the way along its bones, it is the length of thigh and shin, left and right
    together. Legs are found by name (``body_parts``); where no joint has such a name, every joint
    below the first root counts, and only bodies that stand can be compared. Where nothing can be
    compared, as for a body without legs or with legs of length zero, the ratio is 1.
    """
    parts = body_parts(skeleton)
    legs = [*parts["legs"], *parts["feet"]]
    tree = [j for j in range(len(skeleton)) if (j, *skeleton.ancestors(j))[-1] == skeleton.roots[0]]
    down_before, stands_before = _reach_down(skeleton, before, legs or tree)
    down_after, stands_after = _reach_down(skeleton, after, legs or tree)
    along_before = before[list(parts["legs"])].norm(dim=-1).sum()
    along_after = after[list(parts["legs"])].norm(dim=-1).sum()
    standing = stands_before & stands_after
    shorter = torch.where(standing, down_before, along_before)
    longer = torch.where(standing, down_after, along_after)
    known = (shorter > 0) & (longer > 0)
    return torch.where(known, longer / torch.where(known, shorter, 1), 1)


def _reach_down(
    skeleton: Skeleton, offsets: Float[Tensor, "joints 3"], joints: list[int]
) -> tuple[Float[Tensor, ""], Tensor]:
    """How far the joints reach below the first root at rest, and whether the body stands so."""
    heights: list[Tensor] = []
    ways: list[Tensor] = []
    for joint, parent in enumerate(skeleton.parents):
        # A root's own offset is where it stands, not a bone.
        rise, length = offsets[joint, 1], offsets[joint].norm()
        heights.append(0 * rise if parent < 0 else heights[parent] + rise)
        ways.append(0 * length if parent < 0 else ways[parent] + length)
    down = -torch.stack(heights)[joints].min()
    return down, (down > 0) & (down >= _STANDS * torch.stack(ways)[joints].max())


def scale_body(
    skeleton: Skeleton, offsets: Float[Tensor, "joints 3"], factors: Mapping[str, float]
) -> Float[Tensor, "joints 3"]:
    """Make bones longer or shorter; their directions, and so the rest pose, stay.

    Args:
        skeleton: whose body it is.
        offsets: translation of each joint from its parent in the rest pose, metres.
        factors: for parts (``body_parts``), for ``"all"`` bones, or for single joints, whose bone
            is the one from the parent; the factors that a bone has are multiplied. Where a root
            stands is no bone and is kept.

    Raises:
        ConfigError: a factor that is not a positive number, or a name that is neither a joint nor
            a part that this skeleton has.
        SkeletonError: another number of joints, or an offset that is not finite.
    """
    _check_offsets(skeleton, offsets, "body to scale")
    bones = [joint for joint, parent in enumerate(skeleton.parents) if parent >= 0]
    groups: dict[str, tuple[int, ...]] = {
        name: (joint,) for joint, name in enumerate(skeleton.names) if joint in bones
    }
    groups |= {part: joints for part, joints in body_parts(skeleton).items() if joints}
    groups[WHOLE] = tuple(bones)
    scale = torch.ones_like(offsets[:, :1])
    for name, factor in factors.items():
        if name not in groups:
            raise ConfigError(
                f"no part and no joint below a root is called {name!r}; "
                f"{did_you_mean(name, groups)}"
            )
        if not 0 < factor < math.inf:
            raise ConfigError(f"factor of {name!r} is {factor}; expected a positive number")
        scale[list(groups[name])] *= factor
    return offsets * scale


def body_parts(skeleton: Skeleton) -> dict[str, tuple[int, ...]]:
    """Joints of each part of the body; the bone that comes from a joint's parent belongs with it.

    Knees and elbows are found by name, each with its twin on the other side; all else follows from
    how joints hang together. A part that is not found is empty, and no joint is in two.

    - ``hips``: from where the legs part to where they begin, so the width of the hips;
    - ``legs``: thigh and shin, which end at the knee and at its children;
    - ``feet``: all below;
    - ``shoulders``, ``arms``, ``hands``: the same of the arms;
    - ``trunk``: from the root to where the arms part;
    - ``head``: neck and all else that hangs from there.
    """
    parts: dict[str, tuple[int, ...]] = {}
    knees, elbows = _highest(skeleton, _KNEE), _highest(skeleton, _ELBOW)
    parts["hips"], parts["legs"], parts["feet"] = _limbs(skeleton, knees)
    parts["shoulders"], parts["arms"], parts["hands"] = _limbs(skeleton, elbows)
    limbs = {joint for joints in parts.values() for joint in joints}
    chest = _fork(skeleton, elbows)
    trunk = sorted((chest, *skeleton.ancestors(chest))) if chest >= 0 else []
    parts["trunk"] = tuple(joint for joint in trunk if skeleton.parents[joint] >= 0)
    parts["head"] = tuple(
        joint
        for joint in range(len(skeleton))
        if chest in skeleton.ancestors(joint) and joint not in limbs
    )
    return parts


def _highest(skeleton: Skeleton, pattern: re.Pattern[str]) -> list[int]:
    """Joints of both sides with such a name, without those below another one."""
    sided = {joint for pair in skeleton.left_right_pairs for joint in pair}
    named = {joint for joint in sided if pattern.search(skeleton.names[joint].lower())}
    return sorted(joint for joint in named if not named & set(skeleton.ancestors(joint)))


def _limbs(skeleton: Skeleton, middle: list[int]) -> tuple[tuple[int, ...], ...]:
    """Joints above, in and below the two long bones of limbs, given their knees or elbows."""
    fork = _fork(skeleton, middle)
    above, long, below = set[int](), set[int](), set[int]()
    for joint in range(len(skeleton)):
        ancestors = skeleton.ancestors(joint)
        if joint in middle:
            long.add(joint)
            above |= {a for a in ancestors if fork in skeleton.ancestors(a)}
        elif set(middle) & set(ancestors):
            (long if skeleton.parents[joint] in middle else below).add(joint)
    return tuple(sorted(above)), tuple(sorted(long)), tuple(sorted(below))


def _fork(skeleton: Skeleton, joints: list[int]) -> int:
    """The lowest joint above all of these; -1 if there is none."""
    shared = [set(skeleton.ancestors(joint)) for joint in joints]
    return max(set.intersection(*shared), default=-1) if shared else -1


def _check_offsets(skeleton: Skeleton, offsets: Float[Tensor, "*any"], what: str) -> None:
    if offsets.shape != (len(skeleton), 3):
        raise SkeletonError(
            f"{what}: offsets {tuple(offsets.shape)}, expected ({len(skeleton)}, 3), one for each "
            "joint of the skeleton"
        )
    wrong = (~torch.isfinite(offsets)).any(-1).nonzero().flatten().tolist()
    if wrong:
        raise SkeletonError(
            f"{what}: the offset of joint {skeleton.names[wrong[0]]!r} is not finite: "
            f"{offsets[wrong[0]].tolist()}; mend it first"
        )
