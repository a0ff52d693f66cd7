"""Bad files end in one DataError that says where, what, and what to do; nothing hangs."""

from __future__ import annotations

import contextlib
import time
from pathlib import Path

import pytest
import torch
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from tests.io.bvh_texts import DIALECTS, body, channels, motion, numbers
from tests.io.test_bvh_dialects import write

from posecast.errors import DataError
from posecast.io.bvh import read_bvh, read_bvh_document, write_bvh, write_bvh_document

PLAIN = body() + motion(numbers(12))
ROW = numbers(12)[0]
FIRST_ROW = len(body().splitlines()) + 4


def with_row(place: int, words: list[str]) -> str:
    """The plain file with another row; ``place`` counts from 0."""
    rows = numbers(12)
    rows[place] = words
    return body() + motion(rows)


BAD: dict[str, tuple[bytes | str, str, int | None]] = {
    "empty": ("", "is empty", None),
    "blank": (" \n\t\n", "is empty", None),
    "binary": (b"\x00\x01\x02\xff" * 99, "is not BVH", 1),
    "another format": ("#VRML V2.0 utf8\n", "is not BVH", 1),
    "broken UTF-16": (b"\xff\xfeH\x00\x00\xd8I\x00", "is not the UTF-16 text", None),
    "hierarchy only": (body(), "no MOTION section", None),
    "cut in the hierarchy": (PLAIN.partition("CHANNELS")[0], "1 '{' without a '}'", 5),
    "brace missing": (PLAIN.replace("}\n}\nMOTION", "}\nMOTION"), "1 '{' without a '}'", 20),
    "brace too many": (PLAIN.replace("}\nMOTION", "}\n}\nMOTION"), "expected ROOT or MOTION", 21),
    "no root": ("HIERARCHY\nMOTION\nFrames: 1\nFrame Time: 1\n1\n", "has no ROOT", 2),
    "joint outside": (PLAIN.replace("ROOT", "JOINT"), "expected ROOT or MOTION", 2),
    "unknown word": (PLAIN.replace("OFFSET 0.5", "SCALE 0.5"), "found 'SCALE'", 8),
    "short offset": (PLAIN.replace("0 1.5 0", "0 1.5"), "one of the three numbers", 17),
    "comma in offset": (PLAIN.replace("0.5 4.25", "0,5 4.25"), "not a decimal sign", 8),
    "offset that is nan": (PLAIN.replace("0.5 4.25", "nan 4.25"), "lost the value", 8),
    "no offset": (PLAIN.replace("OFFSET 3 .5 0.\n", ""), "'LeftHand' ends without an OFFSET", 17),
    "two offsets": (PLAIN.replace("OFFSET 0 0 0", "OFFSET 0 0 0\nOFFSET 1 1 1"), "one OFFSET", 5),
    "channel missing": (PLAIN.replace("LS 6", "LS 7"), "channel 7 of 7 of joint 'Hips'", 6),
    "channel too many": (PLAIN.replace("LS 6", "LS 5"), "more channels than CHANNELS", 5),
    "channel unknown": (PLAIN.replace("Xpos", "Wpos"), "found 'Wposition'", 5),
    "channel count": (PLAIN.replace("LS 6", "LS six"), "number of channels", 5),
    "channels by the million": (PLAIN.replace("LS 6", "LS 600000000"), "number of channels", 5),
    "position twice": (PLAIN.replace("Ypos", "Xpos"), "position channel twice", 5),
    "End Site with channels": (
        PLAIN.replace("OFFSET 0 1.5 0", "OFFSET 0 1.5 0\nCHANNELS 0"),
        "an End Site has nothing else",
        17,
    ),
    "no channels at all": (
        body(root="", arm="", hand="") + motion([["1"]]),
        "no joint has channels",
        None,
    ),
    "no frame count": (PLAIN.replace("Frames: 4\n", ""), "expected 'Frames'", FIRST_ROW - 2),
    "no frame time": (PLAIN.replace("Frame Time: 0.04\n", ""), "'Frame Time'", FIRST_ROW - 1),
    "frame count in words": (PLAIN.replace(": 4", ": four"), "number of frames", FIRST_ROW - 2),
    "negative frame count": (PLAIN.replace(": 4", ": -4"), "number of frames", FIRST_ROW - 2),
    "frame time zero": (PLAIN.replace("0.04", "0"), "expected more than 0", FIRST_ROW - 1),
    "frame time negative": (PLAIN.replace("0.04", "-0.04"), "more than 0", FIRST_ROW - 1),
    "frame time with comma": (PLAIN.replace("0.04", "0,04"), "not a decimal sign", FIRST_ROW - 1),
    "no frames": (body() + motion([], 4), "no frames after the frame time", FIRST_ROW),
    "no frames declared": (body() + motion([], 0), "expected one or more", FIRST_ROW),
    "a number missing": (with_row(1, ROW[1:]), "found 11 numbers, expected 12", FIRST_ROW + 1),
    "a number too many": (with_row(1, [*ROW, "1"]), "found 13 numbers", FIRST_ROW + 1),
    "cut in the last row": (with_row(3, ROW[:7]), "found 7 numbers, expected 12", FIRST_ROW + 3),
    "not a number": (with_row(1, [*ROW[:3], "1.2.3", *ROW[4:]]), "found '1.2.3'", FIRST_ROW + 1),
    "digits joined": (with_row(1, [*ROW[:3], "1_0", *ROW[4:]]), "found '1_0'", FIRST_ROW + 1),
    "nan": (with_row(2, [*ROW[:5], "-nan", *ROW[6:]]), "Xrotation of joint 'Hips'", FIRST_ROW + 2),
    "nan of Windows": (with_row(2, [*ROW[:5], "-1.#IND", *ROW[6:]]), "lost", FIRST_ROW + 2),
    "infinite": (with_row(2, [*ROW[:6], "inf", *ROW[7:]]), "joint 'LeftArm'", FIRST_ROW + 2),
    "too large": (with_row(2, [*ROW[:6], "1e400", *ROW[7:]]), "too large", FIRST_ROW + 2),
    "zero byte": (PLAIN.replace(ROW[2], "1\0002"), "found '1\\x002'", FIRST_ROW),
    "too far to be true": (with_row(1, [ROW[0], "1e20", *ROW[2:]]), "frame 1 is 1e+20 file", None),
    "a bone too long": (PLAIN.replace("0.5 4.25", "0.5 4e300"), "OFFSET of joint 1", None),
    "a row cut, the next one torn": (
        body() + motion([ROW, ROW[:5], ROW[5:], ROW, ROW], 5),
        "found 5 numbers, expected 12",
        FIRST_ROW + 1,
    ),
    "thirds of rows": (body() + motion([ROW[:4]] * 3, 9), "4 numbers a line", FIRST_ROW),
    "text at the end": (PLAIN + "the end\n", "found 'the'", FIRST_ROW + 4),
    "all rows too short": (
        body() + motion([row[:6] for row in numbers(12)]),
        "6 numbers a line",
        FIRST_ROW,
    ),
}  # fmt: skip


