"""Shapes are checked at run time in the whole suite; fixtures that every test may use."""

from __future__ import annotations

import os
import sys
import types
from collections.abc import Iterator
from pathlib import Path

import jaxtyping
import pytest
from beartype import BeartypeConf, beartype
from jaxtyping import install_import_hook

# The hook takes a checker by name. Ours lets a whole number stand for a float, as Python does.
_checker = types.ModuleType("posecast_shape_checker")
_checker.check = beartype(conf=BeartypeConf(is_pep484_tower=True))  # type: ignore[attr-defined]
sys.modules[_checker.__name__] = _checker
install_import_hook("posecast", "posecast_shape_checker.check")

import torch  # noqa: E402

# Tests work on small tensors and run several at a time: threads would only wait for each other.
torch.set_num_threads(1)


@pytest.fixture
def generator() -> torch.Generator:
    """A random generator with a fixed seed, new for every test."""
    return torch.Generator().manual_seed(20190117)


@pytest.fixture(scope="session")
def data_root() -> Path:
    """Folder with unpacked real motion capture; the test is skipped where there is none."""
    root = os.environ.get("POSECAST_DATA")
    if not root or not Path(root).is_dir():
        pytest.skip("POSECAST_DATA does not name a folder of real motion capture")
    return Path(root)


@pytest.fixture
def onnx_extra() -> Iterator[None]:
    """What exports and runs a step; the test is skipped without it.

    Meanwhile shapes are not checked: the exporter's are symbols, which are no numbers to a checker.
    """
    for package in ("onnx", "onnxscript", "onnxruntime"):
        pytest.importorskip(package)
    jaxtyping.config.update("jaxtyping_disable", True)
    yield
    jaxtyping.config.update("jaxtyping_disable", False)
