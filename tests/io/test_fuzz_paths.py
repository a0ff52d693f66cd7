"""Damaged files of paths: a path or a DataError of one line comes out."""

from __future__ import annotations

import importlib.util
from pathlib import Path as FilePath

import pytest
import torch
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from posecast.errors import DataError
from posecast.io import read_path

CSV = b"# drawn\nx,z,t,facing,speed\n0,0,0,90,1.5\n0,2.5,,,\n3,4,5.5,-90,0.5\n0,0,9,,\n"

JSON = b"""{"closed": false, "straight": true,
"points": [[0, 0], {"x": 0, "z": 2.5, "t": 1.5}, [3.0, 4e0], {"z": 1, "x": 2, "facing": 45}]}"""

SVG = b"""<?xml version="1.0"?>
<svg xmlns="http://www.w3.org/2000/svg"><g transform="rotate(30) scale(2,1)">
<circle r="50" cx="3"/><path id="p" transform="matrix(1 0 .1 1 5 6)"
d="M 0 0 L 30 100 h50 V 9 C 0 10 10 20 30 10 S 40 0 50 0 Q 60 0 60 -10 T 9 9 A 50 40 9 0 1 70 0"/>
</g></svg>"""

TOKENS = (
    b"", b" ", b"\n", b"\r", b"\0", b"\xff", b"\xef\xbb\xbf", "½٣".encode(), b"#", b",", b",,",
    b";", b"-", b"e", b".", b"nan", b"inf", b"1e999", b"1e-999", b"1e300", b"1_0", b"9" * 5000,
    b"0", b"1", b"null", b"true", b"[", b"]", b"{", b"}", b'"', b":", b"[" * 3000, b"M", b"Z", b"A",
    b"S", b"T", b"<g>", b"</g>", b"<", b">", b"&amp;", b"&x;", b"(", b")", b"/", b"skewX",
    b"transform", b"0 0", b"x,z\n", b"y", b"t", b"facing", b"speed", b"path", b"circle", b"id",
    b"style='transform: none'",
)  # fmt: skip


@st.composite
def damaged(draw: st.DrawFn, whole: bytes) -> bytes:
    """``whole`` after a few cuts, copies and replacements, at any place."""
    text = whole
    for _ in range(draw(st.integers(1, 4))):
        start = draw(st.integers(0, len(text)))
        stop = min(len(text), start + draw(st.sampled_from([0, 0, 1, 2, 5, 30, 200, 10**6])))
        piece = draw(
            st.one_of(st.sampled_from(TOKENS), st.just(text[start:stop] * 2), st.binary(max_size=6))
        )
        text = text[:start] + piece + text[stop:]
    return text


def read_or_refuse(file: FilePath, text: bytes) -> None:
    """Reads; a refusal must be one line that begins with the file."""
    file.write_bytes(text)
    message = ""
    try:
        path = read_path(file, spacing=0.05)
    except DataError as error:
        message = str(error)
    if message:
        assert message.startswith(str(file))
        assert len(message.splitlines()) == 1
        assert len(message) < len(str(file)) + 400
    else:
        assert path.length > 0
        assert torch.isfinite(path.points).all()
        assert torch.isfinite(path.curvatures).all()
        assert len(path.marks) > 0


FUZZ = settings(
    max_examples=200,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)


def test_the_files_that_get_damaged_are_whole(tmp_path):
    kinds = {"csv": CSV, "json": JSON}
    if importlib.util.find_spec("svgpathtools"):
        kinds["svg"] = SVG
    for kind, text in kinds.items():
        (tmp_path / f"p.{kind}").write_bytes(text)
        assert read_path(tmp_path / f"p.{kind}").length > 1


@FUZZ
@given(text=damaged(CSV))
def test_damaged_rows_give_a_path_or_a_data_error(tmp_path, text):
    read_or_refuse(tmp_path / "p.csv", text)


@FUZZ
@given(text=damaged(JSON))
def test_damaged_json_gives_a_path_or_a_data_error(tmp_path, text):
    read_or_refuse(tmp_path / "p.json", text)


@FUZZ
@given(text=damaged(SVG))
def test_a_damaged_drawing_gives_a_path_or_a_data_error(tmp_path, text):
    pytest.importorskip("svgpathtools")
    read_or_refuse(tmp_path / "p.svg", text)
