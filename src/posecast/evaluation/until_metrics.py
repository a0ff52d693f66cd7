"""Metrics until a time rather than at it, positions in thighs, correct keypoints.

Those of Aksan et al. 2019 on AMASS. A sum over the frames until t grows with the frame rate; a mean
does not.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Literal

import torch
from jaxtyping import Float
from torch import Tensor

from posecast.errors import ConfigError
from posecast.evaluation.metric import Ask, FrameMetric, Metric, Scene, check_lengths
from posecast.evaluation.pose_metrics import joint_angle, joint_distances
from posecast.geometry import quaternion
from posecast.geometry.euler import quaternion_to_euler
from posecast.motion.clip import Motion
from posecast.skeleton import Skeleton

THRESHOLDS = (0.001, 0.005, 0.01, 0.02, 0.05, 0.1, 0.15, 0.2, 0.3)
"""Distances within which a joint is correct, in thighs (Aksan et al. 2019, code)."""

_FEWER_THRESHOLDS = ((6, 6), (12, 7), (18, 8))
"""Until so many frames, exclusive, only so many of them count."""

_KNEE = re.compile(r"^(left|l)_?(knee|leg|shin|tibia|lowerleg|calf)$|^(knee|lowerleg|calf)_l$")


def left_thigh(skeleton: Skeleton) -> int:
    """The joint at the lower end of the left thigh, by its name: its offset is the thigh.

    Raises:
        ConfigError: no joint has a known name of a left knee.
    """
    for joint, name in enumerate(skeleton.names):
        if _KNEE.match(name.lower()):
            return joint
    raise ConfigError(
        "positions in thighs need a left knee, but no joint is called like one among "
        f"{', '.join(skeleton.names)}; name it with the protocol's option thigh"
    )


def euler_inverse(predicted: Motion, target: Motion, scene: Scene) -> Float[Tensor, "batch frames"]:
    """L2 norm of the difference of Euler angles of local rotations' inverses, radians.

    Intrinsic z-y-x, not wrapped, all angles of the joints that count. The function of Martinez et
    al. 2017 that Aksan et al. 2019 use takes rotations of row vectors, as Human3.6M's are; those of
    AMASS are not, and are handed to it all the same.

    Source: Aksan et al. 2019, as their code has it.
    """
    found, true = (
        quaternion_to_euler(quaternion.conjugate(motion.rotations_local), order="zyx")
        for motion in (predicted, target)
    )
    squares = (found - true).square().sum(-1)
    return scene.of_joints(squares).sum(-1).sqrt()


def distances_in_thighs(
    predicted: Motion, target: Motion, scene: Scene
) -> Float[Tensor, "batch frames some"]:
    """How far the joints that count are off, as for ``position``, by the length of a thigh.

    Of the left one of each window's own body: the paper says the right one, its code takes this.

    Raises:
        ConfigError: no joint is known to be a knee, or a thigh has no length.
    """
    joint = left_thigh(scene.skeleton) if scene.thigh is None else scene.thigh
    thigh = torch.linalg.vector_norm(target.offsets[:, joint], dim=-1)
    if not bool((thigh > 0).all()):
        raise ConfigError(
            f"positions in thighs: the offset of {scene.skeleton.names[joint]!r} has no length; "
            "bones of AMASS have one only with a template of the body (see docs/corpora.md)"
        )
    return scene.of_joints(joint_distances(predicted, target, scene)) / thigh[:, None, None]


def position_thighs(
    predicted: Motion, target: Motion, scene: Scene
) -> Float[Tensor, "batch frames"]:
    """Distance between joint positions in thighs, mean over the joints that count.

    Source: Aksan et al. 2019, Table 2.
    """
    return distances_in_thighs(predicted, target, scene).mean(-1)


def correct_keypoints(
    distances: Float[Tensor, "batch frames joints"], thresholds: Sequence[float] = THRESHOLDS
) -> Float[Tensor, "batch frames thresholds"]:
    """Share of the joints that are no farther off than each threshold (PCK).

    Args:
        distances: in any unit.
        thresholds: in the same unit.
    """
    limits = torch.as_tensor(thresholds, dtype=distances.dtype, device=distances.device)
    return (distances[..., None] <= limits).to(distances).mean(-2)


def thresholds_until(frames: int) -> tuple[float, ...]:
    """The thresholds that count until a number of frames: fewer while all joints are near."""
    for limit, count in _FEWER_THRESHOLDS:
        if frames < limit:
            return THRESHOLDS[:count]
    return THRESHOLDS


@dataclass(frozen=True)
class CorrectKeypointsArea:
    """Area under the share of correct joints over the threshold, until a number of frames.

    Shares are averaged over frames, then integrated by trapezoids and divided by the width: 1 if
    every joint is within the smallest threshold. Up to 0.1, 0.15 and 0.2 thighs for horizons below
    6, 12 and 18 frames, 0.3 from there on, so that areas at different horizons say nothing of each
    other.

    Source: Aksan et al. 2019, Table 2, as their code has it.
    """

    name: str = "pck_auc"
    title: str = "Area under correct keypoints, mean until"
    unit: str = "-"
    digits: int = 3
    least_frames: int = 1
    least_prefix: int = 1
    asks: frozenset[Ask] = frozenset({"counted", "thigh"})
    higher_is_better: bool = True

    def values(
        self, predicted: Motion, target: Motion, scene: Scene, frames: Sequence[int]
    ) -> Float[Tensor, "batch horizons"]:
        """See ``Metric.values``."""
        given = scene.prefix.root_positions.shape[1]
        check_lengths(self, prefix=given, frames=frames, fps=scene.fps)
        shares = correct_keypoints(distances_in_thighs(predicted, target, scene))
        areas: list[Tensor] = []
        for count in frames:
            limits = torch.tensor(thresholds_until(count)).to(shares)
            mean = shares[:, :count, : len(limits)].mean(1)
            areas.append(torch.trapezoid(mean, limits, dim=-1) / (limits[-1] - limits[0]))
        return torch.stack(areas, dim=-1)

    def left_out(self, skeleton: Skeleton) -> tuple[str, ...]:
        """See ``Metric.left_out``."""
        return skeleton.names[:1]


def _until(span: Literal["sum", "mean"]) -> Iterator[FrameMetric]:
    """The metrics that have a value a frame, over the frames until t."""
    joints: frozenset[Ask] = frozenset({"counted"})
    thighs: frozenset[Ask] = frozenset({"counted", "thigh"})
    for name, title, unit, measure, asks in (
        ("euler_inverse", "Euler-angle error of inverse rotations", "rad", euler_inverse, joints),
        ("joint_angle", "Angle of root-relative rotations", "rad", joint_angle, joints),
        (
            "position_thighs",
            "Joint position error",
            "thighs",
            position_thighs,
            thighs,
        ),
    ):
        yield FrameMetric(
            f"{name}_{span}",
            f"{title}, {span} until",
            unit,
            measure,
            span=span,
            asks=asks,
        )


UNTIL_METRICS: tuple[Metric, ...] = (*_until("sum"), *_until("mean"), CorrectKeypointsArea())
