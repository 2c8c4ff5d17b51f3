"""Which points lie in a stretch of an instrument's memory."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from multidrop.profile import Profile
from multidrop.protocols.datalink.memory import BITS_OF_A_BYTE, END, SIZES, MemoryMap
from multidrop.protocols.datalink.points import DataPoint, Points


class Placed(NamedTuple):
    """A point, where it begins in a stretch and ends, and what people call it."""

    point: DataPoint
    start: int
    end: int
    shown: str


_WHOLE = ("B", "C", "H", "A", "F")  # types by which memory is read that no point describes


class Layout:
    """The points of a profile by their place; behind them those of its memory map.

    Of a profile that says nothing of its instrument the map is not taken for
    granted: such memory is plain memory.
    """

    def __init__(self, profile: Profile, memory_map: MemoryMap) -> None:
        """Raises `UsageError` for a point of the profile that the map does not have."""
        points = Points(profile, memory_map)
        self._map = memory_map
        self._points = points
        self._mapped = bool(profile.points or profile.dialect)
        described: dict[str, DataPoint] = {}
        for description in profile.points.values():
            (point,) = points.find(description.at)
            described.setdefault(point.text, point)  # a point may have several names
        self._described = described.values()

    def points(self, memory_address: int, count: int) -> list[Placed]:
        """The points that lie wholly in these bytes; what is left between them is plain memory.

        Of a byte of bits, those that the profile describes.
        """
        end = memory_address + count
        found = [
            point
            for point in self._described
            if memory_address <= point.memory_address and point.memory_address + point.count <= end
        ]
        covered = bytearray(count)
        for point in found:
            start = point.memory_address - memory_address
            covered[start : start + point.count] = b"\1" * point.count
        at = memory_address
        while at < end:
            size = _run(covered, at - memory_address)
            if not covered[at - memory_address]:
                found += self._undescribed(at, at + size)
            at += size
        found.sort(key=lambda point: (point.memory_address, point.bit))
        return [_placed(point, point.memory_address - memory_address) for point in found]

    def bits(self, memory_address: int, selected: int) -> list[DataPoint] | None:
        """The L points of the `selected` bits of a byte; None where it holds no such points."""
        area = self._map.areas.get("L") if self._mapped else None
        if area is None or not area.base <= memory_address < END:
            return None
        first = (memory_address - area.base) * BITS_OF_A_BYTE
        if area.points is not None and first >= area.points:
            return None
        return [
            self._points.find(f"L{first + bit}")[0]
            for bit in range(BITS_OF_A_BYTE)
            if selected >> bit & 1
        ]

    def _undescribed(self, start: int, end: int) -> Iterator[DataPoint]:
        plain = start
        at = start
        while at < end:
            point = self._by_map(at, end) if self._mapped else None
            if point is None:
                at += 1
                continue
            if plain < at:
                yield _memory(plain, at)
            yield point
            plain = at = at + point.count
        if plain < end:
            yield _memory(plain, end)

    def _by_map(self, at: int, end: int) -> DataPoint | None:
        """The point of the map that begins here and ends in time."""
        for letter in _WHOLE:
            area = self._map.areas.get(letter)
            if area is None or area.points is None or at < area.base:
                continue
            number, rest = divmod(at - area.base, SIZES[letter])
            if not rest and number < area.points and at + SIZES[letter] <= end:
                return self._points.find(f"{letter}{number}")[0]
        return None


def _placed(point: DataPoint, start: int) -> Placed:
    return Placed(point, start, start + point.count, str(point))


def _memory(start: int, end: int) -> DataPoint:
    """Plain memory, also behind its end: a question may be wrong."""
    text = f"mem/0x{start:04X}/{end - start}"
    return DataPoint(text=text, type="bytes", memory_address=start, count=end - start)


def _run(covered: bytearray, at: int) -> int:
    """How many bytes from here on are as this one."""
    size = 1
    while at + size < len(covered) and covered[at + size] == covered[at]:
        size += 1
    return size
