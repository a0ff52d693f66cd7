"""Our archive gives a clip back bit by bit, and refuses what is not one."""

from __future__ import annotations

import re
import struct
import zipfile
from pathlib import Path

import numpy as np
import pytest
import torch
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from posecast.errors import DataError
from posecast.geometry import quaternion
from posecast.io.archive import REQUIRED, read_archive, write_archive
from posecast.io.arrays import read_arrays
from posecast.motion import Clip
from posecast.skeleton import Skeleton

SKELETON = Skeleton(("hips", "knie.l", "Füße", "left hand"), (-1, 0, 1, -1))


def make_clip(dtype: torch.dtype = torch.float64, frames: int = 7) -> Clip:
    generator = torch.Generator().manual_seed(3)

    def random(*shape: int) -> torch.Tensor:
        return torch.randn(*shape, dtype=torch.float64, generator=generator)

    return Clip(
        skeleton=SKELETON,
        offsets=random(4, 3).to(dtype),
        fps=119.88,
        root_positions=random(frames, 3).to(dtype),
        rotations_local=quaternion.normalize(random(frames, 4, 4)).to(dtype),
        translations_local=random(frames, 4, 3).to(dtype),
        name="S5 walking/1 — “take”",
        labels={"subject": "S5", "größe": "1,80 m", "": '\0 quote " \\ '},
        tracks={
            "phase": random(frames),
            "contacts": random(frames, 2) > 0,
            "count": torch.arange(frames, dtype=torch.int16),
            "file": random(frames, 2, 3).float(),
        },
    )


def assert_same(found: Clip, expected: Clip) -> None:
    def same(a: torch.Tensor, b: torch.Tensor) -> bool:
        return (
            a.dtype == b.dtype and a.shape == b.shape and a.numpy().tobytes() == b.numpy().tobytes()
        )

    assert found.skeleton == expected.skeleton
    assert found.fps == expected.fps
    assert found.name == expected.name
    assert dict(found.labels) == dict(expected.labels)
    assert same(found.offsets, expected.offsets)
    assert same(found.root_positions, expected.root_positions)
    assert same(found.rotations_local, expected.rotations_local)
    assert (found.translations_local is None) == (expected.translations_local is None)
    if found.translations_local is not None and expected.translations_local is not None:
        assert same(found.translations_local, expected.translations_local)
    assert list(found.tracks) == list(expected.tracks)
    assert all(same(found.tracks[name], values) for name, values in expected.tracks.items())


@pytest.mark.parametrize("dtype", [torch.float64, torch.float32, torch.float16])
def test_a_clip_comes_back_bit_by_bit_in_its_own_precision(tmp_path, dtype):
    clip = make_clip(dtype)
    write_archive(clip, tmp_path / "a.npz")
    assert_same(read_archive(tmp_path / "a.npz"), clip)


def test_a_clip_without_optional_parts_comes_back_without_them(tmp_path):
    full = make_clip()
    clip = Clip(full.skeleton, full.offsets, 30, full.root_positions, full.rotations_local)
    write_archive(clip, tmp_path / "a.npz")
    assert_same(read_archive(tmp_path / "a.npz"), clip)


def test_equal_clips_give_equal_bytes_under_any_name(tmp_path):
    write_archive(make_clip(), tmp_path / "a.npz")
    write_archive(make_clip(), tmp_path / "b.bin")
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.bin").read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.npz", "b.bin"]


def test_views_and_tensors_with_gradients_are_written_like_any_other(tmp_path):
    clip = make_clip(frames=12)
    view = Clip(
        clip.skeleton,
        clip.offsets.clone().requires_grad_(),
        clip.fps,
        clip.root_positions[::3],
        clip.rotations_local[::3],
    )
    write_archive(view, tmp_path / "a.npz")
    found = read_archive(tmp_path / "a.npz")
    assert torch.equal(found.rotations_local, clip.rotations_local[::3])
    found.root_positions.add_(1)  # owned and writable


def test_the_six_required_arrays_are_enough(tmp_path):
    clip = make_clip(torch.float32)
    np.savez_compressed(
        tmp_path / "other.npz",
        names=np.array(clip.skeleton.names),
        parents=np.array(clip.skeleton.parents, dtype=np.int32),
        offsets=clip.offsets.numpy(),
        fps=30,
        root_positions=np.asfortranarray(clip.root_positions.numpy()),
        rotations_local=clip.rotations_local.numpy().astype(">f4"),
        something_else=np.zeros(3),
    )
    found = read_archive(tmp_path / "other.npz")
    assert found.skeleton == clip.skeleton
    assert (found.fps, found.name, dict(found.labels)) == (30.0, "other", {})
    assert torch.equal(found.root_positions, clip.root_positions)
    assert torch.equal(found.rotations_local, clip.rotations_local)


