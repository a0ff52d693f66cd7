"""Reports: baselines in every table, JSON of the agreed form, spread over runs, intervals."""

from __future__ import annotations

import csv
import json
import statistics

import pytest
import torch

from posecast.errors import ConfigError
from posecast.evaluation import Report, bootstrap, build_protocol, evaluate, make_baseline
from posecast.evaluation.windows import H36M_ACTIONS
from posecast.model import RunningAverage, ZeroVelocity
from posecast.motion.corpus import Corpus

BASELINES = ["zero-velocity", "running-average-2", "running-average-4"]


@pytest.fixture
def corpus(make_h36m):
    return make_h36m(("walking", "eating"))


def test_the_json_of_a_baseline_has_exactly_the_agreed_keys(corpus):
    report = evaluate(ZeroVelocity(), build_protocol("h36m-standard"), corpus, system=BASELINES[0])
    content = json.loads(report.to_json())
    assert list(content) == ["system", "corpus", "protocol", "rows", "missing"]
    assert content["system"] == "zero-velocity"
    assert (content["corpus"], content["protocol"]) == ("toy", "h36m-standard")
    assert len(content["missing"]) == 26
    assert len(content["rows"]) == 3 * 3 * 4
    keys = ["action", "metric", "horizon_ms", "value", "windows"]
    for row in content["rows"]:
        assert [key for key in row if key != "published"] == keys
        printed = row["action"] != "average" and row["metric"] in ("euler", "euler_all")
        assert ("published" in row) == printed
    assert content["rows"][0]["published"] == 0.39


def test_the_json_of_a_model_lists_the_baselines_apart(corpus):
    report = evaluate(RunningAverage(3), build_protocol("h36m-standard"), corpus, system="mine")
    content = json.loads(report.to_json())
    assert list(content) == ["system", "corpus", "protocol", "rows", "missing", "baselines"]
    assert [baseline["system"] for baseline in content["baselines"]] == BASELINES
    assert all(len(baseline["rows"]) == 36 for baseline in content["baselines"])
    assert not any("published" in row for row in content["rows"])


@pytest.mark.parametrize("system", ["mine", *BASELINES])
def test_every_table_has_the_baselines_as_rows(corpus, system):
    report = evaluate(ZeroVelocity(), build_protocol("h36m-standard"), corpus, system=system)
    text = report.to_markdown()
    assert text.count("**") == 6  # three metrics
    for name in {system, *BASELINES}:
        assert text.count(f"| walking | {name} |") == 3
        assert text.count(f"| average of 2 (of 15) | {name} |") == 3
    lines = list(csv.DictReader(report.to_csv().splitlines()))
    assert {line["system"] for line in lines} == {system, *BASELINES}
    # Every row of the table has the numbers of its own action and system.
    labels = {"average": "average of 2 (of 15)"}
    for line in (*report.lines, *report.baseline_lines):
        if line.metric == "euler" and line.horizon_ms == 400:
            row = f"| {labels.get(line.action, line.action)} | {line.system} | "
            cells = next(each for each in text.splitlines() if each.startswith(row)).split(" | ")
            assert cells[5].split()[0] == f"{line.value:.3f}"
    assert len(lines) == 36 * len({system, *BASELINES})


def test_a_table_has_the_baselines_of_its_protocol(make_h36m):
    whole = make_h36m(("walking", "eating"))
    corpus = Corpus("toy", whole.clips, {"train": (0, 1), "test": (0, 1, 2, 3)})
    protocol = build_protocol("h36m-long", horizons_ms=[80, 1000])
    report = evaluate(RunningAverage(3), protocol, corpus, system="mine")
    names = ["zero-velocity", "running-average-2", "running-average-4", "mean-pose"]
    assert [scores.system for scores in report.baselines] == names
    text = report.to_markdown()
    assert all(text.count(f"| walking | {name} |") == 3 for name in ["mine", *names])
    assert "lose to zero velocity from 0.8 s on" in text
    lines = list(csv.DictReader(report.to_csv().splitlines()))
    assert {line["system"] for line in lines} == {"mine", *names}
    content = json.loads(report.to_json())
    assert [baseline["system"] for baseline in content["baselines"]] == names
    own = evaluate(make_baseline("mean-pose", corpus), protocol, corpus, system="mean-pose")
    assert [scores.system for scores in own.baselines] == names[:3]
    assert "baselines" not in json.loads(own.to_json())


