"""Which joints are predicted from which: the trees of a structured head."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import groupby
from typing import Literal, get_args

import torch

from posecast.config import did_you_mean
from posecast.errors import ConfigError
from posecast.skeleton import Skeleton

Tree = Literal["kinematic", "reverse", "random"]
Ancestors = Literal["none", "parent", "all"]


@dataclass(frozen=True)
class ReadingOrder:
    """For every joint the joints whose predictions it reads, none of them in a circle.

    Args:
        reads: for each joint indices of others, in the order in which they are read.
    """

    reads: tuple[tuple[int, ...], ...]

    @classmethod
    def of(
        cls,
        skeleton: Skeleton,
        *,
        ancestors: Ancestors = "all",
        tree: Tree | Mapping[str, str | None] = "kinematic",
        tree_seed: int = 0,
    ) -> ReadingOrder:
        """The order along a tree.

        Args:
            skeleton: whose joints; several roots are allowed.
            ancestors: what a joint reads: ``all`` above it, its parent first and then upwards (the
                dense wiring of Aksan et al. 2019); its ``parent`` alone (their sparse wiring); or
                ``none``, so that every joint is predicted for itself.
            tree: ``kinematic``: the skeleton's own; ``reverse``: every bone of it the other way
                around, so that a joint reads its children, or all below it; ``random``: the
                skeleton's own with its joints in each other's places, so that the shape of the tree
                and the number of weights stay; or the parent of every joint by name, null for
                roots.
            tree_seed: which of the random trees.

        Raises:
            ConfigError: an unknown choice, a tree where none is read, or one that leaves joints
                out, names others, or runs in a circle.
        """
        if ancestors not in get_args(Ancestors):
            raise ConfigError(
                f"ancestors: {ancestors!r} is not known; choose {_listed(get_args(Ancestors))}"
            )
        if tree_seed < 0:
            raise ConfigError(f"tree_seed: {tree_seed}; expected 0 or more")
        if tree_seed and tree != "random":
            raise ConfigError(
                f"tree_seed: {tree_seed} draws a random tree, but the tree is {tree!r}; "
                "set tree to random, or leave tree_seed out"
            )
        if ancestors == "none":
            if tree != "kinematic":
                raise ConfigError(
                    f"tree: {tree!r} is read by nobody with ancestors 'none'; "
                    "choose ancestors 'parent' or 'all', or leave tree out"
                )
            return cls(((),) * len(skeleton))
        if tree == "reverse":
            return cls(_below(skeleton, everything=ancestors == "all"))
        chains = _chains(_parents(skeleton, tree, tree_seed))
        return cls(chains if ancestors == "all" else tuple(chain[:1] for chain in chains))

    @cached_property
    def groups(self) -> tuple[tuple[int, ...], ...]:
        """Joints that are predicted together: all they read is in groups before, and they read
        equally many."""
        depth: dict[int, int] = {}

        def find(joint: int) -> int:
            if joint not in depth:
                depth[joint] = 1 + max((find(read) for read in self.reads[joint]), default=-1)
            return depth[joint]

        def key(joint: int) -> tuple[int, int]:
            return find(joint), len(self.reads[joint])

        ordered = sorted(range(len(self.reads)), key=key)
        return tuple(tuple(joints) for _, joints in groupby(ordered, key=key))


def _listed(choices: tuple[str, ...]) -> str:
    """Choices in quotes, in words."""
    quoted = [repr(choice) for choice in choices]
    return f"{', '.join(quoted[:-1])} or {quoted[-1]}"


def _below(skeleton: Skeleton, *, everything: bool) -> tuple[tuple[int, ...], ...]:
    """For each joint its children, or all joints below it, the nearest first."""
    if not everything:
        return skeleton.children
    found: list[tuple[int, ...]] = [()] * len(skeleton)
    for joint in reversed(range(len(skeleton))):
        below = [(child, *found[child]) for child in skeleton.children[joint]]
        level = sorted((each for chain in below for each in chain), key=skeleton.depths.__getitem__)
        found[joint] = tuple(level)
    return tuple(found)


def _parents(
    skeleton: Skeleton, tree: Tree | Mapping[str, str | None], tree_seed: int
) -> tuple[int, ...]:
    """The parent of every joint, -1 for roots; they need not come before their children."""
    if isinstance(tree, Mapping):
        return _named_parents(skeleton, tree)
    if tree == "kinematic":
        return skeleton.parents
    if tree != "random":
        raise ConfigError(
            f"tree: {tree!r} is not known; choose {_listed(get_args(Tree))}, or give the parent "
            "of every joint by name"
        )
    generator = torch.Generator("cpu").manual_seed(tree_seed)
    sits_at = torch.randperm(len(skeleton), generator=generator, device="cpu").tolist()
    who = [sits_at.index(place) for place in range(len(skeleton))]
    above = (skeleton.parents[sits_at[joint]] for joint in range(len(skeleton)))
    return tuple(-1 if parent == -1 else who[parent] for parent in above)


def _named_parents(skeleton: Skeleton, tree: Mapping[str, str | None]) -> tuple[int, ...]:
    """Parents by name as indices."""
    missing = [name for name in skeleton.names if name not in tree]
    if missing:
        raise ConfigError(
            f"tree: says nothing of {', '.join(missing)}; give a parent for every joint, or null"
        )
    for name in (*tree, *(parent for parent in tree.values() if parent is not None)):
        if name not in skeleton.names:
            raise ConfigError(
                f"tree: no joint is called {name!r}; {did_you_mean(name, skeleton.names)}"
            )
    above = (tree[name] for name in skeleton.names)
    return tuple(-1 if parent is None else skeleton.index(parent) for parent in above)


def _chains(parents: tuple[int, ...]) -> tuple[tuple[int, ...], ...]:
    """All joints above each, the nearest first."""
    chains: list[tuple[int, ...]] = []
    for joint in range(len(parents)):
        chain: list[int] = []
        above = parents[joint]
        while above != -1:
            if len(chain) == len(parents):
                raise ConfigError("tree: runs in a circle; no joint may be above itself")
            chain.append(above)
            above = parents[above]
        chains.append(tuple(chain))
    return tuple(chains)
