"""A training step of every recipe at paper size, and the time of its matrix products alone.

A step is an update on made-up windows: loss, gradient, clipping and optimizer, with the feed as it
is in the middle of training. Its products are recorded once and done again by the same kernels, on
the same sizes, with nothing in between: the floor. Those inside PyTorch's own LSTM layer, which is
one operation, are done by the fastest exact kernel. ``gflop`` counts their multiplications and
additions; ``ceiling_share`` is their rate in the step as a share of that of one large product.

Recipes whose corpus has a skeleton of its own are taken on it, all others on CMU's 31 joints.
"""

from __future__ import annotations

import argparse
import json
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Any

import torch
from benchmarks.representations import random_motion
from benchmarks.timing import paired, table
from benchmarks.training_step import fastest_rate
from torch import Tensor
from torch.utils._python_dispatch import TorchDispatchMode

from posecast.model import Forecaster
from posecast.model.products import Weight, exact_products
from posecast.motion import Motion
from posecast.motion.tracks import FACING, MOVEMENT, STYLE
from posecast.recipe import Recipe, list_recipes, load_recipe
from posecast.recipe.files import SMALL
from posecast.recipe.system_recipe import CORPUS_SKELETONS
from posecast.representation import Codec
from posecast.skeleton import named_skeleton
from posecast.training import training_loss

PRODUCTS = ("mm", "addmm", "bmm", "baddbmm", "_linear_pointwise")
"""Names of PyTorch's operations that are products, in place or not."""

LAYERS = ("mkldnn_rnn_layer", "mkldnn_rnn_layer_backward")
"""Names of those that are a layer of an LSTM, forward and back."""


def run(rounds: int = 3, names: Sequence[str] = ()) -> list[dict[str, object]]:
    """Rows ``name, ms, products_ms, floor_share, gflop, ceiling_share, foreign_load, threads``.

    Args:
        rounds: timed steps of each recipe.
        names: of recipes; none: all at paper size.
    """
    ceiling = fastest_rate()
    chosen = names or [name for name in list_recipes() if not name.endswith(SMALL)]
    return [_row(load_recipe(name), rounds, ceiling) for name in chosen]


def _row(recipe: Recipe, rounds: int, ceiling: float) -> dict[str, object]:
    update = training_step(recipe)
    update()
    with Products() as products:
        update()
    times = paired({"step": update, "products": products}, "step", rounds=rounds, warmup=1)
    step, floor = times["step"], times["products"]
    return {
        "name": recipe.name,
        "ms": 1e3 * step.median_seconds,
        "products_ms": 1e3 * floor.median_seconds,
        "floor_share": 1 / floor.ratio,
        "gflop": products.operations / 1e9,
        "ceiling_share": products.operations / step.median_seconds / ceiling,
        "foreign_load": step.foreign_load,
        "threads": torch.get_num_threads(),
    }


def forecaster_and_windows(recipe: Recipe) -> tuple[Forecaster, Motion]:
    """A fresh network of a recipe, and a batch of made-up windows."""
    plan = recipe.plan
    corpus = str(recipe.config["corpus"]["kind"])
    known = CORPUS_SKELETONS.get(corpus, lambda: named_skeleton("cmu-31").skeleton)
    plain = recipe.build_codec(known())
    motion = random_motion(plain.skeleton, plan.batch, plan.prefix + plan.horizon)
    motion = motion._replace(
        actions=plain.actions[:1] * plan.batch, tracks=_random_tracks(plain, motion)
    )
    statistics = plain.measure([motion])
    standardized = recipe.config["codec"].get("standardize", "none") != "none"
    codec = recipe.build_codec(known(), statistics if standardized else None)
    return recipe.build_forecaster(codec), motion


def _random_tracks(codec: Codec, motion: Motion) -> dict[str, Tensor]:
    """Something for every track that a codec reads."""
    shape = motion.root_positions.shape[:2]
    styles = 0 if codec.controls is None else len(codec.controls.styles)
    sizes = {MOVEMENT: (2,), FACING: (2,), STYLE: (styles,)}
    return {name: torch.rand(*shape, *sizes.get(name, ())) for name in codec.tracks}


