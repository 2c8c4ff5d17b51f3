"""The checksum of each protocol, over any bytes. Each is one line of its document."""

from __future__ import annotations

from functools import reduce
from operator import xor


def xor8(data: bytes) -> int:
    """SLINK3: exclusive or of all bytes (FlexMax manual chapter 2, "vertical parity"), 0..255."""
    return reduce(xor, data, 0)
