"""Products of vectors number by number, for formulas that take their operands apart anyway.

An axis of three is too short for ``torch.linalg.cross``: a call of it, and more so its backward,
takes several times as long, and a compiler cannot look into it.
"""

from __future__ import annotations

from collections.abc import Sequence

from torch import Tensor

Parts = Sequence[Tensor]
"""Numbers of vectors or quaternions, each a tensor of its own; they broadcast."""


def cross(left: Parts, right: Parts) -> tuple[Tensor, Tensor, Tensor]:
    """Cross product of vectors."""
    a, b, c = left
    x, y, z = right
    return b * z - c * y, c * x - a * z, a * y - b * x
