"""read_clip and write_clip choose by extension, and tell what they know where they cannot."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from posecast.corpora.synthetic import make_clip
from posecast.errors import ConfigError, DataError
from posecast.geometry import quaternion
from posecast.io import READERS, WRITERS, read_clip, write_clip
from posecast.motion import Clip
from posecast.skeleton import Skeleton


@pytest.fixture
def clip() -> Clip:
    rotations = quaternion.exp(torch.linspace(0, 1, 5 * 2 * 3, dtype=torch.float64).view(5, 2, 3))
    return Clip(
        Skeleton(("hips", "head"), (-1, 0)),
        torch.tensor([[0, 0, 0], [0, 1.5, 0]], dtype=torch.float64),
        30.0,
        torch.zeros(5, 3, dtype=torch.float64),
        rotations,
    )


def test_the_formats_are_those_of_the_table_in_the_documents():
    assert sorted(READERS) == [".amc", ".bvh", ".npz", ".pkl", ".txt"]
    assert sorted(WRITERS) == [".bvh", ".glb", ".npz"]


@pytest.mark.parametrize("name", ["a.npz", "a.NPZ", "a.bvh", "a.BVH"])
def test_what_is_written_is_read_back(tmp_path, clip, name):
    assert write_clip(clip, tmp_path / name) == ()
    found = read_clip(tmp_path / name)
    assert found.skeleton == clip.skeleton
    difference = quaternion.angle(found.rotations_local, clip.rotations_local)
    assert difference.max() < np.deg2rad(1e-4)


def test_an_npz_is_told_apart_by_its_arrays(tmp_path, clip):
    write_clip(clip, tmp_path / "ours.npz")
    np.savez(tmp_path / "amass.npz", poses=np.zeros((3, 156)), mocap_framerate=60)
    np.savez(tmp_path / "neither.npz", a=np.zeros(3))
    assert read_clip(tmp_path / "ours.npz").skeleton == clip.skeleton
    assert len(read_clip(str(tmp_path / "amass.npz")).skeleton) == 22
    with pytest.raises(DataError, match=r"no array names, .*found a; docs/archive.md"):
        read_clip(tmp_path / "neither.npz")


def test_human36m_text_and_amc_are_found_by_extension(tmp_path):
    (tmp_path / "walking_1.txt").write_text(",".join(["0.0"] * 99) + "\n")
    assert read_clip(tmp_path / "walking_1.txt").labels["action"] == "walking"
    (tmp_path / "01_01.amc").write_text("1\nroot 0 0 0 0 0 0\n")
    with pytest.raises(DataError, match="no skeleton beside it"):
        read_clip(tmp_path / "01_01.amc")


@pytest.mark.parametrize(
    ("name", "remedy"),
    [
        ("01.asf", "name the .amc file"),
        ("a.fbx", "export it as BVH"),
        ("a.gltf", "GLB is only written"),
        ("a.mat", "convert it first"),
        ("a", "convert it first"),
    ],
)
def test_an_unknown_extension_is_answered_with_the_known_ones_and_a_remedy(
    tmp_path, clip, name, remedy
):
    with pytest.raises(DataError, match=rf"read: \.amc, \.bvh, \.npz, \.pkl, \.txt; .*{remedy}"):
        read_clip(tmp_path / name)
    with pytest.raises(DataError, match=r"write: \.bvh, \.glb, \.npz; "):
        write_clip(clip, tmp_path / name)
    assert list(tmp_path.iterdir()) == []


def test_a_glb_is_written_and_reading_it_is_refused(tmp_path, clip):
    assert write_clip(clip, tmp_path / "a.GLB") == ()
    assert (tmp_path / "a.GLB").read_bytes()[:4] == b"glTF"
    with pytest.raises(DataError, match=r"a\.GLB: extension '\.glb', .*GLB is only written; keep"):
        read_clip(tmp_path / "a.GLB")


@pytest.mark.parametrize("extension", sorted(READERS))
def test_missing_files_and_folders_are_told(tmp_path, extension):
    with pytest.raises(DataError, match="no such file"):
        read_clip(tmp_path / f"a{extension}")
    (tmp_path / f"b{extension}").mkdir()
    with pytest.raises(DataError, match=r"regular file|folder"):
        read_clip(tmp_path / f"b{extension}")


@pytest.mark.parametrize("extension", sorted(WRITERS))
def test_nothing_half_written_stays_when_writing_fails(tmp_path, clip, extension):
    torch.nn.init.constant_(clip.root_positions, float("nan"))
    with pytest.raises(DataError):
        write_clip(clip, tmp_path / f"a{extension}")
    with pytest.raises(DataError):
        write_clip(clip, tmp_path / "no such folder" / f"a{extension}")
    assert list(tmp_path.iterdir()) == []


def test_an_option_is_handed_to_the_reader_of_the_format(tmp_path: Path) -> None:
    clip = make_clip(0, fps=50.0, seconds=1.0)
    write_clip(clip, tmp_path / "walk.bvh")
    tall = read_clip(tmp_path / "walk.bvh", unit=0.02, fps=30)
    assert tall.fps == 30
    torch.testing.assert_close(tall.offsets, 2 * clip.offsets.double(), atol=1e-6, rtol=0)
    with pytest.raises(ConfigError, match=r"'template' is no option of files like this.*unit, up"):
        read_clip(tmp_path / "walk.bvh", template="body.npy")
    with pytest.raises(ConfigError, match="fps is -1: expected a positive number"):
        read_clip(tmp_path / "walk.bvh", fps=-1)


def test_a_rate_that_is_missing_can_be_given(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", poses=np.zeros((4, 72)), trans=np.zeros((4, 3)))
    with pytest.raises(DataError, match="--fps"):
        read_clip(tmp_path / "a.npz")
    assert read_clip(tmp_path / "a.npz", fps=60).fps == 60


def test_the_shape_of_a_body_is_called_that(tmp_path: Path) -> None:
    np.savez(tmp_path / "shape.npz", betas=np.zeros(16), gender="neutral")
    with pytest.raises(DataError, match="it is the shape of a body, leave it out"):
        read_clip(tmp_path / "shape.npz")
