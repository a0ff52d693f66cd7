"""Scores of whole walks with known answers; steadiness of long ones."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
import torch

from posecast.corpora.synthetic import make_clip
from posecast.errors import ConfigError
from posecast.evaluation.steadiness import steadiness
from posecast.evaluation.walked import Walked
from posecast.evaluation.walks import WalkScores, reference_of, score_walk
from posecast.geometry import quaternion
from posecast.motion import Clip, turn

FPS = 30.0


@pytest.fixture(scope="module")
def walking() -> Clip:
    """Ten seconds of a generated walk along a line."""
    return make_clip(0, fps=FPS, seconds=10.0)


def test_a_statue_that_glides_slides_all_the_way(make_statue, make_course, straight) -> None:
    """Ten metres at 1 m/s, in one contact."""
    scores = score_walk(make_statue(frames=301), make_course(straight))
    assert scores.standing == 1
    assert scores.slide_path == pytest.approx(1000)
    assert scores.slide_straight == pytest.approx(1000)
    assert scores.slide_fast == 1


@pytest.mark.parametrize(("height", "depth"), [(-0.03, 3.0), (0.05, 0.0), (0.0, 0.0)])
def test_feet_are_as_deep_in_the_floor_as_the_body_is_sunk(
    make_statue, make_course, straight, height, depth
) -> None:
    scores = score_walk(make_statue(height=height), make_course(straight))
    assert scores.sink_mean == pytest.approx(depth, abs=1e-9)
    assert scores.sink_max == pytest.approx(depth, abs=1e-9)


def test_where_real_feet_stand_is_the_floor(walking: Clip) -> None:
    reference = reference_of([walking])
    found = score_walk(walking, reference=reference)
    assert found.sink_max < 1e-3
    sunk = replace(walking, root_positions=walking.root_positions - torch.tensor([0, 0.04, 0]))
    deep = score_walk(sunk, reference=reference)
    assert deep.sink_max == pytest.approx(4.0, abs=1e-3)
    assert 0.4 * 4 < deep.sink_mean < 0.8 * 4
    assert deep.standing == pytest.approx(found.standing)
    lifted = replace(walking, root_positions=walking.root_positions + torch.tensor([0, 0.04, 0]))
    assert score_walk(lifted, reference=reference).sink_max == 0


def test_sliding_is_added_to_a_walk_that_is_pushed(walking: Clip) -> None:
    """30 cm a second to the side; contacts last 0.6 to 0.7 s."""
    time = torch.arange(walking.frames).double()[:, None] / FPS
    pushed = walking.root_positions + time * torch.tensor([0.3, 0.0, 0.0])
    before, after = score_walk(walking), score_walk(replace(walking, root_positions=pushed))
    assert after.standing == pytest.approx(before.standing)
    assert after.slide_fast == 1
    assert after.slide_path - before.slide_path > 10


@pytest.mark.parametrize("pitched", [10.0, -10.0, 25.0])
def test_leaning_is_in_degrees_from_upright(make_statue, make_course, straight, pitched) -> None:
    course = make_course(straight)
    upright = score_walk(make_statue(), course).lean
    assert upright < 5
    way = Walked.of(make_statue())
    assert upright == pytest.approx(way.lean)
    found = [score_walk(make_statue(pitched=angle), course).lean for angle in (pitched, -pitched)]
    assert sum(found) / 2 == pytest.approx(abs(pitched), abs=1e-6)
    assert score_walk(make_statue(pitched=pitched, turned=70.0), course).lean == pytest.approx(
        found[0]
    )


def test_jitter_is_the_third_derivative(make_statue, make_course, straight) -> None:
    """Of c t^3 / 6 in one direction it is c at every joint."""
    clip = make_statue(frames=61)
    time = torch.arange(61).double() / FPS
    clip.root_positions[:, 1] += 2.5 * time**3 / 6
    scores = score_walk(clip, make_course(straight))
    assert scores.jitter == pytest.approx(2.5, rel=1e-6)


def test_bone_drift_is_in_millimetres_of_the_worst_bone(make_statue, make_course, straight) -> None:
    clip = make_statue(frames=61)
    moved = clip.offsets.expand(61, -1, -1).clone()
    moved[30, 4] *= 1 - 0.007 / float(moved[30, 4].norm())
    course = make_course(straight)
    assert score_walk(clip, course).bone_drift < 1e-9
    stretched = score_walk(replace(clip, translations_local=moved), course).bone_drift
    assert stretched == pytest.approx(7.0)


def test_a_walk_is_like_itself_wherever_it_goes(walking: Clip) -> None:
    reference = reference_of([walking])
    for clip in (walking, turn(walking, 2.0)):
        scores = score_walk(clip, reference=reference)
        assert scores.spectrum < 1e-3
        assert scores.power == pytest.approx(1, abs=1e-3)


def test_a_statue_has_no_power(make_statue, walking: Clip, make_course, straight) -> None:
    clip = make_statue()
    scores = score_walk(clip, make_course(straight), reference=reference_of([walking]))
    assert scores.power < 1e-9
    assert scores.spectrum > 5


def test_a_recording_has_no_scores_of_what_nobody_asked(walking: Clip) -> None:
    scores = score_walk(walking)
    assert 0.001 < scores.path_mean < scores.path_max < 0.08
    unasked = ("arrival_mean", "arrival_max", "facing", "speed", "spectrum", "power")
    for name, value in scores._asdict().items():
        assert math.isnan(value) == (name in unasked)


def test_beyond_the_end_of_a_course_only_arrivals_count(make_statue, make_course, straight) -> None:
    """Half a second late; after the end it goes astray and sinks."""
    course = make_course(straight)
    clip = make_statue(frames=391, ahead=-0.5)
    scores = score_walk(clip, course)
    clip.root_positions[320:, 1] -= 0.5
    clip.root_positions[340:, 0] += 3.0
    assert score_walk(clip, course) == pytest.approx(scores, nan_ok=True)
    assert scores.arrival_max == pytest.approx(0.5, abs=1e-6)


def test_a_part_is_scored_where_it_is(make_statue, make_course, straight) -> None:
    part = make_statue(beside=0.2).cut(30, 270)
    scores = score_walk(part, make_course(straight), start=1.0)
    assert scores.path_max == pytest.approx(0.2)
    assert scores.arrival_max == pytest.approx(0, abs=1e-6)
    assert score_walk(part, make_course(straight)).arrival_max == pytest.approx(1, abs=1e-6)


def test_what_cannot_be_scored_is_refused(make_statue, make_course, straight, walking) -> None:
    course = make_course(straight)
    with pytest.raises(ConfigError, match="its course ends after 10 s"):
        score_walk(make_statue(), course, start=11.0)
    with pytest.raises(ConfigError, match="another skeleton or frame rate"):
        score_walk(make_statue(fps=25.0), course, reference=reference_of([walking]))
    with pytest.raises(ConfigError, match="no clip to compare walks with"):
        reference_of([])
    with pytest.raises(ConfigError, match="several skeletons or frame rates"):
        reference_of([walking, make_clip(0, fps=25.0, seconds=4.0)])


@pytest.fixture
def waving(make_statue) -> Clip:
    """Twelve seconds of a statue that waves, once a second."""
    clip = make_statue(frames=360, speed=0.5)
    time = torch.arange(360).double() / FPS
    arm = clip.skeleton.names.index("LeftArm")
    turned = quaternion.about_axis(
        torch.tensor([0.0, 0.0, 1.0]).double(), torch.sin(2 * math.pi * time)
    )
    rotations = clip.rotations_local.clone()
    rotations[:, arm] = turned
    return replace(clip, rotations_local=rotations)


def test_a_long_walk_is_scored_span_by_span(waving: Clip, make_course, straight) -> None:
    waving.root_positions[240:, 0] += 0.4
    found = steadiness(waving, make_course(straight, speed=0.5), span=4.0)
    assert [round(each.path_max, 6) for each in found.minutes] == [0, 0, 0.4]
    assert [round(each.path_mean, 6) for each in found.minutes] == [0, 0, 0.4]
    assert found.frozen == 0


@pytest.mark.parametrize(("seconds", "spans"), [(9.9, 2), (10.1, 3), (4.0, 1)])
def test_a_rest_of_less_than_half_a_span_is_left_out(
    waving: Clip, make_course, straight, seconds: float, spans: int
) -> None:
    clip = waving.cut(0, round(seconds * FPS))
    found = steadiness(clip, make_course(straight, speed=0.5), span=4.0)
    assert len(found.minutes) == spans
    assert isinstance(found.minutes[0], WalkScores)


def test_who_stops_moving_is_frozen_though_it_glides_on(
    waving: Clip, make_course, straight
) -> None:
    """Nine of twelve seconds."""
    waving.rotations_local[90:] = waving.rotations_local[90]
    course = make_course(straight, speed=0.5)
    assert steadiness(waving, course, span=3.0).frozen == pytest.approx(9 / 12, abs=0.09)


def test_who_moves_a_fifth_as_fast_is_not_frozen(waving: Clip, make_course, straight) -> None:
    arm, time = waving.skeleton.names.index("LeftArm"), torch.arange(360).double() / FPS
    for size, frozen in ((0.2, 0.0), (0.05, 8 / 12)):
        angle = torch.where(time < 4, 1.0, size) * torch.sin(2 * math.pi * time)
        rotations = waving.rotations_local.clone()
        rotations[:, arm] = quaternion.about_axis(torch.eye(3).double()[2], angle)
        clip = replace(waving, rotations_local=rotations)
        found = steadiness(clip, make_course(straight, speed=0.5), span=4.0).frozen
        assert found == pytest.approx(frozen, abs=0.09)


def test_a_statue_was_frozen_from_the_start(make_statue, make_course, straight) -> None:
    assert steadiness(make_statue(), make_course(straight), span=4.0).frozen == 1


def test_too_short_a_walk_has_no_spans(make_statue, make_course, straight) -> None:
    with pytest.raises(ConfigError, match="expected half a span at least"):
        steadiness(make_statue(frames=60), make_course(straight), span=60.0)
