"""One step of a forecaster as an ONNX graph: explicit cells, any batch, state in and out."""

from __future__ import annotations

import copy
import logging
import warnings
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Any, NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor, nn

from posecast.errors import ConfigError
from posecast.export.extra import require_extra
from posecast.model import Forecaster, Prediction
from posecast.representation import Joined, Matrix

OPSET = 18
SCOPES = "pkg.torch.onnx.name_scopes"
"""Where the exporter notes which module a node is from."""

_BATCH = 2  # of the example; sizes 0 and 1 would be taken for constants


class StepNames(NamedTuple):
    """What the inputs and outputs of the graph are called, in their order.

    Args:
        inputs: ``features``, ``controls`` if there are any, then ``state_0`` and so on.
        outputs: ``next_features``, ``emitted`` and ``raw`` as in ``Prediction``, then
            ``next_state_0`` and so on.
        kept: which parts of the backbone's state those are; the others have no numbers.
    """

    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    kept: tuple[int, ...]

    @classmethod
    def of(cls, forecaster: Forecaster) -> StepNames:
        """The names for a forecaster."""
        parts = forecaster.initial_state(1)
        kept = tuple(number for number, part in enumerate(parts) if part.numel())
        states = tuple(f"state_{number}" for number in range(len(kept)))
        steered = () if forecaster.controls is None else ("controls",)
        return cls(
            ("features", *steered, *states),
            ("next_features", "emitted", "raw", *(f"next_{name}" for name in states)),
            kept,
        )


class StepNetwork(nn.Module):
    """One step as a function of tensors alone: a copy of a forecaster, in single precision.

    Args:
        forecaster: what steps; later changes of its weights do not reach the copy.
    """

    def __init__(self, forecaster: Forecaster) -> None:
        super().__init__()
        self.forecaster = copy.deepcopy(forecaster).cpu().float().requires_grad_(False)
        self.names = StepNames.of(self.forecaster)
        self._shapes = [part.shape[1:] for part in self.forecaster.initial_state(1)]
        self.eval()

    def initial_state(self, batch: int) -> list[Float[Tensor, "batch ..."]]:
        """The parts of the first state that the graph has, each a tensor of its own.

        The exporter would take one tensor that stands for two for one input.
        """
        state = self.forecaster.initial_state(batch)
        return [
            state[number].clone(memory_format=torch.contiguous_format) for number in self.names.kept
        ]

    def forward(self, *inputs: Tensor) -> tuple[Tensor, ...]:
        """From the inputs to the outputs of ``StepNames``, both without the axis of frames."""
        features, *others = inputs
        controls = others.pop(0)[:, None] if self.forecaster.controls is not None else None
        state = [features.new_zeros(features.shape[0], *shape) for shape in self._shapes]
        for number, part in zip(self.names.kept, others, strict=True):
            state[number] = part
        found: Prediction = self.forecaster(features[:, None], tuple(state), controls)
        after = (found.state[number] for number in self.names.kept)
        return (found.features[:, 0], found.emitted[:, 0], found.raw[:, 0], *after)


def step_graph(network: StepNetwork) -> Any:
    """An ``onnx.ModelProto`` of one step.

    The step reads one frame (batch, features), its controls (batch, controls) where the forecaster
    takes any, and the state; it gives the frame that follows and the new state. Features are those
    of the codec, in physical units: standardization is inside.

    Raises:
        ConfigError: the extra ``onnx`` is not installed, or the forecaster does what ONNX cannot.
    """
    reason = why_not(network.forecaster)
    if reason is not None:
        raise ConfigError(reason)
    require_extra()
    names, codec = network.names, network.forecaster.codec
    controls = network.forecaster.controls
    steered = [] if controls is None else [torch.zeros(_BATCH, controls.input_dim)]
    example = (torch.zeros(_BATCH, codec.feature_dim), *steered, *network.initial_state(_BATCH))
    batch = torch.export.Dim("batch")
    with _quiet(), torch.no_grad():
        program: Any = torch.onnx.export(
            network,
            example,
            dynamo=True,
            opset_version=OPSET,
            input_names=names.inputs,
            output_names=names.outputs,
            dynamic_shapes=(tuple({0: batch} for _ in example),),
            external_data=False,
            verbose=False,
        )
    return program.model_proto


def forget_origin(model: Any) -> None:
    """Take out what the exporter notes of the machine it ran on: lines of code with paths."""
    graph = model.graph
    for part in (model, graph, *graph.node, *graph.input, *graph.output, *graph.initializer):
        del part.metadata_props[:]
        part.doc_string = ""
    del graph.value_info[:]


def why_not(forecaster: Forecaster) -> str | None:
    """Why a forecaster cannot be exported, and what would fit; ``None``: it can be."""
    representation = forecaster.codec.representation
    if isinstance(representation, Joined):
        representation = representation.rotations
    if isinstance(representation, Matrix):
        return (
            "representation 'matrix' is projected by a singular value decomposition, for which "
            "ONNX has no operator; choose another representation, such as ortho6d, for networks "
            "that are to be exported"
        )
    return None


@contextmanager
def _quiet() -> Iterator[None]:
    """Keep to ourselves what the exporter says of its own internals."""
    with ExitStack() as stack:
        for name in ("torch.onnx", "onnxscript", "onnx_ir"):
            logger = logging.getLogger(name)
            stack.callback(logger.setLevel, logger.level)
            logger.setLevel(logging.ERROR)
        stack.enter_context(warnings.catch_warnings())
        warnings.simplefilter("ignore")
        yield
