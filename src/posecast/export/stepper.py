"""Fast single steps of a forecaster, for streams: what a session can drive in its place."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Literal, get_args

import numpy as np
import numpy.typing as npt
import torch
from jaxtyping import Float
from torch import Tensor

from posecast.errors import ConfigError
from posecast.export.eight_bits import in_eight_bits
from posecast.export.extra import EXTRA, has_extra, onnx_module
from posecast.export.graph import StepNetwork, forget_origin, step_graph, why_not
from posecast.export.layout import Mode
from posecast.model import Forecaster, Prediction, State
from posecast.representation import Codec

_ERRORS_ONLY = 3


class Stepper:
    """A forecaster whose single steps are fast: ``Session(stepper, ...)`` goes on as with itself.

    A copy in single precision, for use: on the CPU, without gradients, without dropout and noise.
    One frame at a time it runs in ONNX Runtime; several at once, a prefix, in PyTorch, whose state
    is the same.

    Args:
        forecaster: what steps; later changes of its weights do not reach the stepper.
        mode: ``exact``: single precision; without the extra ``onnx``, and for what cannot be
            exported, PyTorch takes these steps, too. ``fast``: the backbone's large products in
            eight bits.
        threads: of ONNX Runtime; ``None``: as many as PyTorch's. After a step they wait busily for
            a moment: operations of PyTorch's on several threads right behind it wait for them.

    Attributes:
        weight_bytes: how much has to be read for a step.

    Raises:
        ConfigError: an unknown mode or number of threads; ``fast`` without the extra, or for what
            cannot be exported or has no large product.
    """

    def __init__(
        self, forecaster: Forecaster, mode: Mode = "exact", *, threads: int | None = None
    ) -> None:
        check_mode(mode)
        if threads is not None and threads < 1:
            raise ConfigError(f"threads: {threads}; expected 1 or more")
        self.network = StepNetwork(forecaster)
        self.mode: Mode = mode
        self.weight_bytes = sum(4 * weight.numel() for weight in self.network.parameters())
        self._kept, self._steered = self.network.names.kept, forecaster.controls is not None
        self._run: Callable[[Sequence[Tensor]], list[Tensor]] | None = None
        if mode == "fast" or (has_extra() and why_not(forecaster) is None):
            model = step_model(self.network, mode)
            self.weight_bytes = sum(len(each.raw_data) for each in model.graph.initializer)
            self._run = runner(model.SerializeToString(), self.network, threads)

    @property
    def runtime(self) -> Literal["ONNX Runtime", "PyTorch"]:
        """What takes single steps."""
        return "PyTorch" if self._run is None else "ONNX Runtime"

    @property
    def codec(self) -> Codec:
        """What the features mean, as with the forecaster."""
        return self.network.forecaster.codec

    @property
    def feedback(self) -> Literal["valid", "emitted"]:
        """What a session feeds back, as with the forecaster."""
        return self.network.forecaster.feedback

    def initial_state(self, batch: int) -> State:
        """The state before anything was read."""
        return self.network.forecaster.initial_state(batch)

    def step(
        self,
        features: Float[Tensor, "batch features"],
        state: State,
        controls: Float[Tensor, "batch controls"] | None = None,
    ) -> Prediction:
        """Read one frame and predict the next, as a prediction of one frame.

        Raises:
            ConfigError: controls are missing, or given to a forecaster that takes none.
        """
        if self._run is None or (controls is not None) != self._steered:
            steered = None if controls is None else controls.unsqueeze(1)
            return self._read(features.unsqueeze(1), state, steered)
        steering = () if controls is None else (controls,)
        parts = [state[number] for number in self._kept]
        found, emitted, raw, *changed = self._run((features, *steering, *parts))
        after = list(state)
        for number, part in zip(self._kept, changed, strict=True):
            after[number] = part
        return Prediction(found.unsqueeze(1), raw.unsqueeze(1), emitted.unsqueeze(1), tuple(after))

    def __call__(
        self,
        features: Float[Tensor, "batch frames features"],
        state: State,
        controls: Float[Tensor, "batch frames controls"] | None = None,
        *,
        last: int | None = None,
        generator: torch.Generator | None = None,
    ) -> Prediction:
        """Read frames and predict the frame after each, as the forecaster does in evaluation.

        Args:
            features: frames, the oldest first.
            state: from ``initial_state``, or from the prediction before.
            controls: of the same frames, for a forecaster that takes them.
            last: predict only after that many of the frames, the newest; ``None``: after all.
            generator: nothing is drawn from it.

        Raises:
            ConfigError: controls are missing, or given to a forecaster that takes none.
        """
        if features.shape[1] == 1 and last in (None, 1):
            steered = None if controls is None else controls.squeeze(1)
            return self.step(features.squeeze(1), state, steered)
        return self._read(features, state, controls, last)

    @torch.no_grad()
    def _read(
        self, features: Tensor, state: State, controls: Tensor | None, last: int | None = None
    ) -> Prediction:
        """Read frames in PyTorch."""
        steered = None if controls is None else controls.float()
        before = tuple(part.float() for part in state)
        return self.network.forecaster(features.float(), before, steered, last=last)


def check_mode(mode: str) -> None:
    """Refuse a mode that there is not.

    Raises:
        ConfigError: naming those there are.
    """
    if mode not in get_args(Mode):
        raise ConfigError(f"mode: {mode!r} is not known; choose 'exact' or 'fast'")


def step_model(network: StepNetwork, mode: Mode) -> Any:
    """The ``onnx.ModelProto`` of a step in a mode."""
    model = step_graph(network)
    if mode == "fast":
        in_eight_bits(model)
    forget_origin(model)
    return model


def runner(
    model: bytes, network: StepNetwork, threads: int | None = None
) -> Callable[[Sequence[Tensor]], list[Tensor]]:
    """A function that takes one step in ONNX Runtime: inputs in, outputs out, in their order."""
    runtime = onnx_module("onnxruntime")
    options = runtime.SessionOptions()
    options.intra_op_num_threads = torch.get_num_threads() if threads is None else threads
    options.inter_op_num_threads = 1
    options.log_severity_level = _ERRORS_ONLY
    session = runtime.InferenceSession(model, options, providers=["CPUExecutionProvider"])
    inputs, outputs = network.names.inputs, list(network.names.outputs)

    def run(values: Sequence[Tensor]) -> list[Tensor]:
        arrays: list[npt.NDArray[np.float32]] = session.run(
            outputs,
            {
                name: value.detach().float().contiguous().numpy()
                for name, value in zip(inputs, values, strict=True)
            },
        )
        return [torch.from_numpy(array) for array in arrays]

    return run


def versions() -> dict[str, str]:
    """Versions of the packages that export and run a step."""
    return {"torch": torch.__version__, **{name: onnx_module(name).__version__ for name in EXTRA}}
