"""What a profile knows of a point: role, unit, scale, limits, names. Raw to physical and back."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from enum import StrEnum
from math import isfinite

from multidrop.errors import UsageError

Value = bool | int | float | str | bytes


def shown_value(value: Value) -> str:
    """A value for a message or a table: bytes in hex, seven digits of a float, the rest as it is."""
    if isinstance(value, bytes):
        return value.hex(" ").upper()
    return f"{value:.7g}" if isinstance(value, float) else str(value)


class Role(StrEnum):
    """What a point is for; it decides what may be repeated, restored and written over a network."""

    SETTING = "setting"
    SETPOINT = "setpoint"
    COMMAND = "command"  # moves or enables something, switches a mode or an output, resets
    MEASURED = "measured"
    IDENTITY = "identity"
    COMMUNICATION = "communication"  # address, baud, format
    UNKNOWN = "unknown"


@dataclass(frozen=True, slots=True)
class PointDescription:
    """What a profile knows of a point.

    physical value = raw value x `scale`; `minimum`, `maximum`, `default`,
    `step` and `excluded` are physical. `at` is the point in its protocol's
    grammar, with its type where the grammar has one; else `type` names it.
    """

    name: str
    at: str
    role: Role = Role.UNKNOWN
    meaning: str = ""
    unit: str | None = None
    scale: float = 1.0
    minimum: float | None = None
    maximum: float | None = None
    default: float | str | None = None
    access: str = "rw"  # r, w or rw
    source: str = ""
    note: str = ""  # where this differs from what the source prints, and why
    derived: bool = False  # no source prints the point: it follows by a rule from others
    type: str | None = None
    length: int | None = None  # characters of a text
    elements: int | None = None  # of an array, counted from 0
    step: float | None = None  # only multiples of it are values
    excluded: list[float] = field(
        default_factory=list, hash=False
    )  # values that the limits would allow
    names: dict[str, str] = field(
        default_factory=dict, hash=False
    )  # raw value, in decimal -> its name
    bits: list[str] = field(
        default_factory=list, hash=False
    )  # names from bit 0 on; "" where a bit has none
    hexadecimal: bool = False  # a code or a word of bits that manuals print in hex
    fault: int | None = None  # the bits of the raw value of which any says a fault
    functions: str = ""  # what may be asked of it, one character each, as the protocol numbers them
    refusals: list[int] = field(
        default_factory=list, hash=False
    )  # codes that the source lists for it

    def physical(self, raw: Value) -> Value:
        """The physical value of a raw one."""
        if self.scale == 1.0 or isinstance(raw, str | bytes | bool):
            return raw
        steps = round(1 / self.scale)  # a tenth is exact as a division only
        return raw / steps if steps and 1 / steps == self.scale else raw * self.scale

    def unscaled(self, value: Value, *, whole: bool = True) -> Value:
        """The raw value of a physical one, rounded to the nearest step where it must be `whole`."""
        if self.scale == 1.0 or isinstance(value, str | bytes | bool):
            return value
        if not whole:
            return value / self.scale
        if not isfinite(value):
            raise UsageError(f"{value} is no value for {self.name}")
        return round(value / self.scale)

    def check_limits(self, value: Value) -> None:
        """Raises `UsageError` where the physical value is outside what the profile allows."""
        if isinstance(value, str | bytes):
            return
        if value != value:  # NaN is neither below nor above anything
            raise UsageError(f"{value} is no value for {self.name}")
        below = self.minimum is not None and value < self.minimum
        above = self.maximum is not None and value > self.maximum
        if below or above:
            limits = f"{_limit(self.minimum)}..{_limit(self.maximum)}"
            unit = f" {self.unit}" if self.unit else ""
            raise UsageError(
                f"{shown_value(value)}{unit} is out of range for {self.name}: {limits}{unit}"
            )
        if self.step is not None and value % self.step:
            raise UsageError(
                f"{shown_value(value)} is no value for {self.name}: multiples of {self.step:g}"
            )
        if value in self.excluded:
            raise UsageError(f"{shown_value(value)} is no value for {self.name}")

    def says_fault(self, raw: Value) -> bool | None:
        """Whether a raw value says a fault; None where the point says nothing of faults."""
        if self.fault is None or isinstance(raw, str | bytes | float):
            return None
        return bool(raw & self.fault)

    def raw_of_name(self, name: str) -> int | None:
        """The raw value that has this name; case, blanks and underscores do not matter."""
        for raw, known in self.names.items():
            if _plain(known) == _plain(name):
                return int(raw)
        return None

    @property
    def has_meanings(self) -> bool:
        """Whether its raw values mean something besides themselves; those of most points do not."""
        return bool(self.names or self.bits or self.hexadecimal)

    def meaning_of(self, raw: Value) -> str | None:
        """The names of the bits that are set in a raw value, or its own, or it in hex; None if it has none."""
        if not self.has_meanings:
            return None
        if isinstance(raw, str | bytes | float):
            return None
        if self.bits:
            on = [name for bit, name in enumerate(self.bits) if name and raw >> bit & 1]
            return ", ".join(on) or "none"
        name = self.names.get(str(int(raw)))
        return f"{int(raw):04X}h" if name is None and self.hexadecimal else name


def _plain(name: str) -> str:
    return re.sub(r"[\s_]+", " ", name.strip()).lower()


def _limit(value: float | None) -> str:
    return "" if value is None else f"{value:g}"
