"""Clips as animated glTF 2.0 binaries, for Blender, game engines and browsers: written, not read.

Source: Khronos Group 2021, glTF 2.0 Specification. It has our metres, seconds, y up and +z ahead;
its quaternions are (x, y, z, w).
"""

from __future__ import annotations

from os import PathLike
from typing import Any

import numpy as np
import torch
from jaxtyping import Float, Float32
from torch import Tensor

from posecast.errors import DataError
from posecast.geometry import quaternion
from posecast.io.atomic import atomic_write
from posecast.io.bone_mesh import BoneMesh, bone_mesh
from posecast.io.bvh_layout import unique_names
from posecast.io.glb_container import ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER, GlbBuffer
from posecast.motion.checks import check_motion
from posecast.motion.clip import Clip
from posecast.skeleton import Skeleton
from posecast.version import __version__

_LARGEST = 2**32 - 2**24
"""Bytes of animation: a file's length is held in 32 bits, and mesh and names need some, too."""
_FARTHEST = 1e30
"""Metres up to which sums of offsets are finite in single precision."""
_GREY = {
    "name": "grey",
    "pbrMetallicRoughness": {
        "baseColorFactor": [0.6, 0.6, 0.6, 1.0],
        "metallicFactor": 0.0,
        "roughnessFactor": 0.8,
    },
}


def write_glb(clip: Clip, path: str | PathLike[str], *, mesh: bool = True) -> None:
    """Write a clip as an animated armature: one node a joint, a skin, one animation.

    Nodes have the names of the joints, in their order. At rest they have the clip's offsets, no
    rotation, and stand where the first frame does. Every joint has a track of rotations, with
    continuous signs; roots have a track of translations, and so have all joints if bones move
    (``translations_local``). Frame ``n`` is at ``n / fps`` seconds; ``asset.extras.fps`` says the
    rate. Labels, tracks and ``source`` of the clip are not kept. Numbers are in single precision;
    equal clips give equal bytes, and the file appears whole or not at all.

    Args:
        clip: any clip; it may have several roots.
        path: the file.
        mesh: hang an octahedron on each bone, so that a viewer shows something; without, the
            armature is alone.

    Raises:
        DataError: a number that is not finite or too large for single precision, a quaternion that
            is no rotation, more frames than a file holds, or a place that cannot be written.
    """
    times = _times(clip, path)
    check_motion(path, clip)
    _check_range(clip, path)
    buffer = GlbBuffer()
    document = _document(clip, times, buffer, mesh=mesh)
    try:
        content = buffer.to_glb(document)
    except UnicodeEncodeError as error:
        raise DataError(
            path,
            f"a name holds {error.object[error.start : error.end]!r}, which is no text; rename it",
        ) from error
    with atomic_write(path) as temporary:
        temporary.write_bytes(content)


def _times(clip: Clip, path: str | PathLike[str]) -> Float32[np.ndarray, "frames"]:
    """When the frames are, in seconds; refuses a clip that no file can hold."""
    joints = len(clip.skeleton)
    size = clip.frames * (4 + 16 * joints + 12 * len(_sliding(clip)))
    if size > _LARGEST:
        raise DataError(
            path,
            f"{clip.frames} frames of {joints} joints take {size / 2**30:.1f} GiB, and GLB holds "
            "less than 4; cut the clip into pieces",
        )
    with np.errstate(over="ignore", invalid="ignore"):
        times = (np.arange(clip.frames) / clip.fps).astype(np.float32)
        differ = np.isfinite(times).all() and (np.diff(times) > 0).all()
    if not differ:
        raise DataError(
            path,
            f"{clip.frames} frames, {clip.fps:g} a second, are at times that single precision "
            "does not tell apart; cut the clip into pieces, or give the true rate",
        )
    return times


def _check_range(clip: Clip, path: str | PathLike[str]) -> None:
    """Refuse lengths that overflow in single precision."""
    for values in (clip.offsets, clip.root_positions, clip.translations_local):
        if values is not None and (farthest := float(values.detach().abs().max())) > _FARTHEST:
            raise DataError(
                path,
                f"the clip has a position of {farthest:.1e} m, too large for single precision; "
                "check its unit",
            )


def _sliding(clip: Clip) -> tuple[int, ...]:
    """Joints whose translation from the parent changes in time."""
    roots = clip.skeleton.roots
    return roots if clip.translations_local is None else tuple(range(len(clip.skeleton)))


