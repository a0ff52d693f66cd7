"""Shapes are checked at run time in the whole suite; fixtures that every test may use."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from jaxtyping import install_import_hook

install_import_hook("posecast", "beartype.beartype")

import torch  # noqa: E402


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
