"""The packages of the extra ``onnx``, imported when a step is exported or run and not before."""

from __future__ import annotations

import importlib
from importlib.util import find_spec
from typing import Any

from posecast.errors import ConfigError

EXTRA = ("onnx", "onnxscript", "onnxruntime")


def has_extra() -> bool:
    """Whether everything is there that a step in ONNX Runtime takes."""
    return not _missing()


def require_extra() -> None:
    """Ask for everything that a step in ONNX Runtime takes, before any work.

    Raises:
        ConfigError: some of it is not installed.
    """
    for name in _missing():
        raise ConfigError(
            f"exported steps need {name}, which is not installed; pip install posecast[onnx]"
        )


def onnx_module(name: str) -> Any:
    """A module of the extra; see ``require_extra``."""
    return importlib.import_module(name)


def _missing() -> list[str]:
    return [name for name in EXTRA if find_spec(name) is None]