def test_markdown_says_units_joints_left_out_windows_and_where_numbers_are_from(corpus):
    report = evaluate(ZeroVelocity(), build_protocol("h36m-standard"), corpus, system=BASELINES[0])
    text = report.to_markdown(["euler"])
    assert text.count("**") == 2
    for said in (
        "(rad)",
        "joints left out: Hips",
        "| action | system | 80 ms | 160 ms | 320 ms | 400 ms | windows |",
        "8 windows an action",
        "S5/smoking_1.txt",
        "In brackets, as printed: ijcv2019, Table 1",
    ):
        assert said in text, said
    widths = {line.count("|") for line in text.splitlines() if line.startswith("|")}
    assert widths == {8}


def test_a_table_of_one_action_does_not_repeat_it_as_an_average(make_h36m):
    protocol, corpus = build_protocol("short-term", metrics=["position"]), make_h36m(["eating"])
    report = evaluate(ZeroVelocity(), protocol, corpus, system="mine")
    text = report.to_markdown()
    assert text.count("| eating |") == 4
    assert "average" not in text.replace("running-average", "")
    assert [line.action for line in report.lines] == ["eating"] * 4 + ["average"] * 4


def test_the_average_over_all_actions_stands_beside_the_printed_one(make_h36m):
    report = evaluate(
        ZeroVelocity(), build_protocol("h36m-128"), make_h36m(H36M_ACTIONS), system=BASELINES[0]
    )
    assert report.runs[0].missing == ()
    average = [line for line in report.lines if (line.action, line.metric) == ("average", "euler")]
    printed = [line.published.value for line in average if line.published]
    assert printed == [0.43, 0.72, 1.13, 1.28]
    assert "| average of 15 | zero-velocity |" in report.to_markdown(["euler"])


def test_printed_numbers_keep_the_zeros_they_end_in(make_h36m):
    corpus = make_h36m(["eating", "walking"])
    text = evaluate(
        RunningAverage(3), build_protocol("h36m-standard"), corpus, system="h36m-rnn-pjl"
    ).to_markdown(["euler"])
    rows = [line for line in text.splitlines() if "| h36m-rnn-pjl |" in line]
    values = ("0.324", "0.534", "0.816", "0.950")
    assert all(f"({value})" in rows[0] for value in values)
    baseline = next(line for line in text.splitlines() if "| walking | running-average-2 |" in line)
    assert "(0.48)" in baseline


def test_several_runs_are_their_mean_with_the_deviation_beside(corpus):
    protocol = build_protocol("h36m-standard")
    runs = [RunningAverage(frames) for frames in (2, 3, 4)]
    report = evaluate(runs, protocol, corpus, system="mine")
    single = [protocol.score(run, corpus).value("euler", 80) for run in runs]
    line = next(
        line
        for line in report.lines
        if (line.action, line.metric, line.horizon_ms) == ("average", "euler", 80)
    )
    assert line.value == pytest.approx(sum(single) / 3, rel=1e-12)
    assert line.std == pytest.approx(statistics.stdev(single), rel=1e-9)
    assert "±" in report.to_markdown()
    assert "over 3 runs" in report.to_markdown()
    assert all("std" in row for row in json.loads(report.to_json())["rows"])


def test_a_bootstrap_interval_holds_the_average_and_shrinks_with_more_windows(generator):
    few, many = (
        [torch.randn(windows, 2, dtype=torch.float64, generator=generator) + 5 for _ in range(3)]
        for windows in (8, 800)
    )
    widths = []
    for groups in (few, many):
        low, high = (torch.tensor(ends) for ends in bootstrap(groups, generator=generator))
        average = torch.stack([values.mean(0) for values in groups]).mean(0)
        assert bool(((low < average) & (average < high)).all())
        widths.append(high - low)
    # Mean of three groups of 800 standard normal values: 3.92 / sqrt(2400) = 0.080 wide.
    torch.testing.assert_close(widths[1], torch.full((2,), 0.08), rtol=0.15, atol=0)
    assert bool((widths[0] > 5 * widths[1]).all())


def test_intervals_are_in_the_notes_when_asked_for_and_reproducible(corpus):
    report = evaluate(ZeroVelocity(), build_protocol("h36m-standard"), corpus, system=BASELINES[0])
    texts = [
        report.to_markdown(["euler"], generator=torch.Generator().manual_seed(0)) for _ in range(2)
    ]
    assert texts[0] == texts[1]
    assert "95 % of bootstrap averages of zero-velocity, `euler`" in texts[0]


def test_scores_that_do_not_belong_together_make_no_report(corpus):
    one = build_protocol("h36m-standard").score(ZeroVelocity(), corpus, system="mine")
    other = build_protocol("h36m-128").score(ZeroVelocity(), corpus, system="mine")
    with pytest.raises(ConfigError, match="score all on the same windows"):
        Report((one, other))
    with pytest.raises(ConfigError, match="of one system"):
        Report((one, build_protocol("h36m-standard").score(ZeroVelocity(), corpus)))
    with pytest.raises(ConfigError, match="at least one run"):
        Report(())
