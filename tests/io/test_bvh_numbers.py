"""The parser of plain numbers against Python's float, bit by bit."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from posecast.io import number_block
from posecast.io.number_block import parse_block

_COUNT = 5000


def _values(scale: float) -> list[float]:
    random = np.random.default_rng(7)
    return (scale * random.standard_normal(_COUNT)).tolist()


def _tiny(most: int) -> list[str]:
    """Numbers of up to seven digits over powers of ten from 14 on, past those float64 holds."""
    random = np.random.default_rng(3)
    integers, powers = random.integers(0, 10**7, _COUNT), random.integers(8, most - 5, _COUNT)
    return [f"{whole / 10**6:.6f}e-{power}" for whole, power in zip(integers, powers, strict=True)]


FORMATS: dict[str, Callable[[], list[str]]] = {
    "six decimals": lambda: [f"{value:.6f}" for value in _values(300)],
    "six digits": lambda: [f"{value:.6g}" for value in _values(30)],
    "six digits, small": lambda: [f"{value:.6g}" for value in _values(0.05)],
    "exponents": lambda: [f"{value:.5e}" for value in _values(1e-9)],
    "capital exponents": lambda: [f"{value:.5E}" for value in _values(1e-9)],
    "beyond the exact powers": lambda: _tiny(27),
    "whole numbers": lambda: [str(int(value)) for value in _values(1500)],
    "a point at the end": lambda: [f"{int(value)}." for value in _values(1500)],
    "no digit before the point": lambda: [f"{value:.5f}"[1:] for value in np.abs(_values(0.2))],
    "eight decimals": lambda: [f"{value:.8f}" for value in _values(3000)],
}


def _same(found: np.ndarray, words: list[str]) -> bool:
    """Whether the numbers are those of float, the sign of zero included."""
    expected = np.array([float(word) for word in words])
    return found.shape == expected.shape and found.tobytes() == expected.tobytes()


@pytest.mark.parametrize("kind", FORMATS)
def test_numbers_of_the_usual_formats_are_those_of_float_without_the_slow_road(kind):
    words = FORMATS[kind]()
    assert len(words) == _COUNT
    block = parse_block(" ".join(words).encode())
    assert block is not None
    assert _same(block.numbers, words)


_CORNERS = (
    "0 -0 0.0 -0.0 -.5 .5 5. -5. 0000 9999 9999.99999999 -9999.99999999 10000 12345678 123456789 "
    "1234567890123 00000.5 0.123456789 0.1234567890123456789 +1 +.5 1e5 1E+5 1e-5 1.5e-05 1e-22 "
    "9.e-22 .9e-22 1.00000000e-14 1e-005 4.9e-324 1e-400 0e-99 1.7976931348623157e308 "
    "9007199254740993 0.30000000000000004 2.2250738585072011e-308"
)


@pytest.mark.parametrize("blank", [" ", "  ", "\t", "\n", "\r\n", " \n\n\t"])
def test_every_way_to_write_a_number_is_read_as_float_reads_it(blank):
    words = _CORNERS.split()
    assert len(words) == 37
    many = [part for word in words for part in (word, *["-1.25"] * 5)]  # unusual ones are few
    for text in (blank.join(many), blank.join(many) + blank, blank + blank.join(many)):
        block = parse_block(text.encode())
        assert block is not None
        assert _same(block.numbers, many)


_UNREADABLE = (
    "nan inf -Infinity 1_000 0x10 1e400 1,5 1.5.2 1..5 - . -. e-15 -e-15 .e-15 1e 1e- 1e-1x --1 "
    "1-2 1e-15- 1e-1.5 1e--15 1.5e-15e-15 1.5f 1d-05 \xa01 \xb2 1\x0b2 1\x002 1\x1f2 12345x 1.5-15"
)


@pytest.mark.parametrize("word", _UNREADABLE.split(" "))
def test_what_is_no_plain_number_is_left_to_the_slow_road(word):
    assert parse_block(b"0.5 " * 50) is not None
    assert parse_block(b"0.5 " * 50 + word.encode("latin-1") + b" 0.5" * 50) is None


def test_many_numbers_with_all_their_digits_are_left_to_the_slow_road():
    assert parse_block(" ".join(map(repr, _values(30))).encode()) is None


def test_line_ends_tell_how_many_numbers_come_before_them():
    block = parse_block(b" 1 2\t3 \r\n\n4 5 6\n \n7 8")
    assert block is not None
    assert block.numbers.tolist() == [1, 2, 3, 4, 5, 6, 7, 8]
    assert block.line_ends.tolist() == [3, 3, 6, 6]


@pytest.mark.parametrize("size", [20, 33, 64, 1000])
@pytest.mark.parametrize("columns", [1, 3, 40])
def test_it_does_not_matter_where_the_text_is_cut_into_chunks(size, columns, monkeypatch):
    words = FORMATS["six digits, small"]()[:1200]
    rows = [" ".join(words[start : start + columns]) for start in range(0, 1200, columns)]
    text = "\n".join(rows).encode()
    monkeypatch.setattr(number_block, "_CHUNK", size)
    monkeypatch.setattr(number_block, "_MOST_UNUSUAL", 1.0)
    block = parse_block(text)
    assert block is not None
    assert _same(block.numbers, words)
    assert block.line_ends.tolist() == list(range(columns, 1200, columns))


def test_a_word_that_fills_a_chunk_is_left_to_the_slow_road(monkeypatch):
    monkeypatch.setattr(number_block, "_CHUNK", 20)
    assert parse_block(b"0.5 " * 20 + b"0" * 30 + b" 0.5" * 20) is None


@pytest.mark.parametrize("powers", [23, len(number_block._LONG_POWERS)])
def test_machines_without_a_wider_float_read_the_same(powers, monkeypatch):
    words = _tiny(50)
    monkeypatch.setattr(number_block, "_LONG_POWERS", number_block._LONG_POWERS[:powers])
    monkeypatch.setattr(number_block, "_MOST_UNUSUAL", 1.0)
    block = parse_block(" ".join(words).encode())
    assert block is not None
    assert _same(block.numbers, words)


@pytest.mark.skipif(len(number_block._LONG_POWERS) != 28, reason="needs a 64-bit mantissa")
def test_a_quotient_that_would_be_rounded_twice_is_doubted():
    random = np.random.default_rng(5)
    integers = random.integers(1, 10**7, 40000).astype(np.float64)
    power = random.integers(23, 28, 40000).astype(np.uint8)
    found, sure = number_block._quotients(integers, power)
    expected = np.array(
        [float(f"{int(whole)}e-{n}") for whole, n in zip(integers, power, strict=True)]
    )
    assert (found[sure] == expected[sure]).all()
    assert 0 < (~sure).sum() < 100
    assert (found[~sure] != expected[~sure]).any()
