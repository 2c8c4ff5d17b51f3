"""Values of datapoints and their bytes: B, L, C, H, A, F, and plain memory.

A value that does not fit is refused before anything is sent.
"""

from __future__ import annotations

from multidrop.errors import UsageError
from multidrop.numerals import decimal_number, whole_number
from multidrop.points import Value
from multidrop.protocols.datalink.memory import SIZES
from multidrop.protocols.datalink.reals import decode_real, encode_real

TYPE_NAMES = {
    "B": "uint8",
    "L": "bool",
    "C": "real3",
    "H": "real5",
    "A": "string",
    "F": "string",
    "mem": "bytes",
}
"""Letter of a point -> the name of its type."""

_BOOLS = {"0": False, "1": True, "false": False, "true": True, "off": False, "on": True}


def decode_value(letter: str, raw: bytes) -> Value:
    """The value of a point's bytes; a bit's are one byte, 00 or 01.

    Texts are Latin-1 without the NULs and blanks at their end.
    """
    if letter == "mem":
        return raw
    if letter == "B":
        return raw[0]
    if letter == "L":
        return raw[0] != 0
    if letter in ("C", "H"):
        return decode_real(raw)
    return raw.rstrip(b"\0 ").decode("latin-1")


def encode_value(letter: str, value: Value, count: int) -> bytes:
    """The `count` bytes of a value. Raises `UsageError` if it does not fit."""
    if letter == "mem":
        return _memory(value, count)
    if letter in ("A", "F"):
        return _text(letter, value)
    if isinstance(value, str | bytes):
        raise UsageError(f"{value!r} is not a value of type {TYPE_NAMES[letter]}")
    if letter in ("C", "H"):
        return encode_real(value, SIZES[letter])
    most = 0xFF if letter == "B" else 1
    if value not in range(most + 1):
        raise UsageError(f"{value} does not fit {TYPE_NAMES[letter]}: a whole number 0..{most}")
    return bytes((int(value),))


def _text(letter: str, value: Value) -> bytes:
    if not isinstance(value, str):
        raise UsageError(f"{value!r} is not a text")
    try:
        raw = value.encode("latin-1")
    except UnicodeEncodeError as error:
        raise UsageError(
            f"{value[error.start]!r} is not a Latin-1 character, and a text takes only those"
        ) from None
    if len(raw) > SIZES[letter]:
        raise UsageError(f"{value!r} is too long for type {letter}: {SIZES[letter]} characters")
    return raw.ljust(SIZES[letter], b"\0")


def _memory(value: Value, count: int) -> bytes:
    if not isinstance(value, bytes):
        raise UsageError(f"{value!r} are not bytes")
    if len(value) != count:
        raise UsageError(f"{len(value)} bytes do not fit a point of {count}")
    return value


def parse_value(letter: str, text: str) -> Value:
    """The value that a person typed. Raises `UsageError`.

    Numbers are decimal, whole ones also `0x` hex; bits `0 1 true false on off`; memory is hex bytes.
    """
    if letter in ("A", "F"):
        return text
    text = text.strip()
    if letter == "mem":
        try:
            return bytes.fromhex(text)
        except ValueError:
            raise UsageError(f"{text!r} is not hex bytes, such as '4B 40 08'") from None
    if letter == "L":
        if text.lower() not in _BOOLS:
            raise UsageError(f"{text!r} is not a bit: 0 or 1, false or true, off or on")
        return _BOOLS[text.lower()]
    try:
        whole = letter == "B" or "0x" in text.lower()
        return whole_number(text) if whole else decimal_number(text)
    except ValueError:
        kind = "whole number" if letter == "B" else "number"
        raise UsageError(f"{text!r} is not a {kind}") from None
