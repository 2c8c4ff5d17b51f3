"""Reals of 3 and 5 bytes: the manuals' examples, exact reading, nearest writing, limits."""

from __future__ import annotations

from fractions import Fraction
from math import inf, ldexp, nan, nextafter

import pytest
from hypothesis import given
from hypothesis import strategies as st

from multidrop.errors import UsageError
from multidrop.protocols.datalink import decode_real, encode_real

SIZE = st.sampled_from([3, 5])

EXAMPLES = [
    ("64 00 07", 100.0),  # printed
    ("9C 00 00 00 07", -100.0),  # printed
    ("45 70 0B", 1111.0),  # printed
    ("45 70 00 00 0B", 1111.0),  # printed
    ("C0 00 01", -1.0),
    ("40 00 01", 1.0),
    ("4B 40 08", 150.5),
    ("40 00 00", 0.5),
    ("7F FF 7F", 32767 / 32768 * 2.0**127),
    ("80 01 7F", -32767 / 32768 * 2.0**127),
    ("40 00 80", 2.0**-129),
    ("C0 00 80", -(2.0**-129)),
    ("7F FF FF FF 7F", (2**31 - 1) * 2.0**96),
    ("00 00 00", 0.0),
    ("00 00 00 00 00", 0.0),
]


@pytest.mark.parametrize(("raw", "value"), EXAMPLES)
def test_examples_both_ways(raw: str, value: float) -> None:
    data = bytes.fromhex(raw)
    assert decode_real(data) == value
    assert encode_real(value, len(data)) == data


@pytest.mark.parametrize(
    ("raw", "value"),
    [
        ("00 00 07", 0.0),  # any zero mantissa
        ("00 00 80", 0.0),
        ("20 00 02", 1.0),  # not normalised
        ("80 00 00", -1.0),  # a mantissa of -1
        ("00 01 80", 2.0**-143),
        ("80 00 7F", -(2.0**127)),
    ],
)
def test_what_is_read_but_never_written(raw: str, value: float) -> None:
    assert decode_real(bytes.fromhex(raw)) == value


@pytest.mark.parametrize(
    ("value", "raw"),
    [
        (1 + 1 / 32768, "40 00 01"),  # a tie goes to the even mantissa
        (1 + 3 / 32768, "40 02 01"),
        (-(1 + 1 / 32768), "C0 00 01"),
        (nextafter(1 + 1 / 32768, 2), "40 01 01"),
        (nextafter(1.0, 0.0), "40 00 01"),  # the mantissa rounds up to 1
        (nextafter(-1.0, 0.0), "C0 00 01"),
        (nextafter(2.0**-129, 0.0), "40 00 80"),  # and into the range
        (2.0**-130, "00 00 00"),  # too small
        (-5e-324, "00 00 00"),
        (-0.0, "00 00 00"),
        (True, "40 00 01"),
        (10**30, "64 F9 64"),
    ],
)
def test_what_is_rounded(value: float, raw: str) -> None:
    assert encode_real(value, 3) == bytes.fromhex(raw)


@pytest.mark.parametrize("size", [3, 5])
@pytest.mark.parametrize(
    "value", [2.0**127, -(2.0**127), nextafter(2.0**127, 0.0), inf, -inf, nan, 10**400]
)
def test_what_does_not_fit(value: float, size: int) -> None:
    with pytest.raises(UsageError, match=f"does not fit a real of {size} bytes: under 1.701e"):
        encode_real(value, size)


@given(size=SIZE, data=st.data())
def test_a_normalised_real_comes_back_as_it_was(size: int, data: st.DataObject) -> None:
    half = 1 << 8 * (size - 1) - 2
    mantissa = data.draw(st.integers(half, 2 * half - 1)) * data.draw(st.sampled_from([1, -1]))
    exponent = data.draw(st.integers(-128, 127))
    raw = mantissa.to_bytes(size - 1, "big", signed=True) + exponent.to_bytes(1, "big", signed=True)
    assert encode_real(decode_real(raw), size) == raw


@given(size=SIZE, value=st.floats(-(2.0**126), 2.0**126, allow_nan=False))
def test_no_other_real_is_nearer(size: int, value: float) -> None:
    raw = encode_real(value, size)
    found = Fraction(decode_real(raw))
    if found == 0:
        assert abs(value) < 2.0**-129
        return
    mantissa = int.from_bytes(raw[:-1], "big", signed=True)
    exponent = int.from_bytes(raw[-1:], "big", signed=True)
    bits = 8 * (size - 1) - 1
    assert 1 << bits - 1 <= abs(mantissa) < 1 << bits
    error = abs(found - Fraction(value))
    half_step = Fraction(ldexp(0.5, exponent - bits))
    assert error <= half_step
    assert error < half_step or mantissa % 2 == 0
