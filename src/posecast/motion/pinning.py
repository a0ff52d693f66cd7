"""Foot pinning: feet that slide while they stand are held in place, and legs bent to suit."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from posecast.errors import ConfigError, SkeletonError
from posecast.geometry import quaternion
from posecast.motion.checks import check_motion
from posecast.motion.clip import Clip
from posecast.motion.contacts import NEAR
from posecast.motion.feet import Feet, find_feet, leg_length
from posecast.motion.leg_reach import Leg, Turns, reach, usual_hinge
from posecast.motion.planting import Short, planted
from posecast.motion.standing import Stand, find_stands, lowest_heights, shortest
from posecast.skeleton import Skeleton
from posecast.skeleton.kinematics import World, forward_kinematics

_PASSES = 5
"""At most so many rounds until nothing is left to change; two of them are the rule, the second of
which finds nothing: only where an eased step looks like a contact there are more."""

_POSES = 64
"""So many poses, spread over the clip, tell feet by geometry where names do not."""

_BONE = 0.01
"""Least length of thigh and shin, in lengths of the leg."""


class PinReport(NamedTuple):
    """What ``pin_feet`` found and changed.

    Args:
        contacts: how many the clip has; see ``find_stands``.
        moved: in how many of them the foot slid, and was moved.
        mean_cm: distance that a toe was moved, mean over the frames in which it was.
        largest_cm: the largest such distance.
        largest_deg: largest change of the rotation of a joint relative to its parent.
        short: contacts in some frames of which the foot is not held, as its leg is too short.
    """

    contacts: int
    moved: int
    mean_cm: float
    largest_cm: float
    largest_deg: float
    short: tuple[Short, ...]

    def text(self) -> str:
        """In one line."""
        line = (
            f"feet pinned in {self.moved} of {self.contacts} contacts: toes moved by "
            f"{self.mean_cm:.1f} cm in the mean and {self.largest_cm:.1f} cm at most, joints by "
            f"{self.largest_deg:.1f} degrees at most"
        )
        if not self.short:
            return line
        left = max(short.left_cm for short in self.short)
        return f"{line}; in {len(self.short)} of them a leg is too short, by up to {left:.1f} cm"


class Pinned(NamedTuple):
    """A clip whose feet stay where they stand, and what that took."""

    clip: Clip
    report: PinReport


class _Joints(NamedTuple):
    """Of one leg, as indices of the skeleton."""

    hip: int
    knee: int
    ankle: int
    toe: int


def pin_feet(
    clip: Clip, *, feet: Feet | None = None, near: float = NEAR, ease: float = 0.1
) -> Pinned:
    """Hold each foot in place while it stands: the joint where the toes begin does not slide.

    Contacts are those of ``find_stands``, since a foot that slides is not slow. Through a contact
    the toe is where it was in the middle of it, as high as it was; in no frame is it below the
    floor. Root and hips stay, the foot keeps its rotation in the world, and the knee the plane and
    side of its bend. Where the leg would be longer than 99.5 % of thigh and shin, or than it was if
    that is more, the heel rises about the toe; where that does not do either the contact ends
    there, and is reported.

    Pinning what is pinned changes no number. If it was rounded in a file in between, contacts are
    found by rounded heights, and toes that are within 0.1 mm of their place stay as they are.
    Tracks, labels and source are kept, as are bones that move (``translations_local``). A clip
    without contacts is returned as it is.

    Args:
        clip: of a body with two legs, each of thigh and shin, on a level floor.
        feet: as ``find_feet`` returns; ``None``: found by name, else in the clip's own poses.
        near: how high above where it stands a foot in contact may be, leg lengths; infinite where
            the floor is not level.
        ease: seconds before and after a contact through which a toe goes over to where it was,
            without a jump of its velocity.

    Raises:
        ConfigError: ``near`` is not positive, or ``ease`` not positive and finite.
        DataError: a number of the clip is not finite, or a quaternion no rotation.
        SkeletonError: no feet are found, or a leg has not two bones.
    """
    if not near > 0:
        raise ConfigError(f"near is {near}; expected a positive number of leg lengths")
    if not 0 < ease < math.inf:
        raise ConfigError(f"ease is {ease}; expected a positive number of seconds")
    check_motion(clip.name or "clip", clip)
    first = last = _Placed(clip, _world(clip))
    if feet is None:
        some = torch.linspace(0, clip.frames - 1, min(clip.frames, _POSES)).long()
        feet = find_feet(clip.skeleton, clip.offsets, first.world.positions[some])
    length = leg_length(clip.skeleton, clip.offsets, feet)
    _check_legs(first, feet, least=_BONE * length)
    short: dict[Stand, Short] = {}
    for _ in range(_PASSES):
        toes = last.world.positions[:, list(feet.toes)]
        stands = find_stands(toes, fps=clip.fps, leg=length, near=near)
        local, left = _planted(last, feet, stands, ease=ease * clip.fps)
        short = {each.stand: each for each in left} | short
        if torch.equal(local, last.clip.rotations_local):
            break
        pinned = replace(clip, rotations_local=local)
        last = _Placed(pinned, _world(pinned))
    return Pinned(last.clip, _report(first, last, feet, stands, tuple(short.values())))


class _Placed(NamedTuple):
    """A clip, and where its joints are."""

    clip: Clip
    world: World


def _planted(
    placed: _Placed, feet: Feet, stands: list[Stand], *, ease: float
) -> tuple[Float[Tensor, "frames joints 4"], list[Short]]:
    """Local rotations with both feet held in their contacts, and where legs are too short.

    Args:
        ease: frames.
    """
    clip, world = placed
    local = clip.rotations_local.clone()
    short: list[Short] = []
    if not stands:
        return local, short
    floors = lowest_heights(world.positions[:, list(feet.toes)])
    for foot, joints in enumerate(_legs(feet)):
        hip, knee, ankle, toe = (world.positions[:, joint] for joint in joints)
        hinge = usual_hinge(world.rotations[:, joints.hip], hip, knee, ankle, toe)
        leg = Leg(hip, knee, ankle, toe, hinge)
        own = [stand for stand in stands if stand.foot == foot]
        planting = planted(leg, own, floor=floors[foot], ease=ease, least=shortest(clip.fps))
        changed = (planting.toe != leg.toe).any(-1)[:, None]
        turned = _turned(clip.skeleton, world, joints, reach(leg, planting.toe))
        for joint, rotations in turned.items():
            local[:, joint] = torch.where(changed, rotations.to(local), local[:, joint])
        short.extend(planting.short)
    return local, short


def _turned(
    skeleton: Skeleton, world: World, joints: _Joints, turns: Turns
) -> dict[int, Float[Tensor, "frames 4"]]:
    """Local rotations of the joints of a leg after its parts have turned in the world.

    The toes keep their rotation in the world: where the heel rises they stay flat.
    """
    shin = quaternion.product(turns.hip, turns.knee)
    still = quaternion.identity(len(shin), like=shin)
    above_and_own = {
        joints.hip: (still, turns.hip),
        # The turn of the hip is above the knee as well as its own, and cancels out.
        joints.knee: (still, turns.knee),
        joints.ankle: (shin, turns.foot),
    }
    if joints.toe != joints.ankle:
        above_and_own[joints.toe] = (turns.foot, still)
    found: dict[int, Tensor] = {}
    for joint, (above, own) in above_and_own.items():
        parent = skeleton.parents[joint]
        over = above if parent < 0 else quaternion.product(above, world.rotations[:, parent])
        turned = quaternion.product(own, world.rotations[:, joint])
        local = quaternion.product(quaternion.conjugate(over), turned)
        found[joint] = quaternion.normalize(local)
    return found


def _report(
    first: _Placed, last: _Placed, feet: Feet, stands: list[Stand], short: tuple[Short, ...]
) -> PinReport:
    toes = list(feet.toes)
    way = (last.world.positions[:, toes] - first.world.positions[:, toes]).norm(dim=-1)
    before, after = (each.clip.rotations_local for each in (first, last))
    changed = (before != after).any(-1)
    moved = torch.stack([changed[:, list(joints)].any(-1) for joints in _legs(feet)], dim=-1)
    if not moved.any():
        return PinReport(len(stands), 0, 0.0, 0.0, 0.0, short)
    return PinReport(
        contacts=len(stands),
        moved=sum(bool(moved[stand.frames, stand.foot].any()) for stand in stands),
        mean_cm=100 * float(way[moved].mean()),
        largest_cm=100 * float(way[moved].max()),
        largest_deg=math.degrees(float(quaternion.angle(before.double(), after.double()).max())),
        short=short,
    )


def _world(clip: Clip) -> World:
    moved = clip.translations_local
    return forward_kinematics(
        clip.skeleton,
        quaternion.normalize(clip.rotations_local.double()),
        (clip.offsets if moved is None else moved).double(),
        clip.root_positions.double(),
    )


def _legs(feet: Feet) -> list[_Joints]:
    return [_Joints(*joints) for joints in zip(*feet, strict=True)]


def _check_legs(placed: _Placed, feet: Feet, *, least: float) -> None:
    """Refuse a leg without thigh or shin, which cannot bend.

    Args:
        least: length of either, metres.
    """
    clip, world = placed
    for leg in _legs(feet):
        for upper, lower in ((leg.hip, leg.knee), (leg.knee, leg.ankle)):
            bone = (world.positions[:, lower] - world.positions[:, upper]).norm(dim=-1).min()
            if bone < least:
                hip, ankle = clip.skeleton.names[leg.hip], clip.skeleton.names[leg.ankle]
                raise SkeletonError(
                    f"clip {clip.name!r}: the leg from {hip!r} to {ankle!r} has no thigh or no "
                    "shin, and cannot bend; expected two bones with a knee between them"
                )
