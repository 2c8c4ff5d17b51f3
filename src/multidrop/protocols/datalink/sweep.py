"""How a discovery finds the points of a Datalink instrument: it reads the memory, 32 bytes a message.

An instrument does not say what its memory is for. Its map does, where it is known
(map A by the byte at 8002h): then every point of the map is one. What the map
leaves out is plain memory, `mem/ADDRESS/COUNT`.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import replace

from multidrop.conversation import Conversation
from multidrop.errors import UsageError
from multidrop.numerals import whole_number
from multidrop.points import Point, PointDescription, Sample, shown_value
from multidrop.profile import Profile
from multidrop.protocols.datalink.device import DatalinkDevice, device
from multidrop.protocols.datalink.frame import MOST_DATA, Frame
from multidrop.protocols.datalink.memory import BITS_OF_A_BYTE, END, MAPS, SIZES, MemoryMap
from multidrop.protocols.datalink.points import DataPoint
from multidrop.sweeping import DISCOVERED, Discovered

RANGE = "FIRST..LAST, addresses of memory as in 0x0600..0x0EFF"
_NUMBER = r"(0[xX][0-9a-fA-F]{1,4}|[0-9]{1,5})"
_RANGE = re.compile(rf"{_NUMBER}(?:\.\.{_NUMBER})?")
_LETTERS = ("B", "L", "C", "H", "A")  # F is another view of A


class DatalinkSweep:
    """Stretches of an instrument's memory; each place is the address of one."""

    what = "stretches of memory"

    def __init__(self, device: DatalinkDevice, text: str | None) -> None:
        """Raises `UsageError` for what is no range of memory."""
        self.profile: Profile = device.profile
        self._device = device
        self._map = device.map
        self._mapped = bool(device.profile.points or device.profile.dialect)
        first, last = self._whole() if text is None else _ends(text)
        self._end = last + 1
        self.places = range(first, self._end, MOST_DATA)
        self._known = [device.point(name) for name in self.profile.points]
        self._described = {point.text for point in self._known}

    def _whole(self) -> tuple[int, int]:
        """First and last address: of the map where all of it is known, else of all memory."""
        areas = self._map.areas
        ends = [_area(self._map, letter) for letter in _LETTERS if letter in areas]
        if not self._mapped or len(ends) < len(_LETTERS) or any(end is None for end in ends):
            return 0, END - 1
        known = [end for end in ends if end is not None]
        return min(start for start, _ in known), max(end for _, end in known) - 1

    def where(self, place: int) -> str:
        return f"mem/0x{place:04X}/{self._size(place)}"

    def _size(self, place: int) -> int:
        return min(MOST_DATA, self._end - place)

    def covers(self, description: PointDescription) -> bool:
        return self.places[0] <= self._device.point(description.name).memory_address < self._end

    def begin(self) -> Conversation[Frame, None]:
        """Which map is it? One that a profile has must be the instrument's."""
        if self._mapped:
            yield from self._device.check_map()
        elif (yield from self._device.master.map_identifier()) == MAPS["map-a"].identifier:
            self._mapped = True
            self.profile = replace(self.profile, dialect="map-a")

    def look(self, place: int) -> Conversation[Frame, list[Discovered]]:
        size = self._size(place)
        memory = yield from self._device.master.interrogate(place, size)
        points = list(self._points(place, place + size))
        covered = self._of_map(place, size)
        for point in points:
            covered.update(range(point.memory_address, point.memory_address + point.count))
        for start, end in _gaps(place, place + size, covered):
            points.append(self._device.point(f"mem/0x{start:04X}/{end - start}"))
        points.sort(key=lambda point: (point.memory_address, point.bit))
        return [self._discovered(point, memory[point.memory_address - place :]) for point in points]

    def _points(self, start: int, end: int) -> Iterator[DataPoint]:
        """The points that begin here: those of the profile, and the map's others."""
        yield from (point for point in self._known if start <= point.memory_address < end)
        for letter in _LETTERS if self._mapped else ():
            area = _area(self._map, letter)
            if area is None:
                continue
            for address in range(max(start, area[0]), min(end, area[1])):
                number, rest = divmod(address - area[0], SIZES[letter])
                bits = BITS_OF_A_BYTE if letter == "L" else 1
                for text in (f"{letter}{number * bits + bit}" for bit in range(bits)):
                    if not rest and text not in self._described:
                        yield self._device.point(text)

    def _of_map(self, start: int, size: int) -> set[int]:
        """The bytes that a point of the map begins before."""
        areas = [_area(self._map, letter) for letter in _LETTERS] if self._mapped else []
        return {
            address
            for address in range(start, start + size)
            if any(area is not None and area[0] <= address < area[1] for area in areas)
        }

    def _discovered(self, point: DataPoint, memory: bytes) -> Discovered:
        """A point that the next stretch has the end of is there, and its value is not known."""
        sample = point.sample(memory) if len(memory) >= point.count else None
        note = f"it held {shown_value(sample.value)}" if sample and any(sample.raw) else ""
        return Discovered(point.description or _new(point, note), sample)

    def heard(self, point: Point, sample: Sample) -> PointDescription:
        return point.description or _new(point, "")


def _new(point: Point, note: str) -> PointDescription:
    name = point.text.replace("/", "_").lower()
    return PointDescription(name, point.text, source=DISCOVERED, note=note)


def _area(memory_map: MemoryMap, letter: str) -> tuple[int, int] | None:
    """Where the points of a type begin and end; None where that is not known."""
    area = memory_map.areas.get(letter)
    if area is None or area.points is None:
        return None
    size = area.points // BITS_OF_A_BYTE if letter == "L" else area.points * SIZES[letter]
    return area.base, area.base + size


def _gaps(start: int, end: int, covered: set[int]) -> Iterator[tuple[int, int]]:
    """The stretches between what is covered."""
    begin = None
    for address in range(start, end + 1):
        free = address < end and address not in covered
        if free and begin is None:
            begin = address
        elif not free and begin is not None:
            yield begin, address
            begin = None


def _ends(text: str) -> tuple[int, int]:
    found = _RANGE.fullmatch(text.strip())
    if found is None:
        raise UsageError(f"{text!r} is not a range of memory: {RANGE}")
    first, last = whole_number(found[1]), whole_number(found[2] or found[1])
    if last >= END:
        raise UsageError(f"{text!r} is not in memory, 0..FFFFh")
    if first > last:
        raise UsageError(f"{text!r} runs backwards")
    return first, last


def sweep(
    address: int, profile: Profile, options: Mapping[str, str], text: str | None
) -> DatalinkSweep:
    """The memory of an instrument that `text` names, all of it for None. Raises `UsageError`."""
    return DatalinkSweep(device(address, profile, options), text)


__all__ = ["RANGE", "DatalinkSweep", "sweep"]