def test_the_example_of_the_documents_writes_an_archive(tmp_path, monkeypatch):
    page = Path(__file__).parents[2] / "docs" / "archive.md"
    (example,) = re.findall(r"```python\n(.*?)```", page.read_text(encoding="utf-8"), re.DOTALL)
    monkeypatch.chdir(tmp_path)
    exec(example, {})
    found = read_archive(tmp_path / "nod.npz")
    assert (found.frames, found.skeleton.names) == (2, ("hips", "head"))


def rewritten(tmp_path: Path, **changes: object) -> Path:
    """An archive with some arrays replaced, or left out where the change is ``None``."""
    write_archive(make_clip(), tmp_path / "good.npz")
    arrays: dict = {**read_arrays(tmp_path / "good.npz"), **changes}
    path = tmp_path / "bad.npz"
    np.savez(path, **{name: value for name, value in arrays.items() if value is not None})
    return path


@pytest.mark.parametrize("key", REQUIRED)
def test_a_missing_array_is_named(tmp_path, key):
    with pytest.raises(DataError, match=f"no array {key}; found .*docs/archive.md"):
        read_archive(rewritten(tmp_path, **{key: None}))


UNIT = np.tile([1.0, 0, 0, 0], (7, 4, 1))
HOLED = UNIT.copy()
HOLED[3, 2, 1] = np.nan
LONG = UNIT.copy()
LONG[3, 2, 0] = 1.2

FAULTS = {
    "offsets of another shape": ({"offsets": np.zeros((5, 3))}, r"offsets is float64 \(5, 3\)"),
    "whole numbers": ({"offsets": np.zeros((4, 3), int)}, "expected 16, 32 or 64 bit floats"),
    "parents of another length": ({"parents": np.zeros(3, int)}, r"shape \(4\)"),
    "parents are numbers with a point": ({"parents": np.zeros(4)}, "expected integers"),
    "a child before its parent": ({"parents": np.array([-1, 2, 0, 0])}, "must come before"),
    "a name twice": ({"names": np.array(["a", "b", "a", "c"])}, "must be unique"),
    "names are numbers": ({"names": np.zeros(4)}, "expected text"),
    "no joints": ({"names": np.array([], dtype="U3")}, "names is"),
    "rotations of other frames": ({"rotations_local": UNIT[:6]}, r"shape \(6, 4, 3\)"),
    "no frames": ({"rotations_local": UNIT[:0]}, r"shape \(frames, 4, 4\)"),
    "NaN": ({"rotations_local": HOLED}, "rotations_local has a value that is not finite in row 3"),
    "infinite": ({"root_positions": np.full((7, 3), np.inf)}, "root_positions has a value"),
    "not of unit length": ({"rotations_local": LONG}, "length 1.2 in frame 3, joint 'Füße'"),
    "rate zero": ({"fps": 0}, "fps is 0, expected one number > 0"),
    "rate NaN": ({"fps": np.nan}, "fps is nan"),
    "two rates": ({"fps": np.array([30.0, 60.0])}, "fps is"),
    "a short track": ({"track_phase": np.zeros(6)}, r"track 'phase' has shape \(6,\), expected 7"),
    "a track of texts": ({"track_phase": np.array(["a"] * 7)}, "expected numbers"),
    "a later version": ({"version": 2}, "needs a later posecast"),
    "labels that are a list": ({"labels": np.array("[1]")}, "expected a JSON object of texts"),
    "labels that are no JSON": ({"labels": np.array("{")}, "expected a JSON object of texts"),
    "labels nested deep": ({"labels": np.array("[" * 100000)}, "expected a JSON object"),
    "a name that is a number": ({"name": 3}, "expected a text"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_an_archive_with_a_wrong_array_is_refused(tmp_path, fault):
    changes, message = FAULTS[fault]
    with pytest.raises(DataError, match=message):
        read_archive(rewritten(tmp_path, **changes))


def test_an_array_of_python_objects_is_never_unpickled(tmp_path):
    class Trap:
        def __reduce__(self):
            return (Path.touch, (tmp_path / "sprung",))

    path = rewritten(tmp_path)
    arrays = read_arrays(path)
    np.savez(path, **{**arrays, "names": np.array([Trap()] * 4, dtype=object)}, allow_pickle=True)
    with pytest.raises(DataError, match="'names' holds Python objects"):
        read_archive(path)
    assert not (tmp_path / "sprung").exists()


def member(header: str, data: bytes) -> bytes:
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header.encode() + data


HEADER = "{'descr': '%s', 'fortran_order': False, 'shape': %s, }\n"


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (member(HEADER % ("<f8", "(4, 3)"), bytes(95)), "95 bytes, expected"),
        (member(HEADER % ("<f8", "(4, 3)"), bytes(97)), "97 bytes, expected"),
        (member(HEADER % ("<f8", f"({10**15}, {10**15})"), bytes(8)), "8 bytes, expected"),
        (member(HEADER % ("<f8", f"(0, {10**17}, {10**17})"), b""), "offsets|damaged"),
        (member(HEADER % ("<f8", "(" + "1, " * 99 + ")"), bytes(8)), "damaged"),
        (member(HEADER % ("<U0", f"({10**17},)"), b""), "0 bytes, expected"),
        (member(HEADER % ("<U1", "(1,)"), b"\xff\xff\xff\x7f"), "no characters"),
        (member(HEADER % ("|V8", "(1,)"), bytes(8)), "values of type"),
        (member(HEADER % ("<M8", "(1,)"), bytes(8)), "values of type"),
        (member("{'descr': [('a', '<f8')]}", bytes(8)), "unknown header"),
        (member("(" * 5000, bytes(8)), "unknown header"),
        (b"\x93NUMPY\x01\x00\xff\xff{}", "cut off in its header"),
        (b"\x93NUMPY\x02\x00\xff\xff\xff\xff{}", "cut off in its header"),
        (b"\x93NUM", "no NumPy array"),
        (b"", "no NumPy array"),
    ],
)
def test_an_array_with_a_false_header_is_refused_without_taking_memory(tmp_path, content, message):
    path = rewritten(tmp_path, offsets=None)
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("offsets.npy", content)
    with pytest.raises(DataError, match=message):
        read_archive(path)


