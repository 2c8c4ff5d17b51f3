"""Passports: a backup of all readable points of a device, as text that version control understands.

The format is TOML with one point a line; docs/reference/passport.md specifies it.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any

from multidrop.errors import UsageError
from multidrop.points import Role, Value
from multidrop.profile import nearest
from multidrop.toml_values import read_toml, toml_value

VERSION = 1
_BYTES = "bytes"
"""The type whose values have no form of their own in TOML; they are written in hex."""


@dataclass(frozen=True, slots=True)
class Entry:
    """One point as it was read. `value` is physical; `raw` as the device gave it, as text."""

    point: str
    name: str | None
    role: Role
    value: Value
    unit: str | None
    type: str
    raw: str


@dataclass(frozen=True, slots=True)
class Unread:
    """A point that could not be read, and why."""

    point: str
    name: str | None
    role: Role
    reason: str


@dataclass(frozen=True, slots=True)
class Passport:
    """What a device held at `time` (UTC). Points are keyed as their protocol's grammar writes them."""

    device: str
    profile: str
    profile_version: str
    address: int
    baud: int
    format: str
    time: datetime
    multidrop: str
    points: Mapping[str, Entry] = field(default_factory=dict)
    unreadable: Mapping[str, Unread] = field(default_factory=dict)

    def to_text(self) -> str:
        """The passport as a file has it, its checksum at the end."""
        head = [
            "# multidrop passport: all readable points of one device, one line each.",
            "# The checksum at the end finds damage; it proves no author.",
            f"passport = {VERSION}",
            f"device = {toml_value(self.device)}",
            f"profile = {toml_value(self.profile)}",
            f"profile_version = {toml_value(self.profile_version)}",
            f"address = {self.address}",
            f"baud = {self.baud}",
            f"format = {toml_value(self.format)}",
            f"time = {self.time.astimezone(UTC).strftime('%Y-%m-%dT%H:%M:%SZ')}",
            f"multidrop = {toml_value(self.multidrop)}",
        ]
        points = [_line(entry) for entry in self.points.values()]
        unreadable = [_line(unread) for unread in self.unreadable.values()]
        lines = [*head, "", "[points]", *points, "", "[unreadable]", *unreadable, ""]
        content = "\n".join(lines) + "\n"
        return f'{content}{_CHECKSUM}\nsha256 = "{_digest(content)}"\n'

    @classmethod
    def from_text(cls, text: str, file: str, *, damaged: bool = False) -> Passport:
        """Read a passport. Raises `UsageError` that names file, key and reason.

        With `damaged` a wrong checksum is let pass: somebody edited it and says so.
        One that is missing is not: what was cut short is no whole backup.
        """
        cut = re.search("^passport = ", text, re.MULTILINE) and _said_sum(text) is None
        data = read_toml(text, file, no="the file was cut short" if cut else "no passport")
        _check_version(data, file)
        _check_sum(text, file, damaged=damaged)
        return _passport(data, file)


_CHECKSUM = "[checksum]"
_HEAD: Mapping[str, type] = {
    "device": str,
    "profile": str,
    "profile_version": str,
    "address": int,
    "baud": int,
    "format": str,
    "time": datetime,
    "multidrop": str,
}
_WORDS = {str: "text", int: "whole number", datetime: "time"}


def _check_version(data: Mapping[str, Any], file: str) -> None:
    found = data.get("passport")
    if found is None:
        raise UsageError(f"{file}: no passport: it does not begin with passport = {VERSION}")
    if found != VERSION:
        raise UsageError(
            f"{file}: a passport of format {found!r}; this multidrop reads format {VERSION}"
        )


def _check_sum(text: str, file: str, *, damaged: bool) -> None:
    said = _said_sum(text)
    if said is None:
        raise UsageError(f"{file}: the checksum at the end is missing: the file was cut short")
    if said != _digest(text.rpartition(_CHECKSUM)[0]) and not damaged:
        raise UsageError(
            f"{file}: its checksum does not fit its content: it was damaged, or edited by hand"
            " (--force takes it as it is)"
        )


