"""What is wrong with a plant before anything is opened: all of it at once."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass

from multidrop.errors import UsageError
from multidrop.gateway.parts import wrong_with_parts
from multidrop.gateway.polled import polled, role_of, target_of
from multidrop.gateway.settings import CLASSES, Settings, survey_settings
from multidrop.io.connection import Target
from multidrop.io.polling import Plan, Wanted
from multidrop.io.service import settings_of_line
from multidrop.plant import Plant, PlantDevice
from multidrop.points import Role

FULLEST = 0.9
"""Share of a line that its polls may take: above it there is no room for writes and probes."""


@dataclass(frozen=True, slots=True)
class CheckedLine:
    """A line as it was reckoned. `load` is the share of its time that the polls take, 0..1."""

    name: str
    port: str
    settings: str
    devices: int
    points: int
    load: float


@dataclass(frozen=True, slots=True)
class Checked:
    """What was found. `wrong` is empty where the plant can be run."""

    lines: tuple[CheckedLine, ...]
    wrong: tuple[str, ...]


def check(plant: Plant) -> Checked:
    """Check everything that can be known without opening a port."""
    checking = _Checking(plant)
    lines = [checking.line(name) for name in plant.lines]
    checking.ports_differ()
    if not plant.lines and not plant.wrong:
        checking.wrong.append(f"{plant.file} has no lines")
    settings = survey_settings(plant)
    checking.parts(settings)
    wrong = (*plant.wrong, *settings.wrong, *checking.wrong)
    return Checked(tuple(line for line in lines if line is not None), wrong)


def demand_right(plant: Plant) -> Checked:
    """The same; raises `UsageError` with all that is wrong."""
    checked = check(plant)
    if checked.wrong:
        raise UsageError("\n".join(checked.wrong))
    return checked


class _Checking:
    def __init__(self, plant: Plant) -> None:
        self._plant = plant
        self.wrong: list[str] = []

    def line(self, name: str) -> CheckedLine | None:
        """One line; None where nothing can be reckoned."""
        where = f"{self._plant.file}: line.{name}"
        devices = self._plant.on(name)
        if not devices:
            if not any(text.startswith(where) for text in self._plant.wrong):
                self.wrong.append(f"{where} has no devices")
            return None
        targets = dict(self._targets(where, devices))
        if len(targets) < len(devices) or self._mixed(where, targets):
            return None
        first = next(iter(targets.values()))
        wanted = [
            item for device in devices for item in self._device(where, device, targets[device.name])
        ]
        plan = Plan(first.settings, wanted)
        if plan.load > FULLEST:
            self.wrong.append(
                f"{where}: its polls take {plan} of the line, and more than 90 % is too much: "
                "read fewer points, or less often"
            )
        settings = f"{first.protocol.name} {first.settings.baud} {first.settings.format}"
        return CheckedLine(
            name, first.port, settings, len(devices), sum(len(w.points) for w in wanted), plan.load
        )

    def _targets(self, where: str, devices: list[PlantDevice]) -> Iterator[tuple[str, Target]]:
        said: set[str] = set()
        for device in devices:
            try:
                target = target_of(device)
            except UsageError as error:  # a key of the line, the same for all devices
                if str(error) not in said:
                    self.wrong.append(f"{where}: {error}")
                said.add(str(error))
                continue
            try:
                target.device()
            except UsageError as error:
                self.wrong.append(f"{where}.device.{device.name}: {error}")
                continue
            yield device.name, target

    def _mixed(self, where: str, targets: dict[str, Target]) -> bool:
        """Whether the devices differ in what a line has only once."""
        (first, one), *others = targets.items()
        for name, other in others:
            if settings_of_line(other) != settings_of_line(one):
                self.wrong.append(
                    f"{where}: {first} speaks {_spoken(one)}, {name} {_spoken(other)}; "
                    "a line has one protocol, baud rate and format"
                )
                return True
        return False

    def _device(self, where: str, device: PlantDevice, target: Target) -> Iterator[Wanted]:
        where = f"{where}.device.{device.name}"
        worked_out = target.device()
        for name, every in polled(device).items():
            try:
                yield Wanted(device.name, worked_out, (worked_out.point(name),), every)
                if name in device.points:
                    self._writing(f"{where}.points.{name}", device, name, target)
            except UsageError as error:
                self.wrong.append(f"{where}.points.{name}: {error}")
        for text in device.on_fault:
            try:
                worked_out.points(text)
            except UsageError as error:
                self.wrong.append(f"{where}.on_fault: {error}")

    def _writing(self, where: str, device: PlantDevice, name: str, target: Target) -> None:
        """What may be written over a network, or raises `UsageError`."""
        point = device.points[name]
        if point.write is None:
            if point.motion:
                self.wrong.append(f"{where}.motion allows nothing: there is no write")
            return
        worked_out = target.device()
        if worked_out.point(name).type is None:
            self.wrong.append(f"{where}.write: a point that is written needs its type")
            return
        if role_of(device, name) is Role.COMMAND and not point.motion:
            self.wrong.append(
                f"{where}.write: it is a command, which may move something: it needs motion = true"
            )
        for value in (point.write.minimum, point.write.maximum):
            worked_out.prepare_write(name, value)

    def parts(self, settings: Settings) -> None:
        """What each part says of its own table, and what two of them both want."""
        file = self._plant.file
        self.wrong += [f"{file}: {text}" for text in wrong_with_parts(self._plant, settings)]
        places: dict[str, str] = {}
        for name in CLASSES:
            place = getattr(getattr(settings, name), "listen", None)
            if place is None or place.endswith(":0"):
                continue
            other = places.setdefault(place, name)
            if other != name:
                self.wrong.append(f"{file}: {name}.listen is {place!r}, and so is {other}.listen")

    def ports_differ(self) -> None:
        """Two names for one port, as a device and the link to it."""
        real: dict[str, str] = {}
        for line, port in self._plant.lines.items():
            place = port.lower() if "://" in port else os.path.realpath(port)
            other = real.setdefault(place, line)
            if other != line and port and port != self._plant.lines[other]:
                self.wrong.append(
                    f"{self._plant.file}: line.{line}.port {port!r} is the port of line "
                    f"{other}, {self._plant.lines[other]!r}"
                )


def _spoken(target: Target) -> str:
    return f"{target.protocol.name} {target.settings.baud} {target.settings.format}"
