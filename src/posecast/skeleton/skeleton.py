"""Topology of a skeleton: names and parents of a forest of joints."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

from posecast.errors import SkeletonError


@dataclass(frozen=True)
class Skeleton:
    """A forest of joints, parents before children.

    Topology only: offsets differ from actor to actor and travel with the clip.

    Args:
        names: one unique name a joint.
        parents: index of each joint's parent; -1 marks a root. Several roots are allowed.
    """

    names: tuple[str, ...]
    parents: tuple[int, ...]

    def __post_init__(self) -> None:
        if len(self.names) != len(self.parents):
            raise SkeletonError(
                f"{len(self.names)} joint names but {len(self.parents)} parents; "
                "give one parent for each joint (-1 marks a root)"
            )
        if not self.names:
            raise SkeletonError("a skeleton needs at least one joint; found none")
        for joint, parent in enumerate(self.parents):
            if not -1 <= parent < joint:
                raise SkeletonError(
                    f"joint {self.names[joint]!r} (index {joint}) has parent {parent}; "
                    "a parent must come before its children (-1 marks a root)"
                )
        if len(set(self.names)) != len(self.names):
            twice = sorted({name for name in self.names if self.names.count(name) > 1})
            raise SkeletonError(f"joint names must be unique; found more than once: {twice}")

    def __len__(self) -> int:
        return len(self.names)

    @cached_property
    def roots(self) -> tuple[int, ...]:
        """Indices of the joints without a parent."""
        return tuple(joint for joint, parent in enumerate(self.parents) if parent == -1)

    @cached_property
    def children(self) -> tuple[tuple[int, ...], ...]:
        """For each joint the indices of its children."""
        found: list[list[int]] = [[] for _ in self.parents]
        for joint, parent in enumerate(self.parents):
            if parent >= 0:
                found[parent].append(joint)
        return tuple(tuple(joints) for joints in found)

    @cached_property
    def depths(self) -> tuple[int, ...]:
        """Number of joints above each joint; a root has depth 0."""
        depths: list[int] = []
        for parent in self.parents:
            depths.append(0 if parent == -1 else depths[parent] + 1)
        return tuple(depths)

    @cached_property
    def levels(self) -> tuple[tuple[int, ...], ...]:
        """Joints grouped by depth, roots first."""
        return tuple(
            tuple(joint for joint, depth in enumerate(self.depths) if depth == level)
            for level in range(max(self.depths) + 1)
        )

    def ancestors(self, joint: int) -> tuple[int, ...]:
        """Indices above ``joint``: its parent first, then upwards to the root."""
        chain: list[int] = []
        while (joint := self.parents[joint]) != -1:
            chain.append(joint)
        return tuple(chain)

    def index(self, name: str) -> int:
        """Index of a joint by name.

        Raises:
            SkeletonError: there is no such joint; the message lists the names.
        """
        try:
            return self.names.index(name)
        except ValueError:
            raise SkeletonError(
                f"no joint is called {name!r}; this skeleton has {', '.join(self.names)}"
            ) from None

    def select(self, joints: Sequence[int]) -> Skeleton:
        """The sub-forest of ``joints`` (sorted by index).

        A joint whose parent is left out hangs from its nearest ancestor that stays, or becomes a
        root. Topology only: ``motion.transforms.drop_joints`` folds rotations and offsets too.

        Raises:
            SkeletonError: no joint is chosen, or one that does not exist.
        """
        kept = sorted(set(joints))
        if kept and not 0 <= kept[0] <= kept[-1] < len(self):
            raise SkeletonError(
                f"joints {kept[0]} to {kept[-1]} asked for; this skeleton has 0 to {len(self) - 1}"
            )
        position = {joint: place for place, joint in enumerate(kept)}
        parents = [
            next((position[above] for above in self.ancestors(joint) if above in position), -1)
            for joint in kept
        ]
        return Skeleton(tuple(self.names[joint] for joint in kept), tuple(parents))

    @cached_property
    def left_right_pairs(self) -> tuple[tuple[int, int], ...]:
        """(left, right) joint pairs by name: ``LeftFoot``/``RightFoot``, ``lhip``/``rhip``.

        A joint is on the left only if its right-hand twin exists, so that the ``l`` of
        ``lowerback`` does not make a side.
        """
        by_name = {name: joint for joint, name in enumerate(self.names)}
        pairs: list[tuple[int, int]] = []
        for joint, name in enumerate(self.names):
            twin = next((twin for twin in _right_names(name) if twin in by_name), None)
            if twin is not None:
                pairs.append((joint, by_name[twin]))
        return tuple(pairs)

    @cached_property
    def mirror_permutation(self) -> tuple[int, ...]:
        """For each joint the joint on the other side (itself on the middle line)."""
        swapped = list(range(len(self)))
        for left, right in self.left_right_pairs:
            swapped[left], swapped[right] = right, left
        return tuple(swapped)


_LEFT_MARKERS: tuple[tuple[re.Pattern[str], str], ...] = (
    (re.compile(r"Left"), "Right"),  # LeftFoot, Character1_LeftArm
    (re.compile(r"LEFT"), "RIGHT"),
    (re.compile(r"(?<![a-z])left"), "right"),  # leftEye, hand_left; not cleft
    (re.compile(r"(?<![A-Za-z])L(?=[A-Z])"), "R"),  # LHipJoint
    (re.compile(r"(?<![A-Za-z])l(?=[A-Za-z])"), "r"),  # lfemur, lCollar
    (re.compile(r"(?<![A-Za-z])L(?![A-Za-z])"), "R"),  # Shoulder_L, L_Wrist_End, Bip01 L Hand
    (re.compile(r"(?<![A-Za-z])l(?![A-Za-z])"), "r"),  # hand.l, l_hip
    (re.compile(r"(?<=[a-z0-9])L(?![a-z])"), "R"),  # handL
)


def _right_names(name: str) -> list[str]:
    """Every way of spelling ``name`` with its left-hand markers turned into right-hand ones.

    All markers of a kind first (``LeftHand_LeftThumb``), then the first of them alone.
    """
    found: list[str] = []
    for marker, right in _LEFT_MARKERS:
        if marker.search(name):
            found += [marker.sub(right, name), marker.sub(right, name, count=1)]
    return found
