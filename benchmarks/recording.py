"""A training step recorded as a CUDA graph, beside the same step operation by operation."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence

import torch
from benchmarks.recipe_steps import forecaster_and_windows
from benchmarks.timing import paired, table
from torch import Tensor

from posecast.recipe import Recipe, load_recipe
from posecast.training.recording import Recorder
from posecast.training.step import Example, attempt

NAMES = ("quaternet-vel", "h36m-quaternet-spl", "quaternet-locomotion")


def run(rounds: int = 10, names: Sequence[str] = NAMES) -> list[dict[str, object]]:
    """Milliseconds of an update, and how far loss and gradient of the two are apart.

    The mask is free running, as late in training; ``gradient_difference`` is the length of the
    difference as a share of the gradient's. Without an NVIDIA GPU there are no rows.

    Args:
        rounds: timed updates of each recipe.
        names: of recipes.
    """
    if not torch.cuda.is_available():
        return []
    return [row for name in names for row in _rows(load_recipe(name), rounds)]


def _rows(recipe: Recipe, rounds: int) -> list[dict[str, object]]:
    candidates = {"one by one": Update(recipe, recorded=False), "recorded": Update(recipe)}
    losses = {name: update() for name, update in candidates.items()}
    gradients = {name: torch.cat(update.gradient()) for name, update in candidates.items()}
    apart = gradients["recorded"] - gradients["one by one"]
    timings = paired(candidates, "one by one", rounds=rounds, warmup=3)
    return [
        {
            "name": recipe.name,
            "candidate": name,
            "device": torch.cuda.get_device_name(),
            "ms": 1000 * timing.median_seconds,
            "ratio": timing.ratio,
            "loss": losses[name].item(),
            "gradient_difference": float(apart.norm() / gradients["one by one"].norm()),
        }
        for name, timing in timings.items()
    ]


class Update:
    """An update of a fresh network of a recipe, on the GPU."""

    def __init__(self, recipe: Recipe, *, recorded: bool = True) -> None:
        torch.manual_seed(0)
        forecaster, motion = forecaster_and_windows(recipe)
        self.recipe, self.forecaster = recipe, forecaster.cuda()
        self.example = Example.of(forecaster.codec, motion.map(lambda values: values.cuda()))
        self.mask = torch.arange(recipe.plan.horizon) == 0
        self.optimizer = torch.optim.Adam(forecaster.parameters(), lr=1e-6, fused=True)
        self.recorder = (
            Recorder(forecaster, recipe.objective, prefix=recipe.plan.prefix) if recorded else None
        )

    def __call__(self) -> Tensor:
        self.optimizer.zero_grad()
        loss = self._loss()
        loss.backward()
        if self.recipe.plan.clip is not None:
            torch.nn.utils.clip_grad_norm_(self.forecaster.parameters(), self.recipe.plan.clip)
        self.optimizer.step()
        torch.cuda.synchronize()
        return loss.detach().clone()

    def gradient(self) -> list[Tensor]:
        """Of all weights, flat."""
        self.optimizer.zero_grad()
        self._loss().backward()
        weights = self.forecaster.parameters()
        return [weight.grad.flatten().clone() for weight in weights if weight.grad is not None]

    def _loss(self) -> Tensor:
        if self.recorder is not None:
            return self.recorder(self.example, self.mask).total
        objective = self.recipe.objective
        return objective(
            attempt(
                self.forecaster,
                self.example,
                prefix=self.recipe.plan.prefix,
                mask=self.mask,
                order=objective.order,
            ).comparison
        ).total


def main() -> None:
    """Print the rows as a table, or as JSON."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rounds", type=int, default=10, help="timed updates (default 10)")
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")
    parser.add_argument("names", nargs="*", default=NAMES, help="recipes")
    arguments = parser.parse_args()
    rows = run(arguments.rounds, arguments.names)
    print(json.dumps(rows, indent=1) if arguments.json else table(rows))


if __name__ == "__main__":
    main()
