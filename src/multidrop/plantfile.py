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

import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from multidrop.errors import UsageError
from multidrop.naming import LINE_KEYS, DeviceName
from multidrop.points import Role
from multidrop.profile import PointDescription, Profile, nearest


@dataclass(frozen=True, slots=True)
class PlantDevice:
    """A device of a plant: its name there, how the command line would name it, its profile."""

    name: str
    line: str
    device: DeviceName
    profile: Profile
    every: Mapping[str, float]  # point name -> s between readings
    behind: str | None = None  # for simulation: what is connected behind it


@dataclass(frozen=True, slots=True)
class Plant:
    """What a plant file says. `lines` is line name -> port."""

    file: str
    lines: Mapping[str, str]
    devices: Mapping[str, PlantDevice]

    def find(self, name: str) -> PlantDevice:
        """The device of this name. Raises `UsageError` with the nearest one."""
        if name not in self.devices:
            raise UsageError(
                f"{self.file} has no device {name!r}{nearest(name, self.devices)}; "
                f"it has {', '.join(self.devices) or 'none'}"
            )
        return self.devices[name]


def load_plant(path: Path, load_profile: Callable[[str], Profile]) -> Plant:
    """Read a plant file. Raises `UsageError` that names file, key and reason."""
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        raise UsageError(f"{path}: {error.strerror}") from None
    except UnicodeDecodeError:
        raise UsageError(f"{path}: not UTF-8 text") from None
    return parse_plant(text, str(path), load_profile)


def parse_plant(text: str, file: str, load_profile: Callable[[str], Profile]) -> Plant:
    """The same from text."""
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise UsageError(f"{file}: not TOML: {error}") from None
    _known(data, {"line", "profiles"}, file)
    ports: dict[str, str] = {}
    devices: dict[str, PlantDevice] = {}
    for line, entry in _tables(data.get("line", {}), f"{file}: line"):
        where = f"{file}: line.{line}"
        port = entry.get("port")
        if not isinstance(port, str):
            raise UsageError(
                f"{where}.port is missing: a device path, tcp:// or rfc2217:// address"
            )
        if port in ports.values():
            raise UsageError(f"{where}.port {port!r} is the port of another line too")
        ports[line] = port
        for name, device in _tables(entry.get("device", {}), f"{where}.device"):
            if name in devices:
                raise UsageError(f"{where}.device.{name}: there is another device of this name")
            devices[name] = _device(
                name, line, entry, device, f"{where}.device.{name}", load_profile
            )
    _addresses_differ(devices, file)
    return Plant(file, ports, devices)


def _device(
    name: str,
    line: str,
    line_entry: dict[str, Any],
    entry: dict[str, Any],
    where: str,
    load_profile: Callable[[str], Profile],
) -> PlantDevice:
    _known(entry, {"profile", "address", "points", "behind"}, where)
    address = entry.get("address")
    if not isinstance(address, int) or isinstance(address, bool):
        raise UsageError(f"{where}.address is missing or not a whole number")
    profile_name = entry.get("profile")
    if not isinstance(profile_name, str):
        raise UsageError(f"{where}.profile is missing")
    try:
        profile = load_profile(profile_name)
    except UsageError as error:
        raise UsageError(f"{where}.profile: {error}") from None
    points, every = _points(entry.get("points", {}), profile, f"{where}.points")
    options = {
        key: str(value) for key, value in line_entry.items() if key not in ("port", "device")
    }
    return PlantDevice(
        name=name,
        line=line,
        device=DeviceName(profile_name, address, line_entry["port"], options),
        profile=replace(profile, points={**points, **_without(profile.points, points)}),
        every=every,
        behind=entry.get("behind"),
    )


def _without(
    known: Mapping[str, PointDescription], named: Mapping[str, PointDescription]
) -> dict[str, PointDescription]:
    """What a profile knows besides the plant's own names, which come first."""
    return {name: item for name, item in known.items() if name not in named}


_POINT_KEYS = {"at", "every", "unit", "scale", "role", "write", "meaning"}


def _points(
    table: Any, profile: Profile, where: str
) -> tuple[dict[str, PointDescription], dict[str, float]]:
    points: dict[str, PointDescription] = {}
    every: dict[str, float] = {}
    if not isinstance(table, dict):
        raise UsageError(f"{where} is not a table")
    for name, entry in table.items():
        given = {"at": entry} if isinstance(entry, str) else entry
        if not isinstance(given, dict) or not isinstance(given.get("at"), str):
            raise UsageError(f'{where}.{name} is neither a point nor a table with at = "POINT"')
        _known(given, _POINT_KEYS, f"{where}.{name}")
        points[name] = _point(name, given, profile, f"{where}.{name}")
        every[name] = _number(given, "every", 1.0, f"{where}.{name}")
    return points, every


def _point(name: str, given: dict[str, Any], profile: Profile, where: str) -> PointDescription:
    """A point of the plant: what its profile knows of the same place, and what the plant says over it."""
    limits = given.get("write", {})
    if not isinstance(limits, dict):
        raise UsageError(f"{where}.write is not {{ min = ..., max = ... }}")
    _known(limits, {"min", "max"}, f"{where}.write")
    said: dict[str, Any] = {key: given[key] for key in ("unit", "meaning") if key in given}
    if "role" in given:
        try:
            said["role"] = Role(given["role"])
        except ValueError:
            roles = ", ".join(role.value for role in Role)
            raise UsageError(f"{where}.role {given['role']!r} is none of: {roles}") from None
    if "scale" in given:
        said["scale"] = _number(given, "scale", 1.0, where)
    for key, limit in (("min", "minimum"), ("max", "maximum")):
        if key in limits:
            said[limit] = limits[key]
    known = _known_there(given["at"], profile)
    if known is None:
        return PointDescription(name=name, at=given["at"], **said)
    at = known.at if known.name == given["at"] else given["at"]
    return replace(known, name=name, at=at, **said)


def _known_there(at: str, profile: Profile) -> PointDescription | None:
    """What the profile knows of the same place, by its name or its number: its role above all."""
    place = at.partition(":")[0].lower()
    for item in profile.points.values():
        if at == item.name or place == item.at.partition(":")[0].lower():
            return item
    return None


def _number(given: dict[str, Any], key: str, default: float, where: str) -> float:
    value = given.get(key, default)
    if not isinstance(value, int | float) or isinstance(value, bool) or value <= 0:
        raise UsageError(f"{where}.{key} is {value!r}, which is not a number above 0")
    return float(value)


def _tables(table: Any, where: str) -> list[tuple[str, dict[str, Any]]]:
    if not isinstance(table, dict):
        raise UsageError(f"{where} is not a table")
    for name, entry in table.items():
        if not isinstance(entry, dict):
            raise UsageError(f"{where}.{name} is not a table")
    return list(table.items())


def _known(table: dict[str, Any], keys: set[str], where: str) -> None:
    for key in table:
        if key not in keys:
            raise UsageError(f"{where}: unknown key {key!r}{nearest(key, keys)}")


def _addresses_differ(devices: Mapping[str, PlantDevice], file: str) -> None:
    seen: dict[tuple[str, int | None], str] = {}
    for device in devices.values():
        where = (device.line, device.device.address)
        if where in seen:
            raise UsageError(
                f"{file}: {seen[where]} and {device.name} have the same address "
                f"{device.device.address} on line {device.line}"
            )
        seen[where] = device.name


__all__ = ["LINE_KEYS", "Plant", "PlantDevice", "load_plant", "parse_plant"]
