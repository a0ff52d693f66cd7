"""Plain decimal numbers by the hundred thousand: text to float64, correctly rounded.

NumPy has no fast parser of numbers, but arithmetic on arrays of characters goes a long way.

* For every character of the text, the number that the two and the four digits from there on make
  is found by doubling, with a zero for each digit that is missing: in ``7.318 ``, the four
  digits after the point make 3180. So is the number of digits in a row. These are a few
  operations on bytes, of which a processor does dozens at a time.
* A number is then looked up: up to four digits before the point, twice four after it.
* ``8.84623e-15`` is 884623 / 10**20. Both are exact in float64, so their one division rounds the
  true value once, and the result is that of ``float``. This holds for integers up to 2**53 and
  powers up to 10**22; other numbers are left to ``float`` itself.

Sources: Clinger 1990, "How to read floating point numbers accurately", for the division; compare
Langdale and Lemire 2019, "Parsing gigabytes of JSON per second", for the digits.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

_CHUNK = 1 << 17
"""Characters at a time; all that is computed from them then stays in the cache."""
_MARGIN = 16
"""Characters behind a number that are looked at, whatever they are."""
_MOST_UNUSUAL = 0.2
"""Share of numbers read one by one above which NumPy's own parser is faster."""

_BLANK, _TAB, _LINE_FEED, _RETURN, _MINUS, _POINT, _E = b" \t\n\r-.e"
_MOST_BEFORE, _MOST_AFTER = 4, 8
_SCALE = 10.0**_MOST_AFTER
_POWERS = 10.0 ** np.arange(23)
"""The powers of ten that float64 holds exactly."""
_LONG_POWERS = np.multiply.accumulate(
    np.array(
        [1] + [10] * {63: 27, 112: 48}.get(int(np.finfo(np.longdouble).nmant), 22), np.longdouble
    )
)
"""Those that the widest float of the machine holds exactly, by the bits of its mantissa."""

Bytes = NDArray[np.uint8]
Places = NDArray[np.int64]
Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]


class NumberBlock(NamedTuple):
    """The numbers of a text one after the other, and how many there are up to each line's end."""

    numbers: Floats
    line_ends: Places


def parse_block(text: bytes, start: int = 0) -> NumberBlock | None:
    """Parse numbers between blanks, tabs and line ends; ``None`` if that is not what there is.

    Fast for up to four digits before the point and up to eight after it, with or without a point
    or an exponent. ``None`` means: read it in another way, to get the numbers or the error. That
    is so if any word is no finite decimal number, or if many numbers are longer than this.

    Args:
        text: anything up to ``start``, then the numbers.
        start: a place at which a word may begin.
    """
    numbers = [np.empty(0)]
    line_ends = [np.empty(0, np.int64)]
    count = 0
    while start < len(text):
        stop = _stop(text, start)
        chunk = _parse_chunk(text, start, stop) if stop > start else None
        if chunk is None:
            return None
        numbers.append(chunk.numbers)
        line_ends.append(chunk.line_ends + count)
        count += len(chunk.numbers)
        start = stop
    return NumberBlock(np.concatenate(numbers), np.concatenate(line_ends))


def _stop(text: bytes, start: int) -> int:
    """Where a chunk ends: after its last line or else word; ``start`` if one word fills it."""
    stop = start + _CHUNK
    if stop >= len(text):
        return len(text)
    last = text.rfind(b"\n", start, stop)
    return 1 + (last if last >= 0 else max(text.rfind(b" ", start, stop), start - 1))


def _parse_chunk(text: bytes, start: int, stop: int) -> NumberBlock | None:
    """Parse a part of the text, small enough for the cache, that ends with a word."""
    if stop + _MARGIN > len(text):
        text, start, stop = text[start:stop] + b" " * _MARGIN, 0, stop - start
    characters = np.frombuffer(text, np.uint8, stop - start + _MARGIN, start)
    inside = stop - start + (text[stop - 1] > _BLANK)
    ends = np.flatnonzero(characters[:inside] <= _BLANK)
    kinds = characters.take(ends, mode="clip")
    others = np.flatnonzero(kinds != _BLANK)
    kinds = kinds[others]
    if not ((kinds == _LINE_FEED) | (kinds == _TAB) | (kinds == _RETURN)).all():
        return None
    line_ends = others[kinds == _LINE_FEED] + 1
    starts = np.empty_like(ends)
    starts[0] = 0
    np.add(ends[:-1], 1, out=starts[1:])
    filled = starts < ends
    if not filled.all():
        line_ends = np.cumsum(filled)[line_ends - 1]
        starts, ends = starts[filled], ends[filled]
    numbers, unusual = _usual_numbers(characters, starts, ends)
    if len(unusual) > _MOST_UNUSUAL * len(numbers):
        return None
    bounds = zip((starts[unusual] + start).tolist(), (ends[unusual] + start).tolist(), strict=True)
    words = [text[begin:end] for begin, end in bounds]
    if b"_" in b" ".join(words):  # float takes 1_000
        return None
    try:
        numbers[unusual] = list(map(float, words))
    except ValueError:
        return None
    return NumberBlock(numbers, line_ends) if np.isfinite(numbers).all() else None


