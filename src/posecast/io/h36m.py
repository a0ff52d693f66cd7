"""Human3.6M as exponential-map text: 99 comma-separated numbers a frame, 50 frames a second."""

from __future__ import annotations

import io
import re
from os import PathLike
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float64
from torch import Tensor

from posecast.errors import ConfigError, DataError
from posecast.geometry import quaternion
from posecast.io.files import read_text_bytes
from posecast.io.h36m_root import RootTrack, integrate_root, level_root
from posecast.motion import Clip
from posecast.skeleton import joint_positions, named_skeleton

FPS = 50.0
COLUMNS = 99
_MEANING = "root 3 + 32 joints x 3"
_MILLIMETRE = 0.001
_FEET = ("Foot", "ToeBase", "ToeBaseSite")
_LEG_JOINTS = 11
"""The first joints of the skeleton: hips and both legs."""
_LARGEST_TURN = 100.0
_LARGEST_STEP = 1e5


def read_h36m(path: str | PathLike[str], *, root: str = "world") -> Clip:
    """Read one recording, ``S5/walking_1.txt``, as a clip on the skeleton ``h36m-32``.

    The files follow a row-vector convention; their exponential map r is the rotation exp(-r)
    of column vectors, for every joint. Offsets are those of subject S1.

    Args:
        path: the file. Subject, action and recording become labels where the path shows them.
        root: what becomes of the first six columns, the movement of the root from frame to
            frame in its own frame.

            ``"world"`` sums them up, turned and lifted so that the floor is y = 0. Only the root
            is turned, so local rotations and errors measured on them are those of the file. The
            floor is an estimate (see ``h36m_root.level_root``); the first frame stands above
            x = z = 0 and faces roughly +z.

            ``"increments"`` keeps them: the root's rotation is exp(-r) of columns 3 to 5,
            ``root_positions`` are columns 0 to 2 in metres. This is what QuaterNet trains on.

    Raises:
        DataError: the file is missing, empty, binary, cut off or damaged; see the message.
        ConfigError: ``root`` is neither of the two.

    Source: Jain et al. 2016 for the files; Martinez et al. 2017 for the order of summing up.
    """
    if root not in ("world", "increments"):
        raise ConfigError(f"read_h36m: root={root!r}; expected 'world' or 'increments'")
    columns = read_h36m_columns(path)
    body = named_skeleton("h36m-32")
    offsets = body.offsets()
    rotations = quaternion.exp(-columns[:, 3:].unflatten(-1, (-1, 3)))
    track = RootTrack(columns[:, :3] * _MILLIMETRE, rotations[:, 0])
    if root == "world":
        track = integrate_root(track.positions, track.rotations)
        names = [f"{side}{joint}" for side in ("Right", "Left") for joint in _FEET]
        feet = joint_positions(
            body.skeleton.select(range(_LEG_JOINTS)),
            torch.cat([track.rotations[:, None], rotations[:, 1:_LEG_JOINTS]], dim=1),
            offsets[:_LEG_JOINTS],
            track.positions,
        )[:, [body.skeleton.index(name) for name in names]]
        track = level_root(track, feet, torch.tensor([0, 1, 2, 0, 1, 2]), FPS)
    labels = h36m_labels(path)
    return Clip(
        skeleton=body.skeleton,
        offsets=offsets,
        fps=FPS,
        root_positions=track.positions,
        rotations_local=torch.cat([track.rotations[:, None], rotations[:, 1:]], dim=1),
        name="_".join([*([labels["subject"]] if "subject" in labels else []), Path(path).stem]),
        labels=labels,
    )


def h36m_labels(path: str | PathLike[str]) -> dict[str, str]:
    """Subject (``S5``), action and recording (``1``), as far as the path shows them."""
    file = Path(path)
    labels: dict[str, str] = {}
    if re.fullmatch(r"S\d+", file.parent.name):
        labels["subject"] = file.parent.name
    if named := re.fullmatch(r"([A-Za-z]+)_(\d+)", file.stem):
        labels["action"], labels["recording"] = named[1].lower(), named[2]
    return labels


def read_h36m_columns(path: str | PathLike[str]) -> Float64[Tensor, "frames 99"]:
    """The numbers of one recording as they stand in the file, for published protocols.

    Columns 0-2 are the translation (mm) and 3-5 the rotation of the root since the frame before;
    3+3j to 5+3j hold the exponential map of joint j.

    Raises:
        DataError: see ``read_h36m``.
    """
    content = read_text_bytes(path, f"{COLUMNS} comma-separated numbers a line ({_MEANING})")
    try:
        columns = np.loadtxt(
            io.BytesIO(content), delimiter=",", comments=None, ndmin=2, encoding="latin1"
        )
    except ValueError as error:
        raise _fault(path, content, str(error)) from None
    if columns.shape[1] != COLUMNS or not np.isfinite(columns).all():
        raise _fault(path, content, f"{columns.shape[1]} columns")
    # An exponent gone wrong leaves a finite number that no later computation survives.
    for limit, part, unit in (
        (_LARGEST_STEP, np.s_[:, :3], "mm"),
        (_LARGEST_TURN, np.s_[:, 3:], "rad"),
    ):
        if (excess := np.abs(columns[part]) > limit).any():
            row, column = np.argwhere(excess)[0]
            filled = [n for n, line in enumerate(content.split(b"\n"), start=1) if line.strip()]
            raise DataError(
                path,
                f"{columns[part][row, column]:g} {unit}, expected at most {limit:g}; the file is "
                "damaged or no H3.6M exponential-map text",
                line=filled[row],
            )
    return torch.from_numpy(columns)


def _fault(path: str | PathLike[str], content: bytes, otherwise: str) -> DataError:
    """The first line that is wrong, found by reading again slowly."""
    lines = content.split(b"\n")
    for number, line in enumerate(lines, start=1):
        if not line.strip():
            continue
        fields = line.split(b",")
        if len(fields) != COLUMNS:
            remedy = "copy the file again, or leave out what is no Human3.6M text"
            if len(fields) == 1 and len(line.split()) == COLUMNS:
                remedy = "put commas between the numbers"
            elif number == len(lines) and number > 1:
                remedy = "the file is cut off, copy it again"
            return DataError(
                path,
                f"{len(fields)} columns, expected {COLUMNS} ({_MEANING}); {remedy}",
                line=number,
            )
        for column, field in enumerate(fields):
            try:
                finite = np.isfinite(float(field))
            except ValueError:
                finite = False
            if not finite:
                found = field.strip()[:40].decode("latin-1")
                return DataError(
                    path,
                    f"{found!r} in column {column}, expected a finite number; copy the file again",
                    line=number,
                )
    return DataError(path, f"cannot be read as {COLUMNS} columns of numbers ({otherwise})")
