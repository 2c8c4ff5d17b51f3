"""Where an instrument keeps its datapoints: memory maps A and B (N), and what fits one message.

A map is data: for each type its first address, the bytes from one point to the
next, and how many there are. Map A is that of the 53MC5000, 53IT5100, 53ML5100
and 53SL5100; an instrument has it if the byte at 8002h reads 6. Map B is that
of the 53SL6000, as far as it is known; nothing identifies it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol, TypeVar

from multidrop.errors import UsageError
from multidrop.protocols.datalink.frame import MOST_DATA

MAP_IDENTIFIER_AT = 0x8002
END = 0x10000  # memory addresses have 16 bits


SIZES = {"B": 1, "L": 1, "C": 3, "H": 5, "A": 10, "F": 5}
"""Bytes of one point; an L is one bit of its byte."""

BITS_OF_A_BYTE = 8


@dataclass(frozen=True, slots=True)
class Area:
    """The points of one type: the first one's address, and their number where it is known."""

    base: int
    points: int | None = None


@dataclass(frozen=True, slots=True)
class MemoryMap:
    """`identifier` is what the byte at 8002h must read; None where nothing identifies the map."""

    name: str
    identifier: int | None
    areas: Mapping[str, Area]

    def locate(self, letter: str, number: int) -> int:
        """The address of a point's first byte. Raises `UsageError` where the map has no such point."""
        area = self.areas.get(letter)
        if area is None:
            raise UsageError(
                f"{letter}{number}: where map {self.name} keeps its {letter} points is in no source;"
                f" name it in a profile (bases), or read mem/ADDRESS/COUNT"
            )
        if area.points is not None and number >= area.points:
            raise UsageError(
                f"{letter}{number}: map {self.name} has {letter}0..{letter}{area.points - 1}"
            )
        step = number // BITS_OF_A_BYTE if letter == "L" else number * SIZES[letter]
        address = area.base + step
        if address + SIZES[letter] > END:
            raise UsageError(f"{letter}{number} is behind the end of memory, FFFFh")
        return address

    def with_bases(self, bases: Mapping[str, int]) -> MemoryMap:
        """The same map with other first addresses, as a profile gives them. Raises `UsageError`."""
        areas = dict(self.areas)
        for letter, base in bases.items():
            if letter not in SIZES or not 0 <= base < END:
                raise UsageError(f"bases: {letter} = {base} is not a type B L C H A F at 0..FFFFh")
            areas[letter] = Area(base)
        return replace(self, areas=areas)


MAP_A = MemoryMap(
    name="A",
    identifier=6,
    areas={  # the numbers of points are the 53MC5000's
        "B": Area(0x200, 768),
        "L": Area(0x500, 2048),
        "C": Area(0x600, 768),
        "H": Area(0xF00, 128),
        "A": Area(0x1400, 320),
        "F": Area(0x1400, 640),  # laid over A
    },
)
MAP_B = MemoryMap(
    name="B",
    identifier=None,
    areas={
        "H": Area(0x9CF, 5),  # the sixth would lie on A0
        "A": Area(0x9E8),
        "F": Area(0x9E8),
    },
)
MAPS = {"map-a": MAP_A, "map-b": MAP_B}
"""A profile's dialect -> its map."""


class Stretch(Protocol):
    """Something that lies in memory: `count` bytes from `memory_address` on."""

    @property
    def memory_address(self) -> int: ...
    @property
    def count(self) -> int: ...


StretchT = TypeVar("StretchT", bound=Stretch)


def plan(points: Iterable[StretchT]) -> list[tuple[StretchT, ...]]:
    """Points in groups that one message reads each, by address; a larger one stands alone.

    Bytes between two points of a group are read along: they cost less than
    another message.
    """
    groups: list[list[StretchT]] = []
    for point in sorted(points, key=lambda point: point.memory_address):
        if (
            groups
            and point.memory_address + point.count - groups[-1][0].memory_address <= MOST_DATA
        ):
            groups[-1].append(point)
        else:
            groups.append([point])
    return [tuple(group) for group in groups]


def span(points: Sequence[Stretch]) -> tuple[int, int]:
    """The address and the number of bytes that a group covers."""
    if len(points) == 1:
        return points[0].memory_address, points[0].count
    start = min(point.memory_address for point in points)
    return start, max(point.memory_address + point.count for point in points) - start


def pieces(memory_address: int, count: int) -> list[tuple[int, int]]:
    """Address and size of each message that reads `count` bytes. Raises `UsageError`."""
    if count < 1:
        raise UsageError(f"{count} bytes of memory cannot be read: at least 1")
    if not 0 <= memory_address < END or memory_address + count > END:
        raise UsageError(f"{count} bytes from {memory_address:04X}h on are not in memory, 0..FFFFh")
    if count <= MOST_DATA:
        return [(memory_address, count)]
    end = memory_address + count
    return [(at, min(MOST_DATA, end - at)) for at in range(memory_address, end, MOST_DATA)]
