"""The register map of the Modbus server: which point has which registers, for good.

It is a CSV file beside the plant file. What stands in it never moves: a new point is
added at its end, a point that is gone keeps its line, and nobody else gets its registers.
"""

from __future__ import annotations

import csv
import itertools
import os
import struct
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from enum import StrEnum
from io import StringIO
from math import isfinite
from pathlib import Path

from multidrop.errors import PortError, UsageError
from multidrop.gateway.polled import target_of
from multidrop.numerals import is_digits
from multidrop.plantfile import Plant
from multidrop.points import Value
from multidrop.profile import nearest

HEAD = ("register", "type", "device", "point")
REGISTERS = 1 << 16
BLOCK = 100
"""Each device begins at a multiple of this, so that one read gets it, and it has room to grow."""


class RegisterType(StrEnum):
    """How a value stands in its registers. Two of them are one number, the high word first."""

    FLOAT32 = "float32"
    INT16 = "int16"
    UINT16 = "uint16"
    INT32 = "int32"
    UINT32 = "uint32"

    @property
    def size(self) -> int:
        """Registers."""
        return struct.calcsize(_FORMATS[self]) // 2

    def to_registers(self, value: Value) -> list[int]:
        """Raises `ValueError` for what these registers cannot hold."""
        if isinstance(value, str | bytes):
            raise ValueError("not a number")
        number = value
        if self is not RegisterType.FLOAT32:
            if not isfinite(value) or value != int(value):
                raise ValueError(f"{value} is not whole")
            number = int(value)
        try:
            raw = struct.pack(_FORMATS[self], number)
        except (struct.error, OverflowError) as error:
            raise ValueError(str(error)) from None
        return list(struct.unpack(f">{self.size}H", raw))

    def from_registers(self, registers: Iterable[int]) -> int | float:
        """A float as the shortest decimal that is the same float: 0.1, not 0.10000000149."""
        raw = struct.pack(f">{self.size}H", *registers)
        number: int | float = struct.unpack(_FORMATS[self], raw)[0]
        if isinstance(number, int) or not isfinite(number):
            return number
        for digits in range(6, 9):
            short = float(f"{number:.{digits}g}")
            if _same_float32(short, raw):
                return short
        return number


_FORMATS = {
    RegisterType.FLOAT32: ">f",
    RegisterType.INT16: ">h",
    RegisterType.UINT16: ">H",
    RegisterType.INT32: ">i",
    RegisterType.UINT32: ">I",
}


def _same_float32(number: float, raw: bytes) -> bool:
    try:
        return struct.pack(">f", number) == raw
    except OverflowError:  # rounded up beyond the largest
        return False


@dataclass(frozen=True, slots=True)
class Entry:
    """A point's place. `register` counts from 0, as in the protocol."""

    register: int
    type: RegisterType
    device: str
    point: str

    @property
    def end(self) -> int:
        """The register behind the last one."""
        return self.register + self.type.size

    @property
    def key(self) -> tuple[str, str]:
        return self.device, self.point


class RegisterMap:
    """Entries in the order of the file; none overlaps another."""

    def __init__(self, entries: Iterable[Entry] = ()) -> None:
        self.entries = tuple(entries)
        self._at = {entry.register: entry for entry in self.entries}

    def covering(self, register: int, count: int) -> list[Entry] | None:
        """The points that make up exactly these registers; None where they do not."""
        found = []
        end = register + count
        while register < end:
            entry = self._at.get(register)
            if entry is None:
                return None
            found.append(entry)
            register = entry.end
        return found if register == end else None

    def extended(self, wanted: Iterable[tuple[str, str, RegisterType]]) -> RegisterMap:
        """With these points behind what is there, where they are missing. Raises `UsageError`."""
        entries = list(self.entries)
        known = {entry.key for entry in entries}
        room = _Room(entries)
        for device, point, kind in wanted:
            if (device, point) not in known:
                entry = Entry(room.find(device, kind.size), kind, device, point)
                room.take(entry)
                entries.append(entry)
        return RegisterMap(entries)


