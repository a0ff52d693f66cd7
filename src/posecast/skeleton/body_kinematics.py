"""Where the joints of one body are, pose by pose: for streams, in a dozen small operations."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import torch
from jaxtyping import Float
from torch import Tensor

from posecast.skeleton.kinematics import check_joints
from posecast.skeleton.skeleton import Skeleton

Array = npt.NDArray[np.floating]

_QUADRATIC = {
    (0, 0): ((2, 2, -2), (3, 3, -2)),
    (0, 1): ((1, 2, 2), (0, 3, -2)),
    (0, 2): ((1, 3, 2), (0, 2, 2)),
    (1, 0): ((1, 2, 2), (0, 3, 2)),
    (1, 1): ((1, 1, -2), (3, 3, -2)),
    (1, 2): ((2, 3, 2), (0, 1, -2)),
    (2, 0): ((1, 3, 2), (0, 2, -2)),
    (2, 1): ((2, 3, 2), (0, 1, 2)),
    (2, 2): ((1, 1, -2), (2, 2, -2)),
}
"""Entries of the rotation matrix of (w, x, y, z) less the identity: (i, j, factor of q_i q_j)."""


class BodyKinematics:
    """World positions of one body's joints, for one pose or a few at a time, without gradients.

    ``joint_positions`` is made for many poses and takes as long for a single one as for a hundred.
    Both agree.

    A joint's place is the product of the 4 x 4 matrices of all joints above it. The products are
    formed in rounds: after each, a joint's matrix leads from twice as far up, so that a tree of
    depth 8 needs four rounds, whatever its width. They are NumPy's, which has less around each
    operation than PyTorch, and wakes no threads for matrices so small: on a busy machine it takes
    milliseconds until those have come together.

    Args:
        skeleton: a forest.
        offsets: the body: translation of each joint from its parent, metres, on the CPU.

    Raises:
        SkeletonError: the number of joints is not that of the skeleton.
    """

    def __init__(self, skeleton: Skeleton, offsets: Float[Tensor, "joints 3"]) -> None:
        check_joints(skeleton, len(offsets))
        self.skeleton = skeleton
        body: Array = offsets.detach().numpy()
        still = np.tile(np.eye(4, dtype=body.dtype), (len(skeleton), 1, 1))
        still[:, :3, 3] = body
        self._still: Array = still.reshape(len(skeleton), 16)
        self._from_pairs = _from_pairs().astype(body.dtype)
        self._rounds = _rounds(skeleton)

    def __call__(
        self,
        rotations_local: Float[Tensor, "*batch joints 4"],
        root_positions: Float[Tensor, "*batch 3"] | None = None,
    ) -> Float[Tensor, "*batch joints 3"]:
        """Positions of all joints, in the precision of the body.

        Args:
            rotations_local: unit quaternions relative to the parent; for a root, to the world.
            root_positions: metres; ``None``: at the origin.

        Raises:
            SkeletonError: the number of joints is not that of the skeleton.
        """
        check_joints(self.skeleton, rotations_local.shape[-2])
        turned: Array = rotations_local.detach().numpy().astype(self._still.dtype, copy=False)
        pairs = (turned[..., :, None] * turned[..., None, :]).reshape(*turned.shape[:-1], 16)
        # Local matrices are linear in the products of a quaternion's numbers.
        local = (pairs @ self._from_pairs + self._still).reshape(*turned.shape[:-1], 4, 4)
        placed = np.empty((*turned.shape[:-2], len(self.skeleton) + 1, 4, 4), dtype=local.dtype)
        placed[..., :-1, :, :] = local
        placed[..., -1, :, :] = np.eye(4)
        for above in self._rounds:
            placed = placed[..., above, :, :] @ placed
        found = torch.from_numpy(np.ascontiguousarray(placed[..., :-1, :3, 3]))
        return found if root_positions is None else found + root_positions.to(found)[..., None, :]


def _from_pairs() -> Array:
    """(16, 16): from all q_i q_j to the entries of a 4 x 4 matrix, row by row."""
    factors = np.zeros((4, 4, 4, 4))
    for (row, column), terms in _QUADRATIC.items():
        for i, j, factor in terms:
            factors[i, j, row, column] += factor
    return factors.reshape(16, 16)


def _rounds(skeleton: Skeleton) -> list[npt.NDArray[np.intp]]:
    """For each round, the joint below which each one's matrix begins; past the last: nobody."""
    nobody = len(skeleton)
    above = [nobody if parent == -1 else parent for parent in skeleton.parents] + [nobody]
    rounds: list[npt.NDArray[np.intp]] = []
    while any(joint != nobody for joint in above):
        rounds.append(np.array(above))
        above = [above[joint] for joint in above]
    return rounds
