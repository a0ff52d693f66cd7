"""The legs of a skeleton: which joints are hips, knees, ankles and toes, left and right."""

from __future__ import annotations

import re
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from posecast.errors import SkeletonError
from posecast.geometry import quaternion
from posecast.skeleton import Skeleton
from posecast.skeleton.kinematics import joint_positions

_ANKLE = re.compile(r"ankle|foot|talus")
_TOE = re.compile(r"toe|ball")

_LEG = 0.25
"""Least length of a leg against the height of the body, where only geometry speaks."""

_STANDS = 0.5
"""Share of the way along its bones that a leg must reach down where only geometry speaks."""

_LEVEL = 0.25
"""Most that one foot may be above the other, in lengths of the leg, where only geometry speaks."""

_POINTS = 0.05
"""Least that toes and bent knees point ahead, in widths of the hips, to tell left from right."""


class Feet(NamedTuple):
    """Joints of both legs, each (left, right), as indices of the skeleton.

    Args:
        hips: where the thighs begin.
        knees: where the shins begin; the hips where a leg is a single bone.
        ankles: where the shins end.
        toes: where the toes begin, the ball of the foot; the ankles where a foot has no joint.
    """

    hips: tuple[int, int]
    knees: tuple[int, int]
    ankles: tuple[int, int]
    toes: tuple[int, int]


class _Leg(NamedTuple):
    """Joints of one leg."""

    hip: int
    knee: int
    ankle: int
    toe: int


def find_feet(
    skeleton: Skeleton,
    offsets: Float[Tensor, "joints 3"],
    poses: Float[Tensor, "poses joints 3"] | None = None,
) -> Feet:
    """Find legs and feet by name or, where names say nothing, by how the body stands.

    Names: a joint called ankle, foot or talus with its twin on the other side, and toes or ball
    below, whatever stands around the word (``mixamorig:LeftFoot``, ``Foot_L``, ``lfoot``,
    ``l_ankle``, ``Bip01 L Foot``). Of several such pairs (``ik_foot_l``) the one on the longest
    legs. Hip and knee are where the two longest bones above the ankle begin.

    Geometry: the two lowest ends of chains that part high enough to be legs; the two longest bones
    of each are thigh and shin, the last joint is the toes. The left one is on the left of where
    toes and bent knees point; towards +x where they point nowhere, as in a straight rest pose
    facing +z.

    Args:
        offsets: translation of each joint from its parent in the rest pose, metres.
        poses: world positions, metres, of one or more poses on the feet, for bodies that do not
            stand in their rest pose. ``None``: the rest pose. Names come first all the same.

    Raises:
        SkeletonError: neither names nor geometry show two feet.
    """
    found = _by_name(skeleton, offsets)
    if found is None:
        standing = _rest(skeleton, offsets)[None] if poses is None else poses
        found = _by_geometry(skeleton, offsets, standing)
    if found is None:
        raise SkeletonError(
            "no feet found: looked for joints called ankle, foot or talus on both sides (LeftFoot "
            "and RightFoot, Foot_L and Foot_R, l_ankle and r_ankle) and for the two lowest ends of "
            f"legs in a pose that stands; this skeleton has {', '.join(skeleton.names)}; rename "
            "its feet"
        )
    return found


def leg_length(skeleton: Skeleton, offsets: Float[Tensor, "joints 3"], feet: Feet) -> float:
    """Way along the bones from hip to ankle, mean of left and right, metres.

    Args:
        offsets: translation of each joint from its parent in the rest pose, metres; some may be
            zero.

    Raises:
        SkeletonError: the legs have no length.
    """
    bones = [
        joint
        for hip, ankle in zip(feet.hips, feet.ankles, strict=True)
        for joint in (ankle, *skeleton.ancestors(ankle))
        if hip in skeleton.ancestors(joint)
    ]
    length = float(offsets[bones].double().norm(dim=-1).sum()) / 2
    if not length > 0:
        hip, ankle = skeleton.names[feet.hips[0]], skeleton.names[feet.ankles[0]]
        raise SkeletonError(
            f"the bones from {hip!r} to {ankle!r} have length {length} m; expected a leg: give the "
            "offsets of a body"
        )
    return length


def _by_name(skeleton: Skeleton, offsets: Tensor) -> Feet | None:
    ankles = _highest_pairs(skeleton, _ANKLE)
    chains = [
        (_chain(skeleton, left, right), _chain(skeleton, right, left)) for left, right in ankles
    ]
    chains = [pair for pair in chains if min(map(len, pair)) > 1]
    if not chains:
        return None
    left, right = max(chains, key=lambda pair: _way(offsets, pair[0]))
    toes = _toes(skeleton, left[-1], right[-1])
    return _feet(
        _leg(offsets, left)._replace(ankle=left[-1], toe=toes[0]),
        _leg(offsets, right)._replace(ankle=right[-1], toe=toes[1]),
    )


