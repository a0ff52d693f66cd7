"""BVH files to clips and back, in every dialect met in the wild.

Semantics (those of Blender's importer): a position channel replaces that component of the joint's
OFFSET, for the root too; a joint's rotation is the product of its rotation channels in the order
listed; orders may differ from joint to joint; the frame count is advisory.

Read as well: any case of keywords; CRLF, tabs, blank lines, a byte-order mark, UTF-16, Shift-JIS,
Latin-1; ``Frames:3``; a brace on the line of the name; blanks in names, names that contain
keywords, names used twice; joints with one, two, no or six channels or no CHANNELS line; rows
wrapped over lines; several ROOTs. Not read, with an error that names the cause: decimal commas,
numbers that are not finite, rows with a missing number, a file without MOTION.
"""

from __future__ import annotations

from os import PathLike
from pathlib import Path

import numpy as np
import torch

from posecast.errors import ConfigError, DataError
from posecast.io.bvh_decode import Places, decode_rotations, find_up
from posecast.io.bvh_document import AXES, GREATEST, BvhDocument, BvhEnd, BvhJoint
from posecast.io.bvh_encode import encode
from posecast.io.bvh_layout import (
    UNITS,
    BvhLayout,
    Up,
    frame_rate,
    guess_unit,
    turn_rotations,
    turn_vectors,
    unique_names,
)
from posecast.io.bvh_read import read_bvh_document
from posecast.io.bvh_text import six_decimals, write_bvh_document, write_text
from posecast.motion.clip import Clip
from posecast.skeleton import Skeleton

__all__ = [
    "UNITS",
    "BvhDocument",
    "BvhEnd",
    "BvhJoint",
    "BvhLayout",
    "read_bvh",
    "read_bvh_document",
    "write_bvh",
    "write_bvh_document",
]

_MOST_JOINTS = 2000


def read_bvh(path: str | PathLike[str], *, unit: float | None = None, up: Up | None = None) -> Clip:
    """Read a BVH file as a clip: metres, y up, float64.

    Translations of a joint that do not change in time are its offset, whatever its OFFSET says.
    If those of any joint but the first root do change, the clip has ``translations_local``. With
    several ROOTs, the later ones are placed relative to the first. ``clip.source`` is a
    ``BvhLayout``, from which ``write_bvh`` writes in the file's own conventions; its ``notes``
    say what is odd about the file.

    Args:
        path: the file.
        unit: metres per file unit; guessed from the size of the body if ``None``, among ``UNITS``.
        up: the file's vertical axis; guessed from the motion if ``None``. The whole space is
            turned, rest pose and joint axes along with it. See ``bvh_layout`` for both guesses.

    Raises:
        DataError: see ``read_bvh_document``; or more than 2000 joints, which is no body.
        ConfigError: ``unit`` is not positive, or ``up`` is no axis.
    """
    if unit is not None and not 0 < unit < float("inf"):
        raise ConfigError(f"unit is {unit}: expected a positive number of metres per file unit")
    if up is not None and up not in AXES:
        raise ConfigError(f"up is {up!r}: expected 'x', 'y', 'z' or None")
    document = read_bvh_document(path)
    joints = document.joints
    if len(joints) > _MOST_JOINTS:
        raise DataError(
            path, f"{len(joints)} joints, expected at most {_MOST_JOINTS}; check the braces"
        )
    notes = list(document.notes)
    names = unique_names([joint.name for joint in joints])
    if changed := [new for new, joint in zip(names, joints, strict=True) if new != joint.name]:
        notes.append(f"names used twice or empty; called here {', '.join(changed[:8])}")
    if (roots := sum(joint.parent < 0 for joint in joints)) > 1:
        notes.append(f"{roots} ROOTs; the later ones are placed relative to the first")
    fps, rounding = frame_rate(document.frame_time)
    skeleton = Skeleton(names, tuple(joint.parent for joint in joints))
    rotations = decode_rotations(document)
    places = Places(document)
    _check_size(path, places)
    if unit is None:
        unit, doubt = guess_unit(skeleton, places.lengths())
        notes.append(doubt)
    if up is None:
        up = find_up(skeleton, rotations, places)
    moving = places.translations()
    layout = BvhLayout(
        joints=joints,
        names=names,
        unit=unit,
        up=up,
        frame_time=document.frame_time,
        fps=fps,
        encoding=document.encoding,
        newline=document.newline,
        rows=document.values,
        notes=tuple(note for note in (*notes, rounding) if note),
    )
    return Clip(
        skeleton=skeleton,
        offsets=turn_vectors(torch.from_numpy(places.offsets) * unit, up),
        fps=fps,
        root_positions=turn_vectors(torch.from_numpy(places.root) * unit, up),
        rotations_local=turn_rotations(rotations, up),
        translations_local=(
            None if moving is None else turn_vectors(torch.from_numpy(moving) * unit, up)
        ),
        name=Path(path).stem,
        source=layout,
    )


def _check_size(path: str | PathLike[str], places: Places) -> None:
    """Refuse positions that no computation survives."""
    for tensor in (places.offsets, places.root, *places.moving.values()):
        if (excess := np.abs(tensor) >= GREATEST).any():
            row = int(np.argwhere(excess)[0, 0])
            what = "OFFSET of joint" if tensor is places.offsets else "position in frame"
            raise DataError(
                path,
                f"{what} {row} is {tensor[excess][0]:g} file units, expected less than "
                f"{GREATEST:.0e}; the file is damaged, export it again",
            )


def write_bvh(clip: Clip, path: str | PathLike[str]) -> tuple[str, ...]:
    """Write a clip as BVH, with six decimals.

    A clip that was read from BVH is written as that file was: unit, axes, orders of channels,
    names, End Sites, OFFSETs, encoding, line ends, and the frame time in its own digits if the
    frame rate is still the same; this holds for what was cut, predicted or pruned from it too.
    Other clips are written in centimetres, y up, with rotation order zyx; roots, and joints whose
    translation changes in time, get six channels, the others three.

    For as long as a joint turns as it did in that file, it gets the angles that stand there. From
    then on, and in other clips, angles are continuous in time, and within 3e-5 degrees of gimbal
    lock exactly there. Reading the file gives rotations to 1e-4 degrees and positions to 1e-4 file
    units; writing what was read gives the same bytes.

    Returns:
        What could not be kept: a joint that needed channels which the source did not have.

    Raises:
        DataError: the clip has a number that is not finite, or the file cannot be written.
    """
    encoded = encode(clip, path)
    write_text(path, encoded.document, six_decimals(encoded.document.values))
    return encoded.notes
