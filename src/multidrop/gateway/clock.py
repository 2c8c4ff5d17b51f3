"""Whether this machine's clock is synchronised, as the kernel knows it."""

from __future__ import annotations

import ctypes
import sys

TIMEX = 512
"""Bytes, more than the kernel's structure has on any machine."""

UNSYNCHRONISED = 5
"""What `adjtimex` returns for a clock that nobody keeps right."""


def synchronised() -> bool | None:
    """None where the system does not say."""
    if not sys.platform.startswith("linux"):
        return None
    try:
        ask = ctypes.CDLL(None).adjtimex
    except (OSError, AttributeError):
        return None
    state = ask(ctypes.create_string_buffer(TIMEX))  # all zero: it only asks
    return None if state < 0 else state != UNSYNCHRONISED
