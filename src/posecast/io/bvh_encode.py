"""From a clip to the numbers of a BVH document, in the conventions of the file it came from."""

from __future__ import annotations

from dataclasses import dataclass, replace
from os import PathLike
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float
from numpy.typing import NDArray

from posecast.errors import DataError
from posecast.io.bvh_channels import MICRO, complete_axes, quaternion_to_channels
from posecast.io.bvh_decode import STILL
from posecast.io.bvh_document import (
    AXES,
    GREATEST,
    BvhDocument,
    BvhEnd,
    BvhJoint,
    depth_first,
    first_columns,
    is_position,
)
from posecast.io.bvh_held import NOTHING_HELD, Held, held_angles
from posecast.io.bvh_layout import (
    UNITS,
    BvhLayout,
    turn_rotations_back,
    turn_vectors_back,
    writable_name,
)
from posecast.motion.clip import Clip

_DEFAULT_ORDER = "zyx"
_CHUNK = 2**14


class Encoded(NamedTuple):
    """What is to be written.

    Args:
        document: its values are whole millionths (micro-degrees, millionths of the file unit).
        notes: what could not be written as in the source.
    """

    document: BvhDocument
    notes: tuple[str, ...]


@dataclass
class _Column:
    """A joint being written.

    Args:
        joint: how it stands in the hierarchy; gets channels that it turns out to need.
        translation: (frames, 3) from the parent, or (1, 3) if constant; file units and axes.
        held: angles of the source.
        angles: (frames, turns) micro-degrees.
    """

    joint: BvhJoint
    translation: NDArray[np.float64]
    held: Held = NOTHING_HELD
    angles: NDArray[np.float64] | None = None


def encode(clip: Clip, path: str | PathLike[str]) -> Encoded:
    """Bring a clip into the conventions of ``clip.source``, or into the default ones.

    Raises:
        DataError: a number is not finite or too large for six decimals.
    """
    layout = clip.source if isinstance(clip.source, BvhLayout) else _DEFAULT
    notes: list[str] = []
    rotations = turn_rotations_back(clip.rotations_local.double().cpu(), layout.up)
    columns = _columns(clip, layout, path)
    places = [column.joint.rotation_places for column in columns]
    for column, held in zip(
        columns, held_angles(clip.skeleton.names, places, rotations, layout), strict=True
    ):
        column.held = held
        _fit_translation(column, notes)
    _fit_rotations(columns, rotations, notes)
    joints = tuple(column.joint for column in columns)
    starts = first_columns(joints)
    values = np.empty((clip.frames, starts[-1]))
    for column, start in zip(columns, starts, strict=False):
        _fill(values, column, start)
    values += 0.0  # no minus before a zero
    same_rate = layout.frame_time and clip.fps == layout.fps
    document = BvhDocument(
        joints=joints,
        frame_time=layout.frame_time if same_rate else repr(1 / clip.fps),
        values=values,
        encoding=layout.encoding,
        newline=layout.newline,
    )
    ordered = depth_first(document)
    if ordered is not document:
        notes.append("joints are written depth first, as BVH has them; they were in another order")
    return Encoded(ordered, tuple(notes))


def _fill(values: Float[np.ndarray, "frames channels"], column: _Column, start: int) -> None:
    """Write a joint's numbers into its columns."""
    for place, channel in enumerate(column.joint.channels, start=start):
        if is_position(channel):
            part = column.translation[:, AXES.index(channel[0].lower())]
            values[:, place] = np.rint(part * MICRO)
    places = [start + place for place in column.joint.rotation_places]
    if places and column.angles is not None:
        together = places[-1] - places[0] == len(places) - 1
        values[:, slice(places[0], places[-1] + 1) if together else places] = column.angles


def _columns(clip: Clip, layout: BvhLayout, path: str | PathLike[str]) -> list[_Column]:
    """One column a joint of the clip: as in the source where it is known there, else default."""

    def in_file(metres: torch.Tensor) -> NDArray[np.float64]:
        vectors = turn_vectors_back(metres.double(), layout.up).cpu().numpy() / layout.unit
        if not np.abs(vectors).max(initial=0) < GREATEST:
            raise DataError(
                path, "the clip has a position that is not finite, or beyond 9e9 file units; mend "
                "it before writing"
            )  # fmt: skip
        return vectors

    if not torch.isfinite(clip.rotations_local).all():
        raise DataError(path, "the clip has a rotation that is not finite; mend it before writing")
    offsets, root = in_file(clip.offsets), in_file(clip.root_positions)
    moving = None if clip.translations_local is None else in_file(clip.translations_local)
    known = {name: place for place, name in enumerate(layout.names)}
    had_children = {joint.parent for joint in layout.joints}
    columns: list[_Column] = []
    for place, (name, parent) in enumerate(
        zip(clip.skeleton.names, clip.skeleton.parents, strict=True)
    ):
        translation = offsets[place][None] if moving is None else moving[:, place]
        if parent < 0:
            translation = root + translation
        source = known.get(name)
        if source is None:
            joint = _default_joint(name, parent, offsets[place])
        else:
            joint = replace(layout.joints[source], parent=parent)
        is_leaf = not clip.skeleton.children[place]
        if is_leaf and not joint.ends and (source is None or source in had_children):
            joint = replace(joint, ends=(BvhEnd("Site", _text(offsets[place] / 2)),))
        columns.append(_Column(joint, translation))
    return columns


