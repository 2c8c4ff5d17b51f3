"""How a Datalink point is written: `C103`, `C103..C105`, `mem/0x1000/9`, or a name."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace

from multidrop.errors import UsageError
from multidrop.numerals import whole_number
from multidrop.points import Point, Sample, Value
from multidrop.profile import PointDescription, Profile
from multidrop.protocols.datalink.memory import BITS_OF_A_BYTE, SIZES, MemoryMap, pieces
from multidrop.protocols.datalink.values import TYPE_NAMES, decode_value

GRAMMAR = (
    "B12, L14, C103, H0, A8 or F3, a range as in C103..C105, "
    "mem/ADDRESS/COUNT as in mem/0x1000/9, or a name of the profile"
)

_NUMBER = r"(0[xX][0-9a-fA-F]{1,8}|[0-9]{1,8})"
_POINT = re.compile(r"([BLCHAFblchaf])([0-9]{1,8})")
_MEMORY = re.compile(rf"mem/{_NUMBER}/{_NUMBER}")
_NAME = re.compile(r"[A-Za-z_][\w-]*")


@dataclass(frozen=True, slots=True)
class DataPoint(Point):
    """`count` bytes from `memory_address` on, read as the type `letter`: B L C H A F, or mem.

    `bit` is the bit of an L in its byte, 0 the lowest.
    """

    letter: str = "mem"
    memory_address: int = 0
    count: int = 1
    bit: int = 0

    @property
    def mapped(self) -> bool:
        """Whether a memory map gave the address."""
        return self.letter != "mem"

    def sample(self, memory: bytes) -> Sample:
        """The value in `memory`, which begins with this point's bytes."""
        raw = memory[: self.count]
        if self.letter == "L":
            raw = bytes((raw[0] >> self.bit & 1,))
        return Sample(decode_value(self.letter, raw), TYPE_NAMES[self.letter], raw)

    def unscaled(self, physical: Value) -> Value:
        """The value as the instrument holds it, by the profile's scale."""
        if self.description is None:
            return physical
        return self.description.unscaled(physical, whole=self.letter not in ("C", "H"))


class Points:
    """The points of an instrument: those of its profile by name, all of its memory map by number."""

    def __init__(self, profile: Profile, memory_map: MemoryMap) -> None:
        """Raises `UsageError` for a point of the profile whose `at` is not the grammar's."""
        self._profile = profile
        self._map = memory_map
        self._described: dict[str, PointDescription] = {}
        for description in profile.points.values():
            text = canonical(description.at)
            if text is None:
                raise UsageError(
                    f"point {description.name}: at = {description.at!r} is not {GRAMMAR}"
                )
            self._described.setdefault(text, description)

    def find(self, text: str) -> list[DataPoint]:
        """The points that `text` names, several for a range.

        Raises `UsageError` with the grammar, the nearest name, or what the map has.
        """
        text = text.strip()
        first, dots, last = text.partition("..")
        if dots:
            letter, start, end = _range(first, last, text)
            return [self._point(f"{letter}{number}") for number in range(start, end + 1)]
        known = canonical(text)
        if known is not None:
            return [self._point(known)]
        if _NAME.fullmatch(text) is None:
            raise UsageError(f"{text!r} is not a point: {GRAMMAR}")
        description = self._profile.find(text)
        if description is None:
            raise UsageError(
                f"{self._profile.name} has no point {text!r}{self._profile.nearest_name(text)};"
                f" a point is {GRAMMAR}"
            )
        known = canonical(description.at)
        assert known is not None
        return [replace(self._point(known), description=description)]

    def has(self, text: str) -> bool:
        """Whether the profile describes the point of this canonical text."""
        return text in self._described

    def _point(self, text: str) -> DataPoint:
        """The point of a canonical text."""
        letter, number, count = _parts(text)
        bit = 0
        if letter == "mem":
            address = number
            pieces(address, count)
        else:
            address = self._map.locate(letter, number)
            bit = number % BITS_OF_A_BYTE if letter == "L" else 0
        return DataPoint(
            text=text,
            type=TYPE_NAMES[letter],
            description=self._described.get(text),
            letter=letter,
            memory_address=address,
            count=count,
            bit=bit,
        )


def canonical(text: str) -> str | None:
    """`c0103` as `C103`, `mem/4096/9` as `mem/0x1000/9`; None for anything else."""
    found = _POINT.fullmatch(text)
    if found is not None:
        return f"{found[1].upper()}{int(found[2])}"
    found = _MEMORY.fullmatch(text)
    if found is not None:
        return f"mem/0x{whole_number(found[1]):04X}/{whole_number(found[2])}"
    return None


def _parts(text: str) -> tuple[str, int, int]:
    """Letter, number or memory address, and bytes of a canonical text."""
    if text.startswith("mem/"):
        _, address, count = text.split("/")
        return "mem", int(address, 16), int(count)
    return text[0], int(text[1:]), SIZES[text[0]]


def _range(first_text: str, last_text: str, text: str) -> tuple[str, int, int]:
    """Letter, first and last number."""
    first, last = canonical(first_text), canonical(last_text)
    if first is None or last is None or first[0] != last[0] or first[0] == "m":
        raise UsageError(f"{text!r} is not a range of one type, as in C103..C105")
    start, end = int(first[1:]), int(last[1:])
    if start > end:
        raise UsageError(f"{text!r} runs backwards")
    return first[0], start, end
