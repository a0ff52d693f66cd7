"""A trained forecaster as a plain folder: YAML, JSON and safetensors, never unpickled.

``recipe.yaml`` is the resolved recipe, ``checkpoint.json`` the skeleton, the body, the frame rate
and how far training had come, ``weights.safetensors`` every tensor. The folder is written beside
its place and renamed, so that a reader meets the old one or the new one, never half of one.
"""

from __future__ import annotations

import hashlib
import json
import math
import shutil
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml
from safetensors import SafetensorError
from safetensors.torch import load as load_tensors
from safetensors.torch import save as tensors_to_bytes
from torch import Tensor

from posecast.errors import DataError, SkeletonError
from posecast.skeleton import Skeleton

FORMAT = 1
RECIPE, FACTS, WEIGHTS = "recipe.yaml", "checkpoint.json", "weights.safetensors"


@dataclass(frozen=True, eq=False)
class Checkpoint:
    """What a checkpoint folder holds.

    Args:
        recipe: the resolved recipe, nested dictionaries.
        skeleton: the joints the forecaster was trained on.
        offsets: a body for the skeleton, metres: one row (x, y, z) a joint.
        fps: frames per second of the forecaster's steps.
        tensors: weights and statistics by name.
        progress: how far training had come: epoch, metrics, seed.
    """

    recipe: Mapping[str, Any]
    skeleton: Skeleton
    offsets: tuple[tuple[float, float, float], ...]
    fps: float
    tensors: Mapping[str, Tensor]
    progress: Mapping[str, Any]


def save_checkpoint(checkpoint: Checkpoint, folder: Path) -> None:
    """Write ``checkpoint`` to ``folder``, replacing what is there in one step.

    Raises:
        DataError: the folder cannot be written, or holds something that is not a checkpoint.
    """
    folder = folder.absolute()
    foreign = folder.exists() and not is_checkpoint(folder)
    if foreign and (not folder.is_dir() or any(folder.iterdir())):
        raise DataError(
            folder, "exists and is not a checkpoint; choose another folder or remove it first"
        )
    weights = tensors_to_bytes(
        {name: value.contiguous() for name, value in checkpoint.tensors.items()}
    )
    facts = {
        "format": FORMAT,
        "skeleton": {
            "names": list(checkpoint.skeleton.names),
            "parents": list(checkpoint.skeleton.parents),
        },
        "offsets": [list(offset) for offset in checkpoint.offsets],
        "fps": checkpoint.fps,
        "progress": dict(checkpoint.progress),
        "weights_sha256": hashlib.sha256(weights).hexdigest(),
    }
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        fresh = Path(tempfile.mkdtemp(prefix=f".{folder.name}-", dir=folder.parent))
    except OSError as error:
        raise DataError(folder, f"cannot be written ({error.strerror})") from None
    try:
        (fresh / RECIPE).write_text(
            yaml.safe_dump(dict(checkpoint.recipe), sort_keys=False, allow_unicode=True), "utf-8"
        )
        (fresh / FACTS).write_text(json.dumps(facts, indent=1) + "\n", "utf-8")
        (fresh / WEIGHTS).write_bytes(weights)
        fresh.chmod(0o755)
        _replace_folder(fresh, folder)
    except OSError as error:
        raise DataError(folder, f"cannot be written ({error.strerror})") from None
    finally:
        shutil.rmtree(fresh, ignore_errors=True)


def is_checkpoint(folder: Path) -> bool:
    """Whether ``folder`` holds the three files of a checkpoint."""
    return all((folder / name).is_file() for name in (RECIPE, FACTS, WEIGHTS))