def test_there_is_a_file_for_every_fault() -> None:
    assert len(BAD) == 50


@pytest.mark.parametrize("name", BAD)
def test_a_fault_is_one_error_with_place_and_remedy(name: str, tmp_path: Path) -> None:
    content, message, line = BAD[name]
    path = write(tmp_path, content)
    with pytest.raises(DataError) as caught:
        read_bvh(path)
    assert message in str(caught.value)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 400 + len(str(path))
    assert caught.value.line == line


def test_a_missing_file_and_a_folder_are_data_errors(tmp_path: Path) -> None:
    with pytest.raises(DataError):
        read_bvh(tmp_path / "nowhere.bvh")
    with pytest.raises(DataError):
        read_bvh(tmp_path)


def test_a_file_too_large_to_hold_is_refused_at_once(tmp_path: Path) -> None:
    path = tmp_path / "huge.bvh"
    with path.open("wb") as file:
        file.truncate(2**40)
    with pytest.raises(DataError, match="cut it into shorter files"):
        read_bvh(path)


LARGE = {
    "a deep chain": ("JOINT j\n{\nOFFSET 0 1 0\nCHANNELS 1 Xrotation\n", "}\n"),
    "a deep chain left open": ("JOINT j\n{\nOFFSET 0 1 0\n", ""),
    "joints with one name": ("JOINT j\n{\nOFFSET 0 1 0\nCHANNELS 1 Xrotation\n}\n", ""),
    "End Sites": ("End Site\n{\nOFFSET 0 1 0\n}\n", ""),
    "one line": ("JOINT j { OFFSET 0 1 0 } ", ""),
    "braces": ("{", ""),
}


def large_hierarchy(name: str, size: int) -> str:
    """A file that is large in one way."""
    before, after = LARGE[name]
    joints = before * size + after * size
    text = f"HIERARCHY\nROOT r\n{{\nOFFSET 0 0 0\nCHANNELS 1 Xrotation\n{joints}}}\n"
    return text + motion([["1"] * text.count("CHANNELS")] * 2)


