"""Index tables that let kinematics treat a whole level of the tree in one operation."""

from __future__ import annotations

from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

import torch
from torch import Tensor

from posecast.skeleton.skeleton import Skeleton


class Level(NamedTuple):
    """The joints of one depth, below the roots, as runs of the plan's order.

    Args:
        joints: the run of these joints.
        upper: the run of the level above.
        places: for each joint the place of its parent within the level above.
        rows: rows of the parents in a (4 J, poses) table of all joints in level order.
    """

    joints: slice
    upper: slice
    places: Tensor
    rows: Tensor


class InnerLevel(NamedTuple):
    """One depth of the inner joints (those with children), as a run among the inner joints.

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

    Joints are put in *level order*: roots first, then each next depth, children in the order of
    their parents. Of them K are *inner* joints, which have children: only their world rotations
    move anything. Rows refer to tables with one row for each joint and component and one column
    for each pose: ``4 * joint + component`` where all J joints are in the skeleton's own order,
    ``component * J + place`` where they are in level order, ``component * K + place`` for inner
    joints alone.

    Args:
        order: the joint at each place of the level order.
        places: the place of each joint in it.
        order_rows: for each row in level order its row in the skeleton's own.
        own_rows: for each row in the skeleton's own order its row in level order.
        roots: the number of joints without a parent.
        levels: the other joints by depth.
        above: for each joint but the roots, in level order, the place of its parent.
        above_rows: rows, in level order, of those parents.
        inner: places of the inner joints in the level order.
        inner_levels: inner joints by depth.
        inner_rows: rows of the inner joints among all joints.
        inner_above_rows: rows, among inner joints, of the parents of inner joints but the roots.
        hanging_above_rows: rows, among inner joints, of the parents of all joints but the roots.
        spread_rows: for each row among all joints its row among inner joints; ``4 * K``, one
            past the end, for joints without children.
    """

    order: Tensor
    places: Tensor
    order_rows: Tensor
    own_rows: Tensor
    roots: int
    levels: tuple[Level, ...]
    above: Tensor
    above_rows: Tensor
    inner: Tensor
    inner_levels: tuple[InnerLevel, ...]
    inner_rows: Tensor
    inner_above_rows: Tensor
    hanging_above_rows: Tensor
    spread_rows: Tensor


@lru_cache(maxsize=64)
def tree_plan(skeleton: Skeleton, device: torch.device) -> TreePlan:
    """Make the plan of a skeleton, once for each device."""
    with torch.inference_mode(False):  # what is kept must serve training, too
        return _make_plan(skeleton, device)


def _make_plan(skeleton: Skeleton, device: torch.device) -> TreePlan:
    """All tables of one skeleton."""

    def indices(values: list[int]) -> Tensor:
        return torch.tensor(values, dtype=torch.long, device=device)

    parents, joints = skeleton.parents, range(len(skeleton))
    groups = _level_order(skeleton)
    order = [joint for group in groups for joint in group]
    place = {joint: position for position, joint in enumerate(order)}
    inner = [joint for joint in order if skeleton.children[joint]]
    inner_place = {joint: position for position, joint in enumerate(inner)}
    hanging = order[len(groups[0]) :]

    def rows(places: list[int], among: int) -> Tensor:
        return indices([component * among + at for component in range(4) for at in places])

    def inner_rows(joints: list[int]) -> Tensor:
        return rows([inner_place[joint] for joint in joints], len(inner))

    levels = []
    for upper, group in pairwise(groups):
        first, last = place[group[0]], place[group[-1]]
        levels.append(
            Level(
                joints=slice(first, last + 1),
                upper=slice(place[upper[0]], place[upper[-1]] + 1),
                places=indices([upper.index(parents[joint]) for joint in group]),
                rows=rows([place[parents[joint]] for joint in group], len(order)),
            )
        )
    return TreePlan(
        order=indices(order),
        places=indices([place[joint] for joint in joints]),
        order_rows=indices([4 * joint + component for component in range(4) for joint in order]),
        own_rows=indices(
            [component * len(order) + place[joint] for joint in joints for component in range(4)]
        ),
        roots=len(groups[0]),
        levels=tuple(levels),
        above=indices([place[parents[joint]] for joint in hanging]),
        above_rows=rows([place[parents[joint]] for joint in hanging], len(order)),
        inner=indices([place[joint] for joint in inner]),
        inner_levels=_inner_levels(skeleton, groups, inner_place, device),
        inner_rows=indices([4 * joint + component for component in range(4) for joint in inner]),
        inner_above_rows=inner_rows([parents[joint] for joint in hanging if joint in inner_place]),
        hanging_above_rows=inner_rows([parents[joint] for joint in hanging]),
        spread_rows=indices(
            [
                component * len(inner) + inner_place[joint]
                if joint in inner_place
                else 4 * len(inner)
                for joint in joints
                for component in range(4)
            ]
        ),
    )


def _level_order(skeleton: Skeleton) -> list[list[int]]:
    """Joints by depth, children side by side in the order of their parents."""
    groups = [list(skeleton.roots)]
    while below := [child for joint in groups[-1] for child in skeleton.children[joint]]:
        groups.append(below)
    return groups


def _inner_levels(
    skeleton: Skeleton, groups: list[list[int]], place: dict[int, int], device: torch.device
) -> tuple[InnerLevel, ...]:
    """Runs of inner joints; parents are read in place where they are a run themselves."""
    found: list[InnerLevel] = []
    for group in groups:
        joints = [joint for joint in group if joint in place]
        if not joints:
            break
        start = place[joints[0]]
        above: slice | Tensor | None = None
        if found:
            parents = [place[skeleton.parents[joint]] for joint in joints]
            if parents == list(range(parents[0], parents[0] + len(parents))):
                above = slice(parents[0], parents[-1] + 1)
            else:
                rows = [component * len(place) + row for component in range(4) for row in parents]
                above = torch.tensor(rows, dtype=torch.long, device=device)
        found.append(InnerLevel(start, start + len(joints), above))
    return tuple(found)
