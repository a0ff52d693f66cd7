"""The first release of AMASS: pickles that are read without being executed."""

from __future__ import annotations

import os
import pickle
from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from posecast.errors import DataError
from posecast.geometry import quaternion
from posecast.io.amass_first import read_amass_first
from posecast.io.array_pickle import read_array_pickle
from posecast.skeleton import named_skeleton


def poses(frames=5, seed=0):
    turns = np.random.default_rng(seed).normal(size=(frames * 15, 3))
    return Rotation.from_rotvec(turns).as_matrix().reshape(frames, 135)


def write(path: Path, content: object, protocol: int = 2) -> Path:
    path.write_bytes(pickle.dumps(content, protocol=protocol))
    return path


@pytest.mark.parametrize("protocol", [0, 1, 2, 3, 4, 5])
@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_arrays_come_back_as_they_were_written(tmp_path, protocol, dtype):
    content = {
        "poses": poses().astype(dtype),
        "gender": "female",
        "betas": np.zeros(10),
        "rate": np.float64(60),
        "names": ["a", "b"],
    }
    found = read_array_pickle(write(tmp_path / "a.pkl", content, protocol))
    assert found.keys() == content.keys()
    assert found["poses"].dtype == dtype
    assert np.array_equal(found["poses"], content["poses"])
    assert (found["gender"], found["rate"], found["names"]) == ("female", 60, ["a", "b"])


def test_a_pickle_of_python_2_is_read(tmp_path):
    # What cPickle wrote there: text as bytes, arrays by numpy.core.multiarray.
    numbers = np.arange(6, dtype="<f8").reshape(2, 3)
    raw = numbers.tobytes()
    content = (
        b"\x80\x02}q\x01U\x05posesq\x02cnumpy.core.multiarray\n_reconstruct\nq\x03cnumpy\nndarray\n"
        b"q\x04K\x00\x85q\x05U\x01bq\x06\x87q\x07Rq\x08(K\x01K\x02K\x03\x86q\tcnumpy\ndtype\nq\nU"
        b"\x02f8q\x0bK\x00K\x01\x87q\x0cRq\r(K\x03U\x01<q\x0eNNNJ\xff\xff\xff\xffJ\xff\xff\xff\xff"
        b"K\x00tq\x0fb\x89U0" + raw + b"q\x10tq\x11bs."
    )
    (tmp_path / "old.pkl").write_bytes(content)
    assert np.array_equal(read_array_pickle(tmp_path / "old.pkl")["poses"], numbers)


def opcodes(*parts: bytes) -> bytes:
    """A pickled dictionary whose entry ``poses`` is what the parts make."""
    return b"\x80\x03}X\x05\x00\x00\x00poses" + b"".join(parts) + b"s."


ADDRESS = b"B\x08\x00\x00\x00AAAAAAAA"
OBJECTS = b"cnumpy\ndtype\n(X\x01\x00\x00\x00O\x89\x88tR"
NUMBERS = b"cnumpy\ndtype\n(X\x02\x00\x00\x00f8\x89\x88tR"
PLAIN = b"(K\x03X\x01\x00\x00\x00|NNNJ\xff\xff\xff\xffJ\xff\xff\xff\xffK\x00tb"
BUFFER = b"cnumpy.core.numeric\n_frombuffer\n("
EMPTY = b"cnumpy.core.multiarray\n_reconstruct\n(cnumpy\nndarray\nK\x00\x85X\x01\x00\x00\x00btR"


@pytest.mark.parametrize(
    "parts",
    [
        # Bytes of the file as pointers to objects: the first use would follow them.
        (b"cnumpy\nndarray\n(K\x01\x85", OBJECTS, ADDRESS, b"tR"),
        (BUFFER, ADDRESS, OBJECTS, PLAIN, b"K\x01\x85X\x01\x00\x00\x00CtR"),
        (b"cnumpy.core.multiarray\nscalar\n(", OBJECTS, PLAIN, ADDRESS, b"tR"),
        # A small file that asks for much, an array without content, one of other types.
        (b"cnumpy\nndarray\n(J\xff\xff\xff\x7f\x85X\x02\x00\x00\x00f8tR",),
        (BUFFER, ADDRESS, NUMBERS, b"J\xff\xff\xff\x7f\x85X\x01\x00\x00\x00CtR"),
        (BUFFER, ADDRESS, NUMBERS, b"J\xff\xff\xff\xff\x85X\x01\x00\x00\x00CtR"),
        (EMPTY,),
        (NUMBERS,),
        (b"cnumpy\nndarray\n",),
        (NUMBERS, b"(K\x03X\x01\x00\x00\x00|N(X\x01\x00\x00\x00atNK\x08K\x01K\x00tb"),
        # A state for what every later file is read with.
        (b"c_codecs\nencode\n(N}X\x0c\x00\x00\x00__defaults__Nstb",),
        (b"cnumpy\ndtype\n(N}X\x08\x00\x00\x00__init__Nstb",),
    ],
)
def test_what_only_looks_like_an_array_is_refused(tmp_path, parts):
    (tmp_path / "bad.pkl").write_bytes(opcodes(*parts))
    with pytest.raises(DataError, match="is no pickle of arrays") as caught:
        read_array_pickle(tmp_path / "bad.pkl")
    assert "\n" not in str(caught.value)
    good = {"poses": poses()}
    assert np.array_equal(read_array_pickle(write(tmp_path / "a.pkl", good))["poses"], poses())


