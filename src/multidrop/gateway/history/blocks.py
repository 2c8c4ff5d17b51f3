"""A stretch of one point's samples as bytes: what the SQLite store keeps of them for good.

Pure. Layout, little endian, version 1:

    u8   1: the version
    u8   type of the steps: I or Q (32, 64 bits)
    u8   type of the values: b h i q (whole numbers of 8 to 64 bits), d (float, NaN for none), j (JSON)
    u8   1 if qualities follow, else 0: all are good
    u32  count
    zlib (count - 1 steps from one time to the next in µs; values; qualities, u8 each)

Steps and numbers are in planes: first the lowest byte of all of them, then the next.
"""

from __future__ import annotations

import json
import struct
import sys
import zlib
from array import array
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import accumulate, pairwise
from math import isnan
from types import NoneType
from typing import Any

from multidrop.gateway.history.records import EXACT, Kept, whole

VERSION = 1
HEAD = struct.Struct("<BccBI")
WHOLE = (("b", 1 << 7), ("h", 1 << 15), ("i", 1 << 31), ("q", EXACT))
"""Array types for whole numbers: from -limit to below limit."""


@dataclass(frozen=True, slots=True)
class Chunk:
    """Samples of one point and one span in order. `codes` None: all are good.

    `plain`: all values are numbers.
    """

    times: Sequence[int]
    values: Sequence[Kept]
    codes: Sequence[int] | None = None
    plain: bool = False


def encode(times: Sequence[int], values: Sequence[Kept], codes: Sequence[int]) -> bytes:
    """At least one sample. Times rise."""
    steps = [later - earlier for earlier, later in pairwise(times)]
    step_type = "I" if max(steps, default=0) < 1 << 32 else "Q"
    value_type, packed = _pack_values(values)
    marked = any(codes)
    body = _planes(array(step_type, steps)) + packed + (bytes(codes) if marked else b"")
    head = HEAD.pack(VERSION, step_type.encode(), value_type.encode(), marked, len(times))
    return head + zlib.compress(body, 1)


def decode(first: int, data: bytes) -> Chunk:
    """The samples again; `first` is the time of the first. Raises `ValueError` for other bytes."""
    try:
        version, step_type, value_type, marked, count = HEAD.unpack_from(data)
        if version != VERSION:
            raise ValueError(f"version {version} of a block is not known")
        body = zlib.decompress(data[HEAD.size :])
        steps, rest = _unplane(body, step_type.decode(), count - 1)
        codes = rest[len(rest) - count :] if marked else None
        values, plain = _unpack_values(
            rest[: len(rest) - count] if marked else rest, value_type.decode(), count
        )
    except (struct.error, zlib.error, UnicodeDecodeError) as error:
        raise ValueError(f"not a block of samples: {error}") from None
    return Chunk(list(accumulate(steps, initial=first)), values, codes, plain)


def _pack_values(values: Sequence[Kept]) -> tuple[str, bytes]:
    kinds = set(map(type, values))
    numbers: Any = values  # as their types, just found, say
    if kinds == {int}:
        largest = max(max(numbers) + 1, -min(numbers))
        for name, limit in WHOLE:
            if largest <= limit:
                return name, _planes(array(name, numbers))
    if kinds <= {int, float, NoneType}:
        floats = (float("nan") if number is None else number for number in numbers)
        return "d", _planes(array("d", floats))
    return "j", json.dumps(values, ensure_ascii=False, separators=(",", ":")).encode()


def _unpack_values(packed: bytes, value_type: str, count: int) -> tuple[Sequence[Kept], bool]:
    if value_type == "j":
        return json.loads(packed), False
    unplaned, _ = _unplane(packed, value_type, count)
    numbers = unplaned.tolist()
    if value_type != "d":
        return numbers, True
    if isnan(sum(numbers)):  # there is a NaN among them, or both infinities
        return [whole(number) for number in numbers], False
    return numbers, True


def _planes(numbers: array[int] | array[float]) -> bytes:
    if sys.byteorder == "big":
        numbers.byteswap()
    raw, size = numbers.tobytes(), numbers.itemsize
    return b"".join(raw[place::size] for place in range(size))


def _unplane(data: bytes, name: str, count: int) -> tuple[array[int], bytes]:
    """So many numbers from the front, and the rest."""
    numbers: array[int] = array(name)
    size = numbers.itemsize
    if len(data) < size * count:
        raise ValueError("a block of samples is shorter than it says")
    raw = bytearray(size * count)
    for place in range(size):
        raw[place::size] = data[place * count : (place + 1) * count]
    numbers.frombytes(raw)
    if sys.byteorder == "big":
        numbers.byteswap()
    return numbers, data[size * count :]


def quiet(codes: Sequence[int] | None) -> bool:
    """Whether all of these are good."""
    return codes is None or not any(codes)  # GOOD is 0
