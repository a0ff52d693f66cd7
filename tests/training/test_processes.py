"""One run on two processes gives the evaluation of the same run on one."""

from __future__ import annotations

import csv
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
import torch
from safetensors.torch import load_file

from posecast.training import STATE, Adversary
from posecast.training.state import read_state

EPOCHS = 12
WORKER = Path(__file__).with_name("worker.py")

# Sums over a batch are made in another order, in float32; over 24 updates that grows to this.
TOLERANCE = 3e-5


def table(path: Path) -> torch.Tensor:
    """The numbers of a table, without the column that depends on the clock."""
    with path.open(newline="") as file:
        rows = list(csv.DictReader(file))
    kept = [[float(value) for name, value in row.items() if name != "seconds"] for row in rows]
    return torch.tensor(kept, dtype=torch.float64)


def _search_path(environment: dict[str, str]) -> list[str]:
    """Where Python looks for modules, besides the usual places."""
    return [place for place in environment.get("PYTHONPATH", "").split(os.pathsep) if place]


def run(*command: str | Path) -> None:
    """Run to the end, with one thread a process and no trace of an outer launcher."""
    launched = ("RANK", "WORLD_SIZE", "LOCAL_", "GROUP_", "ROLE_", "MASTER_", "TORCHELASTIC_")
    environment = {
        name: value for name, value in os.environ.items() if not name.startswith(launched)
    }
    search = os.pathsep.join([str(WORKER.parent), *_search_path(environment)])
    found = subprocess.run(
        [sys.executable, "-W", "error::UserWarning", *command],
        env={**environment, "OMP_NUM_THREADS": "1", "PYTHONPATH": search},
        capture_output=True,
        text=True,
        timeout=200,
        check=False,
    )
    assert found.returncode == 0, found.stderr[-3000:]


@pytest.mark.parametrize(
    ("launcher", "adversary", "carry"),
    [
        ("torchrun", None, 0.7),
        ("torchrun", {"fidelity": 0.3, "continuity": 0.2, "hidden": 6}, 0.0),
        pytest.param("lightning", None, 0.0, marks=pytest.mark.slow),
    ],
)
def test_two_processes_give_the_evaluation_of_one(tiny, tmp_path, launcher, adversary, carry):
    opposed = None if adversary is None else Adversary(**adversary)
    tiny.train(tmp_path / "one", epochs=EPOCHS, adversary=opposed, carry=carry)
    two = tmp_path / "two"
    arguments = [two, str(EPOCHS), "0"]
    if adversary is not None or carry:
        arguments += ["auto", json.dumps(adversary) if adversary else "", str(carry)]
    if launcher == "torchrun":
        run("-m", "torch.distributed.run", "--standalone", "--nproc-per-node=2", WORKER, *arguments)
    else:
        run(WORKER, *arguments, "2")
    updates, best = (two / "done").read_text().split()
    assert int(updates) == 2 * EPOCHS  # batches of 3 and 1: uneven shares, and an empty one
    assert 1 <= int(best) <= EPOCHS
    for name in ("log.csv", "validation.csv"):
        one_table, two_table = table(tmp_path / "one" / name), table(two / name)
        assert one_table.shape[0] == EPOCHS
        torch.testing.assert_close(two_table, one_table, rtol=TOLERANCE, atol=TOLERANCE)
    weights = [
        load_file(folder / "last" / "weights.safetensors") for folder in (tmp_path / "one", two)
    ]
    assert len(weights[0]) > 4
    if adversary is not None:
        states = [read_state(folder / STATE) for folder in (tmp_path / "one", two)]
        assert len(states[0].discriminators) == 2 * 8
        weights = [
            {**found, **state.discriminators} for found, state in zip(weights, states, strict=True)
        ]
    for name, value in weights[0].items():
        torch.testing.assert_close(weights[1][name], value, rtol=0, atol=TOLERANCE)
