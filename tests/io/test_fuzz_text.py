"""Damaged AMC, ASF and H3.6M text: a clip or a DataError comes out, in time linear in the file."""

from __future__ import annotations

import gc
import time
from collections.abc import Callable
from pathlib import Path

import pytest
import torch
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from posecast.errors import DataError
from posecast.io.asf_amc import read_amc
from posecast.io.h36m import read_h36m
from posecast.motion import Clip

ASF = b"""# bones
:version 1.10
:units
  length 0.45
  angle deg
:root
   order TX TY TZ RX RY RZ
   axis XYZ
   position 0 0 0
   orientation 0 0 0
:bonedata
  begin
     id 1
     name thigh
     direction 0.34 -0.93 0
     length 7.2
     axis 10 -20 30 XYZ
     dof rx ry rz
     limits (-160.0 20.0)
            (-70.0 70.0)
            (-60.0 70.0)
  end
  begin
     id 2
     name shin
     direction 0 -1 0
     length 7
     axis -90 7.6e-016 20 XYZ
     dof rx
  end
:hierarchy
  begin
    root thigh
    thigh shin
  end
"""

AMC = b"#!OML:ASF test\n:FULLY-SPECIFIED\n:DEGREES\n" + b"".join(
    b"%d\nroot 1 2 3 10 20 30\nthigh 7 8 9.5e-001\nshin -10\n" % number for number in range(1, 6)
)

H36M = b"\n".join(
    b",".join(b"%.7f" % ((row * 7 + column * 3) % 11 / 10 - 0.5) for column in range(99))
    for row in range(6)
)

TOKENS = (
    b"", b" ", b"\n", b"\r", b"\r\n", b"\t", b"\0", b"\xff", b"\xef\xbb\xbf", "½٣".encode(), b"#",
    b":", b",", b",,", b"-", b"e", b".", b"nan", b"inf", b"-inf", b"1e999", b"1e-999", b"1_0",
    b"0x1p3", b"9" * 5000, b"1", b"2", b"root", b"shin", b"thigh", b"begin", b"end", b"name",
    b"dof", b"order", b"axis", b"length", b"angle", b":hierarchy", b":bonedata", b":root",
    b":RADIANS", b"(", b"root root", b"shin thigh", b"XYZ", b"(" * 300,
)  # fmt: skip


@st.composite
def damaged(draw: st.DrawFn, whole: bytes) -> bytes:
    """``whole`` after a few cuts, copies and replacements, at any place."""
    text = whole
    for _ in range(draw(st.integers(1, 4))):
        start = draw(st.integers(0, len(text)))
        stop = min(len(text), start + draw(st.sampled_from([0, 0, 1, 2, 5, 30, 200, 10**6])))
        piece = draw(
            st.one_of(
                st.sampled_from(TOKENS),
                st.just(text[start:stop] * 2),
                st.binary(max_size=6),
            )
        )
        text = text[:start] + piece + text[stop:]
    return text


def read_or_refuse(read: Callable[[], Clip], folder: Path) -> None:
    """Reads; a refusal must be one line that begins with the file."""
    message = ""
    try:
        clip = read()
    except DataError as error:
        message = str(error)
    if message:
        assert message.startswith(str(folder))
        assert len(message.splitlines()) == 1
    else:
        assert clip.frames > 0
        for values in (clip.offsets, clip.root_positions, clip.rotations_local):
            assert torch.isfinite(values).all()


FUZZ = settings(
    max_examples=400,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)


@FUZZ
@given(text=damaged(AMC))
def test_a_damaged_motion_gives_a_clip_or_a_data_error(tmp_path, text):
    (tmp_path / "1.asf").write_bytes(ASF)
    (tmp_path / "1_1.amc").write_bytes(text)
    read_or_refuse(lambda: read_amc(tmp_path / "1_1.amc"), tmp_path)


@FUZZ
@given(text=damaged(ASF))
def test_a_damaged_skeleton_gives_a_clip_or_a_data_error(tmp_path, text):
    (tmp_path / "1.asf").write_bytes(text)
    (tmp_path / "1_1.amc").write_bytes(AMC)
    read_or_refuse(lambda: read_amc(tmp_path / "1_1.amc"), tmp_path)


