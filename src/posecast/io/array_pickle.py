"""Pickled arrays, as the first release of AMASS has them, read without executing anything.

A pickle is a program that may call any function by name. This reader knows the few that make NumPy
arrays and refuses every other name before it is looked up.
"""

from __future__ import annotations

import codecs
import io
import pickle
from collections.abc import Callable, Mapping
from os import PathLike
from typing import Any

import numpy as np

from posecast.errors import DataError
from posecast.io.files import check_is_file

_LARGEST = 1 << 31
"""Bytes; recordings have a hundredth of that."""

_MULTIARRAY: Any = np.ndarray.__reduce__(np.empty(0))[0]
"""The function that makes an empty array to be filled: numpy's ``_reconstruct``."""


def _encode(text: str, encoding: str = "latin1") -> bytes:
    """What Python 2 wrote as bytes; no other encoding is ever looked up."""
    if encoding not in ("latin1", "latin-1"):
        raise pickle.UnpicklingError(f"bytes encoded as {encoding!r}")
    return codecs.encode(text, "latin1")


def _scalar(kind: np.dtype[Any], content: bytes = b"") -> Any:
    """A single number of NumPy's."""
    if kind.hasobject:
        raise pickle.UnpicklingError("a number made of Python objects")
    return np.frombuffer(content, kind, 1)[0]


def _from_buffer(
    content: bytes | bytearray, kind: np.dtype[Any], shape: tuple[int, ...], order: str
) -> np.ndarray:
    """An array as protocol 5 has it."""
    if kind.hasobject:
        raise pickle.UnpicklingError("an array made of Python objects")
    return np.frombuffer(content, kind).reshape(shape, order="F" if order == "F" else "C")


def _no_bytes() -> bytes:
    """How protocol 2 writes that there are none."""
    return b""


_MAKERS: Mapping[tuple[str, str], Callable[..., Any]] = {
    **{
        (f"numpy.{core}.multiarray", name): maker
        for core in ("core", "_core")
        for name, maker in (("_reconstruct", _MULTIARRAY), ("scalar", _scalar))
    },
    **{(f"numpy.{core}.numeric", "_frombuffer"): _from_buffer for core in ("core", "_core")},
    **{(module, "bytes"): _no_bytes for module in ("builtins", "__builtin__")},
    ("numpy", "ndarray"): np.ndarray,
    ("numpy", "dtype"): np.dtype,
    ("_codecs", "encode"): _encode,
}


class _Unpickler(pickle.Unpickler):
    """Finds what makes arrays, and nothing else."""

    def find_class(self, module: str, name: str) -> Any:
        maker = _MAKERS.get((module, name))
        if maker is None:
            raise pickle.UnpicklingError(f"{module}.{name}, which no array is made of")
        return maker

    def persistent_load(self, pid: Any) -> Any:
        raise pickle.UnpicklingError("a reference to something outside the file")


def read_array_pickle(path: str | PathLike[str]) -> dict[str, Any]:
    """The entries of a pickled dictionary of arrays, text and numbers, Python 2's or 3's.

    Raises:
        DataError: the file cannot be read, is damaged, is no dictionary, or asks for anything that
            is not needed to make an array; nothing of it is executed then.
    """
    file = check_is_file(path)
    try:
        if file.stat().st_size > _LARGEST:
            raise DataError(path, f"more than {_LARGEST >> 30} GiB, which no recording has")
        content = file.read_bytes()
    except OSError as error:
        raise DataError(path, f"cannot be read ({error.strerror or error})") from error
    try:
        found = _Unpickler(io.BytesIO(content), encoding="latin1").load()
    except Exception as error:  # a damaged pickle fails in any way there is
        reason = " ".join(str(error).split()) or type(error).__name__
        raise DataError(
            path, f"is no pickle of arrays, or a damaged one: it holds {reason[:200]}; refused"
        ) from None
    if not isinstance(found, dict) or not all(isinstance(key, str) for key in found):
        raise DataError(path, f"holds a {type(found).__name__}, expected arrays by name")
    return found
