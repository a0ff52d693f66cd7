"""A protocol: which windows, which horizons, which metrics; any predictor is scored."""

from __future__ import annotations

from dataclasses import dataclass

from posecast.config import did_you_mean
from posecast.errors import ConfigError
from posecast.evaluation.baselines import BASELINE_NAMES
from posecast.evaluation.measuring import measure
from posecast.evaluation.metric import Counting, Metric, check_lengths
from posecast.evaluation.metrics import METRICS
from posecast.evaluation.prediction import Predictor
from posecast.evaluation.scores import Milliseconds, Scores, list_ms
from posecast.evaluation.times import Frames, frame_of
from posecast.evaluation.until_metrics import left_thigh
from posecast.evaluation.windows import Grid, LegacyDraws, Sampling
from posecast.motion.corpus import Corpus
from posecast.skeleton import Skeleton


@dataclass(frozen=True)
class Protocol:
    """A way to compare predictors; published ones are in ``PROTOCOLS`` of ``protocols``.

    The value of a row is the metric at the horizon or up to it, mean over the windows.

    Args:
        name: what tables call it.
        sampling: which windows.
        prefix_ms: how much motion the predictor is given, milliseconds.
        horizons_ms: when the prediction is compared, ascending, milliseconds.
        metrics: names in ``METRICS``.
        fps: frame rate that the windows are defined at; ``None`` takes the corpus's.
        baselines: names of the baselines in every table, see ``BASELINE_NAMES``.
        notes: what should be read beside its tables; full sentences.
        joints: names of the joints that metrics of chosen joints look at; ``None``: all but the
            first of the corpus's skeleton.
        thigh: the joint whose offset is the unit of metrics in thighs; ``None``: the left knee.
    """

    name: str
    sampling: LegacyDraws | Grid
    prefix_ms: Milliseconds
    horizons_ms: tuple[Milliseconds, ...]
    metrics: tuple[str, ...]
    fps: float | None = None
    baselines: tuple[str, ...] = ("zero-velocity", "running-average-2", "running-average-4")
    notes: tuple[str, ...] = ()
    joints: tuple[str, ...] | None = None
    thigh: str | None = None

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
        for what, names, known in (
            ("metric", self.metrics, METRICS),
            ("baseline", self.baselines, BASELINE_NAMES),
        ):
            for name in names:
                if name not in known:
                    raise ConfigError(
                        f"protocol {self.name!r}: unknown {what} {name!r}; "
                        f"{did_you_mean(name, known)}"
                    )

    def frames(self, fps: float) -> Frames:
        """Prefix and horizons in frames.

        Raises:
            ConfigError: a time does not fall on a frame or is too short for a metric, or the frame
                rate is not the protocol's.
        """
        if self.fps is not None and fps != self.fps:
            raise ConfigError(
                f"protocol {self.name!r} is defined at {self.fps:g} fps; this corpus has "
                f"{fps:g}. Build the corpus at {self.fps:g} fps"
            )
        what = f"protocol {self.name!r}"
        prefix = frame_of(self.prefix_ms, fps, f"{what}, prefix")
        horizons = tuple(frame_of(ms, fps, f"{what}, horizon") for ms in self.horizons_ms)
        for metric in self.metrics:
            check_lengths(METRICS[metric], prefix=prefix, frames=horizons, fps=fps)
        return Frames(prefix, horizons)

    def windows(self, corpus: Corpus, split: str = "test") -> Sampling:
        """The windows on a corpus, grouped by action: the same on every machine.

        Raises:
            ConfigError: the corpus does not fit the protocol.
        """
        self._check_thighs(corpus, split, self.counting(corpus).thigh)
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
        counting = self.counting(corpus)
        sampling, frames = self.windows(corpus, split), self.frames(corpus.fps)
        values = measure(
            predictor,
            corpus,
            sampling.groups,
            frames,
            self.metrics,
            counting=counting,
            batch=batch,
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
            notes=(*sampling.notes, *self.notes),
            joints_left_out={
                metric: _left_out(METRICS[metric], corpus.skeleton, counting)
                for metric in self.metrics
            },
        )

    def _check_thighs(self, corpus: Corpus, split: str, thigh: int | None) -> None:
        """Refuse bodies without a thigh where that is the unit."""
        asking = [metric for metric in self.metrics if "thigh" in METRICS[metric].asks]
        if thigh is None or not asking:
            return
        # Without a template none has one; the first tells, and no more are read for it.
        for index in corpus.indices(split)[:1]:
            if not corpus.clips[index].offsets[thigh].any():
                raise ConfigError(
                    f"metrics {', '.join(asking)} are in thighs, but bones of corpus "
                    f"{corpus.name!r} have no length; give a template of the body "
                    "(corpus.template=FILE), or leave these metrics out (protocol.metrics)"
                )

    def counting(self, corpus: Corpus) -> Counting:
        """The joints that count, and the thigh, as indices of the corpus's skeleton.

        Raises:
            ConfigError: the corpus has not all of them.
        """
        names = corpus.skeleton.names
        wanted = (*(self.joints or ()), *(() if self.thigh is None else (self.thigh,)))
        absent = [name for name in wanted if name not in names]
        if absent:
            raise ConfigError(
                f"protocol {self.name!r} looks at joints that corpus {corpus.name!r} has not: "
                f"{', '.join(absent)}; name others (protocol.joints, protocol.thigh), or set "
                f"joints to null for all but the root; it has {', '.join(names)}"
            )
        chosen = None if self.joints is None else tuple(map(names.index, self.joints))
        thigh = None if self.thigh is None else names.index(self.thigh)
        if thigh is None and any("thigh" in METRICS[metric].asks for metric in self.metrics):
            thigh = left_thigh(corpus.skeleton)
        return Counting(chosen, thigh)


def _left_out(metric: Metric, skeleton: Skeleton, counting: Counting) -> tuple[str, ...]:
    """Names of the joints that never enter a metric's value."""
    if counting.counted is None or "counted" not in metric.asks:
        return metric.left_out(skeleton)
    counted = frozenset(counting.counted)
    return tuple(name for joint, name in enumerate(skeleton.names) if joint not in counted)
