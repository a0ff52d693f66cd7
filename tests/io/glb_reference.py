"""An independent reader of GLB: matrices and slerp, one node and one instant at a time.

Written after the glTF 2.0 specification alone, for what tests ask; shares nothing with the writer.
"""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]
_LETTERS = {5121: "B", 5123: "H", 5125: "I", 5126: "f"}
_WIDTHS = {"SCALAR": 1, "VEC3": 3, "VEC4": 4, "MAT4": 16}


class Glb:
    """A file, taken apart. ``json`` is its first chunk, ``binary`` its second."""

    def __init__(self, path: Path) -> None:
        content = path.read_bytes()
        magic, version, length = struct.unpack_from("<4sII", content)
        assert (magic, version, length) == (b"glTF", 2, len(content))
        size, kind = struct.unpack_from("<I4s", content, 12)
        assert (kind, size % 4) == (b"JSON", 0)
        self.json: dict[str, Any] = json.loads(content[20 : 20 + size].decode("utf-8"))
        start = 20 + size
        size, kind = struct.unpack_from("<I4s", content, start)
        assert (kind, size % 4) == (b"BIN\0", 0)
        self.binary = content[start + 8 :]
        assert len(self.binary) == size == self.json["buffers"][0]["byteLength"]
        self._animated = self._read_animation()

    def numbers(self, accessor: int) -> Array:
        """The elements of an accessor, one a row; matrices as (4, 4) that act on columns."""
        entry = self.json["accessors"][accessor]
        view = self.json["bufferViews"][entry["bufferView"]]
        letter, width = _LETTERS[entry["componentType"]], _WIDTHS[entry["type"]]
        start, count = view["byteOffset"], entry["count"] * width
        assert start % 4 == 0
        assert view["byteLength"] == count * struct.calcsize(letter)
        assert start + view["byteLength"] <= len(self.binary)
        values = np.array(struct.unpack_from(f"<{count}{letter}", self.binary, start), dtype=float)
        if entry["type"] == "MAT4":
            return values.reshape(-1, 4, 4).transpose(0, 2, 1)
        return values.reshape(-1, width) if width > 1 else values

    @property
    def times(self) -> Array:
        """Of the key frames, seconds; all tracks have the same."""
        clocks = {sampler["input"] for sampler in self.json["animations"][0]["samplers"]}
        assert len(clocks) == 1
        return self.numbers(clocks.pop())

    def track(self, node: int, path: str) -> Array | None:
        """Key frames of a node's ``rotation`` (x, y, z, w) or ``translation``."""
        return self._animated.get((node, path))

    def world(self, seconds: float) -> Array:
        """Matrices of all nodes at a time: (nodes, 4, 4), positions in the last column."""
        result = np.full((len(self.json["nodes"]), 4, 4), np.nan)
        todo = [(node, np.eye(4)) for node in self.json["scenes"][self.json["scene"]]["nodes"]]
        while todo:
            node, above = todo.pop()
            result[node] = above @ self.local(node, seconds)
            todo += [
                (child, result[node]) for child in self.json["nodes"][node].get("children", [])
            ]
        return result

    def local(self, node: int, seconds: float | None) -> Array:
        """Matrix of a node relative to its parent at a time; ``None``: as it is at rest."""
        entry = self.json["nodes"][node]
        translation = np.array(entry.get("translation", [0.0, 0.0, 0.0]))
        rotation = np.array(entry.get("rotation", [0.0, 0.0, 0.0, 1.0]))
        if seconds is not None:
            if (moves := self.track(node, "translation")) is not None:
                early, late, fraction = self._around(moves, seconds)
                translation = (1 - fraction) * early + fraction * late
            if (turns := self.track(node, "rotation")) is not None:
                rotation = _slerp(*self._around(turns, seconds))
        matrix = np.eye(4)
        matrix[:3, :3] = Rotation.from_quat(rotation).as_matrix()
        matrix[:3, 3] = translation
        return matrix

    def skinned(self, seconds: float) -> Array:
        """World positions of the vertices of the mesh at a time."""
        skin = self.json["skins"][0]
        matrices = self.world(seconds)[skin["joints"]] @ self.numbers(skin["inverseBindMatrices"])
        attributes = self.json["meshes"][0]["primitives"][0]["attributes"]
        vertices = self.numbers(attributes["POSITION"])
        joints = self.numbers(attributes["JOINTS_0"]).astype(int)
        weights = self.numbers(attributes["WEIGHTS_0"])
        points = np.concatenate([vertices, np.ones((len(vertices), 1))], axis=1)
        each = np.einsum("vkij,vj->vki", matrices[joints], points)
        return np.einsum("vk,vki->vi", weights, each)[:, :3]

    def triangles(self) -> NDArray[np.int64]:
        """Vertices of the triangles of the mesh, three a row."""
        indices = self.numbers(self.json["meshes"][0]["primitives"][0]["indices"])
        return indices.astype(int).reshape(-1, 3)

    def _around(self, track: Array, seconds: float) -> tuple[Array, Array, float]:
        """Key frames before and after a time, and how far between them it is."""
        late = int(np.searchsorted(self.times, seconds))
        if late in (0, len(track)):  # before the first, after the last: they are held
            return track[late and -1], track[late and -1], 0.0
        early = self.times[late - 1]
        return track[late - 1], track[late], (seconds - early) / (self.times[late] - early)

    def _read_animation(self) -> dict[tuple[int, str], Array]:
        (animation,) = self.json["animations"]
        found: dict[tuple[int, str], Array] = {}
        for channel in animation["channels"]:
            key = (channel["target"]["node"], channel["target"]["path"])
            assert key not in found
            sampler = animation["samplers"][channel["sampler"]]
            assert sampler["interpolation"] == "LINEAR"
            found[key] = self.numbers(sampler["output"])
        return found


def _slerp(early: Array, late: Array, fraction: float) -> Array:
    """Between two quaternions as they are written: whoever wrote them chose the signs."""
    angle = np.arccos(np.clip(early @ late, -1, 1))
    if angle < 1e-3:  # lost in the rounding of its cosine, and too small to tell arc from chord
        return (1 - fraction) * early + fraction * late
    return (np.sin((1 - fraction) * angle) * early + np.sin(fraction * angle) * late) / np.sin(
        angle
    )
