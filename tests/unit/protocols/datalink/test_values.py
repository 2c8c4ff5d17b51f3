"""Values of each type and their bytes, and what people type."""

from __future__ import annotations

import pytest

from multidrop.errors import UsageError
from multidrop.points import Value
from multidrop.protocols.datalink.values import decode_value, encode_value, parse_value


@pytest.mark.parametrize(
    ("letter", "value", "raw"),
    [
        ("B", 0, "00"),
        ("B", 255, "FF"),
        ("L", True, "01"),
        ("L", False, "00"),
        ("C", 100.0, "64 00 07"),
        ("H", -100.0, "9C 00 00 00 07"),
        ("A", "FIC-101", "46 49 43 2D 31 30 31 00 00 00"),
        ("A", "0123456789", "30 31 32 33 34 35 36 37 38 39"),
        ("F", "Grün", "47 72 FC 6E 00"),
        ("F", "", "00 00 00 00 00"),
        ("mem", b"\x01\x7e", "01 7E"),
    ],
)
def test_both_ways(letter: str, value: Value, raw: str) -> None:
    data = bytes.fromhex(raw)
    assert decode_value(letter, data) == value
    assert encode_value(letter, value, len(data)) == data


@pytest.mark.parametrize(
    ("letter", "raw", "value"),
    [
        ("L", b"\x80", True),
        ("A", b"TIC 7     ", "TIC 7"),
        ("A", b"TIC\0 \0\0 \0 ", "TIC"),
        ("F", b" a\0b\0", " a\0b"),
    ],
)
def test_what_is_read_leniently(letter: str, raw: bytes, value: Value) -> None:
    assert decode_value(letter, raw) == value


@pytest.mark.parametrize(
    ("letter", "value", "message"),
    [
        ("B", 256, "256 does not fit uint8: a whole number 0..255"),
        ("B", -1, "-1 does not fit uint8"),
        ("B", 1.5, "1.5 does not fit uint8"),
        ("B", float("nan"), "nan does not fit uint8"),
        ("B", "x", "'x' is not a value of type uint8"),
        ("L", 2, "2 does not fit bool: a whole number 0..1"),
        ("L", b"\1", "is not a value of type bool"),
        ("C", 1e39, "does not fit a real of 3 bytes"),
        ("C", "7", "'7' is not a value of type real3"),
        ("H", b"1", "is not a value of type real5"),
        ("A", "01234567890", "'01234567890' is too long for type A: 10 characters"),
        ("F", "012345", "too long for type F: 5"),
        ("A", "5 €", "'€' is not a Latin-1 character"),
        ("A", 5, "5 is not a text"),
        ("mem", "01", "'01' are not bytes"),
        ("mem", b"\1", "1 bytes do not fit a point of 2"),
    ],
)
def test_what_does_not_fit(letter: str, value: Value, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        encode_value(letter, value, 2)


@pytest.mark.parametrize(
    ("letter", "text", "value"),
    [
        ("B", " 17", 17),
        ("B", "0x7E", 0x7E),
        ("L", "1", True),
        ("L", "OFF", False),
        ("C", "-1.5e2", -150.0),
        ("C", "0x10", 16),
        ("H", "7", 7.0),
        ("A", " two words", " two words"),
        ("F", "0x10", "0x10"),
        ("mem", "4b 40 08", b"\x4b\x40\x08"),
    ],
)
def test_what_people_type(letter: str, text: str, value: Value) -> None:
    assert parse_value(letter, text) == value


@pytest.mark.parametrize(
    ("letter", "text", "message"),
    [
        ("B", "1.5", "'1.5' is not a whole number"),
        ("B", "0xG", "'0xG' is not a whole number"),
        ("C", "ten", "'ten' is not a number"),
        ("L", "2", "'2' is not a bit: 0 or 1, false or true, off or on"),
        ("mem", "4b4", "'4b4' is not hex bytes"),
    ],
)
def test_what_nobody_understands(letter: str, text: str, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        parse_value(letter, text)
