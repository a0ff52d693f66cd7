"""Skeletons with a name, read from the small YAML files beside this one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import torch
from jaxtyping import Float
from torch import Tensor

from posecast.config import did_you_mean, read_yaml
from posecast.errors import SkeletonError
from posecast.skeleton.skeleton import Skeleton

_FOLDER = Path(__file__).parent


@dataclass(frozen=True)
class NamedSkeleton:
    """A skeleton that papers or data sets agree on.

    Args:
        name: what it is called in the catalog, such as ``h36m-32``.
        skeleton: joint names and parents.
        whole: name of the skeleton this one was selected from; its own name if it is complete.
        joints: for each joint its index in ``whole``.
        rest_offsets: translation of each joint from its parent at rest, metres; ``None`` where
            the numbers may not be passed on (SMPL).
    """

    name: str
    skeleton: Skeleton
    whole: str
    joints: tuple[int, ...]
    rest_offsets: tuple[tuple[float, float, float], ...] | None

    def offsets(self, dtype: torch.dtype = torch.float64) -> Float[Tensor, "joints 3"]:
        """Translations from the parent at rest, metres; the first root has zero.

        Raises:
            SkeletonError: this skeleton has a topology only.
        """
        if self.rest_offsets is None:
            raise SkeletonError(
                f"skeleton {self.name!r} has no offsets of its own (its body model is licensed); "
                "bring a template"
            )
        return torch.tensor(self.rest_offsets, dtype=dtype)


def skeleton_names() -> tuple[str, ...]:
    """Names of all skeletons in the catalog, sorted."""
    return tuple(sorted(path.stem for path in _FOLDER.glob("*.yaml")))


@cache
def named_skeleton(name: str) -> NamedSkeleton:
    """The skeleton called ``name``.

    Raises:
        SkeletonError: there is none; the message lists those that exist.
    """
    if name not in skeleton_names():
        raise SkeletonError(
            f"no skeleton is called {name!r}; {did_you_mean(name, skeleton_names())}"
        )
    entry = read_yaml(_FOLDER / f"{name}.yaml")
    return _selection(name, entry) if "of" in entry else _complete(name, entry)


def _complete(name: str, entry: Mapping[str, Any]) -> NamedSkeleton:
    """A skeleton written out joint by joint."""
    joints: dict[str, dict[str, Any]] = entry["joints"]
    index = {joint: place for place, joint in enumerate(joints)}
    parents = tuple(
        -1 if fields["parent"] is None else index[fields["parent"]] for fields in joints.values()
    )
    offsets: tuple[tuple[float, float, float], ...] | None = None
    if "unit_m" in entry:
        unit = float(entry["unit_m"])
        triples = [fields["offset"] for fields in joints.values()]
        offsets = tuple((unit * x, unit * y, unit * z) for x, y, z in triples)
    return NamedSkeleton(
        name=name,
        skeleton=Skeleton(tuple(joints), parents),
        whole=name,
        joints=tuple(range(len(joints))),
        rest_offsets=offsets,
    )


def _selection(name: str, entry: Mapping[str, Any]) -> NamedSkeleton:
    """Some joints of another skeleton; the offset of a joint left out adds to those below it."""
    whole = named_skeleton(entry["of"])
    joints = tuple(whole.skeleton.index(joint) for joint in entry["joints"])
    kept = frozenset(joints)
    offsets: tuple[tuple[float, float, float], ...] | None = None
    if whole.rest_offsets is not None:
        sums: list[tuple[float, float, float]] = []
        for joint in joints:
            x, y, z = whole.rest_offsets[joint]
            for above in whole.skeleton.ancestors(joint):
                if above in kept:
                    break
                dx, dy, dz = whole.rest_offsets[above]
                x, y, z = x + dx, y + dy, z + dz
            sums.append((x, y, z))
        offsets = tuple(sums)
    return NamedSkeleton(
        name=name,
        skeleton=whole.skeleton.select(joints),
        whole=whole.name,
        joints=joints,
        rest_offsets=offsets,
    )
