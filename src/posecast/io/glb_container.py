"""The container of binary glTF 2.0: numbers in one buffer, and JSON that says where each is."""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Shaped

ARRAY_BUFFER = 34962
"""``target`` of numbers a vertex."""
ELEMENT_ARRAY_BUFFER = 34963
"""``target`` of the vertices a triangle."""

_ALIGNMENT = 4
_COMPONENTS = {
    np.dtype(np.uint16): 5123,
    np.dtype(np.uint32): 5125,
    np.dtype(np.float32): 5126,
}
_TYPES: Mapping[tuple[int, ...], str] = {(): "SCALAR", (3,): "VEC3", (4,): "VEC4", (4, 4): "MAT4"}
_MAGIC, _VERSION = 0x46546C67, 2
_JSON_CHUNK, _BINARY_CHUNK = 0x4E4F534A, 0x004E4942


class GlbBuffer:
    """The numbers of a file while they are gathered; every array starts at a multiple of four.

    ``views`` and ``accessors`` are the lists of those names in the JSON.
    """

    def __init__(self) -> None:
        self.views: list[dict[str, int]] = []
        self.accessors: list[dict[str, Any]] = []
        self._content = bytearray()

    def add(
        self,
        values: Shaped[np.ndarray, "count *element"],
        *,
        target: int | None = None,
        bounds: bool = False,
    ) -> int:
        """Append an array; returns the index of its accessor.

        Args:
            values: float32, uint16 or uint32; one element a row: scalars, vectors of 3 or 4,
                or 4 x 4 matrices that act on column vectors (glTF stores their columns).
            target: ``ARRAY_BUFFER`` or ``ELEMENT_ARRAY_BUFFER`` for what a mesh reads.
            bounds: say the smallest and largest of each component, which glTF asks for where
                positions of vertices or times of frames are held.
        """
        if values.ndim == 3:
            values = values.transpose(0, 2, 1)
        content = np.ascontiguousarray(values, values.dtype.newbyteorder("<")).tobytes()
        view = {"buffer": 0, "byteOffset": len(self._content), "byteLength": len(content)}
        if target is not None:
            view["target"] = target
        accessor: dict[str, Any] = {
            "bufferView": len(self.views),
            "componentType": _COMPONENTS[values.dtype],
            "count": len(values),
            "type": _TYPES[values.shape[1:]],
        }
        if bounds:
            accessor["min"] = np.atleast_1d(values.min(axis=0)).tolist()
            accessor["max"] = np.atleast_1d(values.max(axis=0)).tolist()
        self.views.append(view)
        self.accessors.append(accessor)
        self._content += content + bytes(-len(content) % _ALIGNMENT)
        return len(self.accessors) - 1

    def to_glb(self, document: Mapping[str, Any]) -> bytes:
        """The whole file: header, JSON, numbers.

        Args:
            document: the JSON but ``accessors``, ``bufferViews`` and ``buffers``.

        Raises:
            UnicodeEncodeError: a text that is not Unicode (an unpaired surrogate).
        """
        whole = {
            **document,
            "accessors": self.accessors,
            "bufferViews": self.views,
            "buffers": [{"byteLength": len(self._content)}],
        }
        text = json.dumps(whole, ensure_ascii=False, allow_nan=False, separators=(",", ":"))
        chunk = text.encode()
        chunk += b" " * (-len(chunk) % _ALIGNMENT)
        length = 12 + 8 + len(chunk) + 8 + len(self._content)
        return b"".join(
            (
                struct.pack("<3I", _MAGIC, _VERSION, length),
                struct.pack("<2I", len(chunk), _JSON_CHUNK),
                chunk,
                struct.pack("<2I", len(self._content), _BINARY_CHUNK),
                self._content,
            )
        )
