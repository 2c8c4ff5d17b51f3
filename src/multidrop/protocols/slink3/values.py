"""Types of parameters and their values: FlexMax manual (A) chapter 5, AX-V manual (B) chapter 5.

Low byte first; floats IEEE 754. A value that does not fit its type is refused
before anything is sent; a value of the wrong width from a slave is a `ProtocolError`.
"""

from __future__ import annotations

import struct
from enum import IntEnum
from math import inf

from multidrop.errors import ProtocolError, UsageError
from multidrop.numerals import decimal_number, whole_number

Value = bool | int | float | str | bytes


class Format(IntEnum):
    """The type code in bits 0-4 of FORMAT, by the names of manual A."""

    VOID = 0x00  # "generic": the slave names the type in its answer
    BOOLEAN = 0x01
    CHAR = 0x02
    SHORT_INT = 0x03
    LONG_INT = 0x04
    UNSIGNED_CHAR = 0x05
    UNSIGNED_SHORT_INT = 0x06
    UNSIGNED_LONG_INT = 0x07
    FLOAT = 0x08
    STRING = 0x09
    OCTET_STRING = 0x0A
    DOUBLE = 0x0F
    LONG_DOUBLE = 0x10

    @property
    def type_name(self) -> str:
        """The name that people write behind a point: `int16`, `auto`, ..."""
        return _TYPE_NAMES.get(self, f"type{self:02X}h")


FORMATS = {int(known): known for known in Format}
"""The types that the manual names, by their code on the wire."""

HAS_SUBINDEX = 0x80  # bit 7 of FORMAT
TYPE_BITS = 0x1F  # bits 0-4

_TYPE_NAMES = {
    Format.VOID: "auto",
    Format.BOOLEAN: "bool",
    Format.CHAR: "int8",
    Format.SHORT_INT: "int16",
    Format.LONG_INT: "int32",
    Format.UNSIGNED_CHAR: "uint8",
    Format.UNSIGNED_SHORT_INT: "uint16",
    Format.UNSIGNED_LONG_INT: "uint32",
    Format.FLOAT: "float32",
    Format.STRING: "string",
    Format.OCTET_STRING: "bytes",
}
FORMATS_BY_TYPE_NAME = {name: type_code for type_code, name in _TYPE_NAMES.items()}

_NUMBERS = {
    Format.CHAR: struct.Struct("<b"),
    Format.SHORT_INT: struct.Struct("<h"),
    Format.LONG_INT: struct.Struct("<i"),
    Format.UNSIGNED_CHAR: struct.Struct("<B"),
    Format.UNSIGNED_SHORT_INT: struct.Struct("<H"),
    Format.UNSIGNED_LONG_INT: struct.Struct("<I"),
    Format.FLOAT: struct.Struct("<f"),
}
_INTEGER_RANGES = {
    Format.CHAR: (-0x80, 0x7F),
    Format.SHORT_INT: (-0x8000, 0x7FFF),
    Format.LONG_INT: (-0x8000_0000, 0x7FFF_FFFF),
    Format.UNSIGNED_CHAR: (0, 0xFF),
    Format.UNSIGNED_SHORT_INT: (0, 0xFFFF),
    Format.UNSIGNED_LONG_INT: (0, 0xFFFF_FFFF),
}


def encode_value(type_code: Format, value: Value) -> bytes:
    """The bytes of `value` on the wire. Raises `UsageError` if it does not fit the type."""
    if type_code in (Format.STRING, Format.OCTET_STRING):
        return _encode_text(type_code, value)
    if isinstance(value, str | bytes):
        raise UsageError(f"{value!r} is not a value of type {type_code.type_name}")
    if type_code is Format.BOOLEAN:
        if value not in (0, 1):
            raise UsageError(f"{value} is not a bool: 0 or 1, false or true")
        return bytes([int(value)])
    if type_code is Format.FLOAT:
        try:
            return _NUMBERS[type_code].pack(value)
        except OverflowError:
            raise UsageError(f"{value} does not fit float32") from None
    limits = _INTEGER_RANGES.get(type_code)
    if limits is None:
        raise UsageError(f"no value of type {type_code.type_name} can be written")
    if isinstance(value, float) and not value.is_integer():
        raise UsageError(
            f"{value} is not a whole number, and {type_code.type_name} takes only those"
        )
    if not limits[0] <= value <= limits[1]:
        raise UsageError(f"{value} does not fit {type_code.type_name}: {limits[0]}..{limits[1]}")
    return _NUMBERS[type_code].pack(int(value))


def _encode_text(type_code: Format, value: Value) -> bytes:
    if isinstance(value, bytes):
        raw = value
    elif type_code is Format.STRING and isinstance(value, str):
        try:
            raw = value.encode("latin-1")
        except UnicodeEncodeError as error:
            raise UsageError(
                f"{value[error.start]!r} is not a Latin-1 character, and a string takes only those"
            ) from None
    else:
        raise UsageError(f"{value!r} is not a value of type {type_code.type_name}")
    if len(raw) > 244:
        raise UsageError(f"{len(raw)} characters are too many: at most 244")
    return raw


def decode_value(type_code: Format, raw: bytes) -> Value:
    """The value in `raw`. Raises `ProtocolError` if the width is not the type's.

    Strings are Latin-1 without the NULs at their end; a type that nobody
    documents comes back as its bytes.
    """
    number = _NUMBERS.get(type_code)
    if number is not None:
        if len(raw) != number.size:
            raise _wrong_width(type_code, number.size, raw)
        return number.unpack(raw)[0]  # type: ignore[no-any-return]
    if type_code is Format.BOOLEAN:
        if len(raw) != 1:
            raise _wrong_width(type_code, 1, raw)
        return raw[0] != 0
    if type_code is Format.STRING:
        return raw.rstrip(b"\0").decode("latin-1")
    return raw


def _wrong_width(type_code: Format, width: int, raw: bytes) -> ProtocolError:
    return ProtocolError(
        f"a value of type {type_code.type_name} has {width} byte{'s' * (width > 1)}, the slave sent {len(raw)}",
        raw,
    )


def width(type_code: Format) -> int | None:
    """Bytes of a value of this type; None where the length is free or unknown."""
    if type_code is Format.BOOLEAN:
        return 1
    number = _NUMBERS.get(type_code)
    return number.size if number is not None else None


def parse_value(type_code: Format, text: str) -> Value:
    """The value that a person typed, for this type. Raises `UsageError`.

    Numbers are decimal or `0x` hex, booleans `0 1 true false on off`, bytes are hex.
    """
    text = text.strip() if type_code is not Format.STRING else text
    if type_code is Format.STRING:
        return text
    if type_code is Format.OCTET_STRING:
        try:
            return bytes.fromhex(text)
        except ValueError:
            raise UsageError(f"{text!r} is not hex bytes, such as 'C8 00'") from None
    if type_code is Format.BOOLEAN:
        known = {"0": 0, "1": 1, "false": 0, "true": 1, "off": 0, "on": 1}
        if text.lower() not in known:
            raise UsageError(f"{text!r} is not a bool: 0 or 1, false or true, off or on")
        return bool(known[text.lower()])
    try:
        decimal = type_code is Format.FLOAT and "0x" not in text.lower()
        number = decimal_number(text) if decimal else whole_number(text)
    except ValueError:
        kind = "number" if type_code is Format.FLOAT else "whole number"
        raise UsageError(f"{text!r} is not a {kind}, decimal or 0x hex") from None
    if number in (inf, -inf) and "inf" not in text.lower():
        raise UsageError(f"{text[:20]} is too large")
    return number
