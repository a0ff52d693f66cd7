"""A layer of gated recurrent units on a CPU, with a backward written by hand.

The equations are those of ``torch.nn.GRU``, whose weights it uses and with which it agrees:

    r = sigmoid(W_ir x + b_ir + W_hr h + b_hr)        z likewise, with weights of its own
    n = tanh(W_in x + b_in + r (W_hn h + b_hn))       h' = n + z (h - n)

It is faster for three reasons: recurrent weights are laid out once for many frames; gates are a few
operations in place; and the gradient of a weight is one product for hundreds of frames that were
read with it, in however many calls, rather than one product and one sum a frame.
"""

from __future__ import annotations

import math
from functools import cached_property
from typing import Any, NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor
from torch.autograd.function import once_differentiable

from posecast.model.products import FEW_ROWS, Weight, exact_products

_BLOCK_ROWS = 512
"""Rows of a product that are enough for it to be fast; backward takes a long run in such blocks.

Memory for a whole run would cost more than it brings: the system hands out large arrays anew each
time, page by page.
"""

_sigmoid_backward = torch.ops.aten.sigmoid_backward.grad_input
_tanh_backward = torch.ops.aten.tanh_backward.grad_input


class _Factors(NamedTuple):
    """What the gradient of a layer's weights is the product of; one row a frame and sequence.

    Args:
        sums: gradients of what the gates sum up: n, r, z, then W_hn h + b_hn. The first three
            belong to the weights of the inputs, the last three to those of the state.
        frames: what the layer read.
        states: its state before it did.
    """

    sums: Tensor
    frames: Tensor
    states: Tensor


_Pending = dict[int, list[_Factors]]
"""Factors by the backward pass that they belong to."""


class GRULayer:
    """One layer with the weights it has at this moment; make a new one when they have changed.

    Args:
        weight_ih: (3 hidden, inputs); gates in the order r, z, n.
        weight_hh: (3 hidden, hidden).
        bias_ih: (3 hidden).
        bias_hh: (3 hidden).
    """

    def __init__(
        self, weight_ih: Tensor, weight_hh: Tensor, bias_ih: Tensor, bias_hh: Tensor
    ) -> None:
        self.products = _Products(weight_ih, weight_hh)
        self.pending: _Pending = {}
        self.weights = _Gather.apply(self.pending, weight_ih, weight_hh, bias_ih, bias_hh)

    def __call__(
        self,
        frames: Float[Tensor, "frames batch inputs"],
        state: Float[Tensor, "batch hidden"],
    ) -> tuple[Float[Tensor, "frames batch hidden"], Float[Tensor, "batch hidden"]]:
        """State after each frame, and after the last. Time comes first. Can be differentiated once.

        Args:
            frames: what the layer reads.
            state: its state before the first of them.
        """
        if not torch.is_grad_enabled():
            return self._read(frames, state)
        states, last = _Run.apply(frames, state, *self.weights, self.products, self.pending)
        return states, last

    def _read(self, frames: Tensor, state: Tensor) -> tuple[Tensor, Tensor]:
        """The same for those who want no gradient: nothing is kept."""
        count, batch, _ = frames.shape
        hidden = state.shape[1]
        two = 2 * hidden
        _, _, bias_ih, bias_hh = self.weights
        gates = self.products.inputs.product(frames.flatten(0, 1), bias_ih)
        states: list[Tensor] = []
        for gate in gates.view(count, batch, 3 * hidden).unbind(0):
            update = self.products.state.product(state, bias_hh)
            reset, keep = gate[:, :two].add_(update[:, :two]).sigmoid_().chunk(2, dim=1)
            new = gate[:, two:].addcmul_(reset, update[:, two:]).tanh_()
            state = torch.lerp(new, state, keep)
            states.append(state)
        return torch.stack(states), state