def _said_sum(text: str) -> str | None:
    """The checksum that stands at the end; None where none does."""
    end = text.rpartition(_CHECKSUM)[2]
    found = re.search(r'^sha256 = "([0-9a-f]{64})"\s*\Z', end, re.MULTILINE)
    return found[1] if found and end != text else None


def _digest(content: str) -> str:
    return hashlib.sha256(content.replace("\r\n", "\n").encode()).hexdigest()


# -- writing ----------------------------------------------------------------------------------


def _line(item: Entry | Unread) -> str:
    given: dict[str, Any] = {"name": item.name, "role": item.role.value}
    if isinstance(item, Entry):
        given |= {"value": item.value, "unit": item.unit, "type": item.type, "raw": item.raw}
    else:
        given["reason"] = item.reason
    inside = ", ".join(
        f"{key} = {toml_value(value)}" for key, value in given.items() if value is not None
    )
    return f"{toml_value(item.point)} = {{ {inside} }}"


# -- reading ----------------------------------------------------------------------------------


def _passport(data: dict[str, Any], file: str) -> Passport:
    head = {key: value for key, value in data.items() if key in _HEAD}
    for key, kind in _HEAD.items():
        if not isinstance(head.get(key), kind) or isinstance(head[key], bool):
            raise UsageError(f"{file}: {key} is missing or no {_WORDS[kind]}")
    if head["time"].tzinfo is None:
        raise UsageError(f"{file}: time has no zone: it ends in Z")
    known = {*_HEAD, "passport", "points", "unreadable", "checksum"}
    for key in data:
        if key not in known:
            raise UsageError(f"{file}: unknown key {key!r}{nearest(key, known)}")
    return Passport(
        **head,
        points={
            point: _entry(point, given, f"{file}: points.{point}")
            for point, given in _table(data, "points", file).items()
        },
        unreadable={
            point: _unread(point, given, f"{file}: unreadable.{point}")
            for point, given in _table(data, "unreadable", file).items()
        },
    )


def _table(data: Mapping[str, Any], key: str, file: str) -> dict[str, dict[str, Any]]:
    table = data.get(key, {})
    if not isinstance(table, dict):
        raise UsageError(f"{file}: {key} is not a table")
    for point, given in table.items():
        if not isinstance(given, dict):
            raise UsageError(f"{file}: {key}.{point} is not a table in one line")
    return table


def _entry(point: str, given: dict[str, Any], where: str) -> Entry:
    texts = _texts(given, {"type", "raw"}, {"name", "unit"}, {"role", "value"}, where)
    if "value" not in given or not isinstance(given["value"], bool | int | float | str):
        raise UsageError(f"{where}.value is missing or no value")
    value: Value = given["value"]
    if texts["type"] == _BYTES:
        try:
            value = bytes.fromhex(str(value))
        except ValueError:
            raise UsageError(f"{where}.value {value!r} is not hex") from None
    return Entry(point=point, role=_role(given, where), value=value, **texts)  # type: ignore[arg-type]


def _unread(point: str, given: dict[str, Any], where: str) -> Unread:
    texts = _texts(given, {"reason"}, {"name"}, {"role"}, where)
    return Unread(point=point, role=_role(given, where), **texts)  # type: ignore[arg-type]


def _texts(
    given: Mapping[str, Any], must: set[str], may: set[str], others: set[str], where: str
) -> dict[str, str | None]:
    """The keys that hold text; those of `may` are None where they are missing."""
    for key in given:
        if key not in must | may | others:
            raise UsageError(f"{where}: unknown key {key!r}{nearest(key, must | may | others)}")
    for key in must | may:
        if (key in must and key not in given) or not isinstance(given.get(key, ""), str):
            raise UsageError(f"{where}.{key} is missing or not text")
    return {key: given.get(key) for key in (*must, *may)}


def _role(given: Mapping[str, Any], where: str) -> Role:
    try:
        return Role(str(given.get("role")))
    except ValueError:
        roles = ", ".join(role.value for role in Role)
        raise UsageError(f"{where}.role {given.get('role')!r} is none of: {roles}") from None
