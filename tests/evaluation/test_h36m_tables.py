"""Baselines on Human3.6M itself: every printed cell of the actions that are there."""

from __future__ import annotations

import pytest

from posecast.corpora import build_corpus
from posecast.evaluation import (
    AVERAGE,
    BASELINES,
    build_protocol,
    make_baseline,
    published_tables,
)
from posecast.evaluation.published import PRINTED_NAMES
from posecast.evaluation.windows import H36M_ACTIONS
from posecast.motion.corpus import Corpus

pytestmark = pytest.mark.data


@pytest.fixture(scope="module")
def h36m(data_root, tmp_path_factory) -> Corpus:
    """The corpus as users build it."""
    root = data_root / "h36m"
    if not (root / "S5").is_dir():
        pytest.skip("no recordings of subject S5 below POSECAST_DATA/h36m")
    return build_corpus("h36m", root=root, cache=tmp_path_factory.mktemp("cache"))


@pytest.mark.parametrize("protocol", ["h36m-standard", "h36m-128"])
@pytest.mark.parametrize("system", BASELINES)
def test_baselines_give_every_printed_cell_to_two_decimals(h36m, system, protocol):
    scores = build_protocol(protocol).score(BASELINES[system], h36m, system=system)
    tables = [
        table
        for table in published_tables()
        if (table.protocol, table.metric) == (protocol, "euler")
        and set(PRINTED_NAMES[system]) & set(table.systems)
    ]
    # BMVC, IJCV and ICCV print the four actions of the standard protocol, the last without
    # running averages; IJCV alone prints all fifteen, with 256 windows.
    assert len(tables) == {"h36m-128": 1}.get(protocol, 3 if system == "zero-velocity" else 2)
    compared = 0
    for table in tables:
        name = next(name for name in PRINTED_NAMES[system] if name in table.systems)
        for action in set(table.systems[name]) & set(scores.actions):
            cells = zip(table.horizons_ms, table.systems[name][action], strict=True)
            for horizon, printed in cells:
                found = scores.value("euler", horizon, action)
                assert abs(found - printed) <= 0.005 + 1e-9, (table.source, action, horizon)
                compared += 1
    classical = {"walking", "eating", "smoking", "discussion"}
    expected = set(scores.actions) if protocol == "h36m-128" else set(scores.actions) & classical
    assert compared == 4 * len(expected) * len(tables) > 0


@pytest.mark.parametrize(("protocol", "windows"), [("h36m-standard", 8), ("h36m-128", 256)])
def test_every_action_has_its_windows_and_missing_files_are_named(h36m, protocol, windows):
    sampling = build_protocol(protocol).windows(h36m)
    assert all(len(group.windows) == windows for group in sampling.groups)
    present = {clip.labels["file"] for clip in h36m.split("test")}
    needed = {action: {f"S5/{action}_{n}.txt" for n in (1, 2)} for action in H36M_ACTIONS}
    assert set(sampling.missing) == set().union(*needed.values()) - present
    complete = [action for action, names in needed.items() if names <= present]
    assert [group.name for group in sampling.groups] == complete


@pytest.mark.parametrize(
    ("action", "starts"),
    [
        ("walking", [1087, 955, 1145, 332, 660, 304, 201, 54]),
        ("phoning", [1426, 374, 1087, 156, 1329, 121, 332, 414]),
        ("walkingtogether", [1087, 1180, 1329, 955, 1145, 332, 660, 304]),
    ],
)
def test_the_recordings_are_as_long_as_the_published_starts_demand(h36m, action, starts):
    sampling = build_protocol("h36m-standard").windows(h36m)
    windows = {group.name: group.windows for group in sampling.groups}
    assert [window.start for window in windows[action]] == starts


def test_four_seconds_of_zero_velocity_are_as_measured_elsewhere(h36m):
    complete = {group.name for group in build_protocol("h36m-long").windows(h36m).groups}
    if set(H36M_ACTIONS) - complete != {"discussion", "waiting", "directions", "sittingdown"}:
        pytest.skip("the numbers are of the other eleven actions")
    scores = build_protocol("h36m-long").score(BASELINES["zero-velocity"], h36m)
    # An independent program on the same eight windows an action.
    measured = (0.417, 0.724, 1.098, 1.227, 1.458, 1.603, 1.802, 2.156, 2.428, 2.475)
    for horizon, expected in zip(scores.horizons_ms, measured, strict=True):
        assert scores.value("euler", horizon) == pytest.approx(expected, abs=0.0006)


def test_both_printed_systems_lose_to_both_baselines_where_the_note_says_so(h36m):
    protocol = build_protocol("h36m-long")
    still, mean = (
        protocol.score(make_baseline(name, h36m), h36m) for name in ("zero-velocity", "mean-pose")
    )
    (table,) = (table for table in published_tables() if table.protocol == "h36m-long")
    for horizon in (800, 1000, 2000, 3000, 4000):
        column = table.horizons_ms.index(horizon)
        printed = [actions[AVERAGE][column] for actions in table.systems.values()]
        assert len(printed) == 2
        assert min(printed) > still.value("euler", horizon)
        assert (min(printed) > mean.value("euler", horizon)) == (horizon >= 2000)
