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
from functools import cached_property

import torch
from jaxtyping import Float
from torch import Tensor

FEW_ROWS = 256
"""Up to this many rows, a product is limited by the weight that is read; packing it pays."""

_HARDLY_ANY_ROWS = 4
"""Below this many, MKL is the faster one on the processors that have AMX, all of them Intel's."""


class Weight:
    """A constant matrix that many others are multiplied with.

    Args:
        matrix: outputs x inputs. Used as it is and, from the first product with few rows on, as a
            packed copy; make a new ``Weight`` when it has changed.
    """

    def __init__(self, matrix: Float[Tensor, "outputs inputs"]) -> None:
        self.matrix = matrix.detach()
        least = _HARDLY_ANY_ROWS if _has_amx() else 1
        self._packed_rows = range(least, FEW_ROWS + 1) if can_pack(matrix) else range(0)

    def product(
        self, rows: Float[Tensor, "rows inputs"], bias: Float[Tensor, " outputs"] | None = None
    ) -> Float[Tensor, "rows outputs"]:
        """``rows @ matrix.T + bias``, without a gradient."""
        if len(rows) in self._packed_rows:
            return torch.ops.mkldnn._linear_pointwise(rows, self._packed, bias, "none", [], "")
        with exact_products(rows):
            return torch.nn.functional.linear(rows, self.matrix, bias)

    @cached_property
    def transposed(self) -> Weight:
        """The matrix with rows and columns exchanged."""
        return Weight(self.matrix.t().contiguous())

    @cached_property
    def _packed(self) -> Tensor:
        return torch.ops.mkldnn._reorder_linear_weight(self.matrix, FEW_ROWS)


def can_pack(like: Tensor) -> bool:
    """Whether this build of PyTorch has packed products for tensors such as ``like``.

    The two operators are not part of PyTorch's public interface; where they are missing, products
    are as fast as ``torch.nn.functional.linear``.
    """
    return (
        like.device.type == "cpu"
        and like.dtype == torch.float32
        and torch.backends.mkldnn.is_available()
        and hasattr(torch.ops.mkldnn, "_linear_pointwise")
        and hasattr(torch.ops.mkldnn, "_reorder_linear_weight")
    )


@contextmanager
def exact_products(like: Tensor) -> Iterator[None]:
    """In here, products of tensors such as ``like`` go to oneDNN, unless it would round them.

    The precision that was set before is set again on leaving. Where the user has asked for a lower
    one, nothing is changed.
    """
    before = torch.get_float32_matmul_precision()
    if before != "highest" or not can_pack(like) or _has_amx():
        yield
        return
    torch.set_float32_matmul_precision("medium")
    try:
        yield
    finally:
        torch.set_float32_matmul_precision(before)


def _has_amx() -> bool:
    """Whether this processor has units for products of bfloat16; true where that is unknown."""
    has_tiles = getattr(torch.cpu, "_is_amx_tile_supported", None)
    return has_tiles is None or bool(has_tiles())
