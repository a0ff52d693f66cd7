"""What a corpus walks like: step rates by speed, how fast it turns, where a step begins."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields

import torch
from jaxtyping import Float
from torch import Tensor

from posecast.errors import ConfigError
from posecast.motion import Clip
from posecast.motion.tracks import MOVEMENT, PHASE, SPEED, STEP_RATE, WALKING
from posecast.motion.transforms import turn
from posecast.representation import Codec

KNOTS = 9
"""Speeds, quantiles of a style's own, at which its step rate is known."""

LEAST, MOST = 0.02, 0.98
"""Quantiles that count as the slowest and the fastest."""

_NEAR = math.pi / 12
"""Radians of phase about the touch-down of the right foot that show how a step begins."""


@dataclass(frozen=True, eq=False)
class GaitTable:
    """What was measured of a corpus's walks, style by style.

    Args:
        speeds: m/s, ascending: from the slowest to the fastest.
        step_rates: radians of phase a second at these speeds; a step is pi.
        sideways: largest usual acceleration towards the inside of a curve, m/s^2.
        gathering: largest usual acceleration along the path, m/s^2.
        poses: mean features where the right foot touches down, heading +z.
    """

    speeds: Float[Tensor, "styles knots"]
    step_rates: Float[Tensor, "styles knots"]
    sideways: Float[Tensor, " styles"]
    gathering: Float[Tensor, " styles"]
    poses: Float[Tensor, "styles features"]

    def step_rate(
        self, speed: Float[Tensor, "*places"], style: int = 0
    ) -> Float[Tensor, "*places"]:
        """Radians of phase a second at some speeds, m/s: linear between those measured.

        Below the slowest a step keeps its length, down to standing still; above the fastest, too.
        """
        speeds, rates = self.speeds[style].to(speed), self.step_rates[style].to(speed)
        within = speed.clamp(float(speeds[0]), float(speeds[-1]))
        after = torch.searchsorted(speeds, within.contiguous()).clamp(1, len(speeds) - 1)
        width = (speeds[after] - speeds[after - 1]).clamp_min(1e-9)
        share = (within - speeds[after - 1]) / width
        rate = rates[after - 1] + share * (rates[after] - rates[after - 1])
        return rate * speed / within

    def tensors(self) -> dict[str, Tensor]:
        """All of it by name, for a checkpoint."""
        return {each.name: getattr(self, each.name) for each in fields(self)}

    @staticmethod
    def of(values: Mapping[str, Tensor]) -> GaitTable:
        """The table that ``tensors`` gave."""
        return GaitTable(**values)


def measure_gait(clips: Iterable[Clip], codec: Codec, styles: Sequence[str] = ()) -> GaitTable:
    """Measure the walks of some clips.

    Args:
        clips: with the tracks of their gait (``motion.with_gait``), usually those of training.
        codec: of the features.
        styles: values of the label ``style``, one row each; none: one row for all.

    Raises:
        ConfigError: no clip of a style walks.
    """
    groups: dict[str, list[Clip]] = {style: [] for style in styles} or {"": []}
    for clip in clips:
        groups.setdefault(clip.labels.get("style", "") if styles else "", []).append(clip)
    rows = [_measure(groups[style], codec, style) for style in (styles or ("",))]
    return GaitTable(*(torch.stack(each) for each in zip(*rows, strict=True)))


def _measure(
    clips: Sequence[Clip], codec: Codec, style: str
) -> tuple[Tensor, Tensor, Tensor, Tensor, Tensor]:
    walked = [clip for clip in clips if bool(clip.tracks[WALKING].any())]
    if not walked:
        what = f"style {style!r}" if style else "the corpus"
        raise ConfigError(f"no clip of {what} walks; leave it out, or train on clips that do")
    speed, rate, sideways, gathering = (
        torch.cat(each) for each in zip(*map(_rates, walked), strict=True)
    )
    knots = torch.quantile(speed, torch.linspace(LEAST, MOST, KNOTS).double())
    width = max(float(knots[-1] - knots[0]) / KNOTS, 1e-3)
    weights = torch.exp(-(((speed - knots[:, None]) / width) ** 2) / 2)
    rates = (weights * rate).sum(-1) / weights.sum(-1)
    inwards, along = (torch.quantile(each.abs(), MOST) for each in (sideways, gathering))
    return knots, rates, inwards, along, _step_pose(walked, codec)


def _rates(clip: Clip) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """Speed, step rate and both accelerations where a clip walks."""
    walking, speed = clip.tracks[WALKING], clip.tracks[SPEED].double()
    x, z = clip.tracks[MOVEMENT].double().unbind(-1)
    if clip.frames < 2:
        return (speed[:0],) * 4
    bearing = torch.atan2(x, z)
    turning = torch.remainder(bearing.diff() + math.pi, 2 * math.pi) - math.pi
    turning = torch.cat([turning, turning[-1:]]) * clip.fps
    gathering = torch.gradient(speed)[0] * clip.fps
    rate = clip.tracks[STEP_RATE].double()
    return speed[walking], rate[walking], (speed * turning)[walking], gathering[walking]


def _step_pose(clips: Sequence[Clip], codec: Codec) -> Float[Tensor, " features"]:
    """Mean features where the right foot touches down, in frames turned to head +z."""
    total, count = torch.zeros(codec.feature_dim).double(), 0
    for clip in clips:
        phase = torch.remainder(clip.tracks[PHASE].double() + math.pi, 2 * math.pi) - math.pi
        for frame in ((phase.abs() < _NEAR) & clip.tracks[WALKING]).nonzero()[:, 0].tolist():
            x, z = clip.tracks[MOVEMENT][frame].tolist()
            single = turn(clip.cut(frame, frame + 1).to(torch.float64), -math.atan2(x, z))
            motion = single.motion()._replace(
                rotations_local=_upper(single.rotations_local)[None],
                tracks={name: values[None] for name, values in single.tracks.items()},
            )
            total, count = total + codec.encode(motion)[0, 0], count + 1
    if not count:
        raise ConfigError("no step of the corpus begins while it walks; train on longer clips")
    joints, root, action = codec.split(total / count)
    return codec.merge(
        codec.representation.project(joints), root, action if codec.actions else None
    )


def _upper(rotations: Float[Tensor, "*batch 4"]) -> Float[Tensor, "*batch 4"]:
    """The same rotations, real parts not negative."""
    return torch.where(rotations[..., :1] < 0, -rotations, rotations)
