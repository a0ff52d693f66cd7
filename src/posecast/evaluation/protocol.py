"""Protocols as data: which windows, which horizons, which metrics; any predictor is scored."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from posecast.config import check_call, did_you_mean, pick_kind
from posecast.errors import ConfigError, SkeletonError
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
from posecast.skeleton.catalog import named_skeleton

SHORT_TERM_MS: tuple[Milliseconds, ...] = (80, 160, 320, 400)


@dataclass(frozen=True)
class Protocol:
    """A way to compare predictors; published ones are in ``PROTOCOLS``.

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

    Source: Pavllo et al., IJCV 2019, Table 2.
    """
    return _h36m("h36m-128", 128, horizons_ms)


def short_term(
    horizons_ms: Sequence[Milliseconds] = SHORT_TERM_MS,
    prefix_ms: Milliseconds = 2000,
    stride: int = 10,
    metrics: Sequence[str] = ("euler", "euler_wrapped", "joint_angle", "position"),
    group_by: str = "action",
    joints: str | list[str] | None = None,
    thigh: str | None = None,
) -> Protocol:
    """Short-term forecasting on any corpus: windows on a grid over all clips of the split.

    Args:
        horizons_ms: when the prediction is compared; must fall on frames of the corpus.
        prefix_ms: how much motion is given.
        stride: frames from the start of one window to that of the next.
        metrics: names in ``METRICS``.
        group_by: label of the clips that makes the lines of the table.
        joints: which joints count for metrics that choose them: names, or a skeleton of the
            catalog such as ``smpl-15``; by default all but the first.
        thigh: the joint whose offset is the unit of metrics in thighs; by default the left knee.
    """
    return Protocol(
        name="short-term",
        sampling=Grid(stride, group_by),
        prefix_ms=prefix_ms,
        horizons_ms=tuple(horizons_ms),
        metrics=tuple(metrics),
        joints=_names(joints),
        thigh=thigh,
    )


AMASS_METRICS = ("euler_inverse_sum", "joint_angle_sum", "position_thighs_sum", "pck_auc")


def amass_spl(
    horizons_ms: Sequence[Milliseconds] = (100, 200, 300, 400),
    metrics: Sequence[str] = AMASS_METRICS,
    joints: str | list[str] | None = "smpl-15",
    thigh: str | None = None,
) -> Protocol:
    """AMASS at 60 fps: 2 s given, windows of 3 s every 2 s, errors summed over frames until t.

    Every horizon, up to 1000 ms, is measured on the same windows of 180 frames.

    Args:
        horizons_ms: 100 to 400 in the tables; the paper's supplement goes on to 1000.
        metrics: names in ``METRICS``.
        joints: which joints count: names, or a skeleton of the catalog.
        thigh: the joint whose offset is the unit of positions; by default the left knee.

    Source: Aksan et al. 2019, section 4 and Table 2.
    """
    return Protocol(
        name="amass-spl",
        sampling=Grid(120, None, least=180),
        prefix_ms=2000,
        horizons_ms=tuple(horizons_ms),
        metrics=tuple(metrics),
        fps=60.0,
        baselines=("zero-velocity",),
        notes=(
            "Aksan et al. 2019 used an early release of AMASS with lists of its own; on other "
            "files or splits numbers are not comparable with theirs.",
        ),
        joints=_names(joints),
        thigh=thigh,
    )


LONG_MS: tuple[Milliseconds, ...] = (80, 160, 320, 400, 600, 800, 1000, 2000, 3000, 4000)


def h36m_long(horizons_ms: Sequence[Milliseconds] = LONG_MS) -> Protocol:
    """The windows of ``h36m-standard`` up to four seconds, with the mean pose in the table.

    Source: Andreou et al. 2022, Table 2; eight windows an action are inferred, see the notes.
    """
    return replace(
        _h36m("h36m-long", 4, horizons_ms),
        baselines=("zero-velocity", "running-average-2", "running-average-4", "mean-pose"),
        notes=(
            "Andreou et al. 2022 do not say how many windows they take; their horizons are those "
            "of QuaterNet's test, which takes 8 an action.",
            "Both systems they print lose to zero velocity from 0.8 s on, and from 2 s on to the "
            "mean pose of the training clips, too; there a lower number than theirs says little.",
        ),
    )


CMU_ACRNN_METRICS = (
    *("npss", "npss_full_power", "npss_with_prefix"),
    *("euclidean_cm", "euclidean_cmu", "euclidean_with_prefix_cm", "euclidean_with_prefix_cmu"),
    "emitted_cm",
    *(
        f"acceleration{what}{prefix}{unit}"
        for what in ("", "_true", "_error")
        for prefix in ("", "_with_prefix")
        for unit in ("", "_cmu")
    ),
    *("bone_length_drift", "jitter", "jitter_true"),
)


def cmu_acrnn(
    horizons_ms: Sequence[Milliseconds] = (100, 400, 1000, 10000),
    stride: int = 7,
    limit: int = 400,
    metrics: Sequence[str] = CMU_ACRNN_METRICS,
) -> Protocol:
    """10 frames of prefix at 30 fps, windows every 7 frames, at most 400, 3 to 300 frames ahead.

    Averages are over all frames up to the horizon, with and without the prefix, and in two units,
    because the paper does not say which it prints.

    Args:
        horizons_ms: how far averages reach.
        stride: frames from the start of one window to that of the next.
        limit: most windows; if there are more on the grid, those are spread over it evenly.
        metrics: names in ``METRICS``.

    Source: Andreou et al. 2022, section 6 and Table 1.
    """
    return Protocol(
        name="cmu-acrnn",
        sampling=Grid(stride, None, limit),
        prefix_ms=1000 / 3,
        horizons_ms=tuple(horizons_ms),
        metrics=tuple(metrics),
        fps=30.0,
        baselines=("zero-velocity", "running-average-2", "mean-pose"),
        notes=(
            "Andreou et al. 2022 print no unit (that of CMU's files, 5.644 cm, is inferred), nor "
            "which subject they test on (86 is likely), nor whether the prefix counts; their "
            "300 frames (10 000 ms) are for the acceleration alone.",
        ),
    )


def cross_skeleton(
    horizons_ms: Sequence[Milliseconds] = (100, 400, 1000),
    prefix_ms: Milliseconds = 1000 / 3,
    stride: int = 7,
    limit: int | None = None,
    metrics: Sequence[str] = ("euclidean_cm", "emitted_cm", "joint_angle", "bone_length_drift"),
) -> Protocol:
    """Bodies and motions seen in training or not, a line for each scenario and body.

    For corpora whose clips are labelled with a ``scenario``, such as ``bodies``.

    Args:
        horizons_ms: how far averages reach; must fall on frames of the corpus.
        prefix_ms: how much motion is given.
        stride: frames from the start of one window to that of the next.
        limit: most windows a line; ``None``: all on the grid.
        metrics: names in ``METRICS``.

    Source: after Andreou et al. 2022, section 7.3, which shows pictures and no numbers.
    """
    return Protocol(
        name="cross-skeleton",
        sampling=Grid(stride, "scenario", limit),
        prefix_ms=prefix_ms,
        horizons_ms=tuple(horizons_ms),
        metrics=tuple(metrics),
        baselines=("zero-velocity",),
    )


PROTOCOLS: dict[str, Callable[..., Protocol]] = {
    "h36m-standard": h36m_standard,
    "h36m-128": h36m_128,
    "h36m-long": h36m_long,
    "cmu-acrnn": cmu_acrnn,
    "cross-skeleton": cross_skeleton,
    "amass-spl": amass_spl,
    "short-term": short_term,
}


def _left_out(metric: Metric, skeleton: Skeleton, counting: Counting) -> tuple[str, ...]:
    """Names of the joints that never enter a metric's value."""
    if counting.counted is None or "counted" not in metric.asks:
        return metric.left_out(skeleton)
    counted = frozenset(counting.counted)
    return tuple(name for joint, name in enumerate(skeleton.names) if joint not in counted)


def _names(joints: str | Sequence[str] | None) -> tuple[str, ...] | None:
    """Joints by name: those of a skeleton in the catalog, or as they are."""
    if joints is None:
        return None
    if not isinstance(joints, str):
        return tuple(joints)
    try:
        return named_skeleton(joints).skeleton.names
    except SkeletonError as error:
        raise ConfigError(f"protocol.joints: {error}") from None


def _h36m(name: str, pairs: int, horizons_ms: Sequence[Milliseconds]) -> Protocol:
    return Protocol(
        name=name,
        sampling=LegacyDraws(pairs),
        prefix_ms=2000,
        horizons_ms=tuple(horizons_ms),
        metrics=("euler", "euler_wrapped", "euler_all"),
        fps=25.0,
    )
