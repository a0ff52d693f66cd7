"""AMASS and other recordings of SMPL-family bodies: .npz files of joint rotations."""

from __future__ import annotations

import json
import math
from collections.abc import Collection, Mapping
from os import PathLike
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from posecast.errors import DataError
from posecast.geometry import quaternion
from posecast.io.archive import read_archive
from posecast.io.arrays import array_names, parse_array, read_arrays
from posecast.io.files import check_is_file, decode_text, read_text_bytes
from posecast.motion import Clip
from posecast.skeleton import named_skeleton

JOINTS = 22
_RATES = ("mocap_framerate", "mocap_frame_rate")
_PARTS = ("root_orient", "pose_body")
_TEMPLATE_KEYS = ("rest_joints", "joints", "J")
_LARGEST_TURN = 100.0
_LARGEST_BODY = 5.0


def is_amass(names: Collection[str]) -> bool:
    """Whether an .npz file with arrays of these names holds a motion of an SMPL body."""
    return "poses" in names or set(_PARTS) <= set(names)


def read_amass(
    path: str | PathLike[str],
    *,
    template: str | PathLike[str] | Float[Tensor, "joints 3"] | None = None,
    fps: float | None = None,
) -> Clip:
    """Read one recording on the skeleton ``smpl-22``: the body without hands and face.

    SMPL and SMPL-H files have ``poses`` (root, body, hands), SMPL-X files may have
    ``root_orient`` and ``pose_body`` instead; the rate is called ``mocap_framerate`` or
    ``mocap_frame_rate``. AMASS is z up: the root is turned by -90 degrees about x, so that z
    becomes y and y becomes -z. The other joints stay as they are.

    Args:
        path: the .npz file.
        template: joint positions of the body at rest in metres, y up, which the files do not
            contain and whose licence does not let us ship: a tensor, a .npy, .json or .npz file
            (array ``J``, ``joints`` or ``rest_joints``, at least 22 rows in SMPL order), or a
            clip of our own with these joints. Without it all offsets are zero, the label
            ``offsets`` is ``unknown``, and only the rotations and the shape of the root's path
            mean anything: the path is then ``trans``, a constant 0.2 m or so from the pelvis.
        fps: frames per second, for files that do not say.

    Raises:
        DataError: the file is missing or damaged, holds a body without motion, has no rate, or a
            wanted array holds Python objects or values that are not finite; see the message.
    """
    names = array_names(path)
    if not is_amass(names):
        found = ", ".join(sorted(names)[:8]) or "none"
        raise DataError(
            path,
            f"no motion: found {found}, expected poses, or root_orient and pose_body"
            + ("; it is the shape of a body, leave it out" if "betas" in names else ""),
        )
    arrays = read_arrays(path, {"poses", *_PARTS, "trans", *_RATES})
    rotations = quaternion.exp(torch.from_numpy(_axis_angles(path, arrays)))
    frames = len(rotations)
    labels: dict[str, str] = {}
    if template is None:
        offsets, pelvis = rotations.new_zeros(JOINTS, 3), rotations.new_zeros(3)
        labels["offsets"] = "unknown"
    else:
        offsets, pelvis = rest_offsets(template)
    if "trans" in arrays:
        translations = torch.from_numpy(_floats(path, "trans", arrays["trans"], (frames, 3)))
    else:
        translations = torch.zeros(frames, 3, dtype=torch.float64)
        labels["translation"] = "unknown"
    # The body model turns about the pelvis at rest, then adds the translation.
    x, y, z = (translations + pelvis).unbind(-1)
    half = math.sqrt(0.5)
    upright = rotations.new_tensor([half, -half, 0.0, 0.0])
    root = quaternion.product(upright, rotations[:, :1])
    return Clip(
        skeleton=named_skeleton("smpl-22").skeleton,
        offsets=offsets,
        fps=_rate(path, arrays) if fps is None else fps,
        root_positions=torch.stack([x, z, -y], dim=-1),
        rotations_local=torch.cat([root, rotations[:, 1:]], dim=1),
        name=Path(path).stem,
        labels=labels,
    )


