"""Metrics of whole predictions: spectra, distances on average, accelerations, stretched bones.

Positions are those of all joints, the first at the origin; where the root faces counts. Metres,
unless a metric's unit says otherwise.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import torch
from jaxtyping import Float
from torch import Tensor

from posecast.evaluation.metric import Ask, FrameMetric, Metric, Scene, check_lengths
from posecast.evaluation.npss import Power, npss
from posecast.motion.clip import Motion
from posecast.skeleton import Skeleton
from posecast.skeleton.kinematics import joint_positions

CMU_UNIT = 2.54 / 0.45 / 100
"""Metres of the length unit of CMU's files, in which Andreou et al. 2022 seem to have measured."""

CMU = "5.644 cm"


def places(motion: Motion, skeleton: Skeleton) -> Float[Tensor, "batch frames joints 3"]:
    """Joints relative to the first one, as the motion puts them: its bones stretch if they do."""
    found = joint_positions(skeleton, motion.rotations_local, motion.bones, None)
    return found - found[..., :1, :]


def euclidean(predicted: Motion, target: Motion, scene: Scene) -> Float[Tensor, "batch frames"]:
    """Distance of joints, metres, mean over all of them, rotations put on the true body.

    What a network says of positions or bones besides does not count.

    Source: Andreou et al. 2022, section 6.
    """
    on_body = predicted.rigid._replace(offsets=target.offsets)
    return _mean_distance(places(on_body, scene.skeleton), places(target, scene.skeleton))


def emitted(predicted: Motion, target: Motion, scene: Scene) -> Float[Tensor, "batch frames"]:
    """As ``euclidean``, with joints where the network itself put them."""
    return _mean_distance(places(predicted, scene.skeleton), places(target, scene.skeleton))


def bone_length_drift(
    predicted: Motion, target: Motion, scene: Scene
) -> Float[Tensor, "batch frames"]:
    """How much longer or shorter bones are than those of the body, metres, mean.

    Over the bones that have a length; zero for a prediction with rigid bones.
    """
    rest = torch.linalg.vector_norm(target.offsets, dim=-1)[:, None]
    found = torch.linalg.vector_norm(predicted.bones, dim=-1).expand(
        *predicted.rotations_local.shape[:2], -1
    )
    has_parent = torch.tensor(scene.skeleton.parents, device=rest.device) >= 0
    counted = (rest > 0) & has_parent
    return ((found - rest).abs() * counted).sum(-1) / counted.sum(-1).clamp_min(1)


def joint_jitter(motion: Motion, scene: Scene) -> Float[Tensor, "batch frames joints"]:
    """Length of the third difference of each joint's place over dt^3, m/s^3.

    The last three frames of the prefix come before the first, so a jump at the seam counts.
    """
    known = places(scene.prefix.cut(-3), scene.skeleton)
    whole = torch.cat([known, places(motion, scene.skeleton)], dim=1)
    return torch.linalg.vector_norm(torch.diff(whole, n=3, dim=1), dim=-1) * scene.fps**3


def jitter(predicted: Motion, target: Motion, scene: Scene) -> Float[Tensor, "batch frames"]:
    """``joint_jitter`` of the prediction, mean over joints; a little is right, see the truth's."""
    return joint_jitter(predicted, scene).mean(-1)


def jitter_true(predicted: Motion, target: Motion, scene: Scene) -> Float[Tensor, "batch frames"]:
    """``joint_jitter`` of the truth, mean over joints."""
    return joint_jitter(target, scene).mean(-1)


@dataclass(frozen=True)
class Span:
    """A metric of a prediction's frames 1 up to the horizon as a whole, put on the true body.

    Args:
        measure: (places predicted, places true) -> one value a window; of all joints, metres.
        with_prefix: whether the frames of the prefix after the first are among them, as they were
            expected one by one (``Scene.replayed``).
        name, title, unit, digits, least_frames, higher_is_better: see ``Metric``.
    """

    name: str
    title: str
    unit: str
    measure: Callable[[Tensor, Tensor], Float[Tensor, "batch"]]
    digits: int = 3
    least_frames: int = 1
    with_prefix: bool = False
    higher_is_better: bool = False

    @property
    def asks(self) -> frozenset[Ask]:
        """See ``Metric``."""
        return frozenset({"replayed"} if self.with_prefix else ())

    @property
    def least_prefix(self) -> int:
        """See ``Metric``; the first frame of the prefix is nobody's prediction."""
        return 2 if self.with_prefix else 1

    def values(
        self, predicted: Motion, target: Motion, scene: Scene, frames: Sequence[int]
    ) -> Float[Tensor, "batch horizons"]:
        """See ``Metric.values``."""
        given = scene.prefix.root_positions.shape[1]
        check_lengths(self, prefix=given, frames=frames, fps=scene.fps)
        before = 0
        if self.with_prefix:
            assert scene.replayed is not None
            before = given - 1
            predicted = Motion.join_frames([scene.replayed, predicted])
            target = Motion.join_frames([scene.prefix.cut(1), target])
        on_body = predicted.rigid._replace(offsets=target.offsets)
        found, true = (places(motion, scene.skeleton) for motion in (on_body, target))
        return torch.stack(
            [self.measure(found[:, : before + n], true[:, : before + n]) for n in frames], dim=1
        )

    def left_out(self, skeleton: Skeleton) -> tuple[str, ...]:
        """None: all joints enter the value, though the first is always at the origin."""
        return ()


