"""Kinematics under ``torch.compile``: one graph, the same values and the same gradients."""

from __future__ import annotations

import subprocess
import sys

import pytest

COMPILED = """
import torch
from posecast.geometry import quaternion
from posecast.skeleton import Skeleton, forward_kinematics

torch.manual_seed(0)
skeleton = Skeleton(tuple("abcdef"), (-1, 0, 1, 0, -1, 4))
raw, offsets, roots = (torch.randn(s).double() for s in ((7, 6, 4), (6, 3), (7, 3)))

def loss(raw, offsets):
    world = forward_kinematics(skeleton, quaternion.normalize(raw), offsets, roots)
    return world.positions.square().sum() + world.rotations[..., 0].sum()

results = []
for call in (loss, torch.compile(loss, backend="aot_eager", fullgraph=True)):
    leaves = [x.clone().requires_grad_() for x in (raw, offsets)]
    value = call(*leaves)
    value.backward()
    results.append([value.detach(), *(leaf.grad for leaf in leaves)])
for eager, compiled in zip(*results, strict=True):
    torch.testing.assert_close(compiled, eager)
"""


@pytest.mark.slow
def test_compiling_changes_no_value_and_no_gradient():
    # in a process of its own: the shape checks of the test suite are not made for compilers
    done = subprocess.run(
        [sys.executable, "-c", COMPILED], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
