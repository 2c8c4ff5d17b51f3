"""Types of parameters: widths, ranges, and what people type."""

from __future__ import annotations

import math
from typing import Any

import pytest

from multidrop.errors import ProtocolError, UsageError
from multidrop.protocols.slink3 import Format
from multidrop.protocols.slink3.values import decode_value, encode_value, parse_value, width

RANGES = [
    (Format.CHAR, -128, 127, "80", "7F"),
    (Format.SHORT_INT, -32768, 32767, "00 80", "FF 7F"),
    (Format.LONG_INT, -2147483648, 2147483647, "00 00 00 80", "FF FF FF 7F"),
    (Format.UNSIGNED_CHAR, 0, 255, "00", "FF"),
    (Format.UNSIGNED_SHORT_INT, 0, 65535, "00 00", "FF FF"),
    (Format.UNSIGNED_LONG_INT, 0, 4294967295, "00 00 00 00", "FF FF FF FF"),
]


@pytest.mark.parametrize(("type_code", "least", "most", "low", "high"), RANGES)
def test_the_range_of_a_type(type_code: Format, least: int, most: int, low: str, high: str) -> None:
    """Low byte first; one step beyond either end is refused before anything is sent."""
    for value, raw in ((least, low), (most, high)):
        assert encode_value(type_code, value) == bytes.fromhex(raw)
        assert decode_value(type_code, bytes.fromhex(raw)) == value
    for value in (least - 1, most + 1):
        with pytest.raises(UsageError, match=rf"{value} does not fit .*: {least}\.\.{most}"):
            encode_value(type_code, value)


@pytest.mark.parametrize(
    ("type_code", "value", "raw"),
    [
        (Format.BOOLEAN, True, "01"),
        (Format.BOOLEAN, False, "00"),
        (Format.BOOLEAN, 1, "01"),
        (Format.SHORT_INT, 5.0, "05 00"),
        (Format.SHORT_INT, True, "01 00"),
        (Format.FLOAT, 3.141592654, "DB 0F 49 40"),
        (Format.FLOAT, 1, "00 00 80 3F"),
        (Format.FLOAT, math.inf, "00 00 80 7F"),
        (Format.FLOAT, -math.inf, "00 00 80 FF"),
        (Format.STRING, "FX°", "46 58 B0"),
        (Format.STRING, b"\x00\x01", "00 01"),
        (Format.STRING, "", ""),
        (Format.OCTET_STRING, b"\xff", "FF"),
    ],
)
def test_values_on_the_wire(type_code: Format, value: Any, raw: str) -> None:
    assert encode_value(type_code, value) == bytes.fromhex(raw)


@pytest.mark.parametrize(
    ("type_code", "raw", "value"),
    [
        (Format.BOOLEAN, "00", False),
        (Format.BOOLEAN, "02", True),
        (Format.STRING, "46 58 B0 00 00", "FX°"),
        (Format.STRING, "00 41", "\0A"),
        (Format.STRING, "", ""),
        (Format.OCTET_STRING, "01 00", b"\x01\x00"),
        (Format.DOUBLE, "01 02", b"\x01\x02"),
        (Format.VOID, "01 02", b"\x01\x02"),
    ],
)
def test_values_from_the_wire(type_code: Format, raw: str, value: Any) -> None:
    assert decode_value(type_code, bytes.fromhex(raw)) == value


def test_nan_passes_through_unchanged() -> None:
    raw = bytes.fromhex("00 00 C0 7F")
    assert math.isnan(decode_value(Format.FLOAT, raw))  # type: ignore[arg-type]
    assert encode_value(Format.FLOAT, math.nan) == raw


