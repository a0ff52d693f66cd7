"""Protocols as data: which windows, which horizons, which metrics; any predictor is scored."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, NamedTuple

from torch import Tensor

from posecast.config import check_call, did_you_mean, pick_kind
from posecast.errors import ConfigError
from posecast.evaluation.metrics import METRICS, Scene
from posecast.evaluation.prediction import Predictor, run_predictor
from posecast.evaluation.scores import Milliseconds, Scores, list_ms
from posecast.evaluation.windows import Grid, LegacyDraws, Sampling
from posecast.motion.clip import Motion
from posecast.motion.corpus import Corpus

SHORT_TERM_MS: tuple[Milliseconds, ...] = (80, 160, 320, 400)


class Frames(NamedTuple):
    """A protocol's times as numbers of frames: of the prefix, and of each horizon after it."""

    prefix: int
    horizons: tuple[int, ...]


@dataclass(frozen=True)
class Protocol:
    """A way to compare predictors; published ones are in ``PROTOCOLS``.

    The value of a row is the metric at the horizon's frame, mean over the windows.

    Args:
        name: what tables call it.
        sampling: which windows.
        prefix_ms: how much motion the predictor is given, milliseconds.
        horizons_ms: when the prediction is compared, ascending, milliseconds.
        metrics: names in ``METRICS``.
        fps: frame rate that the windows are defined at; ``None`` takes the corpus's.
    """

    name: str
    sampling: LegacyDraws | Grid
    prefix_ms: Milliseconds
    horizons_ms: tuple[Milliseconds, ...]
    metrics: tuple[str, ...]
    fps: float | None = None

    def __post_init__(self) -> None:
        if not self.horizons_ms or list(self.horizons_ms) != sorted(set(self.horizons_ms)):
            raise ConfigError(
                f"protocol {self.name!r}: horizons {list_ms(self.horizons_ms)}; "
                "expected at least one, in ascending order"
            )
        if not self.metrics:
            raise ConfigError(
                f"protocol {self.name!r}: no metrics; expected some of {', '.join(METRICS)}"
            )
        for metric in self.metrics:
            if metric not in METRICS:
                raise ConfigError(
                    f"protocol {self.name!r}: unknown metric {metric!r}; "
                    f"{did_you_mean(metric, METRICS)}"
                )

    def frames(self, fps: float) -> Frames:
        """Prefix and horizons in frames.

        Raises:
            ConfigError: a time does not fall on a frame, or the frame rate is not the protocol's.
        """
        if self.fps is not None and fps != self.fps:
            raise ConfigError(
                f"protocol {self.name!r} is defined at {self.fps:g} fps; this corpus has "
                f"{fps:g}. Build the corpus at {self.fps:g} fps"
            )
        return Frames(
            frame_of(self.prefix_ms, fps, f"protocol {self.name!r}, prefix"),
            tuple(frame_of(ms, fps, f"protocol {self.name!r}, horizon") for ms in self.horizons_ms),
        )

    def windows(self, corpus: Corpus, split: str = "test") -> Sampling:
        """The windows on a corpus, grouped by action: the same on every machine."""
        prefix, horizons = self.frames(corpus.fps)
        return self.sampling.sample(corpus, split, prefix + horizons[-1])

    def score(
        self,
        predictor: Predictor,
        corpus: Corpus,
        split: str = "test",
        *,
        system: str = "",
        batch: int = 256,
    ) -> Scores:
        """Predict every window and measure it, in float64.

        Args:
            predictor: given prefixes in float64; what it returns may have any precision.
            system: name for tables; by default that of the predictor's class.
            batch: windows a call of ``predict``.

        Raises:
            ConfigError: the corpus does not fit the protocol, or the prediction is not what was
                asked for.
        """
        if len(corpus.skeleton) < 2:
            raise ConfigError(f"corpus {corpus.name!r} has no joint below the root to measure")
        sampling = self.windows(corpus, split)
        prefix, horizons = self.frames(corpus.fps)
        values: dict[tuple[str, str], Tensor] = {}
        for group in sampling.groups:
            parts = [
                run_predictor(
                    predictor, corpus, group.windows[first : first + batch], prefix, horizons[-1]
                )
                for first in range(0, len(group.windows), batch)
            ]
            known, predicted, target = (
                Motion.join(motions) for motions in zip(*parts, strict=True)
            )
            scene = Scene(corpus.skeleton, corpus.fps, known)
            for metric in self.metrics:
                values[group.name, metric] = METRICS[metric].values(
                    predicted, target, scene, horizons
                )
        return Scores(
            system=system or type(predictor).__name__,
            corpus=corpus.name,
            protocol=self.name,
            split=split,
            horizons_ms=self.horizons_ms,
            values=values,
            expected=sampling.expected,
            missing=sampling.missing,
            notes=sampling.notes,
            joints_left_out={
                metric: METRICS[metric].left_out(corpus.skeleton) for metric in self.metrics
            },
        )


