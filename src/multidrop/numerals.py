"""Numbers as people write them: in the digits 0 to 9, which Python alone does not insist on."""

from __future__ import annotations

from multidrop.errors import UsageError

LONGEST = 100
"""Characters; no protocol holds a number of so many digits, and Python reads 4300 at most."""


def whole_number(text: str) -> int:
    """A number, decimal or `0x` hex. Raises `ValueError` where it is none, `UsageError` where it is too long."""
    if len(text) > LONGEST:
        raise UsageError(f"{text[:20]}... is too long for a number: {len(text)} characters")
    return int(plain(text), 16 if "x" in text.lower() else 10)


def decimal_number(text: str) -> float:
    """A number with or without a fraction. Raises `ValueError` where it is none."""
    return float(plain(text))


def is_digits(text: str) -> bool:
    """Whether it is a whole number without sign, in decimal."""
    return text.isascii() and text.isdigit()


def plain(text: str) -> str:
    """The same text. Raises `ValueError` for digits of other scripts, and for underscores.

    Python reads both: an Arabic two as 2, and 1_5, a slip for 1.5, as 15.
    """
    if not text.isascii() or "_" in text:
        raise ValueError(f"invalid literal: {text!r}")
    return text