def test_the_pieces_of_these_pickles_make_arrays_when_put_together_rightly(tmp_path):
    whole = opcodes(BUFFER, ADDRESS, NUMBERS, PLAIN, b"K\x01\x85X\x01\x00\x00\x00CtR")
    (tmp_path / "good.pkl").write_bytes(whole)
    found = read_array_pickle(tmp_path / "good.pkl")["poses"]
    assert np.array_equal(found, np.frombuffer(b"AAAAAAAA", "f8"))


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize("code", ["b1", "i1", "u2", "i8", "f4", "S3", "U2"])
@pytest.mark.parametrize("layout", ["C", "F"])
def test_numbers_and_text_of_every_kind_and_layout_are_read(tmp_path, order, code, layout):
    values = np.asarray(np.arange(6).reshape(2, 3).astype(order + code), order=layout)
    found = read_array_pickle(write(tmp_path / "a.pkl", {"poses": values}))["poses"]
    assert found.dtype == values.dtype
    assert np.array_equal(found, values)


class Harmful:
    """Unpickling it writes a file."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self):
        return os.system, (f"touch {self.path}",)


@pytest.mark.parametrize(
    "bad",
    [
        lambda mark: pickle.dumps({"poses": Harmful(mark)}),
        lambda mark: pickle.dumps({"poses": np.array([Harmful(mark)], dtype=object)}),
        lambda mark: b"cbuiltins\neval\n(V__import__('os').mkdir('" + bytes(mark) + b"')\ntR.",
        lambda mark: b"cnumpy\nload\n(V" + bytes(mark) + b"\ntR.",
        lambda mark: b"c_codecs\nencode\n(Vx\nVidna\ntR.",
        lambda mark: pickle.dumps({"poses": poses()})[:-100],
        lambda mark: b"",
        lambda mark: b"x" * 1000,
        lambda mark: pickle.dumps([1, 2]),
        lambda mark: pickle.dumps({1: 2}),
    ],
)
def test_anything_but_arrays_is_refused_in_one_line_and_not_executed(tmp_path, bad):
    mark = tmp_path / "executed"
    (tmp_path / "bad.pkl").write_bytes(bad(mark))
    with pytest.raises(DataError) as caught:
        read_array_pickle(tmp_path / "bad.pkl")
    assert "\n" not in str(caught.value)
    assert not mark.exists()


def test_a_recording_is_on_the_whole_body_with_the_rest_unturned(tmp_path):
    numbers = poses(7)
    clip = read_amass_first(write(tmp_path / "A1 - Stand_poses.pkl", {"poses": numbers}))
    skeleton = named_skeleton("smpl-22").skeleton
    assert (clip.skeleton, clip.fps, clip.frames) == (skeleton, 60, 7)
    assert clip.labels == {"translation": "unknown", "offsets": "unknown"}
    turned = [skeleton.index(name) for name in named_skeleton("smpl-15").skeleton.names]
    wanted = Rotation.from_matrix(numbers.reshape(-1, 3, 3)).as_quat()[:, [3, 0, 1, 2]]
    found = clip.rotations_local[:, turned].reshape(-1, 4)
    assert quaternion.angle(found, torch.from_numpy(wanted)).max() < 1e-7
    rest = [joint for joint in range(22) if joint not in turned]
    still = clip.rotations_local[:, rest]
    assert torch.equal(still, quaternion.identity(7, 7, like=still))


def test_a_template_gives_the_body(tmp_path):
    rest = torch.randn(24, 3, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    clip = read_amass_first(write(tmp_path / "a.pkl", {"poses": poses()}), template=rest)
    knee, hip = (clip.skeleton.index(name) for name in ("l_knee", "l_hip"))
    torch.testing.assert_close(clip.offsets[knee], rest[4] - rest[1])
    assert clip.skeleton.parents[knee] == hip
    assert "offsets" not in clip.labels


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({"trans": np.zeros((3, 3))}, "no motion: found trans, expected poses"),
        ({"poses": np.zeros((3, 72))}, r"poses has shape \(3, 72\), expected \(frames, 135\)"),
        ({"poses": np.zeros((0, 135))}, r"poses has shape \(0, 135\)"),
        ({"poses": np.zeros((3, 135))}, "a matrix in row 0 that is no rotation"),
        ({"poses": -poses()}, "that is no rotation"),
        ({"poses": np.where(np.arange(135) == 7, np.nan, poses())}, "not finite in row 0"),
        ({"poses": "none"}, "not made of numbers"),
    ],
)
def test_what_is_no_motion_is_named(tmp_path, content, message):
    with pytest.raises(DataError, match=message):
        read_amass_first(write(tmp_path / "a.pkl", content))