def frame_of(ms: Milliseconds, fps: float, what: str = "time") -> int:
    """The number of frames in a time.

    Args:
        ms: milliseconds; may be rounded to a hundredth.
        fps: frames per second.
        what: names the time in messages.

    Raises:
        ConfigError: it does not fall on a frame; the message says which times near it do.
    """
    frames = ms * fps / 1000
    nearest = round(frames)
    if nearest >= 1 and abs(nearest * 1000 / fps - ms) <= 0.01:
        return nearest
    below = max(math.floor(frames), 1)
    near = " or ".join(f"{count * 1000 / fps:.6g} ms" for count in (below, below + 1))
    raise ConfigError(
        f"{what}: {ms:g} ms is {frames:.4g} frames at {fps:g} fps and does not fall on a frame; "
        f"{near} would{_whole_ms(fps)}"
    )


def build_protocol(kind: str, **options: Any) -> Protocol:
    """A protocol by name, with its options: see the functions in ``PROTOCOLS``.

    Raises:
        ConfigError: the name or an option is unknown, or an option has the wrong type.
    """
    make, arguments = pick_kind(PROTOCOLS, {**options, "kind": kind}, "protocol")
    check_call(make, arguments, where="protocol")
    return make(**arguments)


def h36m_standard(horizons_ms: Sequence[Milliseconds] = SHORT_TERM_MS) -> Protocol:
    """Human3.6M short-term, 8 windows an action (4 a recording), 50 frames of prefix at 25 fps.

    Which angles count depends on how many frames are predicted (``metrics.moving_angles``): the
    published numbers at 80 to 400 ms are those with 10 frames, the default here.

    Source: Martinez et al., CVPR 2017; Pavllo et al., IJCV 2019, Table 1.
    """
    return _h36m("h36m-standard", 4, horizons_ms)


def h36m_128(horizons_ms: Sequence[Milliseconds] = SHORT_TERM_MS) -> Protocol:
    """As ``h36m-standard`` with 128 windows a recording, 256 an action: far less chance in it.

    Source: Pavllo et al., IJCV 2019, section 4.2 and Table 2.
    """
    return _h36m("h36m-128", 128, horizons_ms)


def short_term(
    horizons_ms: Sequence[Milliseconds] = SHORT_TERM_MS,
    prefix_ms: Milliseconds = 2000,
    stride: int = 10,
    metrics: Sequence[str] = ("euler", "euler_wrapped", "joint_angle", "position"),
    group_by: str = "action",
) -> Protocol:
    """Short-term forecasting on any corpus: windows on a grid over all clips of the split.

    Args:
        horizons_ms: when the prediction is compared; must fall on frames of the corpus.
        prefix_ms: how much motion is given.
        stride: frames from the start of one window to that of the next.
        metrics: names in ``METRICS``.
        group_by: label of the clips that makes the lines of the table.
    """
    if stride < 1:
        raise ConfigError(f"protocol 'short-term': stride {stride}; expected at least 1 frame")
    return Protocol(
        name="short-term",
        sampling=Grid(stride, group_by),
        prefix_ms=prefix_ms,
        horizons_ms=tuple(horizons_ms),
        metrics=tuple(metrics),
    )


PROTOCOLS: dict[str, Callable[..., Protocol]] = {
    "h36m-standard": h36m_standard,
    "h36m-128": h36m_128,
    "short-term": short_term,
}


def _h36m(name: str, pairs: int, horizons_ms: Sequence[Milliseconds]) -> Protocol:
    return Protocol(
        name=name,
        sampling=LegacyDraws(pairs),
        prefix_ms=2000,
        horizons_ms=tuple(horizons_ms),
        metrics=("euler", "euler_wrapped", "euler_all"),
        fps=25.0,
    )


def _whole_ms(fps: float) -> str:
    """Advice on the whole milliseconds that fall on frames, where there are such below a second."""
    step = (1000 / Fraction(fps).limit_denominator(1001)).numerator
    return f" (at this rate every {step} ms falls on one)" if step <= 1000 else ""
