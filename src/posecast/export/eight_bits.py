"""A step whose large weights are written in eight bits: four times less to read a frame."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from posecast.errors import ConfigError
from posecast.export.extra import onnx_module
from posecast.export.graph import SCOPES

BLOCK = 128
"""Inputs that share a scale. With fewer, steps are slower and hardly nearer."""

FEWEST = 1 << 16
"""Weights of a product for which eight bits pay; smaller ones are read in no time."""

_MIDDLE, _REACH = 128, 127
_DOMAIN = "com.microsoft"
_BY_INTEGERS = 4  # ONNX Runtime's name for products of eight-bit numbers


class Blocks(NamedTuple):
    """A matrix in eight bits: ``scales * (numbers - 128)``.

    Args:
        numbers: (outputs, blocks, BLOCK); inputs are filled up to whole blocks.
        scales: (outputs * blocks).
    """

    numbers: npt.NDArray[np.uint8]
    scales: npt.NDArray[np.float32]

    @classmethod
    def of(cls, matrix: npt.NDArray[np.float32]) -> Blocks:
        """The nearest numbers to a matrix of outputs x inputs; zeros stay zeros."""
        outputs, inputs = matrix.shape
        filled = np.zeros((outputs, -(-inputs // BLOCK) * BLOCK), dtype=np.float32)
        filled[:, :inputs] = matrix
        blocks = filled.reshape(outputs, -1, BLOCK)
        scales = np.abs(blocks).max(-1, keepdims=True) / _REACH
        scales[scales == 0] = 1
        numbers = np.rint(blocks / scales) + _MIDDLE
        return cls(numbers.astype(np.uint8), scales.astype(np.float32).reshape(-1))


def in_eight_bits(model: Any) -> None:
    """Change the backbone's large products to ones with weights in eight bits, in place.

    What is multiplied with them is rounded to eight bits, too, block by block, at run time. All
    other products stay as they are: those of the output layers hardly take time, and rounded they
    would be most of the difference.

    The operator is ONNX Runtime's own, ``MatMulNBits``, in eight bits from 1.22 on, 1.23 on ARM.

    Args:
        model: an ``onnx.ModelProto`` from ``step_graph``; its nodes still say where they are from.

    Raises:
        ConfigError: the backbone has no product that is large enough.
    """
    weights = {initializer.name: initializer for initializer in model.graph.initializer}
    found = [_large_weight(node, weights) for node in model.graph.node]
    if all(matrix is None for matrix in found):
        raise ConfigError(
            f"no product of the backbone has {FEWEST} weights or more, for which eight bits pay; "
            "use the mode exact"
        )
    nodes: list[Any] = []
    for node, matrix in zip(model.graph.node, found, strict=True):
        nodes += [node] if matrix is None else _replacement(model.graph, node, matrix)
    del model.graph.node[:]
    model.graph.node.extend(nodes)
    read = {name for node in nodes for name in node.input}
    kept = [each for each in model.graph.initializer if each.name in read]
    del model.graph.initializer[:]
    model.graph.initializer.extend(kept)
    model.opset_import.append(onnx_module("onnx").helper.make_opsetid(_DOMAIN, 1))


def _large_weight(node: Any, weights: dict[str, Any]) -> npt.NDArray[np.float32] | None:
    """The constant matrix, outputs x inputs, that a node of the backbone multiplies with."""
    scopes = next((each.value for each in node.metadata_props if each.key == SCOPES), "")
    if "'forecaster.backbone'" not in scopes or node.op_type not in ("Gemm", "MatMul"):
        return None
    weight = weights.get(node.input[1])
    if weight is None or len(weight.dims) != 2 or np.prod(weight.dims) < FEWEST:
        return None
    matrix: npt.NDArray[np.float32] = onnx_module("onnx").numpy_helper.to_array(weight)
    turned = any(each.name == "transB" and each.i for each in node.attribute)
    return matrix if turned else matrix.T


def _replacement(graph: Any, node: Any, matrix: npt.NDArray[np.float32]) -> list[Any]:
    """The same product with weights in eight bits, then its bias."""
    onnx = onnx_module("onnx")
    blocks = Blocks.of(matrix)
    names = [f"{node.name}_numbers", f"{node.name}_scales"]
    for name, values in zip(names, blocks, strict=True):
        graph.initializer.append(onnx.numpy_helper.from_array(values, name))
    biased = len(node.input) > 2
    said = f"{node.output[0]}_unbiased" if biased else node.output[0]
    product = onnx.helper.make_node(
        "MatMulNBits",
        [node.input[0], *names],
        [said],
        name=f"{node.name}_in_eight_bits",
        domain=_DOMAIN,
        K=matrix.shape[1],
        N=matrix.shape[0],
        bits=8,
        block_size=BLOCK,
        accuracy_level=_BY_INTEGERS,
    )
    if not biased:
        return [product]
    bias = onnx.helper.make_node("Add", [said, node.input[2]], [node.output[0]], name=node.name)
    return [product, bias]
