"""Gated recurrent units and a rollout of them, written out one frame at a time."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor, nn

from posecast.model import Forecaster, GRUBackbone


def gru_frame_by_frame(network: nn.GRU, frames: Tensor, state: Tensor) -> tuple[Tensor, Tensor]:
    """The equations of Cho et al. 2014 in PyTorch's form, with the weights of ``network``.

    Args:
        network: a stack of layers, batch first.
        frames: (batch, frames, inputs).
        state: (layers, batch, hidden).

    Returns:
        The last layer's state after each frame, and all layers' state after the last.
    """
    states = list(state.unbind(0))
    outputs = []
    for frame in frames.unbind(1):
        below = frame
        for layer, (w_ih, w_hh, b_ih, b_hh) in enumerate(network.all_weights):
            r_in, z_in, n_in = (below @ w_ih.T + b_ih).chunk(3, dim=-1)
            r_rec, z_rec, n_rec = (states[layer] @ w_hh.T + b_hh).chunk(3, dim=-1)
            r, z = 1 / (1 + torch.exp(-r_in - r_rec)), 1 / (1 + torch.exp(-z_in - z_rec))
            n = torch.tanh(n_in + r * n_rec)
            states[layer] = (1 - z) * n + z * states[layer]
            below = states[layer]
        outputs.append(below)
    return torch.stack(outputs, dim=1), torch.stack(states)


def velocity_rollout(
    forecaster: Forecaster, prefix: Tensor, truth: Tensor, mask: Sequence[bool]
) -> tuple[Tensor, Tensor]:
    """QuaterNet's velocity model the way it is usually written: a call of ``nn.GRU`` a step.

    The prefix is one call; every later frame, true or not, is a call with one frame. Only for a
    forecaster with a GRU, a dense head, quaternions and the residual ``compose``.

    Returns:
        Predicted rotations as features, and the raw outputs.
    """
    backbone, head = forecaster.backbone, forecaster.head
    assert isinstance(backbone, GRUBackbone)
    batch, horizon, width = truth.shape
    context, state = backbone.gru(prefix, torch.stack(backbone.initial_state(batch)))
    last = prefix[:, -1]
    features, raw = [], []
    for step in range(horizon):
        if step:
            last = truth[:, step - 1] if mask[step] else features[-1]
            context, state = backbone.gru(last[:, None], state)
        delta = head(context[:, -1])
        raw.append(delta)
        aw, ax, ay, az = delta.unbind(-1)
        bw, bx, by, bz = last.view(batch, width // 4, 4).unbind(-1)
        product = torch.stack(
            [
                aw * bw - ax * bx - ay * by - az * bz,
                aw * bx + ax * bw + ay * bz - az * by,
                aw * by - ax * bz + ay * bw + az * bx,
                aw * bz + ax * by - ay * bx + az * bw,
            ],
            dim=-1,
        )
        features.append((product / product.norm(dim=-1, keepdim=True)).flatten(1))
    return torch.stack(features, dim=1), torch.stack(raw, dim=1)
