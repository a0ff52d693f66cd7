"""Real recordings: every file is read without a false note, and stands where it should."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.io.bvh_reference import world_positions
from tests.io.test_bvh_dialects import layout_of, world
from tests.io.test_bvh_write import SLACK_DEG, SLACK_UNITS, turned_by

from posecast.io.bvh import read_bvh, read_bvh_document, write_bvh

pytestmark = pytest.mark.data


@pytest.fixture(scope="session")
def salsa(data_root: Path) -> list[Path]:
    """All recordings of subjects 60 and 61."""
    files = sorted((data_root / "cmu-salsa").glob("6[01]/*.bvh"))
    assert len(files) == 28
    return files


@pytest.fixture(scope="session")
def bandai(data_root: Path) -> list[Path]:
    """All walks and runs."""
    files = sorted((data_root / "bandai-locomotion").glob("*.bvh"))
    assert len(files) == 716
    return files


def check_positions(path: Path, joints: int, notes: tuple[str, ...]) -> None:
    """Two frames against the slow reader; unit, up and notes as they are known to be."""
    clip = read_bvh(path)
    layout = layout_of(clip)
    assert (layout.unit, layout.up, layout.notes) == (0.01, "y", notes)
    assert len(clip.skeleton) == joints
    frames = [clip.frames // 3, clip.frames - 1]
    expected = world_positions(path.read_text(encoding="ascii"), frames)
    few = replace(
        clip,
        root_positions=clip.root_positions[frames],
        rotations_local=clip.rotations_local[frames],
        translations_local=(
            None if clip.translations_local is None else clip.translations_local[frames]
        ),
    )
    np.testing.assert_allclose(world(few), 0.01 * expected.positions, rtol=0, atol=1e-10)


def test_all_salsa_recordings_are_read_right(salsa: list[Path]) -> None:
    for path in salsa:
        check_positions(path, 43, ("frame time 0.00833333 read as 1/120 s",))


def test_all_bandai_recordings_are_read_right(bandai: list[Path]) -> None:
    for path in bandai:
        check_positions(path, 22, ("frame time 0.0333333 read as 1/30 s",))


def test_only_the_hips_of_bandai_recordings_move(bandai: list[Path]) -> None:
    for path in bandai[::40]:
        clip = read_bvh(path)
        assert clip.translations_local is not None
        still = clip.translations_local.std(dim=0, correction=0).amax(dim=-1) < 1e-12
        assert [clip.skeleton.names[joint] for joint in (~still).nonzero()[:, 0]] == ["Hips"]


def test_real_recordings_are_written_back_in_their_own_conventions(
    salsa: list[Path], bandai: list[Path], tmp_path: Path
) -> None:
    for path in (*salsa[::14], *bandai[::180]):
        source = read_bvh(path)
        assert write_bvh(source, tmp_path / "first.bvh") == ()
        again = read_bvh(tmp_path / "first.bvh")
        assert layout_of(again).joints == layout_of(source).joints
        before, after = read_bvh_document(path).values, read_bvh_document(tmp_path / "first.bvh")
        np.testing.assert_allclose(after.values, before, rtol=0, atol=SLACK_DEG)
        assert turned_by(source, again) < SLACK_DEG
        np.testing.assert_allclose(world(again), world(source), rtol=0, atol=SLACK_UNITS * 0.01)
        write_bvh(again, tmp_path / "second.bvh")
        assert (tmp_path / "first.bvh").read_bytes() == (tmp_path / "second.bvh").read_bytes()
