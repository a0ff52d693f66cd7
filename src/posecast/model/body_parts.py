"""Five parts of a body, torso, arms and legs: which joints belong to which."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from posecast.config import did_you_mean
from posecast.errors import ConfigError
from posecast.skeleton import Skeleton

PARTS = ("torso", "left_arm", "right_arm", "left_leg", "right_leg")

_NAMES: Mapping[Literal["arm", "leg"], tuple[str, ...]] = {
    "arm": (
        *("shoulder", "clav", "collar", "scapula", "arm", "elbow", "humerus", "radius"),
        *("wrist", "hand"),
    ),
    "leg": (
        *("hip", "thigh", "leg", "knee", "femur", "shin", "calf", "tibia", "ankle", "foot"),
        "toe",
    ),
}
"""What names of joints of a limb contain; fingers and end sites are found below them."""


@dataclass(frozen=True)
class BodyParts:
    """The joints of the torso, of both arms and of both legs.

    Args:
        torso: indices of joints.
        arms: those of the left and of the right arm, equally many; the first of the one corresponds
            to the first of the other, and so on.
        legs: those of the left and of the right leg, likewise.
    """

    torso: tuple[int, ...]
    arms: tuple[tuple[int, ...], tuple[int, ...]]
    legs: tuple[tuple[int, ...], tuple[int, ...]]

    @classmethod
    def of(cls, skeleton: Skeleton, parts: Mapping[str, list[str]] | None = None) -> BodyParts:
        """The parts of a skeleton.

        Args:
            skeleton: whose joints; several roots are allowed.
            parts: names of the joints of ``torso``, ``left_arm``, ``right_arm``, ``left_leg`` and
                ``right_leg``, those of a left and a right part in the same order. ``None``: by the
                skeleton's own names. A joint that has a twin on the other side and the name of a
                joint of an arm or a leg is of that limb, and so is what hangs from it; all others
                are of the torso.

        Raises:
            ConfigError: a part or a joint that does not exist, a part without joints, a joint in
                two parts or in none, or sides with different numbers of joints.
        """
        found = _by_name(skeleton) if parts is None else _as_told(skeleton, parts)
        empty = [name for name in PARTS if not found[name]]
        if empty:
            where = "among the names of this skeleton" if parts is None else "given"
            raise ConfigError(
                f"parts: no joint of {', '.join(empty)} is {where}; choose joints by name for each "
                f"of {', '.join(PARTS)}"
            )
        for limb in _NAMES:
            left, right = (len(found[f"{side}_{limb}"]) for side in ("left", "right"))
            if left != right:
                raise ConfigError(
                    f"parts: left_{limb} has {left} joints, right_{limb} {right}; they share "
                    "weights: choose equally many, joint by joint in the same order"
                )
        torso, *limbs = (found[name] for name in PARTS)
        return cls(torso, (limbs[0], limbs[1]), (limbs[2], limbs[3]))

    @property
    def kinds(self) -> tuple[tuple[tuple[int, ...], ...], ...]:
        """Parts in the order of ``PARTS``, those that share weights together."""
        return ((self.torso,), self.arms, self.legs)

    @property
    def joints(self) -> tuple[int, ...]:
        """All joints, part by part in that order."""
        return tuple(joint for kind in self.kinds for part in kind for joint in part)


def _by_name(skeleton: Skeleton) -> dict[str, tuple[int, ...]]:
    """Joints of each part by what they are called and what they hang from."""
    pairs = skeleton.left_right_pairs
    side = {joint: ("left", "right")[which] for pair in pairs for which, joint in enumerate(pair)}
    part_of: list[str] = []
    for joint, (name, parent) in enumerate(zip(skeleton.names, skeleton.parents, strict=True)):
        limb = next((limb for limb in _NAMES if _is_of(limb, name)), None)
        above = "torso" if parent == -1 else part_of[parent]
        part_of.append(f"{side[joint]}_{limb}" if joint in side and limb else above)
    found = {
        name: tuple(joint for joint, part in enumerate(part_of) if part == name) for name in PARTS
    }
    twins = dict(pairs)
    for limb in _NAMES:
        # In skeletons that list the sides in different orders, twins correspond.
        across = tuple(twins.get(joint, -1) for joint in found[f"left_{limb}"])
        if sorted(across) == sorted(found[f"right_{limb}"]):
            found[f"right_{limb}"] = across
    return found


def _is_of(limb: Literal["arm", "leg"], name: str) -> bool:
    return any(word in name.lower() for word in _NAMES[limb])


def _as_told(skeleton: Skeleton, parts: Mapping[str, list[str]]) -> dict[str, tuple[int, ...]]:
    """Joints of each part by name as indices."""
    for part in parts:
        if part not in PARTS:
            raise ConfigError(f"parts: no part is called {part!r}; {did_you_mean(part, PARTS)}")
    told = [(name, part) for part, names in parts.items() for name in names]
    for name, part in told:
        if name not in skeleton.names:
            raise ConfigError(
                f"parts.{part}: no joint is called {name!r}; {did_you_mean(name, skeleton.names)}"
            )
    for name, count in Counter(name for name, _ in told).items():
        if count > 1:
            places = " and ".join(part for joint, part in told if joint == name)
            raise ConfigError(f"parts: {name} is in {places}; a joint belongs to one part")
    missing = [name for name in skeleton.names if name not in dict(told)]
    if missing:
        raise ConfigError(
            f"parts: {', '.join(missing)} in none; every joint that is written belongs to a part"
        )
    return {part: tuple(map(skeleton.index, parts.get(part, ()))) for part in PARTS}
