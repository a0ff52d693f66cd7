"""A file is replaced as a whole or not at all."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest

from posecast.errors import DataError
from posecast.io.atomic import atomic_write


def test_a_finished_block_leaves_the_new_file_and_nothing_else(tmp_path: Path) -> None:
    target = tmp_path / "clip.npz"
    target.write_text("old")
    with atomic_write(target) as temporary:
        assert temporary.parent == tmp_path
        assert temporary.suffix == ".npz"
        temporary.write_text("new")
        assert target.read_text() == "old"
    assert target.read_text() == "new"
    assert [path.name for path in tmp_path.iterdir()] == ["clip.npz"]


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt])
def test_a_failed_block_leaves_the_old_file_and_nothing_else(
    tmp_path: Path, error: type[BaseException]
) -> None:
    target = tmp_path / "clip.bvh"
    target.write_text("old")

    def write_half() -> None:
        with atomic_write(target) as temporary:
            temporary.write_text("half")
            raise error

    with pytest.raises(error):
        write_half()
    assert target.read_text() == "old"
    assert [path.name for path in tmp_path.iterdir()] == ["clip.bvh"]


def test_a_link_stays_a_link_and_its_file_is_replaced(tmp_path: Path) -> None:
    target, link = tmp_path / "real.bvh", tmp_path / "link.bvh"
    target.write_text("old")
    link.symlink_to(target)
    with atomic_write(link) as temporary:
        temporary.write_text("new")
    assert link.is_symlink()
    assert target.read_text() == "new"


def test_the_file_is_as_open_to_others_as_the_umask_says(tmp_path: Path) -> None:
    before = os.umask(0o027)
    try:
        with atomic_write(tmp_path / "clip.bvh") as temporary:
            temporary.write_text("new")
    finally:
        os.umask(before)
    assert (tmp_path / "clip.bvh").stat().st_mode & 0o777 == 0o640


def test_a_missing_folder_or_a_folder_as_target_is_a_data_error(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="no folder"), atomic_write(tmp_path / "no" / "clip.bvh"):
        pass
    with pytest.raises(DataError, match="not a regular file"), atomic_write(tmp_path):
        pass
    assert list(tmp_path.iterdir()) == []


def test_a_disk_that_is_full_is_a_data_error_and_leaves_the_old_file(tmp_path: Path) -> None:
    target = tmp_path / "clip.bvh"
    target.write_text("old")

    def write_half() -> None:
        with atomic_write(target) as temporary:
            temporary.write_text("half")
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with pytest.raises(DataError, match="No space left on device"):
        write_half()
    assert target.read_text() == "old"
    assert [path.name for path in tmp_path.iterdir()] == ["clip.bvh"]
