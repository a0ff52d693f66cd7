"""Reports of walks: what tables and JSON say."""

from __future__ import annotations

import csv
import io
import json
import math

import pytest

from posecast.errors import ConfigError
from posecast.evaluation.following import SLACK
from posecast.evaluation.steadiness import Steadiness
from posecast.evaluation.walk_report import SHOWN, WalkReport, WalkRow, score_walker
from posecast.evaluation.walks import WalkScores


def scores(**values: float) -> WalkScores:
    return WalkScores(**{**dict.fromkeys(WalkScores._fields, 1.0), **values})


def test_every_score_has_its_column() -> None:
    assert tuple(SHOWN) == WalkScores._fields


def test_a_number_is_the_mean_over_paths_and_over_runs() -> None:
    one = {"straight": scores(facing=1.0), "zigzag": scores(facing=3.0)}
    other = {"straight": scores(facing=4.0), "zigzag": scores(facing=6.0)}
    assert WalkRow("net", (one,)).mean("facing") == 2
    assert WalkRow("net", (one,)).std("facing") is None
    both = WalkRow("net", (one, other))
    assert both.mean("facing") == 3.5
    assert both.std("facing") == pytest.approx(3 / math.sqrt(2))


def test_what_a_walk_has_not_is_left_out_of_the_mean() -> None:
    run = {"straight": scores(slide_path=2.0), "zigzag": scores(slide_path=math.nan)}
    assert WalkRow("net", (run,)).mean("slide_path") == 2
    assert math.isnan(WalkRow("net", ({"straight": scores(speed=math.nan)},)).mean("speed"))


@pytest.fixture
def report() -> WalkReport:
    """Two runs of a network, and real clips."""
    runs = tuple({"straight": scores(jitter=value, path_mean=0.0123)} for value in (100.0, 104.0))
    long = Steadiness((scores(lean=2.0), scores(lean=30.0)), 0.25)
    real = WalkRow("clips", ({"a": scores(facing=math.nan)},))
    return WalkReport((WalkRow("net", runs, long), real), "toy", "validation", ("A note.",))


def test_the_table_has_a_row_a_system_and_units_in_its_head(report: WalkReport) -> None:
    lines = report.to_markdown().splitlines()
    head, _, net, clips = [line for line in lines if line.startswith("|")][:4]
    columns = [cell.strip() for cell in head.split("|")]
    cells = dict(zip(columns, (cell.strip() for cell in net.split("|")), strict=True))
    assert cells["system"] == "net"
    assert cells["off the path (m)"] == "0.012 ± 0.000"
    assert cells["jitter (m/s^3)"] == "102 ± 3"
    assert clips.split("|")[columns.index("facing error (deg)")].strip() == "-"
    assert "- A note." in lines
    assert "- Mean ± standard deviation over 2 runs." in lines


def test_a_long_walk_has_a_table_of_its_own(report: WalkReport) -> None:
    text = report.to_markdown()
    assert "**net**, minute by minute; frozen 25 % of the seconds" in text
    tail = text[text.index("minute by minute") :].splitlines()
    lean = tail[2].split("|").index(" leaning (deg) ")
    assert [line.split("|")[lean].strip() for line in tail[4:6]] == ["2.0", "30.0"]


def test_json_says_all_of_it_and_null_where_there_is_nothing(report: WalkReport) -> None:
    found = json.loads(report.to_json())
    assert (found["protocol"], found["corpus"], found["split"]) == (
        "locomotion",
        "toy",
        "validation",
    )
    net, clips = found["rows"]
    assert net["scores"]["jitter"] == {"value": 102.0, "std": pytest.approx(math.sqrt(8))}
    assert [run["straight"]["jitter"] for run in net["runs"]] == [100, 104]
    assert [minute["lean"] for minute in net["minutes"]] == [2, 30]
    assert net["frozen"] == 0.25
    assert clips["scores"]["facing"] == {"value": None}
    assert clips["runs"][0]["a"]["facing"] is None
    assert "minutes" not in clips
    assert found["units"]["slide_path"] == "cm a contact"


def test_csv_has_a_line_a_number(report: WalkReport) -> None:
    rows = list(csv.DictReader(io.StringIO(report.to_csv())))
    assert len(rows) == 2 * len(SHOWN)
    by_name = {(row["system"], row["score"]): row for row in rows}
    assert float(by_name["net", "jitter"]["value"]) == 102
    assert by_name["net", "jitter"]["runs"] == "2"
    assert by_name["clips", "facing"]["value"] == by_name["clips", "facing"]["std"] == ""


def test_no_walks_are_no_row() -> None:
    with pytest.raises(ConfigError, match="no walks to report"):
        WalkRow("net", ())
    with pytest.raises(ConfigError, match="no walks to report"):
        WalkRow("net", ({},))


def test_anything_that_makes_a_clip_of_a_course_is_a_walker(
    make_statue, make_course, straight
) -> None:
    """A statue that glides along, asked to go on for a while after the end."""
    course, asked = make_course(straight), []

    def glide(course, seconds: float):
        asked.append(seconds)
        return make_statue(frames=round(30 * seconds), beside=0.1)

    found = score_walker(glide, {"there": course})
    assert asked == [pytest.approx(course.duration + SLACK)]
    assert found["there"].path_mean == pytest.approx(0.1)
    assert found["there"].arrival_max == pytest.approx(0, abs=1e-6)
    with pytest.raises(ConfigError, match="there: walked for 2 s, but the course lasts 10 s"):
        score_walker(lambda course, seconds: make_statue(frames=60), {"there": course})
