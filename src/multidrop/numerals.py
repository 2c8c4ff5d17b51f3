"""Whole numbers as people write them."""

from __future__ import annotations

from multidrop.errors import UsageError

LONGEST = 100
"""Characters; no protocol holds a number of so many digits, and Python reads 4300 at most."""


def whole_number(text: str) -> int:
    """A number, decimal or `0x` hex. Raises `ValueError` where it is none, `UsageError` where it is too long."""
    if len(text) > LONGEST:
        raise UsageError(f"{text[:20]}... is too long for a number: {len(text)} characters")
    return int(text, 16 if "x" in text.lower() else 10)
