"""From the numbers of a BVH document to rotations and translations, in file units and axes."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float
from numpy.typing import NDArray
from torch import Tensor

from posecast.io.bvh_channels import channels_to_quaternion
from posecast.io.bvh_document import AXES, BvhDocument, first_columns, is_position
from posecast.io.bvh_layout import Up, guess_up
from posecast.skeleton import Skeleton
from posecast.skeleton.kinematics import joint_positions

_SAMPLED_FRAMES = 48
"""Frames that the vertical axis is guessed from, spread evenly over the clip."""

STILL = 2e-6
"""File units within which a translation counts as constant: what six decimals can shake it by."""


def decode_rotations(document: BvhDocument) -> Float[Tensor, "frames joints 4"]:
    """Rotations in file axes; joints with equal orders are converted together."""
    starts = first_columns(document.joints)
    members: dict[str, list[int]] = {}
    for place, joint in enumerate(document.joints):
        members.setdefault(joint.rotation_axes, []).append(place)
    columns = {
        axes: [
            [starts[place] + document.joints[place].rotation_places[turn] for place in places]
            for turn in range(len(axes))
        ]
        for axes, places in members.items()
    }
    return channels_to_quaternion(document.values, columns, list(members.values()))


class Places:
    """Translations of all joints in file units and file axes.

    Attributes:
        root: (frames, 3) positions of the first root.
        offsets: (joints, 3) translations from the parent, 0 for the first root; where they
            change in time, the OFFSET of the file.
        moving: by joint, (frames, 3) translations that change in time.
    """

    def __init__(self, document: BvhDocument) -> None:
        self.document = document
        starts = first_columns(document.joints)
        self.offsets = np.array(
            [[float(word) for word in joint.offset] for joint in document.joints]
        )
        self.root = self._translation(0, starts[0])
        self.moving: dict[int, NDArray[np.float64]] = {}
        self.offsets[0] = 0
        for place, joint in enumerate(document.joints):
            if place == 0 or (joint.parent >= 0 and not joint.position_axes):
                continue
            translation = self._translation(place, starts[place])
            if joint.parent < 0:
                translation = translation - self.root
            low, high = translation.min(axis=0), translation.max(axis=0)
            if (high - low <= STILL).all():
                self.offsets[place] = low + (high - low) / 2
            else:
                self.moving[place] = translation

    def _translation(self, place: int, start: int) -> NDArray[np.float64]:
        joint = self.document.joints[place]
        offset = np.array([float(word) for word in joint.offset])
        result = np.tile(offset, (len(self.document.values), 1))
        for index, channel in enumerate(joint.channels):
            if is_position(channel):
                axis = AXES.index(channel[0].lower())
                result[:, axis] = self.document.values[:, start + index]
        return result

    def translations(self) -> NDArray[np.float64] | None:
        """(frames, joints, 3), if there is a joint besides the first root that moves."""
        if not self.moving:
            return None
        result = np.tile(self.offsets, (len(self.root), 1, 1))
        for place, translation in self.moving.items():
            result[:, place] = translation
        return result

    def lengths(self) -> list[float]:
        """Length of the bone above each joint; 0 for roots and for bones that change."""
        lengths = np.linalg.norm(self.offsets, axis=1)
        lengths[list(self.moving)] = 0
        lengths[[joint.parent < 0 for joint in self.document.joints]] = 0
        return lengths.tolist()


def find_up(skeleton: Skeleton, rotations: Float[Tensor, "frames joints 4"], places: Places) -> Up:
    """The file's vertical axis, guessed from some frames of the motion."""
    frames = np.linspace(0, len(rotations) - 1, min(len(rotations), _SAMPLED_FRAMES)).astype(int)
    translations = np.tile(places.offsets, (len(frames), 1, 1))
    for place, translation in places.moving.items():
        translations[:, place] = translation[frames]
    positions = joint_positions(
        skeleton,
        rotations[frames],
        torch.from_numpy(translations),
        torch.from_numpy(places.root[frames]),
    )
    # A root that stands still above the hips is no part of the body.
    hips = min(places.moving, default=0)
    body = {hips}
    for joint, parent in enumerate(skeleton.parents):
        if parent in body:
            body.add(joint)
    return guess_up(positions[:, sorted(body)])
