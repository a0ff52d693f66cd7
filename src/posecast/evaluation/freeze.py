"""FreezeDetector: whether a long rollout still moves as the training set does, second by second."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from posecast.errors import ConfigError
from posecast.evaluation.motion_metrics import places
from posecast.motion.clip import Clip, Motion
from posecast.skeleton import Skeleton

FROZEN_QUANTILE = 0.005
FROZEN_SHARE_OF_MEDIAN = 0.01
BEYOND = 1.5
"""How far beyond the farthest window of the training set none of real motion is expected."""
_AT_ONCE = 64  # windows put through forward kinematics in one piece


class Liveliness(NamedTuple):
    """How a rollout moved, in windows of about a second.

    Args:
        speed: mean speed of the joints below the root, metres per second.
        speed_ratio: that by the training set's median.
        spectral_distance: how far the power of the joints' velocities must be shifted to be spread
            as the training set's is, hertz on average; infinite where the speed is not finite.
        frozen: whether the speed is below what the training set has, or the joints move at
            frequencies that it has not, as those of a still pose that trembles do.
        blown: whether the speed is above, or not a finite number.
    """

    speed: Float[Tensor, "batch windows"]
    speed_ratio: Float[Tensor, "batch windows"]
    spectral_distance: Float[Tensor, "batch windows"]
    frozen: Bool[Tensor, "batch windows"]
    blown: Bool[Tensor, "batch windows"]

    @property
    def frozen_share(self) -> Float[Tensor, "batch"]:
        """Share of the windows that are frozen."""
        return self.frozen.double().mean(1)

    @property
    def blown_share(self) -> Float[Tensor, "batch"]:
        """Share of the windows that are blown."""
        return self.blown.double().mean(1)


@dataclass(frozen=True, eq=False)
class FreezeDetector:
    """What of speed and spectrum the training set has, to hold a long rollout against.

    Everything is taken of joints relative to the root, where it faces included; where the root goes
    does not count. A rollout that walks on the spot is lively, one that slides along is frozen.

    A window is frozen if it is slower than all but one in 200 of the training set's (its quantile
    0.005), so real motion raises about that share of false alarms and no more. Where the training
    set itself stands still that long the quantile says nothing; slower than a hundredth of its
    median is frozen in any case, as people who stand still sway by more. A window whose spectrum is
    half as far again from the training set's as the farthest of its own windows is frozen, too:
    what is left of it is noise. A window is blown if it is half as fast again as the fastest of the
    training set.

    Args:
        skeleton: joints of the motions.
        fps: frames per second of the motions.
        window: steps from frame to frame in a window.
        speeds: of all windows of the training set, ascending, metres per second.
        spectrum: share of power at each frequency, mean over these windows.
        farthest: most that a window of the training set is from it, hertz.
    """

    skeleton: Skeleton
    fps: float
    window: int
    speeds: Float[Tensor, "windows"]
    spectrum: Float[Tensor, "frequencies"]
    farthest: float

    @classmethod
    def of(cls, clips: Iterable[Clip], *, window_s: float = 1.0) -> FreezeDetector:
        """What some clips have, usually those of a training split.

        Args:
            clips: of one skeleton and frame rate; cut into windows that do not overlap.
            window_s: length of a window, seconds.

        Raises:
            ConfigError: no clip is as long as a window, a window has no two steps, the frame rates
                differ, or half of the windows rest.
        """
        speeds: list[Tensor] = []
        shares: list[Tensor] = []
        skeleton, fps, window = None, 0.0, 0
        for clip in clips:
            if skeleton is None:
                skeleton, fps, window = clip.skeleton, clip.fps, round(window_s * clip.fps)
                if window < 2:
                    raise ConfigError(
                        f"windows of {window_s:g} s at {fps:g} fps: expected two frames or more"
                    )
            if clip.fps != fps:
                raise ConfigError(
                    f"clips at {fps:g} and {clip.fps:g} frames per second; bring them to one rate"
                )
            for steps in _windows([clip.motion()], skeleton, window):
                speed, share = _look(steps * fps)
                speeds.append(speed.flatten())
                shares.append(share.flatten(0, 1))
        if skeleton is None or not speeds:
            raise ConfigError(f"no clip is as long as a window of {window_s:g} s")
        every = torch.cat(shares)
        spectrum = every.mean(0)
        farthest = _distance(every, spectrum, fps / window).max().item()
        detector = cls(skeleton, fps, window, torch.cat(speeds).sort().values, spectrum, farthest)
        if not detector.median > 0:
            raise ConfigError("clips that do not move in half of their windows say nothing here")
        return detector

    @property
    def median(self) -> float:
        """Median speed of the training set, metres per second."""
        return float(self.speeds.median())

    @property
    def slowest(self) -> float:
        """Speed below which a window is frozen, metres per second."""
        quantile = float(torch.quantile(self.speeds, FROZEN_QUANTILE))
        return max(quantile, FROZEN_SHARE_OF_MEDIAN * self.median)

    @property
    def fastest(self) -> float:
        """Speed above which a window is blown, metres per second."""
        return BEYOND * float(self.speeds[-1])

    @property
    def strangest(self) -> float:
        """Distance of the spectra, hertz, above which a window is frozen."""
        return BEYOND * self.farthest

    def examine(self, pieces: Iterable[Motion]) -> Liveliness:
        """Look at a rollout, window by window.

        Args:
            pieces: the rollout at the frame rate of the training set, in one piece or in several
                that follow each other; only a window or so of each is kept. Frames at the end that
                fill no window are left out.

        Raises:
            ConfigError: fewer frames than a window has.
        """
        speeds: list[Tensor] = []
        distances: list[Tensor] = []
        for steps in _windows(pieces, self.skeleton, self.window):
            speed, share = _look(steps * self.fps)
            distance = _distance(share, self.spectrum, self.fps / self.window)
            speeds.append(speed)
            distances.append(torch.where(torch.isfinite(speed), distance, torch.inf))
        if not speeds:
            raise ConfigError(
                f"a rollout of fewer than {self.window + 1} frames, which is a window of "
                f"{self.window / self.fps:g} s; forecast longer"
            )
        speed, distance = torch.cat(speeds, dim=1), torch.cat(distances, dim=1)
        trembling = torch.isfinite(distance) & (distance > self.strangest)
        return Liveliness(
            speed,
            speed / self.median,
            distance,
            (speed < self.slowest) | trembling,
            ~(speed <= self.fastest),  # not a number is not below anything
        )


def _windows(
    pieces: Iterable[Motion], skeleton: Skeleton, window: int
) -> Iterator[Float[Tensor, "batch windows steps joints 3"]]:
    """Steps of all joints but the first from frame to frame, float64, in whole windows.

    The last frame of a window is the first of the next.
    """
    kept: Motion | None = None
    for piece in pieces:
        kept = piece if kept is None else Motion.join_frames([kept, piece])
        while (count := min((kept.root_positions.shape[1] - 1) // window, _AT_ONCE)) > 0:
            frames = kept.cut(0, count * window + 1).map(Tensor.double)
            steps = torch.diff(places(frames, skeleton)[:, :, 1:], dim=1)
            yield steps.unflatten(1, (count, window))
            kept = kept.cut(count * window)


def _distance(
    share: Float[Tensor, "*batch frequencies"],
    spectrum: Float[Tensor, "frequencies"],
    hertz: float,
) -> Float[Tensor, "*batch"]:
    """How far power must be shifted on average, for frequencies that are ``hertz`` apart."""
    return hertz * (share - spectrum).cumsum(-1).abs().sum(-1)


def _look(
    velocities: Float[Tensor, "batch windows steps joints 3"],
) -> tuple[Float[Tensor, "batch windows"], Float[Tensor, "batch windows frequencies"]]:
    """Mean speed, and share of power at each frequency over all joints and directions.

    A Hann window keeps a movement that is cut off from spreading over all frequencies. All power of
    a window without motion is at frequency zero.
    """
    speed = torch.linalg.vector_norm(velocities, dim=-1).mean((2, 3))
    fade = torch.hann_window(velocities.shape[2] + 2, periodic=False).to(velocities)[1:-1]
    power = torch.fft.rfft(velocities * fade[:, None, None], dim=2).abs().square().sum((3, 4))
    total = power.sum(-1, keepdim=True)
    rest = torch.zeros_like(power)
    rest[..., 0] = 1.0
    return speed, torch.where(total > 0, power / torch.where(total > 0, total, 1.0), rest)
