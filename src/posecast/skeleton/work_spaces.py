"""Buffers of the kinematics of one chunk of poses, and the steps that run in them.

A work space serves all chunks of one length: fresh memory, and even a fresh view of old memory,
costs as much as the arithmetic of a step. What a method returns is valid until the next call.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from posecast.skeleton.planes import (
    Quaternions,
    Vectors,
    add_product,
    cross,
    from_planes,
    product,
    rotate,
    to_planes,
)
from posecast.skeleton.tree_plan import Level, Run, TreePlan


class Step(NamedTuple):
    """The products of one level of a walk.

    Args:
        parents: places to gather the parents' rotations from; ``None``: read where they are.
        above: the parents' rotations.
        own: rotations relative to them.
        result: world rotations.
    """

    parents: Tensor | None
    above: Quaternions
    own: Quaternions
    result: Quaternions


class Walk:
    """World rotations of a chunk, level by level down the tree."""

    def __init__(self, plan: TreePlan, levels: tuple[Level, ...], like: Tensor, poses: int) -> None:
        self.roots = plan.roots
        self.order = plan.order[: levels[-1].joints.stop if levels else plan.roots]
        self.local = like.new_empty(self.order.shape[0], 4, poses)
        self.world = torch.empty_like(self.local)
        self.steps = [self._step(level) for level in levels]

    def _step(self, level: Level) -> Step:
        own, result = self.local[level.joints], self.world[level.joints]
        in_place = len(level.runs) == 1
        above = self.world[level.runs[0].parents] if in_place else torch.empty_like(own)
        return Step(
            None if in_place else level.parents,
            Quaternions(above),
            Quaternions(own),
            Quaternions(result),
        )

    def down(self, rotations: Float[Tensor, "joints 4 poses"]) -> Float[Tensor, "turned 4 poses"]:
        """World rotations, in the order of work, from local ones in the skeleton's."""
        torch.index_select(rotations, 0, self.order, out=self.local)
        self.world[: self.roots] = self.local[: self.roots]
        for parents, above, own, result in self.steps:
            if parents is not None:
                torch.index_select(self.world, 0, parents, out=above.all)
            product(above, own, out=result)
        return self.world


class PlacingSpace:
    """Positions of a chunk: ``turn``, then ``place``; its walk goes down the levels given."""

    def __init__(self, plan: TreePlan, levels: tuple[Level, ...], like: Tensor, poses: int) -> None:
        joints = plan.order.shape[0]
        self.plan = plan
        self.walk = Walk(plan, levels, like, poses)
        self.bones = like.new_empty(joints, 3, poses)
        self.placed = torch.empty_like(self.bones)
        self.hanging = Vectors(self.bones[plan.roots :])
        self.above = Quaternions(like.new_empty(joints - plan.roots, 4, poses))
        self.twice = Vectors(torch.empty_like(self.hanging.all))
        self.sums = [
            (self.bones[run.joints], self.bones[run.parents])
            for level in (*plan.levels, plan.ends)
            for run in level.runs
        ]

    def turn(
        self, rotations: Float[Tensor, "poses joints 4"], offsets: Float[Tensor, "bodies joints 3"]
    ) -> None:
        """Fill ``bones``: joints' vectors from their parents, in the world; roots' as they are."""
        world = self.walk.down(to_planes(rotations))
        torch.index_select(world, 0, self.plan.parents, out=self.above.all)
        bodies = to_planes(offsets).index_select(0, self.plan.order)
        self.bones[: self.plan.roots] = bodies[: self.plan.roots]
        body = Vectors(bodies[self.plan.roots :])
        rotate(self.above, body, twice=self.twice, out=self.hanging)

    def place(self, roots: Float[Tensor, "poses 3"] | None) -> Float[Tensor, "poses joints 3"]:
        """Positions, summed up in place of the bones."""
        return from_planes(self.places(roots))

    def places(self, roots: Float[Tensor, "poses 3"] | None) -> Float[Tensor, "joints 3 poses"]:
        """The same as planes."""
        if roots is not None:
            self.bones[: self.plan.roots] += roots.t()
        for joints, parents in self.sums:
            joints += parents
        return torch.index_select(self.bones, 0, self.plan.places, out=self.placed)


