"""Every dialect is read as an independent slow reader understands it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from tests.io.bvh_reference import world_positions
from tests.io.bvh_texts import DIALECTS, TURNS, body, channels, motion, numbers

from posecast.errors import ConfigError, DataError
from posecast.io.bvh import BvhLayout, read_bvh, read_bvh_document, write_bvh_document
from posecast.motion import Clip
from posecast.skeleton.kinematics import joint_positions


def world(clip: Clip) -> np.ndarray:
    """World positions of all joints, metres."""
    moving = clip.translations_local
    offsets = clip.offsets.expand(clip.frames, -1, -1) if moving is None else moving
    return joint_positions(
        clip.skeleton, clip.rotations_local, offsets, clip.root_positions
    ).numpy()


def write(folder: Path, content: bytes | str) -> Path:
    """A file with this content."""
    path = folder / "file.bvh"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def layout_of(clip: Clip) -> BvhLayout:
    """The clip's source, which is a BVH file."""
    assert isinstance(clip.source, BvhLayout)
    return clip.source


def test_there_are_as_many_dialects_as_the_table_has() -> None:
    assert len(DIALECTS) == 52


@pytest.mark.parametrize("name", DIALECTS)
def test_positions_are_those_of_the_slow_reader(name: str, tmp_path: Path) -> None:
    dialect = DIALECTS[name]
    clip = read_bvh(write(tmp_path, dialect.content), unit=1.0, up="y")
    expected = world_positions(dialect.text)
    assert clip.rotations_local.dtype == torch.float64
    assert clip.frames == len(expected.positions) == 4
    assert [joint.name for joint in layout_of(clip).joints] == expected.names
    np.testing.assert_allclose(world(clip), expected.positions, rtol=0, atol=1e-11)
    notes = layout_of(clip).notes
    assert len(notes) == len(dialect.notes)
    assert all(note.startswith(start) for note, start in zip(notes, dialect.notes, strict=True))


@pytest.mark.parametrize("name", DIALECTS)
def test_a_document_is_written_back_without_changing_a_number(name: str, tmp_path: Path) -> None:
    first = read_bvh_document(write(tmp_path, DIALECTS[name].content))
    write_bvh_document(first, tmp_path / "again.bvh")
    second = read_bvh_document(tmp_path / "again.bvh")
    assert second.joints == first.joints
    assert (second.encoding, second.newline) == (first.encoding, first.newline)
    assert second.frame_time == first.frame_time
    np.testing.assert_array_equal(second.values, first.values)


def test_windings_stay_in_the_document(tmp_path: Path) -> None:
    rows = numbers(12)
    rows[2][4] = "1101.5"
    document = read_bvh_document(write(tmp_path, body() + motion(rows)))
    assert document.values[2, 4] == 1101.5


def test_names_used_twice_get_numbers_that_are_free(tmp_path: Path) -> None:
    clip = read_bvh(write(tmp_path, DIALECTS["names used twice"].content), unit=1.0, up="y")
    assert clip.skeleton.names == ("Bone", "Bone_3", "Bone_2")


def test_translations_that_stand_still_become_offsets(tmp_path: Path) -> None:
    six = channels(f"Xposition Yposition Zposition {TURNS}")
    rows = numbers(18)
    for row in rows:
        row[6:9], row[12:15] = ["1", "2", "3"], ["4", "5", "6"]
    still = read_bvh(write(tmp_path, body(arm=six, hand=six) + motion(rows)), unit=0.01, up="y")
    assert still.translations_local is None
    torch.testing.assert_close(
        still.offsets, torch.tensor([[0, 0, 0], [0.01, 0.02, 0.03], [0.04, 0.05, 0.06]]).double()
    )
    rows[1][12] = "4.1"
    moving = read_bvh(write(tmp_path, body(arm=six, hand=six) + motion(rows)), unit=0.01, up="y")
    assert moving.translations_local is not None
    assert moving.translations_local[:, 2, 0].tolist() == pytest.approx([0.04, 0.041, 0.04, 0.04])
    assert moving.translations_local[:, 1].tolist() == [pytest.approx([0.01, 0.02, 0.03])] * 4
    assert moving.offsets[2].tolist() == pytest.approx([0.03, 0.005, 0.0])


@pytest.mark.parametrize("unit", [0.0, -1.0, float("nan"), float("inf")])
def test_a_unit_that_is_none_is_refused(unit: float, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="unit is"):
        read_bvh(write(tmp_path, DIALECTS["plain"].content), unit=unit)


def test_a_file_without_motion_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="no MOTION section"):
        read_bvh(write(tmp_path, body()))


def test_a_decimal_comma_is_named(tmp_path: Path) -> None:
    rows = numbers(12)
    rows[1][4] = "12,5"
    with pytest.raises(DataError, match="comma is not a decimal sign") as caught:
        read_bvh(write(tmp_path, body() + motion(rows)))
    assert caught.value.line == len(body().splitlines()) + 3 + 2