def training_step(recipe: Recipe) -> Callable[[], Tensor]:
    """An update of a fresh network of a recipe on made-up windows."""
    plan = recipe.plan
    forecaster, motion = forecaster_and_windows(recipe)
    weights = list(forecaster.parameters())
    optimizer: torch.optim.Optimizer
    if plan.optimizer == "adam":
        optimizer = torch.optim.Adam(weights, lr=1e-5, fused=True)
    else:
        optimizer = torch.optim.SGD(weights, lr=1e-5)
    mask = recipe.feed.mask(plan.horizon, plan.epochs // 2, torch.Generator().manual_seed(0))

    def update() -> Tensor:
        optimizer.zero_grad()
        loss = training_loss(
            forecaster, motion, prefix=plan.prefix, mask=mask, objective=recipe.objective
        ).total
        loss.backward()
        if plan.clip is not None:
            torch.nn.utils.clip_grad_norm_(weights, plan.clip)
        optimizer.step()
        return loss.detach()

    return update


class Products(TorchDispatchMode):
    """Records the products of what runs inside of it; called, does them again.

    Of products of one kind on factors of the same sizes the first's factors stand for all.
    """

    def __init__(self) -> None:
        super().__init__()
        self.operations = 0
        self._calls: dict[tuple[object, ...], Callable[[], object]] = {}
        self._counts: Counter[tuple[object, ...]] = Counter()

    def __torch_dispatch__(self, func, types, args=(), kwargs=None):  # type: ignore[no-untyped-def]
        kwargs = kwargs or {}
        found = func(*args, **kwargs)
        name = func.overloadpacket.__name__.removesuffix("_")
        if name in PRODUCTS:
            self._note(func, args, kwargs, found)
        elif name in LAYERS:
            self._note_layer(args, backward=name == LAYERS[1])
        return found

    def _note_layer(self, args: tuple[Any, ...], *, backward: bool) -> None:
        """The products inside of an LSTM layer: of all frames with one weight, then one by one."""
        frames, below, own = args[:3]
        steps, batch = frames.shape[:2]
        self.operations += (4 if backward else 2) * steps * batch * (below.numel() + own.numel())
        key = ("layer", backward, tuple(frames.shape), tuple(own.shape))
        self._counts[key] += 1
        if key not in self._calls:
            self._calls[key] = _layer_products(frames, below, own, backward=backward)

    def _note(self, func: Any, args: tuple[Any, ...], kwargs: dict[str, Any], found: Any) -> None:
        factors = [value for value in args if isinstance(value, Tensor)]
        precision = torch.get_float32_matmul_precision()
        key = (func, precision, *((tuple(f.shape), _strides(f)) for f in factors))
        # What is added comes first where something is.
        added = func.overloadpacket.__name__.removesuffix("_") in ("addmm", "baddbmm")
        self.operations += 2 * found.numel() * args[1 if added else 0].shape[-1]
        self._counts[key] += 1

        def again() -> object:
            torch.set_float32_matmul_precision(precision)
            return func(*args, **kwargs)

        self._calls.setdefault(key, again)

    def __call__(self) -> None:
        before = torch.get_float32_matmul_precision()
        try:
            with torch.no_grad():
                for key, call in self._calls.items():
                    for _ in range(self._counts[key]):
                        call()
        finally:
            torch.set_float32_matmul_precision(before)


def _layer_products(
    frames: Tensor, below: Tensor, own: Tensor, *, backward: bool
) -> Callable[[], object]:
    """The products of an LSTM layer, forward or back, on random factors."""
    rows = frames.detach().flatten(0, 1).contiguous()
    steps, batch, gates = len(frames), frames.shape[1], len(own)
    bias, state = torch.zeros(gates), torch.randn(batch, own.shape[1])
    states, slopes = torch.randn(len(rows), own.shape[1]), torch.randn(len(rows), gates)
    weights = Weight(below), Weight(own)

    def forward() -> None:
        weights[0].product(rows, bias)
        for _ in range(steps):
            weights[1].product(state, bias)

    def back() -> None:
        weights[0].back(slopes, onto=torch.zeros_like(rows))
        for _ in range(steps):
            weights[1].back(slopes[:batch], onto=state)
        with exact_products(slopes):
            slopes.t() @ rows
            slopes.t() @ states

    return back if backward else forward


def _strides(values: Tensor) -> tuple[int, ...]:
    """How a factor lies in memory; a packed one has no strides."""
    return () if values.is_mkldnn else values.stride()


def main() -> None:
    """Print the rows as a table, or as JSON."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rounds", type=int, default=3, help="timed steps (default 3)")
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")
    parser.add_argument("names", nargs="*", help="recipes; all at paper size")
    arguments = parser.parse_args()
    rows = run(rounds=arguments.rounds, names=arguments.names)
    print(json.dumps(rows, indent=1) if arguments.json else table(rows))


if __name__ == "__main__":
    main()
