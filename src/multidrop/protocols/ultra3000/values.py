"""Values as digits: 8, 16 or 32 bits in 2, 4 or 8, most significant first; text two digits a character.

A value that does not fit is refused before anything is sent; an answer of the
wrong width is a `ProtocolError`. There is no floating point: profiles scale.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from multidrop.errors import ProtocolError, UsageError
from multidrop.numerals import decimal_number, is_digits, whole_number
from multidrop.points import Value
from multidrop.protocols.ultra3000.frame import MOST_DATA


@dataclass(frozen=True, slots=True)
class Kind:
    """A type of value: its name, its digits, whether it is signed (two's complement)."""

    name: str
    digits: int
    signed: bool = False

    @property
    def limits(self) -> tuple[int, int]:
        """The least and the greatest whole number of this type."""
        steps = 16**self.digits
        return (-steps // 2, steps // 2 - 1) if self.signed else (0, steps - 1)


INTEGERS = {
    kind.name: kind
    for kind in (
        Kind("uint8", 2),
        Kind("uint16", 4),
        Kind("uint32", 8),
        Kind("int8", 2, signed=True),
        Kind("int16", 4, signed=True),
        Kind("int32", 8, signed=True),
    )
}
VERSION = Kind("version", 4)  # major and minor number, a byte each
ACTION = Kind("action", 0)  # a write without data
HEX = Kind("hex", 0)  # a parameter that nobody describes, as wide as it comes


def string(length: int) -> Kind:
    """Text of `length` characters, NUL at the end of a shorter one."""
    return Kind("string", 2 * length)


def kinds_of(text: str | None, length: int | None) -> tuple[Kind, ...]:
    """The types that a profile's `type` names, as in `uint8` or `int16|int32`: the first is written.

    Raises `UsageError`. None gives a parameter that nobody describes.
    """
    if text is None:
        return (HEX,)
    if text == "string":
        if not length:
            raise UsageError("a string needs its length")
        return (string(length),)
    special = {kind.name: kind for kind in (VERSION, ACTION)}
    found = []
    for name in text.split("|"):
        kind = INTEGERS.get(name) or special.get(name)
        if kind is None:
            names = " ".join([*INTEGERS, *special, "string"])
            raise UsageError(f"{name!r} is no type of this protocol: {names}")
        found.append(kind)
    return tuple(found)


def decode_value(kind: Kind, data: str) -> Value:
    """The value of digits that have this type's width."""
    if kind is HEX:
        return f"0x{data}"
    if kind.name == "string":
        return bytes.fromhex(data).rstrip(b"\0 ").decode("latin-1")
    if kind is VERSION:
        return f"{int(data[:2], 16)}.{int(data[2:], 16):02}"
    value = int(data, 16)
    if kind.signed and value >= 8 * 16 ** (kind.digits - 1):
        value -= 16**kind.digits
    return value


def encode_value(kind: Kind, value: Value) -> str:
    """The digits of `value`. Raises `UsageError` if it does not fit the type."""
    if kind.name == "string":
        return _encode_text(kind, value)
    if isinstance(value, str | bytes) or kind.name not in INTEGERS:
        raise UsageError(f"{value!r} is not a value of type {kind.name}")
    if value != value or value in (float("inf"), float("-inf")) or value != int(value):
        raise UsageError(f"{value} is not a whole number, and {kind.name} takes only those")
    least, greatest = kind.limits
    if not least <= value <= greatest:
        raise UsageError(f"{value} does not fit {kind.name}: {least}..{greatest}")
    return f"{int(value) % 16**kind.digits:0{kind.digits}X}"


def _encode_text(kind: Kind, value: Value) -> str:
    if not isinstance(value, str):
        raise UsageError(f"{value!r} is not text")
    try:
        raw = value.encode("latin-1")
    except UnicodeEncodeError as error:
        raise UsageError(
            f"{value[error.start]!r} is not a Latin-1 character, and a string takes only those"
        ) from None
    length = kind.digits // 2
    if len(raw) > length:
        raise UsageError(f"{len(raw)} characters are too many: at most {length}")
    return raw.ljust(length, b"\0").hex().upper()


def encode_hex(value: Value, digits: int | None) -> str:
    """The digits of a parameter that nobody describes: `0x` hex, or a whole number.

    `digits` is the width that an answer has shown; without one, the digits must
    have been written out. Raises `UsageError`.
    """
    if isinstance(value, str):
        given = re.fullmatch(r"0[xX]([0-9a-fA-F]+)", value.strip())
        if given is None:
            raise UsageError(_ambiguous(value.strip()))
        text = given[1].upper()
    elif isinstance(value, int) and value >= 0 and digits is not None:
        text = f"{value:X}"
    else:
        raise UsageError(f"{value!r} is no value here: 0x and as many digits as the parameter has")
    if len(text) > MOST_DATA:
        raise UsageError(f"{len(text)} digits are too many: a frame takes {MOST_DATA}")
    if digits is None:
        return text
    text = text.lstrip("0").rjust(digits, "0")
    if len(text) > digits:
        raise UsageError(f"0x{text} does not fit: the parameter has {digits} digits")
    return text


def _ambiguous(text: str) -> str:
    why = "nothing is known of this parameter, so its value is 0x hex"
    if not is_digits(text):
        return f"{text!r}: {why}, such as 0x01"
    return f"{text!r}: {why}: 0x{text}, or 0x{whole_number(text):X} if it is decimal"


def kind_of_answer(kinds: tuple[Kind, ...], data: str, indexed: int | None) -> tuple[Kind, str]:
    """The type that an answer's digits have, and the value's digits.

    An array answers with the value alone, or with `indexed`, its index, in front;
    the width tells which. Raises `ProtocolError`.
    """
    front = "" if indexed is None else f"{indexed:02X}"
    if kinds[0] is HEX:
        told = front and len(data) in (6, 10) and data.startswith(front)
        return HEX, data[2:] if told else data
    for kind in kinds:
        if len(data) == kind.digits:
            return kind, data
    for kind in kinds:
        if front and len(data) == kind.digits + 2 and data.startswith(front):
            return kind, data[2:]
    widths = " or ".join(str(kind.digits) for kind in kinds)
    raise ProtocolError(f"a value of {widths} digits was expected, {len(data)} came", data.encode())


def parse_value(kind: Kind, text: str, *, scaled: bool) -> Value:
    """The value that a person typed, for this type. Numbers are decimal or `0x` hex. Raises `UsageError`."""
    if kind.name == "string" or kind in (HEX, ACTION):
        return text
    text = text.strip()
    try:
        decimal = scaled and "0x" not in text.lower()
        return decimal_number(text) if decimal else whole_number(text)
    except ValueError:
        what = "number" if scaled else "whole number"
        raise UsageError(f"{text!r} is not a {what}, decimal or 0x hex") from None
