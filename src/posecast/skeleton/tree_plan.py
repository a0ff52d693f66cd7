"""Index tables that let kinematics treat a whole level of the tree in one operation."""

from __future__ import annotations

from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

import torch
from torch import Tensor

from posecast.skeleton.skeleton import Skeleton


class Level(NamedTuple):
    """The joints of one depth, below the roots.

    Args:
        joints: their indices.
        parents: the index of the parent of each.
        places: the place of the parent of each among the joints of the level above.
    """

    joints: Tensor
    parents: Tensor
    places: Tensor


class InnerLevel(NamedTuple):
    """One depth of the joints that have children, in ``TreePlan.inner`` order.

    Args:
        start: place of the first.
        stop: place after the last.
        above: where their parents are: a run of places, rows of a (4 K, poses) table of
            quaternion planes, or ``None`` for roots.
    """

    start: int
    stop: int
    above: slice | Tensor | None


class TreePlan(NamedTuple):
    """What the kinematics of one skeleton need to know about its tree, on one device.

    ``inner`` are the K joints with children, level by level: only their world rotations move
    anything. ``hanging`` are the joints with a parent. Rows refer to tables with one row for
    each joint and component and one column for each pose: ``4 * joint + component`` in tables
    of all joints, ``component * K + place`` in those of inner joints.

    Args:
        roots: indices of the joints without a parent.
        hanging: indices of the joints with one.
        hanging_parents: indices of the parents of those.
        levels: hanging joints by depth.
        inner: indices of the joints with children, by depth.
        inner_levels: the same as ranges, with the way to their parents.
        inner_rows: rows of the inner joints in a table of all joints.
        inner_above_rows: rows, among inner joints, of the parents of inner joints with a parent.
        hanging_above_rows: rows, among inner joints, of the parents of hanging joints.
        spread_rows: for each row of a table of all joints its row among inner joints; ``4 * K``,
            one past the end, for joints without children.
        by_level: position of each joint in the sequence of roots, then levels.
    """

    roots: Tensor
    hanging: Tensor
    hanging_parents: Tensor
    levels: tuple[Level, ...]
    inner: Tensor
    inner_levels: tuple[InnerLevel, ...]
    inner_rows: Tensor
    inner_above_rows: Tensor
    hanging_above_rows: Tensor
    spread_rows: Tensor
    by_level: Tensor


@lru_cache(maxsize=64)
def tree_plan(skeleton: Skeleton, device: torch.device) -> TreePlan:
    """Make the plan of a skeleton, once for each device."""

    def indices(values: list[int]) -> Tensor:
        return torch.tensor(values, dtype=torch.long, device=device)

    parents = skeleton.parents
    joints = range(len(skeleton))
    hanging = [joint for joint in joints if parents[joint] >= 0]
    groups = _inner_groups(skeleton)
    inner = [joint for group in groups for joint in group]
    place = {joint: position for position, joint in enumerate(inner)}
    count = len(inner)

    def rows(places: list[int]) -> list[int]:
        return [component * count + position for component in range(4) for position in places]

    inner_levels = []
    for depth, group in enumerate(groups):
        start = place[group[0]]
        above: slice | Tensor | None = None
        if depth:
            places = [place[parents[joint]] for joint in group]
            run = range(places[0], places[0] + len(places))
            above = slice(run.start, run.stop) if places == list(run) else indices(rows(places))
        inner_levels.append(InnerLevel(start, start + len(group), above))
    sequence = [joint for level in skeleton.levels for joint in level]
    return TreePlan(
        roots=indices(list(skeleton.roots)),
        hanging=indices(hanging),
        hanging_parents=indices([parents[joint] for joint in hanging]),
        levels=tuple(
            Level(
                joints=indices(list(level)),
                parents=indices([parents[joint] for joint in level]),
                places=indices([above.index(parents[joint]) for joint in level]),
            )
            for above, level in pairwise(skeleton.levels)
        ),
        inner=indices(inner),
        inner_levels=tuple(inner_levels),
        inner_rows=indices([4 * joint + component for component in range(4) for joint in inner]),
        inner_above_rows=indices(
            rows([place[parents[joint]] for joint in inner if parents[joint] >= 0])
        ),
        hanging_above_rows=indices(rows([place[parents[joint]] for joint in hanging])),
        spread_rows=indices(
            [
                component * count + place[joint] if joint in place else 4 * count
                for joint in joints
                for component in range(4)
            ]
        ),
        by_level=indices([sequence.index(joint) for joint in joints]),
    )


def _inner_groups(skeleton: Skeleton) -> list[list[int]]:
    """Joints with children, by depth, those of one parent side by side, in the parents' order."""
    groups: list[list[int]] = []
    group = [root for root in skeleton.roots if skeleton.children[root]]
    while group:
        groups.append(group)
        group = [
            child
            for joint in group
            for child in skeleton.children[joint]
            if skeleton.children[child]
        ]
    return groups
