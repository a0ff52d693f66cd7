"""Unit, vertical axis and frame rate are guessed right, and doubts are said."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from posecast.corpora import build_corpus
from posecast.io.bvh import UNITS, BvhLayout, read_bvh, write_bvh
from posecast.io.bvh_layout import frame_rate, guess_unit, unique_names
from posecast.motion import Clip
from posecast.skeleton import Skeleton


@pytest.fixture(scope="module")
def walkers() -> list[Clip]:
    """The smallest, a middling and the tallest of the synthetic people, walking or running."""
    clips = sorted(
        build_corpus("synthetic", cache=False).clips,
        key=lambda clip: float(clip.offsets.norm(dim=-1).sum()),
    )
    assert len(clips) >= 20
    return [clips[place].cut(0, 60) for place in (0, len(clips) // 2, -1)]


def written_as(clip: Clip, path: Path, **conventions: object) -> Clip:
    """The clip with the conventions of a BVH file, changed as told."""
    write_bvh(replace(clip, source=None), path)
    layout = read_bvh(path, unit=0.01, up="y").source
    assert isinstance(layout, BvhLayout)
    return replace(clip, source=replace(layout, rows=None, **conventions))  # type: ignore[arg-type]


@pytest.mark.parametrize("up", ["x", "y", "z"])
@pytest.mark.parametrize("unit", UNITS)
def test_people_are_found_in_every_unit_and_upright(
    unit: str, up: str, walkers: list[Clip], tmp_path: Path
) -> None:
    for clip in walkers:
        path = tmp_path / "walker.bvh"
        assert write_bvh(written_as(clip, path, unit=UNITS[unit], up=up), path) == ()
        found = read_bvh(path)
        assert isinstance(found.source, BvhLayout)
        assert (found.source.up, found.source.unit) == (up, UNITS[unit])
        assert found.source.notes == ()
        torch.testing.assert_close(found.offsets, clip.offsets, rtol=0, atol=1e-6)
        torch.testing.assert_close(found.root_positions, clip.root_positions, rtol=0, atol=1e-6)
        # The axes of all joints turn with the space, so the rotations are the same numbers again.
        alike = (found.rotations_local * clip.rotations_local).sum(-1).abs()
        assert alike.min() > 1 - 1e-12


def test_a_body_of_no_size_or_an_odd_one_gives_a_note() -> None:
    chain = Skeleton(("a", "b"), (-1, 0))
    assert guess_unit(chain, [0.0, 0.0]) == (0.01, guess_unit(chain, [0.0, 0.0]).doubt)
    assert "no bone has a length" in guess_unit(chain, [0.0, 0.0]).doubt
    assert "0.037 m tall" in guess_unit(chain, [0.0, 0.05]).doubt
    assert guess_unit(chain, [0.0, 230.0]) == (0.01, "")


@pytest.mark.parametrize(
    ("text", "fps", "noted"),
    [
        ("0.008333", 120, True),
        ("0.00833333", 120, True),
        ("0.0083333333333333332", 120, False),
        ("0.0333333", 30, True),
        ("0.033333", 30, True),
        ("0.0333", 30, True),
        ("0.033367", 30000 / 1001, True),
        ("0.0167", 60, True),
        ("0.016666", 60, True),
        (".04", 25, False),
        ("4E-2", 25, False),
        ("0.04", 25, False),
        ("0.011111", 90, True),
        ("0.0153846", 65, True),
        ("0.03", 1 / 0.03, False),
        ("1", 1, False),
        ("33.333", 1 / 33.333, True),
        ("1.25", 0.8, False),
        ("0.0123456789", 1 / 0.0123456789, False),
    ],
)
def test_a_frame_time_is_a_usual_rate_rounded_or_itself(text: str, fps: float, noted: bool) -> None:
    rate, note = frame_rate(text)
    assert rate == pytest.approx(fps, rel=1e-15)
    assert bool(note) == noted


def test_names_become_unique_and_stay_as_they_are_where_they_can() -> None:
    assert unique_names(["a", "b"]) == ("a", "b")
    assert unique_names(["a", "a", "a_2", "a"]) == ("a", "a_3", "a_2", "a_4")
    assert unique_names(["", "joint_0", ""]) == ("joint_1", "joint_0", "joint_2")
    many = unique_names(["bone"] * 5000)
    assert len(set(many)) == 5000
