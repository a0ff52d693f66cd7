"""Pickled arrays, as the first release of AMASS has them, read without executing anything.

A pickle is a program that may call any function by name. This reader knows the few names that NumPy
arrays are made with, has harmless things of its own for them, and refuses every other.
"""

from __future__ import annotations

import io
import pickle
import re
from collections.abc import Callable, Mapping
from os import PathLike
from typing import Any, ClassVar

import numpy as np

from posecast.errors import DataError
from posecast.io.files import check_is_file

_LARGEST = 1 << 31
"""Bytes; recordings have a hundredth of that."""

_CODE = re.compile(r"b1|[iu][1248]|f[248]|[SU][0-9]{1,6}")
"""Truth values, whole numbers, numbers and text: what NumPy calls their types."""


class _Kind:
    """Stands for NumPy's ``dtype``: a type of numbers or text, and the order of its bytes."""

    def __init__(self, code: str, align: bool | int = False, copy: bool | int = True) -> None:
        if not isinstance(code, str) or not _CODE.fullmatch(code):
            raise pickle.UnpicklingError(f"values of type {code!r}, expected numbers or text")
        self.code, self.order = code, "="

    def __setstate__(self, state: tuple[Any, ...]) -> None:
        _, order, *inner = state
        if order not in ("<", ">", "|", "=") or any(part is not None for part in inner[:3]):
            raise pickle.UnpicklingError("a type of values that is made of others")
        self.order = order

    def read(self, content: bytes | bytearray) -> np.ndarray:
        """The values that some bytes are."""
        return np.frombuffer(content, np.dtype(self.order.replace("|", "") + self.code))


class _Array:
    """Stands for NumPy's ``ndarray`` until its state comes."""

    values: np.ndarray

    def __setstate__(self, state: tuple[Any, ...]) -> None:
        _, shape, kind, is_fortran, content = state
        if isinstance(content, str):  # bytes of Python 2
            content = content.encode("latin1")
        self.values = _filled(content, kind, shape, "F" if is_fortran else "C")


class _ArrayClass:
    """Stands for the name ``ndarray``, which only ``_reconstruct`` is given; makes nothing."""


def _filled(content: object, kind: object, shape: object, order: str) -> np.ndarray:
    """An array of some bytes, which are copied."""
    if not isinstance(kind, _Kind) or not isinstance(content, bytes | bytearray):
        raise pickle.UnpicklingError("an array of something else than numbers or text")
    if not isinstance(shape, tuple) or not all(type(size) is int and size >= 0 for size in shape):
        raise pickle.UnpicklingError(f"an array of shape {shape!r}")
    return kind.read(content).reshape(shape, order="F" if order == "F" else "C").copy()


def _reconstruct(kind: object, shape: object, code: object) -> _Array:
    """An array that is to be filled."""
    return _Array()


def _from_buffer(content: object, kind: object, shape: object, order: str) -> np.ndarray:
    """An array as protocol 5 has it."""
    return _filled(content, kind, shape, order)


def _scalar(kind: object, content: object = b"") -> Any:
    """A single number of NumPy's."""
    if isinstance(content, str):
        content = content.encode("latin1")
    return _filled(content, kind, (1,), "C")[0]


def _encode(text: str, encoding: str = "latin1") -> bytes:
    """What Python 2 wrote as bytes; no other encoding is ever looked up."""
    if encoding not in ("latin1", "latin-1"):
        raise pickle.UnpicklingError(f"bytes encoded as {encoding!r}")
    return text.encode("latin1")


def _no_bytes() -> bytes:
    """How protocol 2 writes that there are none."""
    return b""


_MAKERS: Mapping[tuple[str, str], Callable[..., Any]] = {
    **{
        (f"numpy.{core}.multiarray", name): maker
        for core in ("core", "_core")
        for name, maker in (("_reconstruct", _reconstruct), ("scalar", _scalar))
    },
    **{(f"numpy.{core}.numeric", "_frombuffer"): _from_buffer for core in ("core", "_core")},
    **{(module, "bytes"): _no_bytes for module in ("builtins", "__builtin__")},
    ("numpy", "ndarray"): _ArrayClass,
    ("numpy", "dtype"): _Kind,
    ("_codecs", "encode"): _encode,
}
"""What a name in the file stands for: nothing of NumPy's own is ever handed to it."""


class _Unpickler(pickle._Unpickler):
    """Finds what makes arrays, and nothing else; gives a state to nothing but these.

    Python's own, not the faster one in C, whose steps cannot be overridden.
    """

    dispatch: ClassVar = dict(pickle._Unpickler.dispatch)

    def find_class(self, module: str, name: str) -> Any:
        maker = _MAKERS.get((module, name))
        if maker is None:
            raise pickle.UnpicklingError(f"{module}.{name}, which no array is made of")
        return maker

    def persistent_load(self, pid: Any) -> Any:
        raise pickle.UnpicklingError("a reference to something outside the file")

    def load_build(self) -> None:
        # A state for a function or a class would change it for every file read after this one.
        if not isinstance(self.stack[-2], _Array | _Kind):  # type: ignore[attr-defined]
            raise pickle.UnpicklingError("a state of something that is no array")
        super().load_build()  # type: ignore[misc]

    dispatch[pickle.BUILD[0]] = load_build  # type: ignore[assignment]


def _settle(found: Any) -> Any:
    """What was found, with arrays in the places of those that stood for them."""
    if isinstance(found, _Array):
        if not hasattr(found, "values"):
            raise pickle.UnpicklingError("an array that was never filled")
        return found.values
    if isinstance(found, dict):
        return {key: _settle(value) for key, value in found.items()}
    if isinstance(found, list | tuple):
        return type(found)(_settle(value) for value in found)
    if found is None or isinstance(found, np.ndarray | np.generic | str | bytes | int | float):
        return found
    raise pickle.UnpicklingError(f"a {type(found).__name__}, expected arrays, text or numbers")


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
        found = _settle(_Unpickler(io.BytesIO(content), encoding="latin1").load())
    except Exception as error:  # a damaged pickle fails in any way there is
        reason = " ".join(str(error).split()) or type(error).__name__
        raise DataError(
            path, f"is no pickle of arrays, or a damaged one: it holds {reason[:200]}; refused"
        ) from None
    if not isinstance(found, dict) or not all(isinstance(key, str) for key in found):
        raise DataError(path, f"holds a {type(found).__name__}, expected arrays by name")
    return found