def _document(
    clip: Clip, times: Float32[np.ndarray, "frames"], buffer: GlbBuffer, *, mesh: bool
) -> dict[str, Any]:
    """The JSON of the file; its numbers go into the buffer."""
    skeleton, joints = clip.skeleton, len(clip.skeleton)
    rest = _float64(clip.offsets)
    rest[list(skeleton.roots)] += _float64(clip.root_positions[0])
    positions = _rest_positions(skeleton, rest)
    *names, armature, bones = unique_names([*skeleton.names, "armature", "bones"])
    # The joints of a skin must have a common ancestor, which a forest lacks: an armature above all.
    nodes = [
        *_joint_nodes(skeleton, names, rest),
        {"name": armature, "children": list(skeleton.roots)},
    ]
    document: dict[str, Any] = {
        "asset": {
            "version": "2.0",
            "generator": f"posecast {__version__}",
            "extras": {"fps": float(clip.fps)},
        },
        "scene": 0,
        "scenes": [{"nodes": [joints]}],
        "nodes": nodes,
        "skins": [_skin(armature, positions, buffer)],
        "animations": [_animation(clip, times, buffer)],
    }
    if mesh:
        # Beside the armature, not in it: what is above a skinned mesh does not move it.
        document["scenes"][0]["nodes"].append(len(nodes))
        nodes.append({"name": bones, "mesh": 0, "skin": 0})
        document["meshes"] = [_mesh(bones, bone_mesh(skeleton, positions, _slides(clip)), buffer)]
        document["materials"] = [_GREY]
    return document


def _joint_nodes(
    skeleton: Skeleton, names: list[str], rest: Float[np.ndarray, "joints 3"]
) -> list[dict[str, Any]]:
    """A node a joint, at rest."""
    nodes: list[dict[str, Any]] = []
    for name, children, translation in zip(names, skeleton.children, rest, strict=True):
        nodes.append({"name": name, "translation": translation.tolist()})
        if children:
            nodes[-1]["children"] = list(children)
    return nodes


def _rest_positions(
    skeleton: Skeleton, rest: Float[np.ndarray, "joints 3"]
) -> Float[np.ndarray, "joints 3"]:
    """Where joints are in the world that turn nowhere, metres."""
    positions = rest.copy()
    for joint, parent in enumerate(skeleton.parents):
        if parent >= 0:
            positions[joint] += positions[parent]
    return positions


def _skin(
    armature: str, positions: Float[np.ndarray, "joints 3"], buffer: GlbBuffer
) -> dict[str, Any]:
    """All joints, and for each the matrix from the world at rest to its own frame."""
    joints = len(positions)
    inverse_binds = np.tile(np.eye(4, dtype=np.float32), (joints, 1, 1))
    inverse_binds[:, :3, 3] = -positions
    return {
        "name": armature,
        "joints": list(range(joints)),
        "skeleton": joints,
        "inverseBindMatrices": buffer.add(inverse_binds),
    }


def _slides(clip: Clip) -> Float[np.ndarray, "joints"]:
    """How far each joint moves in its parent's frame, metres."""
    if clip.translations_local is None:
        return np.zeros(len(clip.skeleton))
    return np.linalg.norm(np.ptp(_float64(clip.translations_local), axis=0), axis=-1)


def _mesh(name: str, shape: BoneMesh, buffer: GlbBuffer) -> dict[str, Any]:
    """Normals are left out: viewers must then draw flat faces, as these are."""
    joints = np.zeros((len(shape.vertices), 4), dtype=np.uint16)
    joints[:, 0] = shape.joints
    weights = np.zeros((len(shape.vertices), 4), dtype=np.float32)
    weights[:, 0] = 1
    vertices = shape.vertices.astype(np.float32)
    corners = shape.triangles.astype(np.uint32).reshape(-1)
    attributes = {
        "POSITION": buffer.add(vertices, target=ARRAY_BUFFER, bounds=True),
        "JOINTS_0": buffer.add(joints, target=ARRAY_BUFFER),
        "WEIGHTS_0": buffer.add(weights, target=ARRAY_BUFFER),
    }
    indices = buffer.add(corners, target=ELEMENT_ARRAY_BUFFER)
    return {
        "name": name,
        "primitives": [{"attributes": attributes, "indices": indices, "material": 0}],
    }


def _animation(
    clip: Clip, times: Float32[np.ndarray, "frames"], buffer: GlbBuffer
) -> dict[str, Any]:
    """The motion: rotations of all joints, translations of those that slide."""
    samplers: list[dict[str, Any]] = []
    channels: list[dict[str, Any]] = []
    clock = buffer.add(times, bounds=True)

    def add(joint: int, path: str, values: Float[np.ndarray, "frames channels"]) -> None:
        output = buffer.add(values.astype(np.float32))
        channels.append({"sampler": len(samplers), "target": {"node": joint, "path": path}})
        samplers.append({"input": clock, "interpolation": "LINEAR", "output": output})

    # Not unit in half precision; and viewers would interpolate from q to -q by the long way round.
    unit = quaternion.normalize(clip.rotations_local.detach().double())
    rotations = _float64(quaternion.unroll(unit))
    for joint in range(len(clip.skeleton)):
        add(joint, "rotation", rotations[:, joint, [1, 2, 3, 0]])
    moved = clip.offsets[None] if clip.translations_local is None else clip.translations_local
    for joint in _sliding(clip):
        translations = np.broadcast_to(_float64(moved[:, joint]), (clip.frames, 3))
        if clip.skeleton.parents[joint] < 0:
            translations = translations + _float64(clip.root_positions)
        add(joint, "translation", translations)
    return {"name": clip.name or "motion", "samplers": samplers, "channels": channels}


def _float64(values: Tensor) -> Float[np.ndarray, "*shape"]:
    """A copy in double precision."""
    return values.detach().to("cpu", torch.float64, copy=True).numpy()