@pytest.mark.parametrize(
    ("type_code", "value", "message"),
    [
        (Format.BOOLEAN, 2, "2 is not a bool"),
        (Format.BOOLEAN, "1", "'1' is not a value of type bool"),
        (Format.SHORT_INT, 1.5, "1.5 is not a whole number"),
        (Format.SHORT_INT, math.nan, "nan is not a whole number"),
        (Format.SHORT_INT, math.inf, "inf is not a whole number"),
        (Format.SHORT_INT, b"\x01\x00", "is not a value of type int16"),
        (Format.FLOAT, 1e39, "does not fit float32"),
        (Format.FLOAT, "1", "'1' is not a value of type float32"),
        (Format.STRING, "€", "'€' is not a Latin-1 character"),
        (Format.STRING, 5, "5 is not a value of type string"),
        (Format.STRING, "x" * 245, "245 characters are too many: at most 244"),
        (Format.OCTET_STRING, "x", "'x' is not a value of type bytes"),
        (Format.VOID, 1, "no value of type auto can be written"),
        (Format.DOUBLE, 1.0, "no value of type type0Fh can be written"),
    ],
)
def test_values_that_do_not_fit(type_code: Format, value: Any, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        encode_value(type_code, value)


@pytest.mark.parametrize(
    ("type_code", "size"),
    [
        (Format.BOOLEAN, 1),
        (Format.CHAR, 1),
        (Format.UNSIGNED_CHAR, 1),
        (Format.SHORT_INT, 2),
        (Format.UNSIGNED_SHORT_INT, 2),
        (Format.LONG_INT, 4),
        (Format.UNSIGNED_LONG_INT, 4),
        (Format.FLOAT, 4),
    ],
)
def test_a_value_of_the_wrong_width_is_the_slaves_error(type_code: Format, size: int) -> None:
    assert width(type_code) == size
    for wrong in (size - 1, size + 1):
        with pytest.raises(ProtocolError, match=f"has {size} bytes?, the slave sent {wrong}"):
            decode_value(type_code, bytes(wrong))


@pytest.mark.parametrize(
    "type_code", [Format.VOID, Format.STRING, Format.OCTET_STRING, Format.DOUBLE]
)
def test_types_of_any_width(type_code: Format) -> None:
    assert width(type_code) is None


@pytest.mark.parametrize(
    ("type_code", "text", "value"),
    [
        (Format.SHORT_INT, " -5 ", -5),
        (Format.SHORT_INT, "0x7F", 127),
        (Format.SHORT_INT, "-0X10", -16),
        (Format.FLOAT, "1.5", 1.5),
        (Format.FLOAT, "0x10", 16),
        (Format.FLOAT, "inf", math.inf),
        (Format.BOOLEAN, "On", True),
        (Format.BOOLEAN, "off", False),
        (Format.BOOLEAN, "true", True),
        (Format.BOOLEAN, "FALSE", False),
        (Format.BOOLEAN, " 1", True),
        (Format.BOOLEAN, "0", False),
        (Format.STRING, " as it is ", " as it is "),
        (Format.OCTET_STRING, "C8 00", b"\xc8\x00"),
        (Format.OCTET_STRING, "", b""),
    ],
)
def test_what_people_type(type_code: Format, text: str, value: Any) -> None:
    assert parse_value(type_code, text) == value


@pytest.mark.parametrize(
    ("type_code", "text", "message"),
    [
        (Format.SHORT_INT, "five", "'five' is not a whole number, decimal or 0x hex"),
        (Format.SHORT_INT, "1.5", "'1.5' is not a whole number"),
        (Format.SHORT_INT, "0xG", "'0xG' is not a whole number"),
        (Format.FLOAT, "1,5", "'1,5' is not a number, decimal or 0x hex"),
        (Format.FLOAT, "1e400", "1e400 is too large"),
        (Format.FLOAT, "-1e400", "-1e400 is too large"),
        (Format.BOOLEAN, "yes", "'yes' is not a bool"),
        (Format.OCTET_STRING, "C8 0", "'C8 0' is not hex bytes"),
    ],
)
def test_what_is_no_value(type_code: Format, text: str, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        parse_value(type_code, text)
