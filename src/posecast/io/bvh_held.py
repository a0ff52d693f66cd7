"""Which angles of the file that a clip came from still hold, so that they can be written again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float
from numpy.typing import NDArray

from posecast.io.bvh_decode import decode_rotations
from posecast.io.bvh_document import GREATEST, BvhDocument, first_columns
from posecast.io.bvh_layout import BvhLayout

_SAME = 2e-7
"""Difference of quaternions, 2e-5 degrees, that is none: what float32 makes of them."""


class Held(NamedTuple):
    """Angles of one joint in the source.

    Args:
        degrees: (rows, turns), from the row on that is the clip's first frame; no rows where the
            source did not have the joint.
        frames: so many frames of the clip, from the first on, are turned as the rows say.
    """

    degrees: NDArray[np.float64]
    frames: int


NOTHING_HELD = Held(np.empty((0, 0)), 0)


def held_angles(
    names: tuple[str, ...],
    rotation_places: Sequence[tuple[int, ...]],
    rotations: Float[torch.Tensor, "frames joints 4"],
    layout: BvhLayout,
) -> list[Held]:
    """What holds of each joint of a clip.

    Args:
        names: joints of the clip.
        rotation_places: for each of them the places of its rotations among its channels.
        rotations: file axes.
        layout: of the source.
    """
    if layout.rows is None:
        return [NOTHING_HELD] * len(names)
    known = {name: place for place, name in enumerate(layout.names)}
    everything = decode_rotations(BvhDocument(layout.joints, layout.frame_time, layout.rows))
    begin = _first_row(names, rotations.numpy(), known, everything.numpy())
    rows = layout.rows[begin : begin + len(rotations)]
    before = everything[begin : begin + len(rotations)].numpy()
    after = rotations[: len(rows)].numpy()
    starts = first_columns(layout.joints)
    found: list[Held] = []
    for place, name in enumerate(names):
        source = known.get(name)
        if source is None:
            found.append(NOTHING_HELD)
            continue
        turns = [starts[source] + turn for turn in rotation_places[place]]
        apart = _apart(after[:, place], before[:, source])
        other = (apart > _SAME) | (np.abs(rows[:, turns]).max(axis=1, initial=0) >= GREATEST)
        frames = int(other.argmax()) if other.any() else len(rows)
        found.append(Held(layout.rows[begin:, turns], frames))
    return found


def _first_row(
    names: tuple[str, ...],
    rotations: Float[np.ndarray, "frames joints 4"],
    known: Mapping[str, int],
    source: Float[np.ndarray, "rows known 4"],
) -> int:
    """The row of the source at which a clip that was cut from it begins; 0 where none is it."""
    pairs = [(place, known[name]) for place, name in enumerate(names) if name in known]
    begins, ends = np.ones((2, len(source)), dtype=np.bool_)
    for ours, theirs in pairs:
        begins &= _apart(source[:, theirs], rotations[0, ours]) <= _SAME
        ends &= _apart(source[:, theirs], rotations[-1, ours]) <= _SAME
    found = np.flatnonzero(begins)
    if not len(found):
        return 0
    # Of rows that are alike, as those of somebody who waits, the one that fits the end, too.
    last = found + len(rotations) - 1
    fits = (last < len(source)) & ends[np.minimum(last, len(source) - 1)]
    return int(found[fits.argmax()])


def _apart(
    some: Float[np.ndarray, "frames 4"], others: Float[np.ndarray, "*#frames 4"]
) -> Float[np.ndarray, "frames"]:
    """Largest difference of components, of the nearer sign."""
    one, other = some.T.copy(), others.T.copy().reshape(4, -1)
    return np.minimum(np.abs(one - other).max(axis=0), np.abs(one + other).max(axis=0))
