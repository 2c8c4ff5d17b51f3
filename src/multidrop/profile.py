"""A device model as data: line settings and points, raw to physical and back.

A profile is a TOML file; `Profile.from_toml` takes its text. Every refusal
names the file, the key and the reason.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Callable
from dataclasses import dataclass, field, fields
from typing import Any, Generic, TypeVar

from multidrop.description import PointDescription, Role
from multidrop.errors import UsageError
from multidrop.toml_values import read_toml

ResultT = TypeVar("ResultT")


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
    bases: dict[str, int] = field(default_factory=dict)
    """Datalink: type of points -> memory address of the first, where the map does not say."""
    notes: str = ""
    version: str = ""
    """Of the profile itself: raised when a point changes its meaning."""
    points: dict[str, PointDescription] = field(default_factory=dict)

    @classmethod
    def from_toml(cls, text: str, file: str) -> Profile:
        """Raises `UsageError` that names `file`, the key and the reason."""
        data = read_toml(text, file)
        head = data.pop("profile", None)
        points = data.pop("points", {})
        for key in data:
            raise UsageError(f"{file}: unknown key {key!r}{nearest(key, ('profile', 'points'))}")
        if not isinstance(head, dict) or not isinstance(points, dict):
            raise UsageError(f"{file}: a [profile] table and [points.NAME] tables are expected")
        described = {
            name: described_point(name, entry, f"{file}: points.{name}")
            for name, entry in points.items()
        }
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


class OfProfile(Generic[ResultT]):
    """Something that is worked out from a profile, once for each; profiles never change."""

    MOST = 256  # profiles that are remembered

    def __init__(self, work_out: Callable[[Profile], ResultT]) -> None:
        self._work_out = work_out
        self._known: dict[int, tuple[Profile, ResultT]] = {}  # a profile has no hash, but an id

    def __call__(self, profile: Profile) -> ResultT:
        known = self._known.get(id(profile))
        if known is None:
            if len(self._known) == self.MOST:
                self._known.clear()
            known = self._known[id(profile)] = profile, self._work_out(profile)
        return known[1]


_POINT_KEYS = {item.name: item.type for item in fields(PointDescription) if item.name != "name"}


def described_point(name: str, entry: Any, where: str) -> PointDescription:
    """The point of a table as a profile has it. Raises `UsageError` that begins with `where`."""
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
    for raw in given.get("names", ()):
        if not re.fullmatch(r"-?[0-9]+", raw):
            raise UsageError(f"{where}.names: {raw!r} is not a raw value in decimal")
    return PointDescription(name=name, **given)


_TOML_TYPES: dict[str, type | tuple[type, ...]] = {
    "str": str,
    "str | None": str,
    "int | None": int,
    "float": (int, float),
    "float | None": (int, float),
    "float | str | None": (int, float, str),
    "bool": bool,
    "Role": str,
    "dict[str, int]": dict,
    "dict[str, str]": dict,
    "list[str]": list,
    "list[int]": list,
    "list[float]": list,
}

_TOML_CONTENTS: dict[str, type | tuple[type, ...]] = {
    "dict[str, int]": int,
    "dict[str, str]": str,
    "list[str]": str,
    "list[int]": int,
    "list[float]": (int, float),
}


def check_keys(table: dict[str, Any], keys: dict[str, Any], where: str) -> None:
    """Every key of a table is known and of its type, else `UsageError` with the nearest valid one."""
    for key, value in table.items():
        if key not in keys:
            raise UsageError(f"{where}: unknown key {key!r}{nearest(key, keys)}")
        expected = _TOML_TYPES[str(keys[key])]
        if not isinstance(value, expected) or (isinstance(value, bool) and expected is not bool):
            raise UsageError(f"{where}.{key} is {value!r}, which is not a {keys[key]}")
        inside = _TOML_CONTENTS.get(str(keys[key]))
        if inside is not None:
            items: Any = value.values() if isinstance(value, dict) else value
            for item in items:
                if not isinstance(item, inside) or isinstance(item, bool):
                    raise UsageError(f"{where}.{key} holds {item!r}, which makes it no {keys[key]}")


def nearest(word: str, known: Any) -> str:
    """` - did you mean 'x'?` for the nearest of the known words, or nothing."""
    found = difflib.get_close_matches(word, list(known), n=1, cutoff=0.5)
    return f" - did you mean {found[0]!r}?" if found else ""


__all__ = [
    "OfProfile",
    "PointDescription",
    "Profile",
    "check_keys",
    "described_point",
    "nearest",
]
