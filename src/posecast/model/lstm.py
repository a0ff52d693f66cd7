"""Stacks of LSTM cells: wired as usual, with connections past layers, or with a delay."""

from __future__ import annotations

import math
from typing import Literal, get_args

import torch
from jaxtyping import Float
from torch import Tensor, nn

from posecast.errors import ConfigError
from posecast.model.recurrent import State, Summary, check_stack

Wiring = Literal["stacked", "skip", "delayed"]


class LSTMBackbone(nn.Module):
    """A stack of long short-term memory cells.

    With two biases a cell, as PyTorch has them, it is that of Zhou et al. 2018 and Andreou et al.
    2022; with one, as TensorFlow has it, that of Martinez et al. 2017 and Aksan et al. 2019.

    Args:
        input_dim: numbers a frame.
        hidden: units a layer.
        layers: how many layers.
        wiring: ``stacked``: each layer reads what the one below puts out in the same frame;
            ``skip``: and the frame itself, and the summary is what all layers put out side by side
            (Graves 2013; ERD and LSTM-3LR of Fragkiadaki et al. 2015); ``delayed``: what the one
            below put out in the frame before, as the code of Zhou et al. does, so that an input
            reaches the output after as many more frames as there are layers above the first.
        initial_state: ``zero``: zeros; ``learned``: trained vectors, the same for every sequence,
            drawn from a normal distribution with standard deviation 0.01.
        biases: vectors of them a cell. PyTorch adds up two: the same network as with TensorFlow's
            one, but their sum learns twice as fast and there are more parameters.
        forget_bias: added to the bias of the forget gates when weights are drawn; 1 in TensorFlow.

    Raises:
        ConfigError: an unknown choice, or a number out of its range.
    """

    def __init__(
        self,
        input_dim: int,
        hidden: int = 1024,
        layers: int = 3,
        wiring: Wiring = "stacked",
        initial_state: Literal["learned", "zero"] = "zero",
        biases: int = 2,
        forget_bias: float = 0.0,
    ) -> None:
        super().__init__()
        check_stack(layers, initial_state)
        if wiring not in get_args(Wiring):
            raise ConfigError(
                f"wiring: {wiring!r} is not known; choose 'stacked', 'skip' or 'delayed'"
            )
        if biases not in (1, 2):
            raise ConfigError(f"biases: {biases}; expected 1 or 2 a cell")
        if not math.isfinite(forget_bias):
            raise ConfigError(f"forget_bias: {forget_bias}; expected a finite number")
        self.wiring: Wiring = wiring
        self.forget_bias = forget_bias
        make = nn.LSTM if biases == 2 else _OneBias
        above = hidden + (input_dim if wiring == "skip" else 0)
        self.layers = nn.ModuleList(
            make(input_dim if layer == 0 else above, hidden, batch_first=True)
            for layer in range(layers)
        )
        self.hidden = hidden
        self.first: nn.Parameter | None = None
        if initial_state == "learned":
            self.first = nn.Parameter(torch.empty(2 * layers, hidden))
        self.reset_parameters()

    @property
    def context_dim(self) -> int:
        """Size of the summary: the units of the last layer, or of all with ``skip``."""
        return self.hidden * (len(self.layers) if self.wiring == "skip" else 1)

    def reset_parameters(self, generator: torch.Generator | None = None) -> None:
        """Draw all weights anew: PyTorch's uniform; the first state from N(0, 0.01)."""
        bound = 1 / math.sqrt(self.hidden)
        for weight in self.layers.parameters():
            nn.init.uniform_(weight, -bound, bound, generator=generator)
        with torch.no_grad():
            for layer in self.layers:
                forget = layer.get_parameter("bias_ih_l0").unflatten(0, (4, -1))[1]
                forget += self.forget_bias
        if self.first is not None:
            nn.init.normal_(self.first, std=0.01, generator=generator)

    def initial_state(self, batch: int) -> State:
        """For each layer its output, then its cell: two tensors (batch, hidden)."""
        if self.first is not None:
            return tuple(part.expand(batch, -1) for part in self.first)
        zero = next(self.layers.parameters()).new_zeros(batch, self.hidden)
        return (zero,) * (2 * len(self.layers))

    def forward(self, frames: Float[Tensor, "batch frames inputs"], state: State) -> Summary:
        """Read frames, the oldest first."""
        after: list[Tensor] = []
        contexts: list[Tensor] = []
        inputs = frames
        for number, layer in enumerate(self.layers):
            context, output, cell = _read(layer, inputs, state[2 * number], state[2 * number + 1])
            after += [output, cell]
            contexts.append(context)
            inputs = context
            if self.wiring == "delayed":
                inputs = torch.cat([state[2 * number][:, None], context[:, :-1]], dim=1)
            elif self.wiring == "skip":
                inputs = torch.cat([frames, context], dim=-1)
        context = torch.cat(contexts, dim=-1) if self.wiring == "skip" else contexts[-1]
        return Summary(context, tuple(after))


class _OneBias(nn.LSTM):
    """An LSTM of one layer whose second bias is zero and is no weight."""

    def __init__(self, input_size: int, hidden_size: int, *, batch_first: bool) -> None:
        super().__init__(input_size, hidden_size, batch_first=batch_first)
        del self.bias_hh_l0
        zeros = torch.zeros(4 * hidden_size)
        self.register_buffer("bias_hh_l0", zeros, persistent=False)
        self._flat_weights = [getattr(self, name) for name in self._flat_weights_names]


def _read(
    layer: nn.Module, frames: Tensor, output: Tensor, cell: Tensor
) -> tuple[Tensor, Tensor, Tensor]:
    """Outputs after each frame, and output and cell after the last."""
    assert isinstance(layer, nn.LSTM)
    # On a CPU a cell has less around it, which pays for a single frame and for no more; other
    # devices have not been timed. Compilers see through cells, not into layers.
    cell_pays = frames.device.type == "cpu" or torch.compiler.is_compiling()
    if cell_pays and frames.shape[1] == 1:
        output, cell = torch.lstm_cell(frames[:, 0], (output, cell), *layer.all_weights[0])
        return output[:, None], output, cell
    # cuDNN refuses a state that is not contiguous, as a learned one is not: one row for all.
    before = (output[None].contiguous(), cell[None].contiguous())
    outputs, (output, cell) = layer(frames, before)
    return outputs, output[0], cell[0]