def _highest_pairs(skeleton: Skeleton, pattern: re.Pattern[str]) -> list[tuple[int, int]]:
    """(left, right) joints with such a name, without those below others."""
    pairs = [
        pair
        for pair in skeleton.left_right_pairs
        if pattern.search(skeleton.names[pair[0]].lower())
    ]
    lefts = {left for left, _ in pairs}
    return [pair for pair in pairs if not lefts & set(skeleton.ancestors(pair[0]))]


def _toes(skeleton: Skeleton, left: int, right: int) -> tuple[int, int]:
    """First toes below the ankles, else another foot below them (SMPL), else the ankles."""
    for pattern in (_TOE, _ANKLE):
        for pair in skeleton.left_right_pairs:
            below = left in skeleton.ancestors(pair[0]) and right in skeleton.ancestors(pair[1])
            if below and pattern.search(skeleton.names[pair[0]].lower()):
                return pair
    return left, right


def _chain(skeleton: Skeleton, end: int, other: int) -> tuple[int, ...]:
    """Joints from below where two chains part down to the end of one of them."""
    shared = set(skeleton.ancestors(other))
    chain = [end, *(joint for joint in skeleton.ancestors(end) if joint not in shared)]
    return tuple(reversed(chain))


def _way(offsets: Tensor, chain: tuple[int, ...]) -> float:
    """Along the bones of a chain from its first joint, metres."""
    return float(offsets[list(chain[1:])].double().norm(dim=-1).sum())


def _leg(offsets: Tensor, chain: tuple[int, ...]) -> _Leg:
    """Hip, knee and ankle by the two longest bones of a chain; its last joint is the toe.

    Of a single bone the upper end is hip and knee.
    """
    bones = range(1, len(chain))
    longest = sorted(bones, key=lambda place: -float(offsets[chain[place]].norm()))[:2]
    thigh, shin = min(longest), max(longest)
    return _Leg(chain[thigh - 1], chain[shin - 1], chain[shin], chain[-1])


def _feet(left: _Leg, right: _Leg) -> Feet:
    return Feet(
        (left.hip, right.hip),
        (left.knee, right.knee),
        (left.ankle, right.ankle),
        (left.toe, right.toe),
    )


def _rest(skeleton: Skeleton, offsets: Tensor) -> Float[Tensor, "joints 3"]:
    """Positions in the rest pose, the first root at the origin, metres."""
    still = quaternion.identity(len(skeleton), like=offsets)
    return joint_positions(skeleton, still, offsets)


def _by_geometry(
    skeleton: Skeleton, offsets: Tensor, poses: Float[Tensor, "poses joints 3"]
) -> Feet | None:
    chains = _lowest_chains(skeleton, offsets, poses[..., 1].double().mean(0))
    if chains is None:
        return None
    one, other = (_leg(offsets, chain) for chain in chains)
    side = _side(poses.double(), one, other)
    if side == 0:
        return None
    return _feet(one, other) if side > 0 else _feet(other, one)


def _lowest_chains(
    skeleton: Skeleton, offsets: Tensor, height: Float[Tensor, "joints"]
) -> tuple[tuple[int, ...], tuple[int, ...]] | None:
    """Two chains that end lowest, if a body can stand on them.

    Args:
        height: of each joint, metres.
    """
    ends = [joint for joint, below in enumerate(skeleton.children) if not below]
    ends = sorted(ends, key=lambda joint: float(height[joint]))
    extent = float(height.max() - height.min())
    for other in ends[1:]:
        chains = _chain(skeleton, ends[0], other), _chain(skeleton, other, ends[0])
        ways = [_way(offsets, chain) for chain in chains]
        if min(map(len, chains)) < 3 or min(ways) < _LEG * extent:
            continue  # two toes of one foot, or a tail
        drops = [float(height[chain[0]] - height[chain[-1]]) for chain in chains]
        stands = all(drop >= _STANDS * way for drop, way in zip(drops, ways, strict=True))
        level = float(height[other] - height[ends[0]]) <= _LEVEL * min(ways)
        return chains if stands and level else None
    return None


def _side(poses: Float[Tensor, "poses joints 3"], one: _Leg, other: _Leg) -> float:
    """Positive if the leg ``one`` is the left one, negative if the right one, 0 if unknown."""
    ahead = torch.zeros_like(poses[:, 0])
    for leg in (one, other):
        ahead = ahead + poses[:, leg.toe] - poses[:, leg.ankle]
        ahead = ahead + poses[:, leg.knee] - (poses[:, leg.hip] + poses[:, leg.ankle]) / 2
    across = poses[:, one.hip] - poses[:, other.hip]
    if float(ahead[:, [0, 2]].norm(dim=-1).mean()) < _POINTS * float(across.norm(dim=-1).mean()):
        return float(across[:, 0].mean())
    # The left of (x, z) is (z, -x).
    return float((across[:, 0] * ahead[:, 2] - across[:, 2] * ahead[:, 0]).mean())