class _Room:
    """Which registers are taken, and where the next point of a device goes."""

    def __init__(self, entries: Iterable[Entry]) -> None:
        self._taken: set[int] = set()
        self._ends: dict[str, int] = {}
        for entry in entries:
            self.take(entry)

    def take(self, entry: Entry) -> None:
        self._taken.update(range(entry.register, entry.end))
        self._ends[entry.device] = max(entry.end, self._ends.get(entry.device, 0))

    def find(self, device: str, size: int) -> int:
        """Behind the device's last register, else in a free block behind all others."""
        own = self._ends.get(device)
        if own is not None:
            place = range(own, own + size)
            if place[-1] // BLOCK == (own - 1) // BLOCK and self._taken.isdisjoint(place):
                return own
        top = max(self._ends.values(), default=0)
        first = -(-top // BLOCK) * BLOCK
        if first + size > REGISTERS:
            raise UsageError(f"the register map is full: there is no room for {device}")
        return first


def wanted_registers(plant: Plant) -> Iterator[tuple[str, str, RegisterType]]:
    """Device, point and type of each point of a plant that is a number, in the file's order."""
    for device in plant.devices.values():
        worked_out = target_of(device).device()
        for name in device.points:
            kind = register_type(worked_out.point(name).type, device.profile.points[name].scale)
            if kind is not None:
                yield device.name, name, kind


def register_type(kind: str | None, scale: float) -> RegisterType | None:
    """How a point of this type is offered; None for text. What is scaled may be a fraction."""
    if kind in ("string", "bytes"):
        return None
    if scale != 1.0:
        return RegisterType.FLOAT32
    return _OFFERED.get(kind or "", RegisterType.FLOAT32)


_OFFERED = {
    "bool": RegisterType.UINT16,
    "uint8": RegisterType.UINT16,
    "uint16": RegisterType.UINT16,
    "int8": RegisterType.INT16,
    "int16": RegisterType.INT16,
    "int32": RegisterType.INT32,
    "uint32": RegisterType.UINT32,
}


# -- the file --------------------------------------------------------------------------------


def map_of(plant: Plant, path: Path) -> tuple[RegisterMap, RegisterMap]:
    """The map as it stands in its file, and as this plant needs it. Raises `UsageError`."""
    try:
        text = path.read_text(encoding="utf-8")
    except FileNotFoundError:
        text = ""
    except (OSError, UnicodeDecodeError) as error:
        raise UsageError(f"{path}: {getattr(error, 'strerror', None) or 'not UTF-8'}") from None
    filed = parse_map(text, str(path))
    return filed, filed.extended(wanted_registers(plant))


def keep_map(plant: Plant, path: Path) -> RegisterMap:
    """The map of this plant; what is new is added to the file.

    Raises `UsageError`, and `PortError` where the disk does not take it.
    """
    filed, wanted = map_of(plant, path)
    new = wanted.entries[len(filed.entries) :]
    if new or not path.exists():
        try:
            _add(path, new)
        except OSError as error:
            raise PortError(f"{path}: {error.strerror}: the register map must be kept") from None
    return wanted


def _add(path: Path, entries: Iterable[Entry]) -> None:
    """All or nothing, also when the power fails: a line that is torn would be another register."""
    text = path.read_text(encoding="utf-8") if path.exists() else ""
    out = StringIO()
    out.write(text if not text or text.endswith("\n") else text + "\n")
    writer = csv.writer(out, lineterminator="\n")
    if not text.strip():
        writer.writerow(HEAD)
    writer.writerows((e.register, e.type.value, e.device, e.point) for e in entries)
    new = path.with_name(path.name + ".new")
    with new.open("w", encoding="utf-8") as file:
        file.write(out.getvalue())
        file.flush()
        os.fsync(file.fileno())
    new.replace(path)


def parse_map(text: str, file: str) -> RegisterMap:
    """A map from its file. Raises `UsageError` with all that is wrong with it."""
    wrong: list[str] = []
    entries: list[Entry] = []
    rows = csv.reader(StringIO(text))
    seen_head = False
    for row in rows:
        if not row or row[0].lstrip().startswith("#"):
            continue
        where = f"{file}: line {rows.line_num}"
        cells = tuple(cell.strip() for cell in row)
        if not seen_head:
            seen_head = True
            if cells != HEAD:
                wrong.append(f"{where} is not the head {','.join(HEAD)}")
                break
            continue
        entry = _entry(cells, where, wrong)
        if entry is not None:
            entries.append(entry)
    _apart(entries, file, wrong)
    if wrong:
        raise UsageError("\n".join(wrong))
    return RegisterMap(entries)


def _entry(cells: tuple[str, ...], where: str, wrong: list[str]) -> Entry | None:
    if len(cells) != len(HEAD) or not all(cells):
        wrong.append(f"{where} is not {','.join(HEAD)}")
        return None
    number, kind, device, point = cells
    if kind not in list(RegisterType):
        known = [each.value for each in RegisterType]
        wrong.append(f"{where}: there is no type {kind!r}{nearest(kind, known)}")
        return None
    found = RegisterType(kind)
    right = is_digits(number) and len(number) <= len(str(REGISTERS))
    if not right or int(number) + found.size > REGISTERS:
        wrong.append(f"{where}: {number!r} is no register for it, 0 to {REGISTERS - found.size}")
        return None
    return Entry(int(number), found, device, point)


def _apart(entries: list[Entry], file: str, wrong: list[str]) -> None:
    ordered = sorted(entries, key=lambda entry: entry.register)
    for one, other in itertools.pairwise(ordered):
        if one.end > other.register:
            wrong.append(
                f"{file}: {one.device} {one.point} at {one.register} and {other.device} "
                f"{other.point} at {other.register} overlap"
            )
    for (device, point), times in Counter(entry.key for entry in entries).items():
        if times > 1:
            wrong.append(f"{file}: {device} {point} stands there twice")
