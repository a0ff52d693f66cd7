"""Matrix products by the fastest kernel that is exact on the processor at hand.

PyTorch sends products of single precision to MKL, which stays at AVX2 speed on processors other
than Intel's. oneDNN's own kernel is reached in two ways. With a weight that was packed beforehand
it is also the faster one on Intel's, as long as the other factor has few rows. And with the
matrix-multiplication precision ``medium``, which rounds to bfloat16 where there are units for it
(AMX) and is exact where there are none, so that it is used only there.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache, cached_property
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor
from torch.autograd.function import once_differentiable

FEW_ROWS = 256
"""Up to this many rows, a product is limited by the weight that is read; its layout matters."""

_HARDLY_ANY_ROWS, _SMALL_WEIGHT = 4, 1 << 18
"""Below these, MKL is the faster one on the processors that have AMX, all of them Intel's."""


class Weight:
    """A constant matrix that many others are multiplied with.

    Args:
        matrix: outputs x inputs. Used as it is and, from the first product with few rows on, as a
            packed copy; make a new ``Weight`` when it has changed.
    """

    def __init__(self, matrix: Float[Tensor, "outputs inputs"]) -> None:
        self.matrix = matrix.detach()
        # MKL is as fast as oneDNN where the weight need not be transposed on the way.
        self._packs_back = can_pack(matrix) and not has_amx()

    def product(
        self, rows: Float[Tensor, "rows inputs"], bias: Float[Tensor, " outputs"]
    ) -> Float[Tensor, "rows outputs"]:
        """``rows @ matrix.T + bias``, without a gradient."""
        if packing_pays(len(rows), like=self.matrix):
            return _packed_product(rows, self._packed, bias)
        with exact_products(rows):
            return torch.nn.functional.linear(rows, self.matrix, bias)

    def back(
        self, rows: Float[Tensor, "rows outputs"], onto: Float[Tensor, "rows inputs"]
    ) -> Float[Tensor, "rows inputs"]:
        """Add ``rows @ matrix`` to ``onto``, in place and without a gradient."""
        if self._packs_back and len(rows) <= FEW_ROWS:
            return onto.add_(_packed_product(rows, self._packed_transposed, None))
        with exact_products(rows):
            return onto.addmm_(rows, self.matrix)

    @cached_property
    def _packed(self) -> Tensor:
        return _pack(self.matrix)

    @cached_property
    def _packed_transposed(self) -> Tensor:
        return _pack(self.matrix.t().contiguous())


def linear(
    rows: Float[Tensor, "*batch inputs"],
    weight: Float[Tensor, "outputs inputs"],
    bias: Float[Tensor, " outputs"],
) -> Float[Tensor, "*batch outputs"]:
    """``torch.nn.functional.linear`` by the fastest kernel; its gradient can be had once."""
    if not _is_quicker(weight):
        return torch.nn.functional.linear(rows, weight, bias)
    found: Tensor = _Product.apply(rows.flatten(0, -2), weight, bias)
    return found.unflatten(0, rows.shape[:-1])


def linear_columns(
    rows: Float[Tensor, "rows inputs"],
    weight: Float[Tensor, "outputs inputs"],
    bias: Float[Tensor, " outputs"],
) -> Float[Tensor, "outputs rows"]:
    """What ``linear`` gives, laid out the other way."""
    if not _is_quicker(weight):
        return torch.addmm(bias[:, None], weight, rows.t())
    found: Tensor = _Product.apply(weight, rows, bias[:, None])
    return found


def _is_quicker(weight: Tensor) -> bool:
    """Whether oneDNN is exact and the faster kernel, and ``_Product`` may be used."""
    return can_pack(weight) and not has_amx() and not torch.compiler.is_compiling()


class _Product(torch.autograd.Function):
    """``left @ right.T + bias`` where products are exact in oneDNN."""

    @staticmethod
    def forward(ctx: Any, left: Tensor, right: Tensor, bias: Tensor) -> Tensor:
        ctx.save_for_backward(left, right)
        ctx.bias_shape = bias.shape
        with exact_products(left):
            return torch.addmm(bias, left, right.t())

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, upstream: Tensor) -> tuple[Tensor | None, ...]:
        left, right = ctx.saved_tensors
        wanted = ctx.needs_input_grad
        with exact_products(left):
            return (
                upstream @ right if wanted[0] else None,
                upstream.t() @ left if wanted[1] else None,
                upstream.sum_to_size(ctx.bias_shape) if wanted[2] else None,
            )


def _pack(matrix: Tensor) -> Tensor:
    """A copy for ``_packed_product``."""
    return torch.ops.mkldnn._reorder_linear_weight(matrix, FEW_ROWS)


def _packed_product(rows: Tensor, packed: Tensor, bias: Tensor | None) -> Tensor:
    """``rows @ matrix.T + bias`` with a packed matrix."""
    return torch.ops.mkldnn._linear_pointwise(rows, packed, bias, "none", [], "")


def packing_pays(rows: int, like: Tensor) -> bool:
    """Whether products of so many rows with a weight such as ``like`` are faster with a copy."""
    if not has_amx():
        return rows <= FEW_ROWS and can_pack(like)
    few = _HARDLY_ANY_ROWS <= rows <= FEW_ROWS
    return few and like.numel() >= _SMALL_WEIGHT and can_pack(like)


def can_pack(like: Tensor) -> bool:
    """Whether this build of PyTorch has packed products for tensors such as ``like``.

    The two operators are not part of PyTorch's public interface; where they are missing, products
    are as fast as ``torch.nn.functional.linear``.
    """
    return like.device.type == "cpu" and like.dtype == torch.float32 and _has_packed_products()


@cache
def _has_packed_products() -> bool:
    """Whether this build of PyTorch knows the two operators."""
    return torch.backends.mkldnn.is_available() and all(
        hasattr(torch.ops.mkldnn, name) for name in ("_linear_pointwise", "_reorder_linear_weight")
    )


@contextmanager
def exact_products(like: Tensor) -> Iterator[None]:
    """In here, products of tensors such as ``like`` go to oneDNN, unless it would round them.

    The precision that was set before is set again on leaving. Where the user has asked for a lower
    one, nothing is changed.
    """
    before = torch.get_float32_matmul_precision()
    if before != "highest" or not can_pack(like) or has_amx():
        yield
        return
    torch.set_float32_matmul_precision("medium")
    try:
        yield
    finally:
        torch.set_float32_matmul_precision(before)


@cache
def has_amx() -> bool:
    """Whether this processor has units for products of bfloat16; true where that is unknown."""
    has_tiles = getattr(torch.cpu, "_is_amx_tile_supported", None)
    return has_tiles is None or bool(has_tiles())
