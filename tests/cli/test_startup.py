"""What starting posecast loads: help is instant, and inference never loads a trainer."""

from __future__ import annotations

import subprocess
import sys

import pytest

HEAVY = ("torch", "lightning", "matplotlib", "tensorboard", "scipy")


def _loaded_by(statement: str) -> set[str]:
    """Top-level modules that are loaded after ``statement``, in a fresh interpreter."""
    script = f"import sys\n{statement}\nprint(*{{module.split('.')[0] for module in sys.modules}})"
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    return set(done.stdout.split())


def test_importing_posecast_loads_nothing_heavy() -> None:
    assert not _loaded_by("import posecast") & set(HEAVY)


@pytest.mark.parametrize("arguments", [["--help"], ["train", "--help"], ["--version"]])
def test_help_loads_nothing_heavy(arguments: list[str]) -> None:
    call = (
        "import contextlib, io\n"
        "from posecast.cli.main import main\n"
        "with contextlib.redirect_stdout(io.StringIO()), contextlib.suppress(SystemExit):\n"
        f"    main({arguments!r})"
    )
    assert not _loaded_by(call) & set(HEAVY)


def test_using_a_checkpoint_loads_neither_trainer_nor_plots() -> None:
    names = (
        "import posecast; posecast.load, posecast.rollout, posecast.evaluate, posecast.read_clip"
    )
    loaded = _loaded_by(names)
    assert "torch" in loaded
    assert not loaded & {"lightning", "matplotlib", "tensorboard"}


def test_every_public_name_can_be_had() -> None:
    import posecast

    assert len(posecast.__all__) > 20
    for name in posecast.__all__:
        assert getattr(posecast, name).__name__ == name
    assert set(posecast.__all__) <= set(dir(posecast))


def test_a_name_that_is_not_there_is_an_attribute_error() -> None:
    import posecast

    with pytest.raises(AttributeError, match="has no attribute 'forecasts'"):
        _ = posecast.forecasts