def seconds_to_read(path: Path) -> float:
    """Processor time until there is a clip or a ``DataError``."""
    start = time.process_time()
    with contextlib.suppress(DataError):
        read_bvh(path)
    return time.process_time() - start


@pytest.mark.slow  # reads the clock: not in the default run
@pytest.mark.parametrize("name", LARGE)
def test_time_grows_with_the_size_of_the_hierarchy_and_no_faster(name: str, tmp_path: Path) -> None:
    small = seconds_to_read(write(tmp_path, large_hierarchy(name, 1_500)))
    large = seconds_to_read(write(tmp_path, large_hierarchy(name, 6_000)))
    # Linear time is 4 times as much, quadratic time 16 times; the constant is the clock's.
    assert large < 9 * small + 0.1


def test_a_deep_chain_is_a_document_but_no_body(tmp_path: Path) -> None:
    path = write(tmp_path, large_hierarchy("a deep chain", 5_000))
    document = read_bvh_document(path)
    assert len(document.joints) == 5_001
    assert document.joints[-1].parent == 4_999
    write_bvh_document(document, tmp_path / "again.bvh")
    assert read_bvh_document(tmp_path / "again.bvh").joints == document.joints
    with pytest.raises(DataError, match="5001 joints, expected at most 2000"):
        read_bvh(path)


MOTIONS = {
    "blank lines": "\n" * 3_000_000,
    "blanks in a line": " " * 3_000_000,
    "blanks after the colon": "Frames:" + " " * 3_000_000,
    "a long word": "Frames: " + "9" * 3_000_000,
    "one number a line": "Frames: 9\nFrame Time: 1\n" + "1\n" * 100_000,
    "all numbers in one line": "Frames: 9\nFrame Time: 1\n" + "1 " * 100_000,
    "one endless number": "Frames: 1\nFrame Time: 1\n" + "1" * 1_000_000,
    "an endless frame time": "Frames: 1\nFrame Time: 0." + "3" * 1_000_000,
    "a frame that is not there": "Frames: 1000000000000\nFrame Time: 1\n" + "1 2 3 4 5\n" * 2,
}


@pytest.mark.timeout(60)
@pytest.mark.parametrize("name", MOTIONS)
def test_a_large_or_strange_motion_is_refused_in_time(name: str, tmp_path: Path) -> None:
    hierarchy = body(arm=channels(""), hand=channels(""))
    path = write(tmp_path, hierarchy + "MOTION\n" + MOTIONS[name] + "\n")
    with pytest.raises(DataError) as caught:
        read_bvh(path)
    assert len(str(caught.value)) < 400 + len(str(path))


PIECES = (
    *("{", "}", "\n", " ", "\r", "\t", ",", ".", "-", "e", "nan", "1e999", "\0", "\x85", "é"),
    *("HIERARCHY", "ROOT", "JOINT", "End Site", "OFFSET", "CHANNELS", "CHANNELS 3", "MOTION"),
    *("Frames: 2", "Frame Time: 0.1", "Xposition", "Zrotation", "1e308", "-1e308", "0", "9" * 30),
)


@st.composite
def mutated(draw: st.DrawFn) -> bytes:
    """A dialect's bytes with a few pieces cut, doubled, moved or put in."""
    content = DIALECTS[draw(st.sampled_from(sorted(DIALECTS)))].content
    for _ in range(draw(st.integers(1, 5))):
        first = draw(st.integers(0, len(content)))
        second = draw(st.integers(first, min(len(content), first + 200)))
        piece = draw(
            st.one_of(
                st.sampled_from(PIECES).map(lambda text: text.encode()),
                st.binary(max_size=4),
                st.just(content[first:second] * 2),
                st.just(b""),
            )
        )
        content = content[:first] + piece + content[second:]
    return content


@settings(
    max_examples=300, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(content=mutated())
def test_a_damaged_file_is_read_or_is_a_data_error(content: bytes, tmp_path: Path) -> None:
    path = write(tmp_path, content)
    with contextlib.suppress(DataError):
        clip = read_bvh(path)
        assert torch.isfinite(clip.rotations_local).all()
        assert torch.isfinite(clip.root_positions).all()
        write_bvh(clip, tmp_path / "written.bvh")
        # What was written is a proper file, whatever it came from.
        assert len(read_bvh_document(tmp_path / "written.bvh").values) == clip.frames
