"""Kinematics against a plain loop over joints: values, gradients, forests, chunks, edges."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest
import torch
from torch import Tensor

from posecast.errors import SkeletonError
from posecast.geometry import quaternion
from posecast.skeleton import (
    Skeleton,
    forward_kinematics,
    joint_positions,
    local_to_root,
    planes,
    root_to_local,
)

_path = Path(__file__).parents[1] / "references" / "plain_kinematics.py"
_spec = importlib.util.spec_from_file_location("plain_kinematics", _path)
assert _spec is not None
assert _spec.loader is not None
plain = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(plain)

TREES = {
    "body": (-1, 0, 1, 2, 0, 4, 5, 0, 7, 8, 8, 10, 8, 12),
    "chain": (-1, 0, 1, 2, 3, 4),
    "star": (-1, 0, 0, 0, 0),
    "forest": (-1, 0, 1, -1, 3, 1, 3, -1),
    "roots only": (-1, -1, -1),
    "one joint": (-1,),
    "crossed": (-1, 0, 0, 2, 1, 1, 2, 3, 5, 4),
    # drawn at random: every joint has some joint before it as its parent, or none
    "wild": (-1, 0, -1, 2, 0, 3, 1, 5, 5, 0, 3, 9, 7, 7, 2, 11, 4, 9, 16, 12),
    "wilder": (-1, 0, 1, 0, -1, 3, 3, 2, 6, 4, 9, 8, 1, 10, 12, 8, 14, 13, 15, 5, 17, 20, -1),
}


def skeleton_of(tree: str) -> Skeleton:
    parents = TREES[tree]
    return Skeleton(tuple(f"joint{k}" for k in range(len(parents))), parents)


def poses(shape: tuple[int, ...], skeleton: Skeleton, generator: torch.Generator) -> Tensor:
    q = torch.randn(*shape, len(skeleton), 4, dtype=torch.float64, generator=generator)
    return quaternion.normalize(q)


def vectors(*shape: int, generator: torch.Generator) -> Tensor:
    return torch.randn(*shape, 3, dtype=torch.float64, generator=generator)


def exactly(a: Tensor, b: Tensor) -> None:
    torch.testing.assert_close(a, b, atol=1e-12, rtol=0)


BODIES = {"one body": (), "one a clip": (4, 1), "one a frame": (4, 6)}


@pytest.mark.parametrize("bodies", BODIES)
@pytest.mark.parametrize("tree", TREES)
def test_positions_and_rotations_are_those_of_a_loop_over_joints(tree, bodies, generator):
    skeleton = skeleton_of(tree)
    q = poses((4, 6), skeleton, generator)
    offsets = vectors(*BODIES[bodies], len(skeleton), generator=generator)
    roots = vectors(4, 6, generator=generator)
    for root in (roots, None):
        positions, rotations = plain.plain_kinematics(skeleton.parents, q, offsets, root)
        world = forward_kinematics(skeleton, q, offsets, root)
        exactly(world.positions, positions)
        exactly(world.rotations, rotations)
        exactly(joint_positions(skeleton, q, offsets, root), positions)
        exactly(plain.plain_positions(skeleton.parents, q, offsets, root), positions)


def gradients(function, q: Tensor, offsets: Tensor, roots: Tensor, weights: Tensor):
    """Gradients of a weighted sum of positions; that of rotations in the tangent space."""
    inputs = [x.clone().requires_grad_() for x in (q, offsets, roots)]
    (function(*inputs) * weights).sum().backward()
    turned = torch.zeros_like(q) if inputs[0].grad is None else inputs[0].grad
    return turned, turned - (turned * q).sum(-1, keepdim=True) * q, *(x.grad for x in inputs[1:])


@pytest.mark.parametrize("chunk", [10**9, 30])
@pytest.mark.parametrize("bodies", BODIES)
@pytest.mark.parametrize("tree", TREES)
def test_gradients_are_those_of_a_loop_over_joints(tree, bodies, chunk, generator, monkeypatch):
    monkeypatch.setattr(planes, "CHUNK_ELEMENTS", chunk)
    skeleton = skeleton_of(tree)
    q = poses((4, 6), skeleton, generator)
    offsets = vectors(*BODIES[bodies], len(skeleton), generator=generator)
    roots = vectors(4, 6, generator=generator)
    weights = vectors(4, 6, len(skeleton), generator=generator)

    def slow(q, o, r):
        return plain.plain_kinematics(skeleton.parents, q, o, r)[0]

    def world(q, o, r):
        return forward_kinematics(skeleton, q, o, r).positions

    def fast(q, o, r):
        return joint_positions(skeleton, q, o, r)

    truth = gradients(slow, q, offsets, roots, weights)
    by_level = gradients(world, q, offsets, roots, weights)
    by_torque = gradients(fast, q, offsets, roots, weights)
    for expected, found in zip(truth[1:], by_level[1:], strict=True):
        exactly(found, expected)
    for expected, found in zip(truth[1:], by_torque[1:], strict=True):
        exactly(found, expected)
    exactly(by_torque[0], by_torque[1])  # no part along the quaternion


@pytest.mark.parametrize("tree", ["body", "forest"])
def test_gradients_agree_with_finite_differences(tree, generator):
    skeleton = skeleton_of(tree)
    raw = torch.randn(2, len(skeleton), 4, dtype=torch.float64, generator=generator)
    shared = vectors(len(skeleton), generator=generator)
    own = vectors(2, len(skeleton), generator=generator)
    roots = vectors(2, generator=generator)

    def fast(raw, offsets, roots):
        return joint_positions(skeleton, quaternion.normalize(raw), offsets, roots)

    for offsets in (shared, own):
        inputs = [x.clone().requires_grad_() for x in (raw, offsets, roots)]
        assert torch.autograd.gradcheck(fast, inputs)


def test_only_the_gradients_asked_for_are_made(generator):
    skeleton = skeleton_of("body")
    q = poses((5,), skeleton, generator)
    offsets = vectors(len(skeleton), generator=generator).requires_grad_()
    positions = joint_positions(skeleton, q, offsets)
    positions.sum().backward()
    assert q.grad is None
    assert offsets.grad is not None
    assert not joint_positions(skeleton, q, offsets.detach()).requires_grad
    with torch.no_grad():
        assert not joint_positions(skeleton, q, offsets).requires_grad


def test_rotations_from_inference_serve_gradients_of_the_body(generator):
    skeleton = skeleton_of("body")
    with torch.inference_mode():
        q = poses((5,), skeleton, generator).clone()
    offsets = vectors(len(skeleton), generator=generator).requires_grad_()
    forward_kinematics(skeleton, q, offsets).positions.sum().backward()
    assert offsets.grad is not None


@pytest.mark.parametrize("count", [1, 2, 7, 8, 9, 23])
def test_chunks_change_nothing(count, generator, monkeypatch):
    skeleton = skeleton_of("body")
    q = poses((count,), skeleton, generator)
    offsets = vectors(count, len(skeleton), generator=generator)
    roots = vectors(count, generator=generator)
    whole = joint_positions(skeleton, q, offsets, roots)
    monkeypatch.setattr(planes, "CHUNK_ELEMENTS", 4 * len(skeleton))
    exactly(joint_positions(skeleton, q, offsets, roots), whole)
    one_by_one = [joint_positions(skeleton, q[k], offsets[k], roots[k]) for k in range(count)]
    exactly(torch.stack(one_by_one), whole)


def test_every_root_of_a_forest_stands_at_the_root_position_plus_its_own_offset(generator):
    skeleton = skeleton_of("forest")
    assert skeleton.roots == (0, 3, 7)
    q = poses((2,), skeleton, generator)
    offsets = vectors(len(skeleton), generator=generator)
    roots = vectors(2, generator=generator)
    positions = joint_positions(skeleton, q, offsets, roots)
    for root in skeleton.roots:
        exactly(positions[:, root], roots + offsets[root])
        exactly(joint_positions(skeleton, q, offsets)[:, root], offsets[root].expand(2, 3))


def test_turning_the_root_turns_the_body_about_it(generator):
    skeleton = skeleton_of("body")
    q = poses((5,), skeleton, generator)
    offsets = vectors(len(skeleton), generator=generator)
    turn = poses((5,), skeleton, generator)[:, 0]
    turned = q.clone()
    turned[:, 0] = quaternion.product(turn, q[:, 0])
    before = joint_positions(skeleton, q, offsets) - offsets[0]
    after = joint_positions(skeleton, turned, offsets) - offsets[0]
    exactly(after, quaternion.rotate(turn[:, None], before))


def test_bone_lengths_do_not_depend_on_the_pose(generator):
    skeleton = skeleton_of("body")
    offsets = vectors(len(skeleton), generator=generator)
    positions = joint_positions(skeleton, poses((9,), skeleton, generator), offsets)
    bones = (positions[:, 1:] - positions[:, skeleton.parents[1:]]).norm(dim=-1)
    exactly(bones, offsets[1:].norm(dim=-1).expand(9, -1))


@pytest.mark.parametrize("tree", TREES)
def test_local_and_root_relative_rotations_undo_each_other(tree, generator):
    skeleton = skeleton_of(tree)
    q = poses((4, 6), skeleton, generator)
    world = local_to_root(skeleton, q)
    exactly(world, plain.plain_kinematics(skeleton.parents, q, q[..., 1:])[1])
    exactly(root_to_local(skeleton, world), q)
    exactly(local_to_root(skeleton, root_to_local(skeleton, q)), q)


@pytest.mark.parametrize("chunk", [10**9, 10])
@pytest.mark.parametrize("convert", [local_to_root, root_to_local])
def test_conversions_of_rotations_have_their_full_gradient(convert, chunk, generator, monkeypatch):
    monkeypatch.setattr(planes, "CHUNK_ELEMENTS", chunk)
    skeleton = skeleton_of("forest")
    raw = torch.randn(2, len(skeleton), 4, dtype=torch.float64, generator=generator)
    assert torch.autograd.gradcheck(lambda x: convert(skeleton, x), (raw.requires_grad_(),))


def test_float32_keeps_its_type_and_its_digits(generator):
    skeleton = skeleton_of("body")
    q = poses((4, 6), skeleton, generator)
    offsets = vectors(len(skeleton), generator=generator)
    roots = vectors(4, 6, generator=generator)
    truth = joint_positions(skeleton, q, offsets, roots)
    small = [x.float().requires_grad_() for x in (q, offsets, roots)]
    found = joint_positions(skeleton, *small)
    assert found.dtype == torch.float32
    torch.testing.assert_close(found.double(), truth, atol=1e-5, rtol=0)
    found.sum().backward()
    assert [x.grad.dtype for x in small] == [torch.float32] * 3


def test_digits_survive_far_from_the_origin(generator):
    skeleton = skeleton_of("body")
    q = poses((50,), skeleton, generator).float()
    offsets = vectors(len(skeleton), generator=generator).float()
    weights = vectors(50, len(skeleton), generator=generator).float()
    here, far = torch.zeros(50, 3), torch.full((50, 3), 1e4)

    def fast(q, o, r):
        return joint_positions(skeleton, q, o, r)

    near_gradient = gradients(fast, q, offsets, here, weights)[0]
    torch.testing.assert_close(
        gradients(fast, q, offsets, far, weights)[0], near_gradient, atol=0, rtol=0
    )


def test_any_memory_layout_and_any_batch_axes_will_do(generator):
    skeleton = skeleton_of("body")
    q = poses((4, 6), skeleton, generator)
    offsets = vectors(4, 6, len(skeleton), generator=generator)
    roots = vectors(4, 6, generator=generator)
    truth = joint_positions(skeleton, q, offsets, roots)
    swapped = joint_positions(
        skeleton, q.transpose(0, 1), offsets.transpose(0, 1), roots.transpose(0, 1)
    )
    exactly(swapped.transpose(0, 1), truth)
    backwards = q.flip(-1).contiguous().flip(-1)[..., ::1, :]
    exactly(joint_positions(skeleton, backwards, offsets, roots), truth)
    strided = q.new_empty(4, 6, len(skeleton), 8)[..., ::2].copy_(q)
    exactly(joint_positions(skeleton, strided, offsets, roots), truth)
    exactly(joint_positions(skeleton, q[1, 2], offsets[1, 2], roots[1, 2]), truth[1, 2])
    exactly(joint_positions(skeleton, q[None], offsets[None], roots[None])[0], truth)


@pytest.mark.parametrize("shape", [(0,), (0, 5), (5, 0)])
def test_an_empty_batch_gives_an_empty_result_and_a_zero_gradient(shape, generator):
    skeleton = skeleton_of("body")
    q = poses(shape, skeleton, generator).requires_grad_()
    offsets = vectors(len(skeleton), generator=generator).requires_grad_()
    roots = vectors(*shape, generator=generator)
    positions = joint_positions(skeleton, q, offsets, roots)
    assert positions.shape == (*shape, len(skeleton), 3)
    assert forward_kinematics(skeleton, q, offsets, roots).positions.shape == positions.shape
    positions.sum().backward()
    assert q.grad.shape == q.shape
    assert (offsets.grad == 0).all()


def test_arguments_are_left_as_they_were(generator):
    skeleton = skeleton_of("body")
    inputs = (
        poses((6,), skeleton, generator),
        vectors(6, len(skeleton), generator=generator),
        vectors(6, generator=generator),
    )
    copies = [x.clone() for x in inputs]
    joint_positions(skeleton, *inputs)
    forward_kinematics(skeleton, *inputs)
    root_to_local(skeleton, inputs[0])
    gradients(lambda *x: joint_positions(skeleton, *x), *inputs, torch.ones(6, 14, 3).double())
    for before, after in zip(copies, inputs, strict=True):
        torch.testing.assert_close(after, before, atol=0, rtol=0)


@pytest.mark.parametrize("tree", TREES)
def test_what_a_compiler_is_shown_has_the_same_values_and_gradients(tree, generator, monkeypatch):
    skeleton = skeleton_of(tree)
    q = poses((4, 6), skeleton, generator)
    offsets = vectors(4, 1, len(skeleton), generator=generator)
    roots = vectors(4, 6, generator=generator)
    weights = vectors(4, 6, len(skeleton), generator=generator)

    def fast(q, o, r):
        return joint_positions(skeleton, q, o, r)

    expected = gradients(fast, q, offsets, roots, weights)
    world = forward_kinematics(skeleton, q, offsets)
    monkeypatch.setattr(torch.compiler, "is_compiling", lambda: True)
    found = gradients(fast, q, offsets, roots, weights)
    for one, other in zip(found[1:], expected[1:], strict=True):
        exactly(one, other)
    exactly(forward_kinematics(skeleton, q, offsets).positions, world.positions)
    exactly(local_to_root(skeleton, q), world.rotations)


def test_a_plan_made_for_inference_serves_training(generator):
    skeleton = Skeleton(("a", "b", "c"), (-1, 0, 1))
    q = poses((2,), skeleton, generator)
    with torch.inference_mode():
        root_to_local(skeleton, q)
        joint_positions(skeleton, q, torch.ones(3, 3, dtype=torch.float64))
    q.requires_grad_()
    root_to_local(skeleton, q).square().sum().backward()
    joint_positions(skeleton, q, torch.ones(3, 3, dtype=torch.float64)).sum().backward()
    assert q.grad.isfinite().all()


def test_the_second_derivative_of_the_fast_positions_is_refused(generator):
    skeleton = skeleton_of("chain")
    q = poses((2,), skeleton, generator).requires_grad_()
    offsets = vectors(len(skeleton), generator=generator)
    positions = joint_positions(skeleton, q, offsets)
    (first,) = torch.autograd.grad(positions.square().sum(), q, create_graph=True)
    with pytest.raises(RuntimeError, match="once_differentiable"):
        first.sum().backward()


@pytest.mark.parametrize(
    "function",
    [
        lambda s, q, o: joint_positions(s, q, o),
        lambda s, q, o: forward_kinematics(s, q, o),
        lambda s, q, o: local_to_root(s, q),
        lambda s, q, o: root_to_local(s, q),
    ],
)
def test_a_joint_axis_of_another_skeleton_is_refused(function, generator):
    skeleton, other = skeleton_of("body"), skeleton_of("chain")
    with pytest.raises(SkeletonError, match=r"6 joints along the joint axis.* has 14"):
        function(skeleton, poses((2,), other, generator), vectors(6, generator=generator))