class _Digits(NamedTuple):
    """What the digits from each character on make.

    Args:
        run: how many digits there are in a row, up to eight.
        pairs, fours: the number that the first two and four of them make, with zeros for those
            that are missing.
    """

    run: Bytes
    pairs: Bytes
    fours: NDArray[np.uint16]


def _digits(characters: Bytes) -> _Digits:
    """Join neighbors to pairs, pairs to fours, fours to eights; the arrays get a bit shorter."""
    digits = characters ^ ord("0")
    one = (digits < 10).view(np.uint8)
    digits *= one
    two = one[:-1] & one[1:]
    four = two[:-2] & two[2:]
    pairs: Bytes = np.multiply(digits[:-1], 10, dtype=np.uint8)
    pairs += digits[1:] * one[:-1]
    fours = pairs[:-2].astype(np.uint16)
    fours *= 100
    fours += pairs[2:] * two[:-2]
    run: Bytes = one[:-1] + two
    run = run[:-2] + run[2:] * two[:-2]
    run = run[:-4] + run[4:] * four[:-4]
    return _Digits(run, pairs, fours)


def _usual_numbers(characters: Bytes, starts: Places, ends: Places) -> tuple[Floats, Places]:
    """Values of the texts from ``starts`` to ``ends``, and which of them to read otherwise.

    Usual is ``-?[0-9]{0,4}[.]?[0-9]{0,8}([eE]-[0-9]{2})?`` with a digit in front of the ``e``.
    """
    digits = _digits(characters)
    negative = (characters.take(starts, mode="clip") == _MINUS).astype(np.int64)
    place = starts + negative
    before = digits.run.take(place, mode="clip")
    integers = digits.fours.take(place, mode="clip").astype(np.float64)
    integers *= _POWERS.take(before + (_MOST_AFTER - _MOST_BEFORE), mode="clip")
    place += before
    place += characters.take(place, mode="clip") == _POINT
    after = digits.run.take(place, mode="clip")
    decimals = digits.fours.take(place, mode="clip").astype(np.uint32)
    decimals *= np.uint32(10000)
    decimals += digits.fours[4:].take(place, mode="clip") * (after > 4)
    integers += decimals
    place += after
    numbers = integers / _SCALE
    odd = (before > _MOST_BEFORE) | ((before | after) == 0)
    rest = np.flatnonzero((place != ends) | odd)
    if len(rest):
        place = place.take(rest, mode="clip")
        power, good = _negative_exponents(characters, digits, place, ends.take(rest, mode="clip"))
        after = after.take(rest, mode="clip")
        scaled = integers.take(rest, mode="clip")
        scaled /= _POWERS.take(_MOST_AFTER - after, mode="clip")  # exact
        numbers[rest], sure = _quotients(scaled, power + after)
        good &= sure
        good &= ~odd.take(rest, mode="clip")
        rest = rest[~good]
    negative <<= 63
    numbers.view(np.int64)[...] |= negative
    return numbers, rest


def _negative_exponents(
    characters: Bytes, digits: _Digits, starts: Places, ends: Places
) -> tuple[Bytes, Flags]:
    """The two digits in each ``e-15``, and which of the texts are of that form."""
    good = ends - starts == len("e-15")
    good &= (characters.take(starts, mode="clip") | 0x20) == _E
    good &= characters[1:].take(starts, mode="clip") == _MINUS
    good &= digits.run[2:].take(starts, mode="clip") == 2
    return digits.pairs[2:].take(starts, mode="clip"), good


def _quotients(integers: Floats, power: Bytes) -> tuple[Floats, Flags]:
    """``integers / 10**power``, and where it is correctly rounded for sure.

    Between 10**22 and the last power that is exact in a wider float, its quotient is rounded a
    second time; that errs only from the middle between two numbers.
    """
    quotients = integers / _POWERS.take(power, mode="clip")
    sure = power < len(_POWERS)
    large = np.flatnonzero(~sure & (power < len(_LONG_POWERS)))
    if len(large):
        wide = integers[large].astype(np.longdouble)
        wide /= _LONG_POWERS[power[large]]
        quotients[large] = near = wide.astype(np.float64)
        apart = np.abs(wide - near) / np.spacing(near)
        sure[large] = (apart != 0.5) & (apart != 0.25)  # a quarter: below a power of two
    return quotients, sure