def _axis_angles(path: str | PathLike[str], arrays: Mapping[str, np.ndarray]) -> np.ndarray:
    """Rotation vectors of the 22 joints, (frames, 22, 3)."""
    if "poses" in arrays:
        poses = arrays["poses"]
        if poses.ndim != 2 or poses.shape[1] < 3 * JOINTS or poses.shape[1] % 3:
            raise DataError(
                path,
                f"poses has shape {poses.shape}, expected (frames, 72), (frames, 156) or "
                f"(frames, 165): three numbers a joint, at least {JOINTS} joints",
            )
        flat = _floats(path, "poses", poses, (len(poses), poses.shape[1]))[:, : 3 * JOINTS]
    else:
        frames = len(np.atleast_1d(arrays["root_orient"]))
        root = _floats(path, "root_orient", arrays["root_orient"], (frames, 3))
        body = _floats(path, "pose_body", arrays["pose_body"], (frames, 3 * (JOINTS - 1)))
        flat = np.concatenate([root, body], axis=1)
    if not len(flat):
        raise DataError(path, "no frames, expected at least one")
    if np.abs(flat).max() > _LARGEST_TURN:
        raise DataError(
            path,
            f"a rotation vector has {np.abs(flat).max():g} rad, expected at most "
            f"{_LARGEST_TURN:g}; these are no axis-angle rotations",
        )
    return flat.reshape(len(flat), JOINTS, 3)


def _floats(
    path: str | PathLike[str], key: str, values: np.ndarray, shape: tuple[int, ...]
) -> np.ndarray:
    """Finite numbers of a shape, as float64."""
    if values.shape != shape or values.dtype.kind not in "fiu":
        raise DataError(path, f"{key} is {values.dtype} {values.shape}, expected numbers {shape}")
    wide = np.ascontiguousarray(values, dtype=np.float64)
    if not np.isfinite(wide).all():
        row = int(np.argwhere(~np.isfinite(wide))[0, 0])
        raise DataError(path, f"{key} has a value that is not finite in row {row}; leave it out")
    return wide


def _rate(path: str | PathLike[str], arrays: Mapping[str, np.ndarray]) -> float:
    for key in _RATES:
        if key in arrays:
            rate = arrays[key]
            if rate.size == 1 and rate.dtype.kind in "fiu" and 0 < float(rate.item()) < math.inf:
                return float(rate.item())
            raise DataError(
                path, f"{key} is {rate.tolist()!r}, expected one number > 0; give the rate (--fps)"
            )
    raise DataError(
        path,
        "no mocap_framerate or mocap_frame_rate; if the rate is known, give it (--fps)",
    )


def rest_offsets(template: str | PathLike[str] | Tensor) -> tuple[Tensor, Tensor]:
    """Offsets of the 22 joints and the pelvis at rest, metres."""
    where = "template" if isinstance(template, Tensor) else template
    if isinstance(template, Tensor):
        values = template.detach().cpu().double().numpy()
    else:
        values = _read_template(template)
    if values.ndim != 2 or values.shape[1] != 3 or len(values) < JOINTS:
        raise DataError(
            where,
            f"joint positions of shape {values.shape}, expected (24, 3) or (22, 3): SMPL's joints "
            "at rest, in metres",
        )
    rest = torch.from_numpy(_floats(where, "the template", values, values.shape)[:JOINTS].copy())
    size = float((rest - rest[0]).abs().max())
    if not 0.1 < size < _LARGEST_BODY:
        raise DataError(
            where, f"a body that reaches {size:g} m from its pelvis, expected metres; rescale it"
        )
    parents = named_skeleton("smpl-22").skeleton.parents
    offsets = rest - rest[list(parents)]
    offsets[0] = 0
    return offsets, rest[0]


def _read_template(path: str | PathLike[str]) -> np.ndarray:
    file = check_is_file(path)
    if file.suffix.lower() == ".npy":
        try:
            content = file.read_bytes()
        except OSError as error:
            raise DataError(path, f"cannot be read ({error.strerror or error})") from error
        return parse_array(path, file.stem, content)
    if file.suffix.lower() == ".npz":
        names = array_names(path)
        if "rotations_local" in names:
            return _rest_of_clip(path)
        for key in _TEMPLATE_KEYS:
            if key in names:
                return read_arrays(path, {key})[key]
        raise DataError(path, f"no array {', '.join(_TEMPLATE_KEYS)}; found {', '.join(names)}")
    try:
        return np.array(json.loads(decode_text(read_text_bytes(path, "joint positions as JSON"))))
    except (ValueError, RecursionError) as error:
        raise DataError(
            path, f"no JSON list of joint positions ({error}); use .npy, .npz or .json"
        ) from error


def _rest_of_clip(path: str | PathLike[str]) -> np.ndarray:
    """Joint positions at rest of a clip of our own that has SMPL's body joints."""
    clip, body = read_archive(path), named_skeleton("smpl-22").skeleton
    if clip.skeleton.names[:JOINTS] != body.names or clip.skeleton.parents[:JOINTS] != body.parents:
        raise DataError(path, "its first joints are not those of the skeleton smpl-22")
    rest = clip.offsets.double().clone()
    for joint, parent in enumerate(clip.skeleton.parents):
        if parent >= 0:
            rest[joint] += rest[parent]
    return rest.numpy()
