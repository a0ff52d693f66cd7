"""What a run needs in order to go on after a kill: one safetensors file, replaced whole."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from safetensors import SafetensorError, safe_open
from safetensors.torch import save as tensors_to_bytes
from torch import Tensor, nn
from torch.optim import Optimizer

from posecast.errors import ConfigError, DataError
from posecast.io.atomic import atomic_write

FORMAT = 1
KEY = "posecast_training"


@dataclass(frozen=True, eq=False)
class TrainingState:
    """A run after a whole number of epochs.

    No state of a random generator is kept: every draw is addressed by seed and epoch.

    Args:
        epoch: epochs done, which is the number of the next one.
        updates: optimizer steps done.
        settings: what the run was started with, as far as it decides the outcome.
        best: the best validation so far, ``{"epoch": ..., "metrics": {...}}``; ``None``: none yet.
        weights: the forecaster's tensors by name.
        moments: the optimizer's tensors, named ``<parameter>/<entry>``.
        waited: how long the run has waited for a better validation; ``None``: none yet.
        discriminators: tensors of the discriminators by name; empty without an adversary.
        discriminator_moments: those of their optimizer, named likewise.
    """

    epoch: int
    updates: int
    settings: Mapping[str, Any]
    best: Mapping[str, Any] | None
    weights: Mapping[str, Tensor]
    moments: Mapping[str, Tensor]
    waited: Mapping[str, float] | None = None
    discriminators: Mapping[str, Tensor] = field(default_factory=dict)
    discriminator_moments: Mapping[str, Tensor] = field(default_factory=dict)


def write_state(state: TrainingState, path: Path) -> None:
    """Write ``state``; whoever reads ``path`` meets the old file or the new one.

    Raises:
        DataError: the file cannot be written.
    """
    facts = {
        "format": FORMAT,
        "epoch": state.epoch,
        "updates": state.updates,
        "settings": dict(state.settings),
        "best": None if state.best is None else dict(state.best),
        "waited": None if state.waited is None else dict(state.waited),
    }
    parts = {
        "weights/": state.weights,
        "moments/": state.moments,
        "discriminators/": state.discriminators,
        "discriminator_moments/": state.discriminator_moments,
    }
    tensors = {
        f"{prefix}{name}": value for prefix, part in parts.items() for name, value in part.items()
    }
    with atomic_write(path) as temporary:
        # Copies, because the format refuses tensors that share memory, as tied weights do.
        copies = {name: value.detach().cpu().clone() for name, value in tensors.items()}
        try:
            # Not save_file: what it writes is closed to all other users.
            temporary.write_bytes(tensors_to_bytes(copies, metadata={KEY: json.dumps(facts)}))
        except (OSError, SafetensorError) as error:
            raise DataError(path, f"cannot be written ({error})") from None


def read_state(path: Path) -> TrainingState:
    """Read what ``write_state`` wrote. Nothing in the file is executed.

    Raises:
        DataError: the file cannot be read, is damaged, or is of a newer format.
    """
    try:
        with safe_open(path, framework="pt") as file:
            facts = json.loads((file.metadata() or {})[KEY])
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
        if facts["format"] != FORMAT:
            raise DataError(
                path,
                f"training state of format {facts['format']!r}, this version reads {FORMAT}; "
                "finish the run with the version that began it, or start again elsewhere",
            )
        return TrainingState(
            epoch=int(facts["epoch"]),
            updates=int(facts["updates"]),
            settings=dict(facts["settings"]),
            best=facts["best"],
            weights=_below("weights/", tensors),
            moments=_below("moments/", tensors),
            waited=facts.get("waited"),
            discriminators=_below("discriminators/", tensors),
            discriminator_moments=_below("discriminator_moments/", tensors),
        )
    except (OSError, SafetensorError, KeyError, TypeError, ValueError) as error:
        raise DataError(
            path,
            f"is not a training state, or a damaged one ({error}); "
            "remove it to start the run again",
        ) from None


def optimizer_moments(optimizer: Optimizer, module: nn.Module) -> dict[str, Tensor]:
    """The optimizer's tensors under the names of the parameters they belong to."""
    return {
        f"{name}/{entry}": value
        for name, parameter in module.named_parameters()
        for entry, value in optimizer.state.get(parameter, {}).items()
        if isinstance(value, Tensor)
    }


def restore_moments(optimizer: Optimizer, module: nn.Module, moments: Mapping[str, Tensor]) -> None:
    """Give an optimizer over all of ``module``'s parameters the tensors it had, on their device."""
    entries: dict[int, dict[str, Tensor]] = {}
    for place, (name, _) in enumerate(module.named_parameters()):
        entries[place] = _below(f"{name}/", moments)
    known = {place: entry for place, entry in entries.items() if entry}
    optimizer.load_state_dict({**optimizer.state_dict(), "state": known})


def check_settings(found: Mapping[str, Any], wanted: Mapping[str, Any], path: Path) -> None:
    """Refuse to go on with a run that was started otherwise.

    Raises:
        ConfigError: naming each setting, its value then and now.
    """
    changed = [
        f"{name} was {found.get(name)!r}, now {wanted.get(name)!r}"
        for name in sorted({*found, *wanted})
        if found.get(name) != wanted.get(name)
    ]
    if changed:
        raise ConfigError(
            f"{path}: this run was started with other settings ({'; '.join(changed)}); "
            "resume with those, or train in another folder"
        )


def _below(prefix: str, tensors: Mapping[str, Tensor]) -> dict[str, Tensor]:
    """Tensors whose names begin with ``prefix``, without it."""
    return {
        name.removeprefix(prefix): value
        for name, value in tensors.items()
        if name.startswith(prefix)
    }