def _mean_distance(found: Tensor, true: Tensor) -> Tensor:
    """Distance of joints, mean over joints."""
    return torch.linalg.vector_norm(found - true, dim=-1).mean(-1)


def _acceleration(positions: Tensor) -> Float[Tensor, "batch"]:
    """Length of p(t+2) - 2 p(t+1) + p(t), mean over frames and joints, metres a frame^2."""
    return torch.linalg.vector_norm(torch.diff(positions, n=2, dim=1), dim=-1).mean((1, 2))


def _acceleration_error(found: Tensor, true: Tensor) -> Float[Tensor, "batch"]:
    """What the mean over windows of the acceleration is off by, a share a window, metres a frame^2.

    The mean of what is returned is |mean predicted - mean true|, taken of all windows together: how
    lively a motion is can be right where which move comes when cannot be known, as ten seconds on.
    """
    difference = _acceleration(found) - _acceleration(true)
    return torch.where(difference.mean() < 0, -difference, difference)


def _scaled(
    measure: Callable[[Motion, Motion, Scene], Tensor], unit: float
) -> Callable[[Motion, Motion, Scene], Tensor]:
    return lambda predicted, target, scene: measure(predicted, target, scene) / unit


def _npss(power: Power) -> Callable[[Tensor, Tensor], Tensor]:
    return lambda found, true: npss(found.flatten(2), true.flatten(2), power=power)


def _distance(unit: float) -> Callable[[Tensor, Tensor], Tensor]:
    return lambda found, true: _mean_distance(found, true).mean(1) / unit


_CM = 0.01
_DISTANCE = "Joint distance on the true body, mean up to the horizon"


def _accelerations(*, with_prefix: bool) -> list[Span]:
    """Of the prediction, of the truth, and their difference, in two units."""
    what: dict[str, tuple[str, Callable[[Tensor, Tensor], Tensor]]] = {
        "": ("of the prediction, mean up to the horizon", lambda found, true: _acceleration(found)),
        "_true": ("of the truth, mean up to the horizon", lambda found, true: _acceleration(true)),
        "_error": ("over all windows, predicted against true", _acceleration_error),
    }
    infix, suffix = ("_with_prefix", ", prefix included") if with_prefix else ("", "")
    return [
        Span(
            f"acceleration{which}{infix}{ending}",
            f"Joint acceleration {title}{suffix}",
            f"{unit}/frame^2",
            partial(_in_unit, measure, size),
            3,
            3,
            with_prefix,
        )
        for which, (title, measure) in what.items()
        for ending, unit, size in (("", "cm", _CM), ("_cmu", CMU, CMU_UNIT))
    ]


def _in_unit(
    measure: Callable[[Tensor, Tensor], Tensor], unit: float, found: Tensor, true: Tensor
) -> Tensor:
    return measure(found, true) / unit


MOTION_METRICS: tuple[Metric, ...] = (
    Span("npss", "NPSS of joint positions", "dimensionless", _npss("real")),
    Span("npss_full_power", "NPSS of joint positions, full power", "dimensionless", _npss("full")),
    Span(
        "npss_with_prefix",
        "NPSS, prefix included",
        "dimensionless",
        _npss("real"),
        with_prefix=True,
    ),
    FrameMetric("euclidean_cm", _DISTANCE, "cm", _scaled(euclidean, _CM), 2, "mean", 0),
    FrameMetric("euclidean_cmu", _DISTANCE, CMU, _scaled(euclidean, CMU_UNIT), 2, "mean", 0),
    Span(
        "euclidean_with_prefix_cm",
        f"{_DISTANCE}, prefix included",
        "cm",
        _distance(_CM),
        2,
        with_prefix=True,
    ),
    Span(
        "euclidean_with_prefix_cmu",
        f"{_DISTANCE}, prefix included",
        CMU,
        _distance(CMU_UNIT),
        2,
        with_prefix=True,
    ),
    FrameMetric(
        "emitted_cm",
        "Joint distance as the network put them, mean up to the horizon",
        "cm",
        _scaled(emitted, _CM),
        2,
        "mean",
        0,
    ),
    *_accelerations(with_prefix=False),
    *_accelerations(with_prefix=True),
    FrameMetric(
        "bone_length_drift",
        "Bone length error, mean up to the horizon",
        "mm",
        _scaled(bone_length_drift, 0.001),
        2,
        "mean",
    ),
    FrameMetric(
        "jitter",
        "Jitter of the prediction, mean up to the horizon",
        "m/s^3",
        jitter,
        1,
        "mean",
        0,
        least_prefix=3,
    ),
    FrameMetric(
        "jitter_true",
        "Jitter of the truth, mean up to the horizon",
        "m/s^3",
        jitter_true,
        1,
        "mean",
        0,
        least_prefix=3,
    ),
)
