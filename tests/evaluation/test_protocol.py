"""Protocols: horizons fall on frames, any predictor is scored, and misuse is explained."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from posecast.errors import ConfigError
from posecast.evaluation import (
    AVERAGE,
    METRICS,
    PROTOCOLS,
    Scene,
    build_protocol,
)
from posecast.evaluation.times import frame_of
from posecast.evaluation.windows import Grid
from posecast.model import RunningAverage, ZeroVelocity
from posecast.motion.clip import Motion
from posecast.motion.corpus import Corpus

OWN = ("acceleration", "jitter")
"""Of these the truth itself has some."""


class Oracle:
    """Knows the clips and continues each prefix with what really follows."""

    def __init__(self, corpus):
        self.clips = corpus.clips

    def replay(self, prefix: Motion) -> Motion:
        return prefix.cut(1)

    def predict(self, prefix: Motion, horizon: int) -> Motion:
        rotations, positions = [], []
        length = prefix.rotations_local.shape[1]
        for known in prefix.rotations_local:
            clip, start = next(
                (clip, start)
                for clip in self.clips
                for start in range(clip.frames - length - horizon + 1)
                if torch.equal(clip.rotations_local[start], known[0])
                and torch.equal(clip.rotations_local[start + length - 1], known[-1])
            )
            piece = slice(start + length, start + length + horizon)
            rotations.append(clip.rotations_local[piece])
            positions.append(clip.root_positions[piece])
        return Motion(torch.stack(rotations), torch.stack(positions), prefix.offsets)


class Wrong:
    """Returns what ``change`` makes of a correct repetition of the last pose."""

    def __init__(self, change):
        self.change = change

    def predict(self, prefix: Motion, horizon: int) -> Motion:
        return self.change(ZeroVelocity().predict(prefix, horizon))


class Remembering(ZeroVelocity):
    """Repeats the last pose and keeps what it was asked for."""

    def predict(self, prefix: Motion, horizon: int) -> Motion:
        asked.append((tuple(prefix.rotations_local.shape), prefix.rotations_local.dtype, horizon))
        return super().predict(prefix, horizon)


asked: list[tuple[tuple[int, ...], torch.dtype, int]] = []


@pytest.fixture
def corpus(make_h36m) -> Corpus:
    return make_h36m(("walking", "eating"))


@pytest.mark.parametrize(
    ("ms", "fps", "frames"),
    [
        (80, 25.0, 2),
        (400, 25.0, 10),
        (1000, 30.0, 30),
        (33.33, 30.0, 1),
        (333.33, 30.0, 10),
        (100, 60.0, 6),
    ],
)
def test_a_time_that_falls_on_a_frame_is_that_many_frames(ms, fps, frames):
    assert frame_of(ms, fps) == frames


@pytest.mark.parametrize(
    ("ms", "fps", "advice"),
    [
        (80, 30.0, "66.6667 ms or 100 ms would (at this rate every 100 ms falls on one)"),
        (100, 25.0, "80 ms or 120 ms would (at this rate every 40 ms falls on one)"),
        (10, 25.0, "40 ms or 80 ms would"),
        (0, 25.0, "40 ms or 80 ms would"),
    ],
)
def test_a_time_between_frames_is_refused_with_the_nearest_that_would_do(ms, fps, advice):
    with pytest.raises(ConfigError) as caught:
        frame_of(ms, fps, "horizon")
    assert f"horizon: {ms} ms is" in str(caught.value)
    assert advice in str(caught.value)


def test_there_are_seven_protocols():
    assert list(PROTOCOLS) == [
        *("h36m-standard", "h36m-128", "h36m-long"),
        *("cmu-acrnn", "cross-skeleton", "amass-spl", "short-term"),
    ]


@pytest.mark.parametrize(("kind", "windows"), [("h36m-standard", 8), ("h36m-128", 256)])
def test_the_human36m_protocols_give_50_frames_and_ask_for_10(corpus, kind, windows):
    protocol = build_protocol(kind)
    assert protocol.frames(25.0) == (50, (2, 4, 8, 10))
    assert protocol.metrics == ("euler", "euler_wrapped", "euler_all")
    asked.clear()
    protocol.score(Remembering(), corpus)
    assert asked == [((windows, 50, 5, 4), torch.float64, 10)] * 2


@pytest.mark.parametrize("kind", ["h36m-standard", "h36m-128", "h36m-long"])
def test_the_human36m_windows_may_be_measured_by_other_metrics(corpus, kind):
    chosen = build_protocol(kind, metrics=["joint_angle", "euler"], horizons_ms=[80, 400])
    scores = chosen.score(ZeroVelocity(), corpus)
    published = build_protocol(kind, horizons_ms=[80, 400]).score(ZeroVelocity(), corpus)
    assert {row.metric for row in scores.rows} == {"joint_angle", "euler"}
    assert scores.value("euler", 400) == published.value("euler", 400)


def test_batches_do_not_change_the_result(corpus):
    protocol = build_protocol("h36m-standard")
    asked.clear()
    small = protocol.score(Remembering(), corpus, batch=3)
    assert [shape[0] for shape, *_ in asked] == [3, 3, 2, 3, 3, 2]
    assert small.rows == protocol.score(ZeroVelocity(), corpus).rows


@pytest.mark.parametrize("kind", PROTOCOLS)
def test_an_oracle_scores_zero_everywhere(corpus, kind):
    options = {
        "short-term": {"stride": 40},
        "cross-skeleton": {"stride": 40, "prefix_ms": 400, "horizons_ms": [80, 160, 320, 400]},
        "cmu-acrnn": {"stride": 40, "horizons_ms": [120, 400, 800, 1000]},
        "amass-spl": {"joints": None, "horizons_ms": [120, 200, 320, 400]},
    }.get(kind, {})
    protocol = build_protocol(kind, **options)
    if kind == "cmu-acrnn":  # at the rate of the corpus, which is that of no paper
        protocol = replace(protocol, fps=25.0, prefix_ms=400)
    if kind == "amass-spl":
        protocol = replace(protocol, fps=25.0, sampling=Grid(40, None, least=75))
    scores = protocol.score(Oracle(corpus), corpus)
    lines = len(scores.actions) + 1  # and their average
    assert lines == (2 if kind in ("cmu-acrnn", "cross-skeleton", "amass-spl") else 3)
    assert len(scores.rows) == lines * len(scores.metrics) * len(protocol.horizons_ms)
    # What the truth itself has of acceleration and jitter is no error.
    judged = [row for row in scores.rows if not row.metric.startswith(OWN) or "error" in row.metric]
    shares = [row.value for row in judged if row.metric == "pck_auc"]
    assert shares == pytest.approx([1.0] * len(shares))
    assert max(row.value for row in judged if row.metric != "pck_auc") < 1e-6


def test_a_row_is_the_mean_over_windows_and_the_average_is_unweighted(make_clip):
    clips = [make_clip(300, 1, action="walk"), make_clip(80, 2, action="jog")]
    corpus = Corpus("toy", clips, {"test": (0, 1)})
    protocol = build_protocol("short-term", metrics=["position"], horizons_ms=[80, 400])
    scores = protocol.score(ZeroVelocity(), corpus)
    by_name = {(row.action, row.horizon_ms): row for row in scores.rows}
    assert len(by_name) == 6
    assert (by_name["walk", 80].windows, by_name["jog", 80].windows) == (25, 3)
    assert by_name[AVERAGE, 80].windows == 28
    for horizon in (80, 400):
        mean = (by_name["walk", horizon].value + by_name["jog", horizon].value) / 2
        assert by_name[AVERAGE, horizon].value == pytest.approx(mean, rel=1e-12)
        assert scores.value("position", horizon) == by_name[AVERAGE, horizon].value
    walk = protocol.windows(corpus).groups[1]
    assert (walk.name, len(walk.windows)) == ("walk", 25)
    expected = 0.0
    for window in walk.windows:
        whole = clips[window.clip].motion()
        known, target = (
            Motion(*(part[:, frame : frame + 1] for part in whole[:2]), whole.offsets)
            for frame in (window.start + 49, window.start + 51)
        )
        scene = Scene(corpus.skeleton, corpus.fps, known)
        expected += float(METRICS["position"].values(known, target, scene, [1])) / 25
    assert by_name["walk", 80].value == pytest.approx(expected, rel=1e-9)


def test_zero_velocity_is_the_same_over_moving_angles_and_over_all(corpus):
    scores = build_protocol("h36m-standard").score(ZeroVelocity(), corpus)
    for horizon in (80, 160, 320, 400):
        moving, everything = scores.value("euler", horizon), scores.value("euler_all", horizon)
        assert moving > 0.1
        assert moving == pytest.approx(everything, rel=1e-12)


def test_the_prefix_the_horizons_and_the_stride_are_options(make_clip):
    corpus = Corpus("toy", [make_clip(100, 1, fps=30.0)], {"validation": (0,)})
    protocol = build_protocol("short-term", prefix_ms=500, horizons_ms=[100, 1000], stride=7)
    assert protocol.frames(30.0) == (15, (3, 30))
    sampling = protocol.windows(corpus, "validation")
    assert [window.start for window in sampling.groups[0].windows] == list(range(0, 56, 7))
    scores = protocol.score(RunningAverage(2), corpus, "validation", system="average")
    assert (scores.system, scores.split, scores.actions) == ("average", "validation", ("all",))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            lambda motion: Motion(motion.rotations_local[:, 1:], *motion[1:]),
            r"rotations_local of shape \(8, 9, 5, 4\); expected \(8, 10, 5, 4\)",
        ),
        (
            lambda motion: motion._replace(root_positions=motion.root_positions[:, :9]),
            r"root_positions of shape \(8, 9, 3\)",
        ),
        (
            lambda motion: motion._replace(rotations_local=motion.rotations_local / 0),
            "not finite in 8 of 8 windows",
        ),
        (
            lambda motion: motion._replace(rotations_local=2 * motion.rotations_local),
            "length is off 1 by up to 1",
        ),
    ],
)
def test_a_prediction_that_is_not_what_was_asked_for_is_refused(corpus, change, message):
    with pytest.raises(ConfigError, match=message):
        build_protocol("h36m-standard").score(Wrong(change), corpus)


@pytest.mark.parametrize(
    ("kind", "options", "message"),
    [
        ("h36m", {}, "did you mean 'h36m-128'"),
        ("short-term", {"horizon_ms": [80]}, "horizon_ms: unknown key; did you mean 'horizons_ms'"),
        ("short-term", {"metrics": ["eular"]}, "unknown metric 'eular'; did you mean 'euler'"),
        ("short-term", {"horizons_ms": [160, 80]}, "in ascending order"),
        ("short-term", {"horizons_ms": []}, "at least one"),
        ("short-term", {"stride": 0}, "stride 0; expected at least 1"),
        ("cmu-acrnn", {"limit": 0}, "limit 0; expected at least 1"),
        ("short-term", {"stride": "10"}, "found '10', expected a whole number"),
    ],
)
def test_a_misspelled_protocol_is_refused_before_anything_is_read(kind, options, message):
    with pytest.raises(ConfigError, match=message):
        build_protocol(kind, **options)


def test_a_corpus_at_another_frame_rate_is_refused(make_clip):
    corpus = Corpus("toy", [make_clip(400, 1, fps=50.0)], {"test": (0,)})
    with pytest.raises(ConfigError, match="defined at 25 fps; this corpus has 50"):
        build_protocol("h36m-standard").windows(corpus)


def test_a_value_that_was_not_measured_is_refused(corpus):
    scores = build_protocol("h36m-standard").score(ZeroVelocity(), corpus)
    with pytest.raises(ConfigError, match="80, 160, 320, 400 ms"):
        scores.value("euler", 560)


def test_a_protocol_that_measures_nothing_is_refused():
    with pytest.raises(ConfigError, match="'short-term': no metrics; expected some of euler"):
        build_protocol("short-term", metrics=[])


def test_the_windows_of_amass_spl_are_three_seconds_whatever_the_horizon(make_h36m):
    corpus = make_h36m(("walking",))
    frames = corpus.clips[0].frames
    long = replace(
        build_protocol("amass-spl", horizons_ms=[80, 400], joints=None),
        fps=25.0,
        sampling=Grid(50, None, least=75),
    )
    (group,) = long.windows(corpus).groups
    starts = [window.start for window in group.windows if window.clip == group.windows[0].clip]
    assert starts == list(range(0, frames - 74, 50))
    shorter = replace(long, horizons_ms=(120,))
    assert shorter.windows(corpus).groups == long.windows(corpus).groups
    assert build_protocol("amass-spl").sampling == Grid(120, None, least=180)
    assert build_protocol("amass-spl").frames(60.0) == (120, (6, 12, 18, 24))
    assert build_protocol("amass-spl", horizons_ms=[600, 1000]).frames(60.0) == (120, (36, 60))
    with pytest.raises(ConfigError, match=r"windows of 76 frames.*have 75: shorten the horizons"):
        replace(long, horizons_ms=(1040,)).windows(corpus)


def test_the_joints_that_count_are_chosen_by_name(corpus):
    whole = build_protocol("short-term", stride=40, metrics=["position", "euler"])
    some = build_protocol(
        "short-term", stride=40, metrics=["position", "euler"], joints=["Head", "Hips"]
    )
    scores = some.score(ZeroVelocity(), corpus)
    assert scores.joints_left_out == {
        "position": ("Spine", "LeftLeg", "RightLeg"),
        "euler": ("Hips",),  # it counts what it always counts
    }
    alone = build_protocol("short-term", stride=40, metrics=["position"], joints=["Head"])
    head = alone.score(ZeroVelocity(), corpus).value("position", 400)
    assert scores.value("position", 400) == pytest.approx(head / 2)  # the hips do not move
    every = whole.score(ZeroVelocity(), corpus)
    assert every.value("euler", 400) == scores.value("euler", 400)
    assert every.value("position", 400) != scores.value("position", 400)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            {"joints": ["Head", "Tail"]},
            "looks at joints that corpus 'toy' has not: Tail; name others",
        ),
        ({"thigh": "Femur"}, "looks at joints that corpus 'toy' has not: Femur"),
    ],
)
def test_joints_that_are_not_there_are_named(corpus, options, message):
    protocol = build_protocol("short-term", stride=40, **options)
    with pytest.raises(ConfigError, match=message):
        protocol.score(ZeroVelocity(), corpus)


def test_a_skeleton_that_is_in_no_catalog_is_named():
    with pytest.raises(ConfigError, match=r"protocol.joints: no skeleton is called 'smpl-16'"):
        build_protocol("amass-spl", joints="smpl-16")
