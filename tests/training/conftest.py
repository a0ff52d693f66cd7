"""The tiny corpus and forecaster of ``tiny.py``, which subprocesses run too."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import pytest


@pytest.fixture(scope="session")
def tiny() -> ModuleType:
    """The module beside this file; test folders are not packages."""
    spec = importlib.util.spec_from_file_location(
        "training_tiny", Path(__file__).with_name("tiny.py")
    )
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["training_tiny"] = module
    spec.loader.exec_module(module)
    return module