def test_a_zip_bomb_is_refused_before_it_unpacks(tmp_path):
    path = tmp_path / "bomb.npz"
    block = bytes(1 << 20)
    with (
        zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive,
        archive.open("names.npy", "w", force_zip64=True) as stream,
    ):
        for _ in range(300):
            stream.write(block)
    with pytest.raises(DataError, match="claims to unpack to 314572800 bytes"):
        read_archive(path)


def test_a_member_that_lies_about_its_size_is_refused(tmp_path):
    path = tmp_path / "liar.npz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("names.npy", bytes(1 << 20))
    content = bytearray(path.read_bytes())
    directory = content.rindex(b"PK\x01\x02")
    content[directory + 24 : directory + 28] = struct.pack("<I", 100)
    path.write_bytes(content)
    with pytest.raises(DataError, match=r"damaged|longer"):
        read_archive(path)


@pytest.mark.parametrize("content", [b"", b"PK", b"PK\x05\x06" + bytes(18), b"hello", bytes(500)])
def test_a_file_that_is_no_archive_is_refused(tmp_path, content):
    path = tmp_path / "a.npz"
    path.write_bytes(content)
    with pytest.raises(DataError, match=r"damaged or no \.npz|no array names"):
        read_archive(path)


@settings(
    max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(data=st.data())
def test_a_damaged_or_cut_archive_gives_a_clip_or_a_data_error(tmp_path, data):
    path = tmp_path / "a.npz"
    write_archive(make_clip(frames=2), path)
    content = bytearray(path.read_bytes())
    for _ in range(data.draw(st.integers(0, 4))):
        place = data.draw(st.integers(0, len(content) - 1))
        content[place] = data.draw(st.integers(0, 255))
    path.write_bytes(content[: data.draw(st.integers(0, len(content)))])
    message = ""
    try:
        clip = read_archive(path)
    except DataError as error:
        message = str(error)
    if message:
        assert message.startswith(str(path))
        assert "\n" not in message
    else:
        assert clip.frames == 2


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"rotations_local": torch.zeros(7, 4, 4)}, "length 0 in frame 0, joint 'hips'"),
        ({"root_positions": torch.full((7, 3), torch.nan)}, "root_positions has a value"),
        ({"tracks": {"x": torch.zeros(7, dtype=torch.bfloat16)}}, "clip.to"),
        ({"skeleton": Skeleton(("a", "b", "c", "d\0"), (-1, 0, 1, 2))}, "zero character"),
    ],
)
def test_what_could_not_be_read_back_is_not_written(tmp_path, change, message):
    clip = make_clip()
    path = tmp_path / "a.npz"
    fields = {
        "skeleton": clip.skeleton,
        "offsets": clip.offsets,
        "fps": 30.0,
        "root_positions": clip.root_positions,
        "rotations_local": clip.rotations_local,
    }
    with pytest.raises(DataError, match=message):
        write_archive(Clip(**{**fields, **change}), path)
    assert list(tmp_path.iterdir()) == []