def load_checkpoint(folder: Path) -> Checkpoint:
    """Read a checkpoint folder. Nothing in it is executed, whoever wrote it.

    Raises:
        DataError: not a checkpoint, a damaged one, or one of a newer format.
    """
    folder = folder.absolute()
    if not is_checkpoint(folder):
        previous = _previous(folder)
        if not is_checkpoint(previous):
            raise DataError(
                folder,
                f"not a checkpoint: expected a folder with {RECIPE}, {FACTS} and {WEIGHTS}; "
                + _checkpoints_near(folder),
            )
        folder = previous
    facts = _read_facts(folder / FACTS)
    weights = (folder / WEIGHTS).read_bytes()
    if hashlib.sha256(weights).hexdigest() != facts.get("weights_sha256"):
        raise DataError(
            folder / WEIGHTS,
            f"does not match the checksum in {FACTS}; the file is damaged or was exchanged: "
            "copy the folder again",
        )
    try:
        tensors = load_tensors(weights)
        recipe = yaml.safe_load((folder / RECIPE).read_text("utf-8"))
    except RecursionError:
        raise DataError(folder / RECIPE, "brackets nested too deep for a recipe") from None
    except (SafetensorError, yaml.YAMLError, UnicodeDecodeError) as error:
        raise DataError(folder, f"damaged: {' '.join(str(error).split())}") from None
    if not isinstance(recipe, dict):
        raise DataError(
            folder / RECIPE,
            "no mapping of keys to values, expected a recipe; copy the folder again",
        )
    try:
        checkpoint = Checkpoint(
            recipe=recipe,
            skeleton=Skeleton(
                tuple(str(name) for name in facts["skeleton"]["names"]),
                tuple(int(parent) for parent in facts["skeleton"]["parents"]),
            ),
            offsets=tuple((float(x), float(y), float(z)) for x, y, z in facts["offsets"]),
            fps=float(facts["fps"]),
            tensors=tensors,
            progress=dict(facts["progress"]),
        )
    except (KeyError, TypeError, ValueError, OverflowError, SkeletonError) as error:
        raise DataError(folder / FACTS, f"damaged ({error}); copy the folder again") from None
    body = [number for offset in checkpoint.offsets for number in offset]
    if len(body) != 3 * len(checkpoint.skeleton) or not all(map(math.isfinite, body)):
        raise DataError(
            folder / FACTS,
            f"damaged (offsets of {len(checkpoint.offsets)} joints, {len(checkpoint.skeleton)} "
            "expected, all finite); copy the folder again",
        )
    return checkpoint


def _checkpoints_near(folder: Path) -> str:
    """What to do about a folder that is no checkpoint: the ones inside it, or beside it."""
    names = ("best", "last")
    near = [place / name for place in (folder, folder.parent) for name in names]
    found = [str(place) for place in near if is_checkpoint(place)]
    if found:
        return f"take {' or '.join(found)}"
    return "posecast train writes RUN/last, and RUN/best where there are validation clips"


def _read_facts(path: Path) -> dict[str, Any]:
    """The JSON file, its format checked."""
    try:
        facts = json.loads(path.read_text("utf-8"))
    except RecursionError:
        raise DataError(path, "brackets nested too deep for what a checkpoint says") from None
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise DataError(path, f"not valid JSON ({error}); copy the folder again") from None
    found = facts.get("format") if isinstance(facts, dict) else None
    if isinstance(found, bool) or not isinstance(found, int) or not 1 <= found <= FORMAT:
        raise DataError(
            path, f"checkpoint format {found!r}, this version reads up to {FORMAT}; update posecast"
        )
    return facts


def _previous(folder: Path) -> Path:
    """Where the checkpoint that is being replaced waits until the new one is in place."""
    return folder.with_name(f"{folder.name}.previous")


def _replace_folder(fresh: Path, folder: Path) -> None:
    """Put ``fresh`` in the place of ``folder``; a kill in between leaves ``folder.previous``."""
    previous = _previous(folder)
    if folder.exists():
        shutil.rmtree(previous, ignore_errors=True)
        folder.replace(previous)
    fresh.replace(folder)
    shutil.rmtree(previous, ignore_errors=True)
