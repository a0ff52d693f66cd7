"""Matrix products by the fastest kernel that is exact on the processor at hand.

PyTorch sends products of single precision to MKL. That is the right library on processors that
have units for products of bfloat16 (AMX), all of them Intel's, and products with few rows are
faster still with a weight that was packed for them. On others MKL may stay at AVX2 speed; oneDNN's
own kernel is reached there in two ways: with a weight that was packed, and with the
matrix-multiplication precision ``medium``, which rounds to bfloat16 where there is AMX and is
exact where there is none.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache, cached_property

import torch
from jaxtyping import Float
from torch import Tensor

FEW_ROWS = 256
"""Up to this many rows, a product is limited by the weight that is read; packing it pays."""

_HARDLY_ANY_ROWS = 4
"""Below this many, MKL reads a packed weight no faster."""


class Weight:
    """A constant matrix that many others are multiplied with.

    Args:
        matrix: outputs x inputs. Used as it is and, from the first product with few rows on, as a
            packed copy; make a new ``Weight`` when it has changed.
    """

    def __init__(self, matrix: Float[Tensor, "outputs inputs"]) -> None:
        self.matrix = matrix.detach()
        self._packed_by_mkl: _PackedByMKL | None = None

    def product(
        self, rows: Float[Tensor, "rows inputs"], bias: Float[Tensor, " outputs"]
    ) -> Float[Tensor, "rows outputs"]:
        """``rows @ matrix.T + bias``, without a gradient."""
        if packing_pays(len(rows), like=self.matrix):
            if not has_amx():
                return self._packed.product(rows, bias)
            if self._packed_by_mkl is None:
                self._packed_by_mkl = _PackedByMKL(self.matrix, len(rows))
            return self._packed_by_mkl.product(rows, bias)
        with exact_products(rows):
            return torch.nn.functional.linear(rows, self.matrix, bias)

    def back(
        self, rows: Float[Tensor, "rows outputs"], onto: Float[Tensor, "rows inputs"]
    ) -> Float[Tensor, "rows inputs"]:
        """Add ``rows @ matrix`` to ``onto``, in place and without a gradient."""
        if not has_amx() and packing_pays(len(rows), like=self.matrix):
            return onto.add_(self._packed_transposed.product(rows, None))
        # MKL hardly gains from packing where the weight need not be transposed on the way.
        with exact_products(rows):
            return onto.addmm_(rows, self.matrix)

    @cached_property
    def _packed(self) -> _PackedByOneDNN:
        return _PackedByOneDNN(self.matrix)

    @cached_property
    def _packed_transposed(self) -> _PackedByOneDNN:
        return _PackedByOneDNN(self.matrix.t().contiguous())


class _PackedByOneDNN:
    """A copy of a matrix for oneDNN."""

    def __init__(self, matrix: Tensor) -> None:
        self.packed = torch.ops.mkldnn._reorder_linear_weight(matrix, FEW_ROWS)

    def product(self, rows: Tensor, bias: Tensor | None) -> Tensor:
        """``rows @ matrix.T + bias``."""
        return torch.ops.mkldnn._linear_pointwise(rows, self.packed, bias, "none", [], "")


class _PackedByMKL:
    """A copy of a matrix for MKL and one number of rows; others are multiplied without it."""

    def __init__(self, matrix: Tensor, rows: int) -> None:
        self.matrix, self.rows = matrix, rows
        self.packed = torch.ops.mkl._mkl_reorder_linear_weight(matrix, rows)

    def product(self, rows: Tensor, bias: Tensor) -> Tensor:
        """``rows @ matrix.T + bias``."""
        return torch.ops.mkl._mkl_linear(rows, self.packed, self.matrix, bias, self.rows)


def packing_pays(rows: int, like: Tensor) -> bool:
    """Whether products of so many rows with a weight such as ``like`` are faster with a copy.

    The operators for it are not part of PyTorch's public interface; where they are missing,
    products are as fast as ``torch.nn.functional.linear``.
    """
    if rows > FEW_ROWS or like.device.type != "cpu" or like.dtype != torch.float32:
        return False
    if not has_amx():
        return has_onednn()
    # At a lower precision PyTorch does not go to MKL.
    exact = torch.get_float32_matmul_precision() == "highest"
    return exact and rows >= _HARDLY_ANY_ROWS and has_mkl()


@contextmanager
def exact_products(like: Tensor) -> Iterator[None]:
    """In here, products of tensors such as ``like`` go to oneDNN, unless it would round them.

    The precision that was set before is set again on leaving. Where the user has asked for a lower
    one, nothing is changed.
    """
    before = torch.get_float32_matmul_precision()
    if before != "highest" or like.device.type != "cpu" or has_amx() or not has_onednn():
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


@cache
def has_onednn() -> bool:
    """Whether this build of PyTorch has oneDNN, and its packed products."""
    return torch.backends.mkldnn.is_available() and all(
        hasattr(torch.ops.mkldnn, name) for name in ("_linear_pointwise", "_reorder_linear_weight")
    )


@cache
def has_mkl() -> bool:
    """Whether this build of PyTorch has MKL, and its packed products."""
    return torch.backends.mkl.is_available() and all(
        hasattr(torch.ops.mkl, name) for name in ("_mkl_linear", "_mkl_reorder_linear_weight")
    )
