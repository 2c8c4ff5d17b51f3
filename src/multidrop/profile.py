"""A device model as data: line settings and points, raw to physical and back.

A profile is a TOML file; `Profile.from_toml` takes its text. Every refusal
names the file, the key and the reason.
"""

from __future__ import annotations

import difflib
import tomllib
from dataclasses import dataclass, field, fields
from typing import Any

from multidrop.errors import UsageError
from multidrop.points import Role, Value


@dataclass(frozen=True, slots=True)
class PointDescription:
    """What a profile knows of a point.

    physical value = raw value x `scale`; `minimum`, `maximum` and `default`
    are physical. `at` is the point in its protocol's grammar, with its type.
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

    def physical(self, raw: Value) -> Value:
        """The physical value of a raw one."""
        if self.scale == 1.0 or isinstance(raw, str | bytes | bool):
            return raw
        return raw * self.scale

    def unscaled(self, value: Value) -> Value:
        """The raw value of a physical one, rounded to the nearest step."""
        if self.scale == 1.0 or isinstance(value, str | bytes | bool):
            return value
        return round(value / self.scale)

    def check_limits(self, value: Value) -> None:
        """Raises `UsageError` where the physical value is outside what the profile allows."""
        if isinstance(value, str | bytes):
            return
        below = self.minimum is not None and value < self.minimum
        above = self.maximum is not None and value > self.maximum
        if below or above:
            limits = f"{_limit(self.minimum)}..{_limit(self.maximum)}"
            unit = f" {self.unit}" if self.unit else ""
            raise UsageError(f"{value}{unit} is out of range for {self.name}: {limits}{unit}")


def _limit(value: float | None) -> str:
    return "" if value is None else f"{value:g}"


@dataclass(frozen=True, slots=True)
class Profile:
    """What is known of a device model. A protocol's own name is its profile with no points."""

    name: str
    protocol: str
    title: str = ""
    dialect: str | None = None
    baud: int | None = None
    format: str | None = None
    inferred: dict[str, int] = field(default_factory=dict)
    """Prefix of inferred names -> what is added to the number behind it."""
    notes: str = ""
    points: dict[str, PointDescription] = field(default_factory=dict)

    @classmethod
    def from_toml(cls, text: str, file: str) -> Profile:
        """Raises `UsageError` that names `file`, the key and the reason."""
        try:
            data = tomllib.loads(text)
        except tomllib.TOMLDecodeError as error:
            raise UsageError(f"{file}: not TOML: {error}") from None
        head = data.pop("profile", None)
        points = data.pop("points", {})
        for key in data:
            raise UsageError(f"{file}: unknown key {key!r}{nearest(key, ('profile', 'points'))}")
        if not isinstance(head, dict) or not isinstance(points, dict):
            raise UsageError(f"{file}: a [profile] table and [points.NAME] tables are expected")
        described = {name: _description(name, entry, file) for name, entry in points.items()}
        keys = {item.name: item.type for item in fields(cls) if item.name != "points"}
        check_keys(head, keys, f"{file}: profile")
        for required in ("name", "protocol"):
            if required not in head:
                raise UsageError(f"{file}: profile.{required} is missing")
        return cls(**head, points=described)

    def find(self, name: str) -> PointDescription | None:
        return self.points.get(name)

    def nearest_name(self, name: str) -> str:
        """` - did you mean 'x'?` or nothing."""
        return nearest(name, self.points)


_POINT_KEYS = {item.name: item.type for item in fields(PointDescription) if item.name != "name"}


def _description(name: str, entry: Any, file: str) -> PointDescription:
    where = f"{file}: points.{name}"
    if not isinstance(entry, dict):
        raise UsageError(f"{where} is not a table")
    check_keys(entry, _POINT_KEYS, where)
    if "at" not in entry:
        raise UsageError(f"{where}.at is missing")
    given = dict(entry)
    try:
        given["role"] = Role(entry.get("role", "unknown"))
    except ValueError:
        roles = ", ".join(role.value for role in Role)
        raise UsageError(f"{where}.role {entry['role']!r} is none of: {roles}") from None
    if given.get("access", "rw") not in ("r", "w", "rw"):
        raise UsageError(f"{where}.access {given['access']!r} is none of: r, w, rw")
    if given.get("scale", 1.0) == 0:
        raise UsageError(f"{where}.scale must not be 0")
    return PointDescription(name=name, **given)


_TOML_TYPES: dict[str, type | tuple[type, ...]] = {
    "str": str,
    "str | None": str,
    "int | None": int,
    "float": (int, float),
    "float | None": (int, float),
    "float | str | None": (int, float, str),
    "Role": str,
    "dict[str, int]": dict,
}


def check_keys(table: dict[str, Any], keys: dict[str, Any], where: str) -> None:
    """Every key of a table is known and of its type, else `UsageError` with the nearest valid one."""
    for key, value in table.items():
        if key not in keys:
            raise UsageError(f"{where}: unknown key {key!r}{nearest(key, keys)}")
        expected = _TOML_TYPES[str(keys[key])]
        if not isinstance(value, expected) or isinstance(value, bool):
            raise UsageError(f"{where}.{key} is {value!r}, which is not a {keys[key]}")


def nearest(word: str, known: Any) -> str:
    """` - did you mean 'x'?` for the nearest of the known words, or nothing."""
    found = difflib.get_close_matches(word, list(known), n=1, cutoff=0.5)
    return f" - did you mean {found[0]!r}?" if found else ""
