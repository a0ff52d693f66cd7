"""What a metric is, and what it is shown."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple, Protocol, runtime_checkable

import torch
from jaxtyping import Float
from torch import Tensor

from posecast.errors import ConfigError
from posecast.motion.clip import Motion
from posecast.skeleton import Skeleton

Ask = Literal["replayed", "counted", "thigh"]
"""Parts of a scene that are found only for metrics that look at them."""


class Counting(NamedTuple):
    """Which joints metrics look at.

    Args:
        counted: indices of the joints, for metrics that ask; ``None``: all but the first.
        thigh: the joint whose offset is a thigh, the unit of some metrics; ``None``: the left knee,
            by its name.
    """

    counted: tuple[int, ...] | None = None
    thigh: int | None = None


EVERY_JOINT = Counting()


class Scene(NamedTuple):
    """What a metric may need to know besides the two motions.

    Args:
        skeleton: joints of both motions.
        fps: frames per second.
        prefix: the true frames before the first predicted one.
        replayed: what was expected of the prefix's frames after the first, each after reading those
            before it; only where a metric asks for it.
        counted, thigh: see ``Counting``.
    """

    skeleton: Skeleton
    fps: float
    prefix: Motion
    replayed: Motion | None = None
    counted: tuple[int, ...] | None = None
    thigh: int | None = None

    def mean_of_joints(
        self, values: Float[Tensor, "batch frames joints"]
    ) -> Float[Tensor, "batch frames"]:
        """Mean over the joints that count."""
        return self.of_joints(values).mean(-1)

    def of_joints(
        self, values: Float[Tensor, "batch frames joints"]
    ) -> Float[Tensor, "batch frames some"]:
        """The values of the joints that count."""
        return values[..., 1:] if self.counted is None else values[..., list(self.counted)]


@runtime_checkable
class Metric(Protocol):
    """What a protocol asks of a metric; ``FrameMetric`` serves all that have a value a frame.

    Attributes:
        name: what rows call it.
        title: its heading in words.
        unit: unit of the values.
        digits: decimals worth printing.
        least_frames: fewest frames that a horizon must have.
        least_prefix: fewest frames that the prefix must have.
        asks: what of a scene it looks at beyond skeleton, frame rate and prefix.
        higher_is_better: whether it counts what is right, rather than measures what is wrong.
    """

    @property
    def name(self) -> str: ...
    @property
    def title(self) -> str: ...
    @property
    def unit(self) -> str: ...
    @property
    def digits(self) -> int: ...
    @property
    def least_frames(self) -> int: ...
    @property
    def least_prefix(self) -> int: ...
    @property
    def asks(self) -> frozenset[Ask]: ...
    @property
    def higher_is_better(self) -> bool: ...

    def values(
        self, predicted: Motion, target: Motion, scene: Scene, frames: Sequence[int]
    ) -> Float[Tensor, "batch horizons"]:
        """One value a window and horizon; a table shows their mean over all windows.

        Args:
            predicted: all windows of one action, as many frames as the furthest horizon.
            target: the truth for the same frames.
            scene: skeleton, frame rate, prefix.
            frames: horizons as numbers of frames; 1 is the first predicted frame.

        Raises:
            ConfigError: a horizon or the prefix is too short for it.
        """
        ...

    def left_out(self, skeleton: Skeleton) -> tuple[str, ...]:
        """Names of the joints that never enter the value."""
        ...


def check_lengths(metric: Metric, *, prefix: int, frames: Sequence[int], fps: float) -> None:
    """Refuse horizons or a prefix that a metric cannot be taken of.

    Raises:
        ConfigError: one has too few frames.
    """
    if min(frames) < metric.least_frames:
        raise ConfigError(
            f"metric {metric.name!r} needs horizons of {metric.least_frames} frames or more; the "
            f"first, {1000 * min(frames) / fps:g} ms, has {min(frames)} at {fps:g} fps: leave out "
            "the horizon or the metric"
        )
    if prefix < metric.least_prefix:
        raise ConfigError(
            f"metric {metric.name!r} needs a prefix of {metric.least_prefix} frames or more; found "
            f"{prefix}: lengthen the prefix or leave out the metric"
        )


@dataclass(frozen=True)
class FrameMetric:
    """A metric with a value for every window and frame; arguments beyond ``Metric``'s are below.

    Args:
        measure: (predicted, target, scene) -> one value a window and frame.
        span: the value at the horizon's frame, or the sum or mean of frames 1 up to it.
        first_counted: joints before this one never enter the value.
    """

    name: str
    title: str
    unit: str
    measure: Callable[[Motion, Motion, Scene], Float[Tensor, "batch frames"]]
    digits: int = 3
    span: Literal["at", "sum", "mean"] = "at"
    first_counted: int = 1
    least_frames: int = 1
    least_prefix: int = 1
    asks: frozenset[Ask] = frozenset()
    higher_is_better: bool = False

    def values(
        self, predicted: Motion, target: Motion, scene: Scene, frames: Sequence[int]
    ) -> Float[Tensor, "batch horizons"]:
        """See ``Metric.values``."""
        given = scene.prefix.root_positions.shape[1]
        check_lengths(self, prefix=given, frames=frames, fps=scene.fps)
        values = self.measure(predicted, target, scene)
        count = torch.as_tensor(frames, device=values.device)
        if self.span == "at":
            return values[:, count - 1]
        total = values.cumsum(dim=1)[:, count - 1]
        return total if self.span == "sum" else total / count

    def left_out(self, skeleton: Skeleton) -> tuple[str, ...]:
        """See ``Metric.left_out``."""
        return skeleton.names[: self.first_counted]