@FUZZ
@given(text=damaged(H36M))
def test_damaged_human36m_text_gives_a_clip_or_a_data_error(tmp_path, text):
    (tmp_path / "walking_1.txt").write_bytes(text)
    read_or_refuse(lambda: read_h36m(tmp_path / "walking_1.txt"), tmp_path)


def chain_of_bones(count: int) -> bytes:
    """A skeleton whose hierarchy is one long chain."""
    bones = b"".join(
        b"begin\nname b%d\ndirection 0 1 0\nlength 1\nend\n" % bone for bone in range(count)
    )
    links = b"".join(b"b%d b%d\n" % (bone, bone + 1) for bone in range(count - 1))
    return b":root\norder TX TY TZ RX RY RZ\n:bonedata\n" + bones + b":hierarchy\nroot b0\n" + links


MOTION = b"1\nroot 1 2 3 10 20 30\n"

GROWING: dict[str, tuple[str, Callable[[int], bytes]]] = {
    "frames": ("1_1.amc", lambda n: AMC[:43] + b"".join(
        b"%d\nroot 1 2 3 4 5 6\nthigh 7 8 9\nshin 1\n" % i for i in range(n))),
    "frames with comments": ("1_1.amc", lambda n: AMC + b"# more\n" + b"".join(
        b"%d\nroot 1 2 3 4 5 6\nthigh 7 8 9\nshin 1\n" % i for i in range(6, n // 4))),
    "one endless number": ("1_1.amc", lambda n: AMC + b"6\nroot " + b"9" * (20 * n)),
    "one endless line": ("1_1.amc", lambda n: AMC + b"6\nroot" + b" 9" * (20 * n)),
    "header lines": ("1_1.amc", lambda n: b":DEGREES\n" * n + AMC),
    "blank lines": ("1_1.amc", lambda n: AMC + b"\n \n" * (10 * n) + b"x"),
    "numbers of frames": ("1_1.amc", lambda n: b"".join(b"%d\n" % i for i in range(n))),
    "bones": ("1.asf", lambda n: ASF.replace(b":hierarchy", b"".join(
        b"begin\nname b%d\ndirection 0 1 0\nlength 1\nend\n" % i for i in range(n))
        + b":hierarchy")),
    "children that are not there": ("1.asf", lambda n: ASF + b"thigh" + b" x" * (10 * n)),
    "limits": ("1.asf", lambda n: ASF.replace(b"(-70", b"(1 2)\n" * n + b"(-70")),
    "columns": ("walking_1.txt", lambda n: H36M + b"\n" + b"1," * (20 * n)),
    "rows": ("walking_1.txt", lambda n: (H36M + b"\n") * (n // 30)),
    "a fault in the last row": ("walking_1.txt", lambda n: (H36M + b"\n") * (n // 30) + b"x"),
    "an endless field": ("walking_1.txt", lambda n: H36M + b"\n" + b"1" * (40 * n)),
}  # fmt: skip


@pytest.mark.slow  # reads the clock: not in the default run
@pytest.mark.parametrize("case", GROWING)
def test_a_file_ten_times_as_long_takes_about_ten_times_as_long(tmp_path, case):
    name, build = GROWING[case]
    (tmp_path / "1.asf").write_bytes(ASF)
    (tmp_path / "1_1.amc").write_bytes(AMC)
    reader = read_h36m if name.endswith(".txt") else read_amc
    path = tmp_path / ("1_1.amc" if name.endswith(".asf") else name)

    def seconds(size: int) -> float:
        (tmp_path / name).write_bytes(build(size))
        best = float("inf")
        for _ in range(3):
            gc.collect()
            begin = time.process_time()
            read_or_refuse(lambda: reader(path), tmp_path)
            best = min(best, time.process_time() - begin)
        return best

    seconds(100)
    gc.disable()
    try:
        small, large = seconds(1_000), seconds(10_000)
    finally:
        gc.enable()
    # Quadratic work would take a hundred times as long. A busy machine and colder caches may
    # cost the longer file a factor of three; below 20 ms there is nothing to see.
    assert large < 40 * max(small, 0.02), (small, large)


def test_a_skeleton_of_thousands_of_bones_in_a_chain_is_read_without_recursion(tmp_path):
    (tmp_path / "1.asf").write_bytes(chain_of_bones(3000))
    (tmp_path / "1_1.amc").write_bytes(MOTION)
    assert len(read_amc(tmp_path / "1_1.amc").skeleton) == 3001
