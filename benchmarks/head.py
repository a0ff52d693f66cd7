"""The structured head against a network a joint in a loop: ``python benchmarks/head.py --help``.

The loop is the usual way to write it: one ``torch.nn.Sequential`` a joint, which reads the context
and what was predicted above it, all joints above (dense). Both have the same weights; results and
gradients are compared before anything is timed. "default" products are PyTorch's own choice;
"medium" lets it take oneDNN's kernel, which is the faster one on AMD and exact there, and rounds to
bfloat16 where there is AMX. The head takes that kernel by itself where it is exact.

The context's product alone, by that kernel, is what no head can be faster than.

Launches are operations of PyTorch's in one call: what an accelerator waits for.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import torch
from torch import Tensor, nn
from torch.utils._python_dispatch import TorchDispatchMode

sys.path.insert(0, str(Path(__file__).parent))
from timing import main_of, paired, rows_of

from posecast.model import StructuredHead
from posecast.model.products import exact_products
from posecast.skeleton import Skeleton, named_skeleton

CONTEXT, JOINT_DIM, HIDDEN = 1024, 9, 64
SKELETONS = ("h36m-21", "smpl-15")
ROWS = (64, 64 * 120)


class Loop(nn.Module):
    """A network a joint, called one after the other."""

    def __init__(self, head: StructuredHead, skeleton: Skeleton) -> None:
        super().__init__()
        self.reads = head.order.reads
        self.networks = nn.ModuleList(nn.Identity() for _ in skeleton.names)
        slot = 0
        for number, joints in enumerate(head.order.groups):
            for place, joint in enumerate(joints):
                self.networks[joint] = _network(head, number, place, slot)
                slot += 1

    def forward(self, context: Tensor) -> Tensor:
        """Numbers for every joint."""
        done: list[Tensor] = []
        for network, reads in zip(self.networks, self.reads, strict=True):
            done.append(network(torch.cat([context, *(done[joint] for joint in reads)], dim=-1)))
        return torch.stack(done, dim=-2)


def _network(head: StructuredHead, number: int, place: int, slot: int) -> nn.Sequential:
    """The network of one joint with the head's own weights."""
    rows = slice(slot * head.units, (slot + 1) * head.units)
    weight = head.context.weight[rows]
    if number:
        weight = torch.cat([weight, head.above[number - 1][place]], dim=1)
    first = nn.Linear(weight.shape[1], head.units)
    last = nn.Linear(head.units, head.joint_dim)
    with torch.no_grad():
        first.weight.copy_(weight)
        first.bias.copy_(head.context.bias[rows])
        last.weight.copy_(head.output[number][place])
        last.bias.copy_(head.output_bias[slot])
    return nn.Sequential(first, nn.ReLU(), last)


def run(rounds: int = 9) -> list[dict[str, object]]:
    """Rows ``name, candidate, seconds, ratio, foreign_load``, and ``launches``."""
    rows: list[dict[str, object]] = []
    for name in SKELETONS:
        for count in ROWS:
            rows += _compare(name, count, rounds if count < 1000 else max(5, rounds // 2))
    return rows


def _compare(name: str, count: int, rounds: int) -> list[dict[str, object]]:
    """Forward, then forward and backward, of one tree and one number of rows."""
    generator = torch.Generator().manual_seed(0)
    skeleton = named_skeleton(name).skeleton
    head = StructuredHead(CONTEXT, skeleton, JOINT_DIM, hidden=HIDDEN)
    head.reset_parameters(generator)
    loop = Loop(head, skeleton)
    context = torch.randn(count, CONTEXT, generator=generator)
    pull = torch.randn(count, len(skeleton), JOINT_DIM, generator=generator)
    _check(head, loop, context, pull)
    rows: list[dict[str, object]] = []
    for task, call in (
        ("forward", partial(_forward, context)),
        ("forward + backward", partial(_gradient, context, pull)),
    ):
        calls: dict[str, Callable[[], object]] = {
            "loop": partial(call, loop),
            "loop, medium": partial(_medium, partial(call, loop)),
            "head, default": partial(_plain, partial(call, head)),
            "head": partial(call, head),
            "context's product": partial(
                _context_product, head, context, back=call.func is _gradient
            ),
        }
        timings = paired(calls, "loop", rounds=rounds)
        found = rows_of(f"{task}, {len(skeleton)} joints, {count} rows", timings)
        for row in found:
            row["launches"] = _launches(calls[str(row["candidate"])])
        rows += found
    return rows


def _context_product(head: StructuredHead, context: Tensor, *, back: bool) -> None:
    """The product of the context with all first layers alone, by the faster kernel: the floor."""
    weight = head.context.weight.detach()
    with torch.inference_mode(), exact_products(context):
        firsts = weight @ context.t()
        if back:
            firsts.t() @ weight
            firsts @ context


def _forward(context: Tensor, head: nn.Module) -> Tensor:
    with torch.inference_mode():
        return head(context)


def _gradient(context: Tensor, pull: Tensor, head: nn.Module) -> Tensor:
    leaf = context.detach().requires_grad_()
    head.zero_grad(set_to_none=True)
    head(leaf).backward(pull)
    assert leaf.grad is not None
    return leaf.grad


@contextmanager
def _precision(name: str) -> Iterator[None]:
    before = torch.get_float32_matmul_precision()
    torch.set_float32_matmul_precision(name)
    try:
        yield
    finally:
        torch.set_float32_matmul_precision(before)


def _medium(call: Callable[[], object]) -> object:
    with _precision("medium"):
        return call()


def _plain(call: Callable[[], object]) -> object:
    """Without the kernel that the head would choose: a precision was asked for, so it keeps out."""
    with _precision("high"):
        return call()


class _Counter(TorchDispatchMode):
    """Counts operations that do something; views are none."""

    def __init__(self) -> None:
        super().__init__()
        self.count = 0

    def __torch_dispatch__(self, func, types, args=(), kwargs=None):  # type: ignore[no-untyped-def]
        self.count += not func.is_view
        return func(*args, **(kwargs or {}))


def _launches(call: Callable[[], object]) -> int:
    with _Counter() as counter:
        call()
    return counter.count


def _check(head: nn.Module, loop: nn.Module, context: Tensor, pull: Tensor) -> None:
    """Stop unless both give the same numbers and the same gradient of the context."""
    torch.testing.assert_close(head(context), loop(context), atol=1e-4, rtol=1e-4)
    slopes = [_gradient(context, pull, each) for each in (head, loop)]
    # Where a sum is within rounding of zero, a rectified unit may be on in one and off in other.
    off = (slopes[0] - slopes[1]).abs()
    assert (off > 1e-3).double().mean() < 1e-3, "gradients differ"


if __name__ == "__main__":
    main_of(run, __doc__, rounds=9)