class PullingSpace:
    """Gradients of a chunk: ``sum`` first; ``offset_gradient`` last, as it spoils the rest."""

    def __init__(self, plan: TreePlan, like: Tensor, poses: int) -> None:
        joints = plan.order.shape[0]
        self.plan = plan
        self.sums, self.moments, self.torques = (like.new_empty(joints, 3, poses) for _ in "sMt")
        self.hanging = Vectors(self.sums[plan.roots :])
        self.crossed = Vectors(self.moments[plan.roots :])
        self.turning = Vectors(self.torques[: plan.turned])
        upwards = (plan.ends, *reversed(plan.levels))
        self.lifts = [self._pairs(self.sums, self.sums, level.runs) for level in upwards]
        self.twists = [
            (
                self.moments[level.joints],
                self.torques[level.joints],
                self._pairs(self.torques, self.moments, level.runs),
            )
            for level in upwards
        ]
        self.above = Quaternions(like.new_empty(joints - plan.roots, 4, poses))
        self.turned_above = Quaternions(self.above.all[: plan.turned - plan.roots])
        self.spun = Quaternions(like.new_empty(plan.turned, 4, poses))
        self.spun_hanging = Quaternions(self.spun.all[plan.roots :])
        # one more row, which ends read: their rotations move nothing
        self.local = like.new_zeros(plan.turned + 1, 4, poses)
        self.local_hanging = Quaternions(self.local[plan.roots : -1])
        self.spread = like.new_empty(joints, 4, poses)

    @staticmethod
    def _pairs(
        parents: Tensor, joints: Tensor, runs: tuple[Run, ...]
    ) -> list[tuple[Tensor, Tensor]]:
        return [(parents[run.parents], joints[run.joints]) for run in runs]

    def sum(
        self,
        gradient: Float[Tensor, "poses joints 3"],
        *,
        world: Float[Tensor, "turned 4 poses"],
    ) -> None:
        """Add to the gradient of every joint those of all below it."""
        self.world = world
        torch.index_select(world, 0, self.plan.parents, out=self.above.all)
        torch.index_select(to_planes(gradient), 0, self.plan.order, out=self.sums)
        for runs in self.lifts:
            for parents, joints in runs:
                parents += joints

    def rotation_gradient(
        self, *, bones: Float[Tensor, "joints 3 poses"]
    ) -> Float[Tensor, "poses joints 4"]:
        """Gradient of the local rotations; zero for ends."""
        plan = self.plan
        cross(Vectors(bones[plan.roots :]), self.hanging, out=self.crossed)
        self.torques.zero_()
        for moments, torques, runs in self.twists:
            moments += torques
            for parents, joints in runs:
                parents += joints
        # 2 (0, R^T tau) q = conj(R) (2 (0, tau) R q), and R q is the joint's own world rotation
        self.spun.all.zero_()
        add_product(self.turning, Quaternions(self.world), out=self.spun, scale=2.0)
        self.local[: plan.roots] = self.spun.all[: plan.roots]
        product(self.turned_above, self.spun_hanging, out=self.local_hanging, sign=-1.0)
        return from_planes(torch.index_select(self.local, 0, plan.spread, out=self.spread))

    def offset_gradient(self) -> Float[Tensor, "joints 3 poses"]:
        """Gradient of the offsets: the sums turned back into the frame of each joint's parent."""
        self.above.all[:, 1:].neg_()
        result = torch.empty_like(self.sums)
        result[: self.plan.roots] = self.sums[: self.plan.roots]
        hanging = Vectors(result[self.plan.roots :])
        rotate(self.above, self.hanging, twice=self.crossed, out=hanging)
        return result.index_select(0, self.plan.places)
