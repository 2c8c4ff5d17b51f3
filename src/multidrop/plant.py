"""A plant: the lines and devices of a site, and what it wants of their points. `plantfile.py` reads it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from multidrop.errors import UsageError
from multidrop.naming import DeviceName
from multidrop.points import Role
from multidrop.profile import Profile, nearest


@dataclass(frozen=True, slots=True)
class Limits:
    """What may be written over a network: physical limits, and s between two writes at least."""

    minimum: float
    maximum: float
    rate: float = 0.0


@dataclass(frozen=True, slots=True)
class PlantPoint:
    """A point that a plant names: how often it is read, and who else may do what with it."""

    name: str
    at: str
    every: float = 1.0  # s between readings
    write: Limits | None = None  # None: nobody writes it over a network
    motion: bool = False  # writing it may move something, and is allowed to
    role: Role | None = None  # as the plant says it; None where it leaves that to the profile
    deadband: float = 0.0  # a smaller change is none, physical
    longest: float | None = None  # s after which it is recorded unchanged; None: as for all


@dataclass(frozen=True, slots=True)
class PlantDevice:
    """A device of a plant: its name there, how the command line would name it, its profile."""

    name: str
    line: str
    device: DeviceName
    profile: Profile  # with the plant's own points before its own
    known: Profile  # the same without them
    points: Mapping[str, PlantPoint]
    on_fault: tuple[str, ...] = ()  # points that are read once when it trips
    behind: str | None = None  # for simulation: what is connected behind it

    @property
    def every(self) -> dict[str, float]:
        """Point name -> s between readings."""
        return {name: point.every for name, point in self.points.items()}


@dataclass(frozen=True, slots=True)
class Plant:
    """What a plant file says. `lines` is line name -> port, `tables` the other tables as they stand.

    `wrong` is all that is wrong with the file; what could be understood is here nevertheless.
    """

    file: str
    lines: Mapping[str, str]
    devices: Mapping[str, PlantDevice]
    tables: Mapping[str, Any] = field(default_factory=dict)
    wrong: tuple[str, ...] = ()

    def find(self, name: str) -> PlantDevice:
        """The device of this name. Raises `UsageError` with the nearest one."""
        if name not in self.devices:
            raise UsageError(
                f"{self.file} has no device {name!r}{nearest(name, self.devices)}; "
                f"it has {', '.join(self.devices) or 'none'}"
            )
        return self.devices[name]

    def on(self, line: str) -> list[PlantDevice]:
        """The devices of a line."""
        return [device for device in self.devices.values() if device.line == line]
