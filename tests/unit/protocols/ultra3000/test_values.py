"""Digits and values both ways, names of functions and refusals, index digits."""

from __future__ import annotations

import pytest

from multidrop.errors import ProtocolError, UsageError
from multidrop.points import Value
from multidrop.protocols.ultra3000.messages import (
    Function,
    Refusal,
    function_name,
    index_digits,
    refusal_meaning,
)
from multidrop.protocols.ultra3000.values import (
    ACTION,
    HEX,
    INTEGERS,
    VERSION,
    decode_value,
    encode_hex,
    encode_value,
    kind_of_answer,
    kinds_of,
    parse_value,
    string,
)


@pytest.mark.parametrize(
    ("name", "value", "digits"),
    [
        ("uint8", 0, "00"),
        ("uint8", 255, "FF"),
        ("uint16", 0x200, "0200"),
        ("uint32", 100000, "000186A0"),
        ("int8", -1, "FF"),
        ("int16", -32768, "8000"),
        ("int16", 32767, "7FFF"),
        ("int32", -100000, "FFFE7960"),
        ("int32", -1, "FFFFFFFF"),
    ],
)
def test_whole_numbers(name: str, value: int, digits: str) -> None:
    assert encode_value(INTEGERS[name], value) == digits
    assert decode_value(INTEGERS[name], digits) == value


def test_text_is_padded_with_nul_and_shown_without_padding() -> None:
    kind = string(4)
    assert encode_value(kind, "#2") == "23320000"
    assert decode_value(kind, "23320000") == "#2"
    assert decode_value(kind, "23322020") == "#2"
    assert decode_value(kind, "20232020") == " #"


def test_a_version_and_a_value_that_nobody_describes() -> None:
    assert decode_value(VERSION, "0105") == "1.05"
    assert decode_value(HEX, "00F0") == "0x00F0"


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("uint8", 256, "256 does not fit uint8: 0..255"),
        ("int16", -32769, "does not fit int16"),
        ("uint8", 1.5, "not a whole number"),
        ("uint8", float("nan"), "not a whole number"),
        ("uint8", float("inf"), "not a whole number"),
        ("uint8", "x", "'x' is not a value of type uint8"),
        ("uint8", b"x", "is not a value of type uint8"),
    ],
)
def test_a_number_that_does_not_fit(name: str, value: Value, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        encode_value(INTEGERS[name], value)


def test_what_cannot_be_written() -> None:
    with pytest.raises(UsageError, match="not a value of type version"):
        encode_value(VERSION, 1)
    with pytest.raises(UsageError, match="5 characters are too many: at most 4"):
        encode_value(string(4), "abcde")
    with pytest.raises(UsageError, match="not a Latin-1 character"):
        encode_value(string(4), "a\u20ac")
    with pytest.raises(UsageError, match="1 is not text"):
        encode_value(string(4), 1)


def test_types_by_name() -> None:
    assert kinds_of(None, None) == (HEX,)
    assert kinds_of("int16|int32", None) == (INTEGERS["int16"], INTEGERS["int32"])
    assert kinds_of("action", None) == (ACTION,)
    assert kinds_of("string", 32)[0].digits == 64
    with pytest.raises(UsageError, match="needs its length"):
        kinds_of("string", None)
    with pytest.raises(UsageError, match="'float' is no type of this protocol: uint8"):
        kinds_of("float", None)


@pytest.mark.parametrize(
    ("value", "digits", "found"),
    [
        ("0x0010", 4, "0010"),
        ("0x10", 4, "0010"),
        ("0XaB", 8, "000000AB"),
        ("0x0000ab", None, "0000AB"),
        ("0x0", 2, "00"),
        (16, 4, "0010"),
    ],
)
def test_hex_of_a_width(value: Value, digits: int | None, found: str) -> None:
    assert encode_hex(value, digits) == found


@pytest.mark.parametrize(
    ("value", "digits", "message"),
    [
        (
            "16",
            4,
            "'16': nothing is known of this parameter, so its value is 0x hex: 0x16, or 0x10",
        ),
        ("1F", 4, "'1F': .* such as 0x01"),
        ("0x12345", 4, "0x12345 does not fit: the parameter has 4 digits"),
        (16, None, "16 is no value here"),
        (-1, 4, "-1 is no value here"),
        (1.5, 4, "1.5 is no value here"),
        (b"\x01", 4, "is no value here"),
    ],
)
def test_hex_that_is_refused(value: Value, digits: int | None, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        encode_hex(value, digits)


def test_an_answers_width_tells_its_type_and_an_index_in_front() -> None:
    both = kinds_of("int16|int32", None)
    assert kind_of_answer(both, "FFFF", None) == (INTEGERS["int16"], "FFFF")
    assert kind_of_answer(both, "0000FFFF", None) == (INTEGERS["int32"], "0000FFFF")
    byte = kinds_of("uint8", None)
    assert kind_of_answer(byte, "03", 7) == (INTEGERS["uint8"], "03")
    assert kind_of_answer(byte, "0703", 7) == (INTEGERS["uint8"], "03")
    for data, indexed in (("0803", 7), ("0703", None), ("070", 7), ("", None)):
        with pytest.raises(ProtocolError, match="2 digits was expected"):
            kind_of_answer(byte, data, indexed)
    with pytest.raises(ProtocolError, match="a value of 4 or 8 digits was expected, 2 came"):
        kind_of_answer(both, "00", None)


@pytest.mark.parametrize(
    ("data", "indexed", "digits"),
    [
        ("0700010203", 7, "00010203"),
        ("070102", 7, "0102"),
        ("080102", 7, "080102"),
        ("0701", 7, "0701"),
        ("070102", None, "070102"),
    ],
)
def test_an_index_in_front_of_a_value_that_nobody_describes(
    data: str, indexed: int | None, digits: str
) -> None:
    assert kind_of_answer((HEX,), data, indexed) == (HEX, digits)


def test_what_a_person_types() -> None:
    number, text = INTEGERS["int16"], string(4)
    assert parse_value(number, " -5 ", scaled=False) == -5
    assert parse_value(number, "0x10", scaled=False) == 16
    assert parse_value(number, "1.5", scaled=True) == 1.5
    assert parse_value(text, " a ", scaled=False) == " a "
    assert parse_value(HEX, "0x01", scaled=False) == "0x01"
    with pytest.raises(UsageError, match=r"'1.5' is not a whole number, decimal or 0x hex"):
        parse_value(number, "1.5", scaled=False)
    with pytest.raises(UsageError, match="'x' is not a number"):
        parse_value(number, "x", scaled=True)


def test_functions_and_refusals_have_names() -> None:
    assert function_name(Function.READ_WORKING) == "read working"
    assert function_name(0xC) == "reserved function Ch"
    assert refusal_meaning(Refusal.ABOVE_MAXIMUM) == "above the maximum"
    assert refusal_meaning(0x7F) == "unlisted refusal 7Fh"
    assert all(refusal_meaning(code) for code in Refusal)


def test_index_digits() -> None:
    assert index_digits(None) == ""
    assert index_digits(63) == "3F"
    with pytest.raises(UsageError, match="element 256"):
        index_digits(256)