def _default_joint(name: str, parent: int, offset: Float[np.ndarray, "3"]) -> BvhJoint:
    channels = tuple(f"{axis.upper()}rotation" for axis in _DEFAULT_ORDER)
    if parent < 0:
        channels = (*(f"{axis.upper()}position" for axis in AXES), *channels)
    return BvhJoint(writable_name(name), parent, _text(offset), channels)


def _text(offset: Float[np.ndarray, "3"]) -> tuple[str, str, str]:
    x, y, z = (f"{value:.6f}" for value in np.round(offset, 6) + 0.0)
    return x, y, z


def _fit_translation(column: _Column, notes: list[str]) -> None:
    """Make OFFSET and position channels say where the joint is.

    An OFFSET that a reader will use, and that is no longer true, is written anew; position
    channels are added where the translation changes in time and the source had none.
    """
    joint, translation = column.joint, column.translation
    low, high = translation.min(axis=0), translation.max(axis=0)
    present = joint.position_axes
    absent = [axis for axis in range(3) if AXES[axis] not in present]
    if (high - low > STILL)[absent].any():
        added = tuple(f"{AXES[axis].upper()}position" for axis in absent)
        first = [channel for channel in joint.channels if is_position(channel)]
        turns = [channel for channel in joint.channels if not is_position(channel)]
        if present and not is_position(joint.channels[0]):
            channels = (*turns, *first, *added)
        else:
            channels = (*first, *added, *turns)
        notes.append(
            f"joint {joint.name!r} moves, which its channels cannot say: {', '.join(added)} added"
        )
        column.joint = replace(joint, channels=channels)
        return
    offset = np.array([float(word) for word in joint.offset])
    middle = low + (high - low) / 2
    stale = [axis for axis in absent if abs(offset[axis] - middle[axis]) > 1e-9 + STILL / 4]
    if stale:
        written = _text(middle)
        words = [written[axis] if axis in stale else joint.offset[axis] for axis in range(3)]
        column.joint = replace(joint, offset=(words[0], words[1], words[2]))


def _fit_rotations(
    columns: list[_Column], rotations: Float[torch.Tensor, "frames joints 4"], notes: list[str]
) -> None:
    """Angles for the channels of every joint; three channels where there are too few."""
    groups: dict[_Kind, list[int]] = {}
    for place, column in enumerate(columns):
        if column.held.frames == len(rotations):
            column.angles = np.rint(column.held.degrees[: len(rotations)] * MICRO)
            continue
        axes = column.joint.rotation_axes
        order = complete_axes(axes) if axes else _DEFAULT_ORDER
        if order is None:
            _give_three(column, _DEFAULT_ORDER, notes)
            order, axes = _DEFAULT_ORDER, _DEFAULT_ORDER
        groups.setdefault(_Kind(order, len(axes), column.held.frames), []).append(place)
    failed: dict[str, list[int]] = {}
    for kind, places in groups.items():
        expressible = _solve(columns, rotations, places, kind)
        for place, good in zip(places, expressible, strict=True):
            if not good and kind.turns < 3:
                _give_three(columns[place], kind.order, notes)
                failed.setdefault(kind.order, []).append(place)
    for order, places in failed.items():
        _solve(columns, rotations, places, _Kind(order, 3, 0))


class _Kind(NamedTuple):
    """Joints that can be solved together: order, number of turns, frames that the source has."""

    order: str
    turns: int
    same: int


def _solve(
    columns: list[_Column],
    rotations: Float[torch.Tensor, "frames joints 4"],
    places: list[int],
    kind: _Kind,
) -> list[bool]:
    order, turns, same = kind
    rotations = rotations[same:]
    near = np.zeros((len(places), turns))
    for row, place in zip(near, places, strict=True):
        known = columns[place].held.degrees[max(same - 1, 0) :][:1].ravel()[:turns]
        row[: len(known)] = known
    # A few joints at a time: what a step reads is then still in the cache.
    batch = max(1, _CHUNK // len(rotations))
    expressible: list[bool] = []
    for first in range(0, len(places), batch):
        chosen = places[first : first + batch]
        found = quaternion_to_channels(
            rotations[:, chosen], order, turns, near[first : first + batch]
        )
        expressible.extend(found.expressible)
        for index, place in enumerate(chosen):
            column = columns[place]
            as_before = np.rint(column.held.degrees[:same] * MICRO).reshape(same, turns)
            column.angles = np.concatenate([as_before, found.micro[:, index]])
    return expressible


def _give_three(column: _Column, order: str, notes: list[str]) -> None:
    """Replace a joint's rotation channels by the three of an order."""
    joint = column.joint
    turns = tuple(f"{axis.upper()}rotation" for axis in order)
    channels: list[str] = []
    for channel in joint.channels:
        if is_position(channel):
            channels.append(channel)
        elif turns[0] not in channels:
            channels.extend(turns)
    if turns[0] not in channels:
        channels.extend(turns)
    old = [channel for channel in joint.channels if not is_position(channel)]
    notes.append(
        f"joint {joint.name!r} turns in ways its channels ({' '.join(old) or 'none'}) cannot say: "
        f"written as {' '.join(turns)}"
    )
    column.joint = replace(joint, channels=tuple(channels))
    fits = joint.rotation_axes == order[: len(joint.rotation_axes)]
    column.held = column.held._replace(frames=0) if fits else NOTHING_HELD


_DEFAULT = BvhLayout(joints=(), names=(), unit=UNITS["cm"], up="y", frame_time="", fps=0.0)
