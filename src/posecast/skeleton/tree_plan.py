"""Index tables that let kinematics treat a whole level of the tree in one operation."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import torch
from torch import Tensor

from posecast.skeleton.skeleton import Skeleton


class Run(NamedTuple):
    """Neighboring joints whose parents, all different, are neighbors in the same order."""

    joints: slice
    parents: slice


class Level(NamedTuple):
    """Joints that can be treated at once, when those before them in the order are done.

    Args:
        joints: where they are in the order.
        parents: the place of each one's parent.
        runs: the same, as few slices as possible; to add along a slice beats to gather.
    """

    joints: slice
    parents: Tensor
    runs: tuple[Run, ...]


class TreePlan(NamedTuple):
    """What the kinematics of one skeleton need to know about its tree, on one device.

    Joints are put in the *order of work*: roots, then the other joints that have children, by
    depth, then all *ends* (joints with a parent and no child). The rotation of an end moves
    nothing; what comes before the ends is called *turned*.

    Args:
        order: the joint at each place of the order of work.
        places: the place of each joint in it.
        parents: for each joint but the roots, in that order, the place of its parent.
        roots: the number of joints without a parent.
        turned: the number of joints before the ends.
        levels: the turned joints but the roots, by depth.
        ends: the ends, whatever their depth.
        spread: the place of each joint among the turned; ``turned``, one too far, for an end.
    """

    order: Tensor
    places: Tensor
    parents: Tensor
    roots: int
    turned: int
    levels: tuple[Level, ...]
    ends: Level
    spread: Tensor


@lru_cache(maxsize=64)
def tree_plan(skeleton: Skeleton, device: torch.device) -> TreePlan:
    """Make the plan of a skeleton, once for each device."""
    with torch.inference_mode(False):  # what is kept must serve training, too
        return _make_plan(skeleton, device)


def _make_plan(skeleton: Skeleton, device: torch.device) -> TreePlan:
    """All tables of one skeleton."""

    def indices(values: list[int]) -> Tensor:
        return torch.tensor(values, dtype=torch.long, device=device)

    groups, ends = _groups(skeleton)
    roots, *below = groups
    order = [joint for group in (*groups, ends) for joint in group]
    place = {joint: position for position, joint in enumerate(order)}

    def level(joints: list[int]) -> Level:
        start = place[joints[0]] if joints else len(order)
        parents = [place[skeleton.parents[joint]] for joint in joints]
        return Level(slice(start, start + len(joints)), indices(parents), _runs(start, parents))

    turned = len(order) - len(ends)
    return TreePlan(
        order=indices(order),
        places=indices([place[joint] for joint in range(len(skeleton))]),
        parents=indices([place[skeleton.parents[joint]] for joint in order[len(roots) :]]),
        roots=len(roots),
        turned=turned,
        levels=tuple(level(joints) for joints in below),
        ends=level(ends),
        spread=indices([min(place[joint], turned) for joint in range(len(skeleton))]),
    )


def _groups(skeleton: Skeleton) -> tuple[list[list[int]], list[int]]:
    """The turned joints by depth, and the ends; children in the order of their parents."""
    children, depths, ends = skeleton.children, [list(skeleton.roots)], list[int]()
    while below := [child for joint in depths[-1] for child in children[joint]]:
        ends += [joint for joint in below if not children[joint]]
        depths.append([joint for joint in below if children[joint]])
    return [depths[0], *(depth for depth in depths[1:] if depth)], ends


def _runs(start: int, parents: list[int]) -> tuple[Run, ...]:
    """Runs of the joints from place ``start`` on, whose parents are given."""
    runs: list[Run] = []
    for joint, parent in enumerate(parents, start):
        if runs and runs[-1].parents.stop == parent:
            first = runs.pop()
            runs.append(
                Run(slice(first.joints.start, joint + 1), slice(first.parents.start, parent + 1))
            )
        else:
            runs.append(Run(slice(joint, joint + 1), slice(parent, parent + 1)))
    return tuple(runs)
