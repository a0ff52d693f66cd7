"""A layer of gated recurrent units on a CPU, with a backward written by hand.

The equations are those of ``torch.nn.GRU``, whose weights it uses and with which it agrees:

    r = sigmoid(W_ir x + b_ir + W_hr h + b_hr)        z likewise, with weights of its own
    n = tanh(W_in x + b_in + r (W_hn h + b_hn))       h' = n + z (h - n)

It is faster for three reasons: recurrent weights are packed once for many frames; gates are a few
operations in place; and the gradient of a weight is one product over all frames that were read
with it, in however many calls, rather than one product and one sum a frame.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor
from torch.autograd.function import once_differentiable

from posecast.model.products import FEW_ROWS, Weight, exact_products

_sigmoid_backward = torch.ops.aten.sigmoid_backward.grad_input
_tanh_backward = torch.ops.aten.tanh_backward.grad_input


class _Factors(NamedTuple):
    """What the gradient of a layer's weights is the product of; one row a frame and sequence.

    Args:
        gates: gradient of what the three gates sum up, with W_hn h + b_hn for the third.
        new: gradient of what the third gate sums up.
        frames: what the layer read.
        states: its state before it did.
    """

    gates: Tensor
    new: Tensor
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
        self.inputs = Weight(weight_ih)
        self.state = Weight(weight_hh)
        self.pending: _Pending = {}
        self.weights = _Gather.apply(self.pending, weight_ih, weight_hh, bias_ih, bias_hh)

    def __call__(
        self,
        frames: Float[Tensor, "frames batch inputs"],
        state: Float[Tensor, "batch hidden"],
    ) -> Float[Tensor, "frames batch hidden"]:
        """State after each frame. Time comes first. Can be differentiated once.

        Args:
            frames: what the layer reads.
            state: its state before the first of them.
        """
        return _Run.apply(frames, state, *self.weights, self.inputs, self.state, self.pending)


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
    def backward(ctx: Any, *_: None) -> tuple[Tensor | None, ...]:
        found = ctx.pending.pop(torch._C._current_graph_task_id(), [])
        if not found:
            return (None,) * 5
        short = [factors for factors in found if len(factors.gates) <= FEW_ROWS]
        runs = [factors for factors in found if len(factors.gates) > FEW_ROWS]
        if short:
            runs.append(_Factors(*(torch.cat(parts) for parts in zip(*short, strict=True))))
        total: list[Tensor] = []
        with exact_products(found[0].gates):
            for run in runs:
                gradients = _weight_gradients(run)
                if total:
                    torch._foreach_add_(total, gradients)
                else:
                    total = gradients
        return (None, *total)


def _weight_gradients(run: _Factors) -> list[Tensor]:
    """Gradients of the four weights; overwrites ``run.gates``."""
    hidden = run.new.shape[1]
    weight_hh = run.gates.t() @ run.states
    bias_hh = run.gates.sum(0)
    run.gates[:, -hidden:] = run.new
    weight_ih = run.gates.t() @ run.frames
    bias_ih = torch.cat([bias_hh[:-hidden], run.new.sum(0)])
    return [weight_ih, weight_hh, bias_ih, bias_hh]


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
        inputs: Weight,
        state: Weight,
        pending: _Pending,
    ) -> Tensor:
        count, batch, _ = frames.shape
        hidden = first.shape[1]
        gates = inputs.product(frames.flatten(0, 1), bias_ih).view(count, batch, 3 * hidden)
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
            update, from_state = state.product(here, bias_hh).split([2 * hidden, hidden], dim=1)
            reset, keep = both.add_(update).sigmoid_().chunk(2, dim=1)
            recall.copy_(from_state)
            new.addcmul_(reset, recall).tanh_()
            torch.lerp(new, here, keep, out=after)
        ctx.inputs, ctx.state, ctx.pending = inputs, state, pending
        # The weights are saved only for autograd to notice when they change before backward.
        ctx.save_for_backward(frames, gates, states, recalled, weight_ih, weight_hh)
        return states[1:]

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, grad: Tensor) -> tuple[Tensor | None, ...]:
        frames, gates, states, recalled, _, _ = ctx.saved_tensors
        hidden = recalled.shape[2]
        d_gates, d_new = torch.empty_like(gates), torch.empty_like(recalled)
        carried = torch.zeros_like(states[0])
        past = zip(
            grad.unbind(0),
            states[:-1].unbind(0),
            recalled.unbind(0),
            *(gate.unbind(0) for gate in gates.chunk(3, dim=2)),
            d_gates.unbind(0),
            *(gate.unbind(0) for gate in d_gates.chunk(3, dim=2)),
            d_new.unbind(0),
            strict=True,
        )
        for step in reversed(list(past)):
            d_state, before, recall, reset, keep, new, d_sums, d_reset, d_keep, d_recall, d_own = (
                step
            )
            d_state = d_state + carried
            _sigmoid_backward(d_state * (before - new), keep, grad_input=d_keep)
            kept = d_state * keep
            _tanh_backward(d_state.sub_(kept), new, grad_input=d_own)
            _sigmoid_backward(d_own * recall, reset, grad_input=d_reset)
            torch.mul(d_own, reset, out=d_recall)
            carried = ctx.state.transposed.product(d_sums).add_(kept)
        d_frames = None
        if ctx.needs_input_grad[0]:
            d_inputs = d_gates.clone()
            d_inputs[..., 2 * hidden :] = d_new
            d_frames = ctx.inputs.transposed.product(d_inputs.flatten(0, 1)).view_as(frames)
        if any(ctx.needs_input_grad[2:6]):
            parts = (d_gates, d_new, frames, states[:-1])
            factors = _Factors(*(part.flatten(0, 1) for part in parts))
            task = torch._C._current_graph_task_id()
            ctx.pending.setdefault(task, []).append(factors)
        return d_frames, carried, None, None, None, None, None, None, None
