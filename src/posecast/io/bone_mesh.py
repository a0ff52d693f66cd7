"""A body to look at for a skeleton that has none: an octahedron a bone, small ones at its ends."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from posecast.skeleton import Skeleton

_WIDEST = 0.12
"""Where along a bone its ring of four vertices is."""
_RADIUS = 0.1
"""Of the ring, for a bone of length 1."""
_GREATEST_RADIUS = 0.4
"""Of any ring, for bones of median length 1: from a root far off to its body leads a thin line."""
_KNOB = 0.2
"""Radius of the small octahedra, for bones of median length 1."""
_SMALLEST = 1e-6
"""Bones shorter than this, in metres, have no direction and are not drawn."""
_BODILESS = 0.15
"""Metres: the median length that is taken where no bone has one; that of a person's bones."""

_RING_TO_TAIL = [(1 + side, 1 + (side + 1) % 4, 5) for side in range(4)]
_RING_TO_HEAD = [(1 + (side + 1) % 4, 1 + side, 0) for side in range(4)]
_FACES = np.array([*_RING_TO_TAIL, *_RING_TO_HEAD])


class BoneMesh(NamedTuple):
    """Triangles in the rest pose; each vertex moves with one joint.

    Args:
        vertices: positions in the world, metres.
        joints: the joint that each vertex moves with.
        triangles: three vertices each, counter-clockwise seen from outside.
    """

    vertices: Float[np.ndarray, "vertices 3"]
    joints: Int[np.ndarray, "vertices"]
    triangles: Int[np.ndarray, "triangles 3"]


def bone_mesh(
    skeleton: Skeleton,
    positions: Float[np.ndarray, "joints 3"],
    slides: Float[np.ndarray, "joints"],
) -> BoneMesh:
    """An octahedron from each joint to each of its children, a small one where a chain ends.

    The tip of a bone moves with the child, the rest of it with the parent, so that a bone whose
    length changes in time is drawn at the length it has. Left out are bones of length zero, and
    what is no bone: where a joint slides farther than bones are long (median), as hips do below
    the motionless root of some files. The mesh is never empty.

    Args:
        skeleton: any forest.
        positions: of the joints in the rest pose, metres.
        slides: how far each joint moves in its parent's frame in the whole clip, metres.
    """
    children = np.flatnonzero(np.array(skeleton.parents) >= 0)
    parents = np.array(skeleton.parents)[children]
    lengths = np.linalg.norm(positions[children] - positions[parents], axis=-1)
    drawn = lengths > _SMALLEST
    usual = float(np.median(lengths[drawn])) if drawn.any() else _BODILESS
    drawn &= slides[children] <= usual
    children, parents, lengths = children[drawn], parents[drawn], lengths[drawn]
    radii = np.minimum(_RADIUS * lengths, _GREATEST_RADIUS * usual)
    bones = _octahedra(positions[parents], positions[children], widest=_WIDEST, radii=radii)
    ends = np.array([joint for joint, below in enumerate(skeleton.children) if not below])
    radius = _KNOB * usual
    up = np.array([0.0, radius, 0.0])
    knobs = _octahedra(
        positions[ends] - up, positions[ends] + up, widest=0.5, radii=np.full(len(ends), radius)
    )
    of_bones = np.concatenate([np.repeat(parents[:, None], 5, axis=1), children[:, None]], axis=1)
    of_knobs = np.repeat(ends[:, None], 6, axis=1)
    bodies = np.concatenate([bones, knobs])
    return BoneMesh(
        vertices=bodies.reshape(-1, 3),
        joints=np.concatenate([of_bones, of_knobs]).reshape(-1),
        triangles=(6 * np.arange(len(bodies))[:, None, None] + _FACES).reshape(-1, 3),
    )


def _octahedra(
    heads: Float[np.ndarray, "bodies 3"],
    tails: Float[np.ndarray, "bodies 3"],
    *,
    widest: float,
    radii: Float[np.ndarray, "bodies"],
) -> Float[np.ndarray, "bodies 6 3"]:
    """Vertices of octahedra: the head, a ring of four around the axis, the tail.

    Args:
        heads: metres.
        tails: metres; each differs from its head.
        widest: where between head (0) and tail (1) the ring is.
        radii: of the rings, metres.
    """
    along = tails - heads
    axis = along / np.linalg.norm(along, axis=-1, keepdims=True)
    # Of the three axes of the world the one farthest from the bone's: their product is never small.
    other = np.eye(3)[np.abs(axis).argmin(axis=-1)]
    side = np.cross(other, axis)
    side /= np.linalg.norm(side, axis=-1, keepdims=True)
    front = np.cross(axis, side)
    center = heads + widest * along
    spokes = radii[:, None, None] * np.stack([side, front, -side, -front], axis=1)
    return np.concatenate([heads[:, None], center[:, None] + spokes, tails[:, None]], axis=1)
