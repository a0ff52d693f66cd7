"""Printed numbers: complete, and found only for what they were printed for."""

from __future__ import annotations

import pytest

from posecast.evaluation import AVERAGE, METRICS, PROTOCOLS, find_published, published_tables
from posecast.evaluation.published import PRINTED_NAMES
from posecast.evaluation.windows import H36M_ACTIONS


def test_all_tables_are_there_and_every_row_fits_its_columns():
    tables = published_tables()
    assert len(tables) == 25
    values = 0
    for table in tables:
        for actions in table.systems.values():
            for row in actions.values():
                assert len(row) == len(table.horizons_ms)
                values += len(row)
    assert values == 1973


def test_tables_of_our_protocols_use_our_metrics_and_actions():
    ours = [table for table in published_tables() if table.protocol in PROTOCOLS]
    assert len(ours) == 25
    for table in ours:
        assert table.metric in METRICS
        for actions in table.systems.values():
            human = table.protocol.startswith("h36m")
            assert set(actions) <= ({*H36M_ACTIONS, AVERAGE} if human else {"all"})


def test_every_printed_name_is_in_some_table():
    printed = {system for table in published_tables() for system in table.systems}
    ours = [name for names in PRINTED_NAMES.values() for name in names]
    assert len(ours) == len(set(ours)) == 51
    assert set(ours) <= printed


@pytest.mark.parametrize(
    ("system", "protocol", "action", "horizon_ms", "value", "source", "digits"),
    [
        ("zero-velocity", "h36m-standard", "walking", 400, 1.15, "ijcv2019, Table 1", 2),
        ("zero-velocity", "h36m-128", AVERAGE, 80, 0.43, "ijcv2019, Table 2", 2),
        ("running-average-4", "h36m-standard", "smoking", 320, 1.03, "ijcv2019, Table 1", 2),
        ("h36m-aged", "h36m-standard", "smoking", 400, 0.84, "ijcv2019, Table 1", 2),
        ("quaternet-vel", "h36m-128", "walking", 80, 0.28, "ijcv2019, Table 2", 2),
        ("quaternet-vel", "h36m-long", AVERAGE, 80, 0.3871, "sca2022, Table 2", 4),
        ("quaternet-vel", "h36m-standard", AVERAGE, 80, 0.3871, "sca2022, Table 2", 4),
        ("zero-velocity", "h36m-long", "walking", 400, 1.15, "ijcv2019, Table 1", 2),
        ("quaternet-dual-quaternion", "h36m-long", AVERAGE, 4000, 4.7124, "sca2022, Table 2", 4),
    ],
)
def test_a_printed_number_is_found(system, protocol, action, horizon_ms, value, source, digits):
    found = find_published(system, protocol, action=action, metric="euler", horizon_ms=horizon_ms)
    assert found == (value, source, digits)


@pytest.mark.parametrize(
    "other",
    [
        {"system": "quaternet-vel-small"},
        {"protocol": "short-term"},
        {"action": "dancing"},
        {"metric": "euler_wrapped"},
        {"metric": "joint_angle"},
        {"horizon_ms": 560},
        {"action": AVERAGE, "complete": False},
    ],
)
def test_nothing_is_found_for_what_was_not_printed(other):
    asked = {
        "system": "quaternet-vel",
        "protocol": "h36m-128",
        "action": "walking",
        "metric": "euler",
        "horizon_ms": 80,
    }
    assert find_published(**asked) is not None
    assert find_published(**{**asked, **other}) is None
