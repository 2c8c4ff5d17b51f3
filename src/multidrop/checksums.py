"""The checksum of each protocol, over any bytes. Each is one line of its document."""

from __future__ import annotations

from functools import reduce
from operator import xor


def xor8(data: bytes) -> int:
    """SLINK3: exclusive or of all bytes (FlexMax manual chapter 2, "vertical parity"), 0..255."""
    return reduce(xor, data, 0)


def sum8(data: bytes) -> int:
    """Datalink: the sum of all bytes modulo 256 (53SL6000 manual p. 125, LRC), 0..255."""
    return sum(data) & 0xFF


def negated_sum8(data: bytes) -> int:
    """Ultra3000: what makes the sum of all bytes 0 modulo 256 (manual page 1-2, checksum), 0..255."""
    return -sum(data) & 0xFF
