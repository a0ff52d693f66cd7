"""What a BVH file says, word for word: joints, channels and numbers, before any convention."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

AXES = "xyz"
GREATEST = 2**53 / 1_000_000
"""File units and degrees up to which six decimals are exact in float64."""


@dataclass(frozen=True)
class BvhEnd:
    """An End Site: where the last bone of a chain stops.

    Args:
        name: what follows the word ``End``, usually ``Site``.
        offset: three numbers as written, in the file's unit.
    """

    name: str
    offset: tuple[str, str, str]


@dataclass(frozen=True)
class BvhJoint:
    """One ROOT or JOINT.

    Args:
        name: as written; neither unique nor free of spaces.
        parent: place of the parent among the joints, -1 for a ROOT.
        offset: three numbers as written, in the file's unit.
        channels: as written (``Xposition``, ``Zrotation``), in the order of the columns.
        ends: its End Sites.
    """

    name: str
    parent: int
    offset: tuple[str, str, str]
    channels: tuple[str, ...] = ()
    ends: tuple[BvhEnd, ...] = ()

    @property
    def position_axes(self) -> str:
        """Axes of the position channels in their order: ``"xyz"``; empty if there are none."""
        return "".join(name[0].lower() for name in self.channels if is_position(name))

    @property
    def rotation_axes(self) -> str:
        """Axes of the rotation channels in their order: ``"zyx"`` means R = Rz Ry Rx."""
        return "".join(name[0].lower() for name in self.channels if not is_position(name))

    @property
    def rotation_places(self) -> tuple[int, ...]:
        """Places of the rotation channels among all channels of the joint."""
        return tuple(place for place, name in enumerate(self.channels) if not is_position(name))


@dataclass(frozen=True, eq=False)
class BvhDocument:
    """A whole file: hierarchy, and one row of numbers a frame, as they stand there.

    Args:
        joints: parents before children, in the order of the text.
        frame_time: seconds, as written.
        values: (frames, channels): degrees and file units, windings kept.
        encoding: of the text, a Python codec name.
        newline: how lines end.
        notes: what a reader should know: each is true of this file.
    """

    joints: tuple[BvhJoint, ...]
    frame_time: str
    values: NDArray[np.float64]
    encoding: str = "utf-8"
    newline: str = "\n"
    notes: tuple[str, ...] = ()


def depth_first(document: BvhDocument) -> BvhDocument:
    """The same document with joints, and their columns, in the order in which text names them.

    A joint stands inside its parent there, so all that is below a joint comes before its next
    sibling. Children stay in their order; a document that was read is in this order already.
    """
    children: list[list[int]] = [[] for _ in document.joints]
    todo: list[int] = []
    for place, joint in enumerate(document.joints):
        (todo if joint.parent < 0 else children[joint.parent]).append(place)
    todo.reverse()
    order: list[int] = []
    while todo:
        order.append(place := todo.pop())
        todo.extend(reversed(children[place]))
    if order == list(range(len(order))):
        return document
    new = {old: place for place, old in enumerate(order)}
    joints = [document.joints[old] for old in order]
    starts = first_columns(document.joints)
    columns = [column for old in order for column in range(starts[old], starts[old + 1])]
    return replace(
        document,
        joints=tuple(
            joint if joint.parent < 0 else replace(joint, parent=new[joint.parent])
            for joint in joints
        ),
        values=document.values[:, columns],
    )


def first_columns(joints: tuple[BvhJoint, ...]) -> tuple[int, ...]:
    """First column of each joint, and at the end the number of columns."""
    columns = [0]
    for joint in joints:
        columns.append(columns[-1] + len(joint.channels))
    return tuple(columns)


def is_channel(word: str) -> bool:
    """Whether a word names a channel, in any case: ``Xposition``, ``zRotation``."""
    lower = word.lower()
    return lower[:1] in tuple(AXES) and lower[1:] in ("position", "rotation")


def is_position(channel: str) -> bool:
    """Whether a channel is a translation."""
    return channel[1:].lower() == "position"
