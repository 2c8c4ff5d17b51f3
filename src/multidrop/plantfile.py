"""`multidrop.toml`: the lines and devices of a site.

::

    profiles = "profiles"                      # the folder of the site's own profiles
    [line.press]
    port = "/dev/serial/by-id/usb-FTDI_1234"   # and the keys of a device's name
    [line.press.device.infeed]
    profile = "flexmax"
    address = 0
    [line.press.device.infeed.points]
    speed = { at = "8237:int16", unit = "rpm" }
    torque = "8238:int16"
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from math import isfinite
from pathlib import Path
from typing import Any

from multidrop.device import misleading
from multidrop.errors import UsageError
from multidrop.naming import LINE_KEYS, DeviceName
from multidrop.plant import Limits, Plant, PlantDevice, PlantPoint
from multidrop.points import Role
from multidrop.profile import OfProfile, PointDescription, Profile, nearest
from multidrop.protocols import PROTOCOLS
from multidrop.toml_values import read_toml

TABLES = ("http", "history", "mqtt", "modbus", "faults", "passports")
"""What stands beside the lines: the parts of a gateway. `gateway/settings.py` reads them."""


DEVICE_KEYS = ("profile", "address", "points", "behind", "on_fault")
POINT_KEYS = (
    *("at", "every", "unit", "scale", "role", "meaning"),
    *("write", "motion", "deadband", "longest", "fault"),
)


LoadProfile = Callable[[str], Profile]


def load_plant(path: Path, load_profile: LoadProfile) -> Plant:
    """Read a plant file. Raises `UsageError` that names file, key and reason of all that is wrong."""
    return _right(read_plant(path, load_profile))


def parse_plant(text: str, file: str, load_profile: LoadProfile) -> Plant:
    """The same from text."""
    return _right(survey(text, file, load_profile))


def _right(plant: Plant) -> Plant:
    if plant.wrong:
        raise UsageError("\n".join(plant.wrong))
    return plant


def read_plant(path: Path, load_profile: LoadProfile) -> Plant:
    """A plant file with all that is `wrong` with it. Raises `UsageError` where it cannot be read."""
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise UsageError(f"{path}: {error.strerror}") from None
    except UnicodeDecodeError:
        raise UsageError(f"{path}: not UTF-8 text") from None
    return survey(text, str(path), load_profile)


def survey(text: str, file: str, load_profile: LoadProfile) -> Plant:
    """The same from text."""
    data = read_toml(text, file)
    reading = _Reading(file, load_profile)
    reading.lines(data)
    tables = {name: data[name] for name in TABLES if name in data}
    return Plant(file, reading.ports, reading.devices, tables, tuple(reading.wrong))


class _Reading:
    """A plant file that is being read: what was understood, and all that is wrong."""

    def __init__(self, file: str, load_profile: LoadProfile) -> None:
        self.file = file
        self.ports: dict[str, str] = {}
        self.devices: dict[str, PlantDevice] = {}
        self.wrong: list[str] = []
        self._load_profile = load_profile

    def lines(self, data: dict[str, Any]) -> None:
        self._known(data, ("line", "profiles", *TABLES), self.file)
        for line, entry in self._tables(data.get("line", {}), f"{self.file}: line"):
            where = f"{self.file}: line.{line}"
            port = entry.get("port")
            if not isinstance(port, str):
                self.wrong.append(
                    f"{where}.port is missing: a device path, tcp:// or rfc2217:// address"
                )
                port = ""
            elif port in self.ports.values():
                self.wrong.append(f"{where}.port {port!r} is the port of another line too")
            self.ports[line] = port
            for name, device in self._tables(entry.get("device", {}), f"{where}.device"):
                self._device(name, line, {**entry, "port": port}, device)
        self._addresses_differ()

    def _device(
        self, name: str, line: str, line_entry: dict[str, Any], entry: dict[str, Any]
    ) -> None:
        where = f"{self.file}: line.{line}.device.{name}"
        if name in self.devices:
            self.wrong.append(f"{where}: there is another device of this name")
        self._known(entry, DEVICE_KEYS, where)
        address = entry.get("address")
        if not isinstance(address, int) or isinstance(address, bool):
            self.wrong.append(f"{where}.address is missing or not a whole number")
            address = None
        profile = self._profile(entry.get("profile"), where)
        if profile is None or address is None or name in self.devices:
            return
        points, described = self._points(entry.get("points", {}), profile, f"{where}.points")
        options = {
            key: str(value) for key, value in line_entry.items() if key not in ("port", "device")
        }
        profile_here = replace(profile, points={**described, **_without(profile.points, described)})
        self._names_lead_there(profile_here, points, f"{where}.points")
        self.devices[name] = PlantDevice(
            name=name,
            line=line,
            device=DeviceName(entry["profile"], address, line_entry["port"], options),
            profile=profile_here,
            known=profile,
            points=points,
            on_fault=self._texts(entry.get("on_fault", []), f"{where}.on_fault"),
            behind=entry.get("behind"),
        )

    def _profile(self, name: Any, where: str) -> Profile | None:
        if not isinstance(name, str):
            self.wrong.append(f"{where}.profile is missing")
            return None
        try:
            return self._load_profile(name)
        except UsageError as error:
            self.wrong.append(f"{where}.profile: {error}")
            return None

    def _points(
        self, table: Any, profile: Profile, where: str
    ) -> tuple[dict[str, PlantPoint], dict[str, PointDescription]]:
        points: dict[str, PlantPoint] = {}
        described: dict[str, PointDescription] = {}
        if not isinstance(table, dict):
            self.wrong.append(f"{where} is not a table")
            return points, described
        for name, entry in table.items():
            given = {"at": entry} if isinstance(entry, str) else entry
            if isinstance(given, dict) and name in profile.points:
                given = {"at": name, **given}
            if not isinstance(given, dict) or not isinstance(given.get("at"), str):
                self.wrong.append(
                    f'{where}.{name} is neither a point nor a table with at = "POINT"'
                )
                continue
            self._known(given, POINT_KEYS, f"{where}.{name}")
            points[name], described[name] = self._point(name, given, profile, f"{where}.{name}")
        return points, described

    def _names_lead_there(self, profile: Profile, names: Iterable[str], where: str) -> None:
        device = PROTOCOLS[profile.protocol].device(0, profile, {})
        for name in misleading(device, names):
            self.wrong.append(
                f"{where}.{name}: {name!r} is a place of its own in this protocol, and would be "
                "read and written instead: give the point another name"
            )

    def _point(
        self, name: str, given: dict[str, Any], profile: Profile, where: str
    ) -> tuple[PlantPoint, PointDescription]:
        """What the plant says of a point, and what its profile knows of the same place with it."""
        limits = self._limits(given, f"{where}.write")
        said: dict[str, Any] = {key: given[key] for key in ("unit", "meaning") if key in given}
        role = self._role(given, where)
        if role is not None:
            said["role"] = role
        if "scale" in given:
            said["scale"] = self._number(given, "scale", 1.0, where)
        if "fault" in given:
            said["fault"] = self._mask(given["fault"], where)
        known = _known_there(given["at"], profile)
        if limits is not None:
            self._inside(limits, known, f"{where}.write")
            said.update(minimum=limits.minimum, maximum=limits.maximum)
        point = PlantPoint(
            name,
            given["at"],
            self._number(given, "every", 1.0, where),
            limits,
            self._flag(given, "motion", where),
            role,
            self._number(given, "deadband", 0.0, where, least=0.0),
            self._number(given, "longest", 1.0, where) if "longest" in given else None,
        )
        if known is None:
            return point, PointDescription(name=name, at=given["at"], **said)
        at = known.at if known.name == given["at"] else given["at"]
        return point, replace(known, name=name, at=at, **said)

    def _limits(self, given: dict[str, Any], where: str) -> Limits | None:
        """What may be written; None where nothing may, or what is said of it is wrong."""
        if "write" not in given:
            return None
        limits = given["write"]
        if not isinstance(limits, dict):
            self.wrong.append(f"{where} is not {{ min = ..., max = ... }}")
            return None
        before = len(self.wrong)
        self._known(limits, ("min", "max", "rate"), where)
        for key in ("min", "max"):
            if not _is_number(limits.get(key)):
                self.wrong.append(f"{where}.{key} is missing or not a number")
        rate = self._number(limits, "rate", 0.0, where, least=0.0)
        if len(self.wrong) > before:
            return None
        if limits["min"] > limits["max"]:
            self.wrong.append(f"{where}: min {limits['min']:g} is above max {limits['max']:g}")
            return None
        return Limits(limits["min"], limits["max"], rate)

    def _inside(self, limits: Limits, known: PointDescription | None, where: str) -> None:
        """The plant may narrow what the profile allows, not widen it."""
        if known is None:
            return
        for value in (limits.minimum, limits.maximum):
            try:
                known.check_limits(value)
            except UsageError as error:
                self.wrong.append(f"{where}: {error}")

    def _role(self, given: dict[str, Any], where: str) -> Role | None:
        if "role" not in given:
            return None
        try:
            return Role(given["role"])
        except ValueError:
            roles = ", ".join(role.value for role in Role)
            self.wrong.append(f"{where}.role {given['role']!r} is none of: {roles}")
            return None

    def _mask(self, value: Any, where: str) -> int | None:
        if not isinstance(value, int) or isinstance(value, bool) or value <= 0:
            self.wrong.append(
                f"{where}.fault is {value!r}, which is not the bits that say a fault: a whole "
                "number above 0"
            )
            return None
        return value

    def _flag(self, given: dict[str, Any], key: str, where: str) -> bool:
        value = given.get(key, False)
        if not isinstance(value, bool):
            self.wrong.append(f"{where}.{key} is {value!r}, which is neither true nor false")
        return value is True

    def _number(
        self,
        given: dict[str, Any],
        key: str,
        default: float,
        where: str,
        least: float | None = None,
    ) -> float:
        value = given.get(key, default)
        right = _is_number(value) and (value > 0 if least is None else value >= least)
        if not right:
            wanted = "a number above 0" if least is None else f"a number of {least:g} or more"
            self.wrong.append(f"{where}.{key} is {value!r}, which is not {wanted}")
            return default
        return float(value)

    def _texts(self, value: Any, where: str) -> tuple[str, ...]:
        if not isinstance(value, list) or not all(isinstance(text, str) for text in value):
            self.wrong.append(f"{where} is not a list of points")
            return ()
        return tuple(value)

    def _tables(self, table: Any, where: str) -> list[tuple[str, dict[str, Any]]]:
        if not isinstance(table, dict):
            self.wrong.append(f"{where} is not a table")
            return []
        for name, entry in table.items():
            if not isinstance(entry, dict):
                self.wrong.append(f"{where}.{name} is not a table")
        return [(name, entry) for name, entry in table.items() if isinstance(entry, dict)]

    def _known(self, table: dict[str, Any], keys: Sequence[str], where: str) -> None:
        for key in table:
            if key not in keys:
                self.wrong.append(f"{where}: unknown key {key!r}{nearest(key, keys)}")

    def _addresses_differ(self) -> None:
        seen: dict[tuple[str, int | None], str] = {}
        for device in self.devices.values():
            where = (device.line, device.device.address)
            if where in seen:
                self.wrong.append(
                    f"{self.file}: {seen[where]} and {device.name} have the same address "
                    f"{device.device.address} on line {device.line}"
                )
            seen[where] = device.name


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and isfinite(value)


def _without(
    known: Mapping[str, PointDescription], named: Mapping[str, PointDescription]
) -> dict[str, PointDescription]:
    """What a profile knows besides the plant's own names, which come first."""
    return {name: item for name, item in known.items() if name not in named}


def _known_there(at: str, profile: Profile) -> PointDescription | None:
    """What the profile knows of the same place, however that is spelled: its role above all."""
    try:
        return _speaker(profile).point(at).description
    except UsageError:  # `check` says so; here nothing is known of it
        return None


_speaker = OfProfile(lambda profile: PROTOCOLS[profile.protocol].device(0, profile, {}))
"""A device of the profile: it finds a point by its name and by its number."""


__all__ = [
    "LINE_KEYS",
    "Limits",
    "Plant",
    "PlantDevice",
    "PlantPoint",
    "load_plant",
    "parse_plant",
    "read_plant",
    "survey",
]
