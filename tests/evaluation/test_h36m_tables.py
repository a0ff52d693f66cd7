"""Baselines on Human3.6M itself: every printed cell of the actions that are there."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest

from posecast.evaluation import BASELINES, build_protocol, published_tables
from posecast.evaluation.published import PRINTED_NAMES
from posecast.evaluation.windows import H36M_ACTIONS
from posecast.io.h36m import read_h36m
from posecast.motion import Clip
from posecast.motion.corpus import Corpus

pytestmark = pytest.mark.data


@pytest.fixture(scope="module")
def test_subject(data_root) -> Corpus:
    """The recordings of subject S5 that are there, even frames."""
    files = sorted(Path(data_root, "h36m", "S5").glob("*.txt"))
    if not files:
        pytest.skip("no recordings of subject S5 below POSECAST_DATA/h36m")
    clips = [_even_frames(read_h36m(file, root="increments")) for file in files]
    return Corpus("h36m", clips, {"test": tuple(range(len(clips)))})


def _even_frames(clip: Clip) -> Clip:
    return dataclasses.replace(
        clip,
        fps=clip.fps / 2,
        root_positions=clip.root_positions[::2],
        rotations_local=clip.rotations_local[::2],
        tracks={},
        name="{subject}/{action}_{recording}".format(**clip.labels),
    )


@pytest.mark.parametrize("protocol", ["h36m-standard", "h36m-128"])
@pytest.mark.parametrize("system", BASELINES)
def test_baselines_give_every_printed_cell_to_two_decimals(test_subject, system, protocol):
    scores = build_protocol(protocol).score(BASELINES[system], test_subject, system=system)
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
def test_every_action_has_its_windows_and_missing_files_are_named(test_subject, protocol, windows):
    sampling = build_protocol(protocol).windows(test_subject)
    assert all(len(group.windows) == windows for group in sampling.groups)
    present = {f"{clip.name}.txt" for clip in test_subject.clips}
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
def test_the_recordings_are_as_long_as_the_published_starts_demand(test_subject, action, starts):
    sampling = build_protocol("h36m-standard").windows(test_subject)
    windows = {group.name: group.windows for group in sampling.groups}
    assert [window.start for window in windows[action]] == starts
