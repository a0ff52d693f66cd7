"""The protocols that papers publish, and one for any corpus, by name."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

from posecast.config import check_call, pick_kind
from posecast.errors import ConfigError, SkeletonError
from posecast.evaluation.protocol import Protocol
from posecast.evaluation.scores import Milliseconds
from posecast.evaluation.windows import Grid, LegacyDraws
from posecast.skeleton.catalog import named_skeleton

SHORT_TERM_MS: tuple[Milliseconds, ...] = (80, 160, 320, 400)


def build_protocol(kind: str, **options: Any) -> Protocol:
    """A protocol by name, with its options: see the functions in ``PROTOCOLS``.

    Raises:
        ConfigError: the name or an option is unknown, or an option has the wrong type.
    """
    make, arguments = pick_kind(PROTOCOLS, {**options, "kind": kind}, "protocol")
    check_call(make, arguments, where="protocol")
    return make(**arguments)


H36M_METRICS = ("euler", "euler_wrapped", "euler_all")


def h36m_standard(
    horizons_ms: Sequence[Milliseconds] = SHORT_TERM_MS, metrics: Sequence[str] = H36M_METRICS
) -> Protocol:
    """Human3.6M short-term, 8 windows an action (4 a recording), 50 frames of prefix at 25 fps.

    Which angles count depends on how many frames are predicted (``metrics.moving_angles``): the
    published numbers at 80 to 400 ms are those with 10 frames, the default here.

    Args:
        horizons_ms: when the prediction is compared.
        metrics: names in ``METRICS``; the published one is ``euler``.

    Source: Martinez et al., CVPR 2017; Pavllo et al., IJCV 2019, Table 1.
    """
    return _h36m("h36m-standard", 4, horizons_ms, metrics)


def h36m_128(
    horizons_ms: Sequence[Milliseconds] = SHORT_TERM_MS, metrics: Sequence[str] = H36M_METRICS
) -> Protocol:
    """As ``h36m-standard`` with 128 windows a recording, 256 an action: far less chance in it.

    Source: Pavllo et al., IJCV 2019, Table 2.
    """
    return _h36m("h36m-128", 128, horizons_ms, metrics)


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


def h36m_long(
    horizons_ms: Sequence[Milliseconds] = LONG_MS, metrics: Sequence[str] = H36M_METRICS
) -> Protocol:
    """The windows of ``h36m-standard`` up to four seconds, with the mean pose in the table.

    Source: Andreou et al. 2022, Table 2; eight windows an action are inferred, see the notes.
    """
    return replace(
        _h36m("h36m-long", 4, horizons_ms, metrics),
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


def _h36m(
    name: str, pairs: int, horizons_ms: Sequence[Milliseconds], metrics: Sequence[str]
) -> Protocol:
    return Protocol(
        name=name,
        sampling=LegacyDraws(pairs),
        prefix_ms=2000,
        horizons_ms=tuple(horizons_ms),
        metrics=tuple(metrics),
        fps=25.0,
    )