class _Products:
    """A layer's weights, ready for products."""

    def __init__(self, weight_ih: Tensor, weight_hh: Tensor) -> None:
        self.inputs = Weight(weight_ih)
        self.state = Weight(weight_hh)

    @cached_property
    def inputs_by_sums(self) -> Weight:
        """Weights of the inputs in the order of the sums of ``_Factors``: those of n come first."""
        matrix = self.inputs.matrix
        return Weight(matrix.roll(len(matrix) // 3, 0))


class _Gather(torch.autograd.Function):
    """Hands weights out to runs, and forms their gradients when all runs have been through.

    Autograd comes here last, after every run of this backward pass.
    """

    @staticmethod
    def forward(ctx: Any, pending: _Pending, *weights: Tensor) -> tuple[Tensor, ...]:
        ctx.pending = pending
        ctx.set_materialize_grads(False)
        return tuple(weight.detach() for weight in weights)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, *given: Tensor | None) -> tuple[Tensor | None, ...]:
        task = _current_pass()
        found = [] if task is None else ctx.pending.pop(task, [])
        if not found:
            return (None, *given)
        together = _Factors(*(torch.cat(parts) for parts in zip(*found, strict=True)))
        # Runs that were long enough on their own have handed theirs over already.
        known = [gradient for gradient in given if gradient is not None]
        gradients = _Gradients(*known) if known else _Gradients.zeros(together)
        gradients.add(together)
        return (None, *gradients)


def _current_pass() -> int | None:
    """A number for the backward pass that is under way; ``None`` where PyTorch does not tell.

    The function is not part of its public interface. Without it, gradients of the weights are
    formed run by run: slower, and the same.
    """
    tell = getattr(torch._C, "_current_graph_task_id", None)
    return None if tell is None else int(tell())


class _Gradients(NamedTuple):
    """Gradients of a layer's weights, as far as they have been summed up."""

    weight_ih: Tensor
    weight_hh: Tensor
    bias_ih: Tensor
    bias_hh: Tensor

    @classmethod
    def zeros(cls, like: _Factors) -> _Gradients:
        """Nothing summed up yet."""
        gates, inputs = 3 * like.states.shape[1], like.frames.shape[1]
        shapes = ((gates, inputs), (gates, like.states.shape[1]), (gates,), (gates,))
        return cls(*(like.sums.new_zeros(shape) for shape in shapes))

    def add(self, factors: _Factors) -> None:
        """Add a product over all rows of the factors."""
        hidden = factors.states.shape[1]
        sums, two = factors.sums.t(), 2 * hidden
        with exact_products(sums):
            self.weight_ih[:two].addmm_(sums[hidden : hidden + two], factors.frames)
            self.weight_ih[two:].addmm_(sums[:hidden], factors.frames)
            self.weight_hh.addmm_(sums[hidden:], factors.states)
        bias = sums.sum(1)
        self.bias_ih[:two].add_(bias[hidden : hidden + two])
        self.bias_ih[two:].add_(bias[:hidden])
        self.bias_hh.add_(bias[hidden:])


class _Run(torch.autograd.Function):
    """A layer over a run of frames."""

    @staticmethod
    def forward(
        ctx: Any,
        frames: Tensor,
        first: Tensor,
        weight_ih: Tensor,
        weight_hh: Tensor,
        bias_ih: Tensor,
        bias_hh: Tensor,
        products: _Products,
        pending: _Pending,
    ) -> tuple[Tensor, Tensor]:
        count, batch, _ = frames.shape
        hidden = first.shape[1]
        gates = products.inputs.product(frames.flatten(0, 1), bias_ih)
        gates = gates.view(count, batch, 3 * hidden)
        states = frames.new_empty(count + 1, batch, hidden)
        recalled = frames.new_empty(count, batch, hidden)
        states[0] = first
        for here, after, recall, both, new in zip(
            states[:-1].unbind(0),
            states[1:].unbind(0),
            recalled.unbind(0),
            gates[..., : 2 * hidden].unbind(0),
            gates[..., 2 * hidden :].unbind(0),
            strict=True,
        ):
            update, from_state = products.state.product(here, bias_hh).split(
                [2 * hidden, hidden], dim=1
            )
            reset, keep = both.add_(update).sigmoid_().chunk(2, dim=1)
            recall.copy_(from_state)
            new.addcmul_(reset, recall).tanh_()
            torch.lerp(new, here, keep, out=after)
        ctx.products, ctx.pending = products, pending
        ctx.set_materialize_grads(False)
        # The weights are saved only for autograd to notice when they change before backward.
        ctx.save_for_backward(frames, gates, states, recalled, weight_ih, weight_hh)
        return states[1:], states[-1].clone()

    @staticmethod
    @once_differentiable
    def backward(
        ctx: Any, grad: Tensor | None, carried: Tensor | None
    ) -> tuple[Tensor | None, ...]:
        frames, gates, states, recalled, _, _ = ctx.saved_tensors
        count, batch, hidden = recalled.shape
        carried = torch.zeros_like(states[0]) if carried is None else carried
        d_frames = frames.new_zeros(frames.shape) if ctx.needs_input_grad[0] else None
        wanted = any(ctx.needs_input_grad[2:6])
        together = _current_pass() if count * batch <= FEW_ROWS else None
        gradients: _Gradients | None = None
        length = math.ceil(count / max(1, round(count * batch / _BLOCK_ROWS)))
        room = gates.new_empty(min(length, count), batch, 4 * hidden)
        for start in reversed(range(0, count, length)):
            block = slice(start, min(start + length, count))
            sums = room[: block.stop - start]
            carried = _back_through(
                None if grad is None else grad[block],
                carried,
                _Kept(states[block], recalled[block], gates[block]),
                ctx.products.state,
                sums,
            )
            factors = _Factors(
                *(part.flatten(0, 1) for part in (sums, frames[block], states[block]))
            )
            if d_frames is not None:
                of_inputs = factors.sums[:, : 3 * hidden]
                ctx.products.inputs_by_sums.back(of_inputs, onto=d_frames[block].flatten(0, 1))
            if wanted and together is not None:
                ctx.pending.setdefault(together, []).append(factors)
            elif wanted:
                gradients = _Gradients.zeros(factors) if gradients is None else gradients
                gradients.add(factors)
        return d_frames, carried, *(gradients or (None,) * 4), None, None


class _Kept(NamedTuple):
    """What forward keeps for backward; one entry a frame."""

    states: Tensor
    recalled: Tensor
    gates: Tensor


def _back_through(
    grad: Tensor | None, carried: Tensor, kept: _Kept, weight: Weight, sums: Tensor
) -> Tensor:
    """Go back through a few frames.

    Args:
        grad: gradient of the state after each of them.
        carried: gradient of the last of these states from what came after it.
        kept: of these frames.
        weight: of the state.
        sums: receives those of ``_Factors``.

    Returns:
        The gradient of the state before the first of the frames.
    """
    hidden = carried.shape[1]
    past = zip(
        [None] * len(sums) if grad is None else grad.unbind(0),
        kept.states.unbind(0),
        kept.recalled.unbind(0),
        *(gate.unbind(0) for gate in kept.gates.chunk(3, dim=2)),
        sums[..., hidden:].unbind(0),
        *(part.unbind(0) for part in sums.chunk(4, dim=2)),
        strict=True,
    )
    for step in reversed(list(past)):
        d_after, before, recall, reset, keep, new, d_sums, *parts = step
        d_new, d_reset, d_keep, d_recall = parts
        d_state = carried if d_after is None else d_after + carried
        room = d_recall  # for what comes in between; fresh memory costs more than the arithmetic
        _sigmoid_backward(torch.sub(before, new, out=room).mul_(d_state), keep, grad_input=d_keep)
        passed = d_state * keep
        _tanh_backward(torch.sub(d_state, passed, out=room), new, grad_input=d_new)
        _sigmoid_backward(torch.mul(d_new, recall, out=room), reset, grad_input=d_reset)
        torch.mul(d_new, reset, out=d_recall)
        carried = weight.back(d_sums, onto=passed)
    return carried
