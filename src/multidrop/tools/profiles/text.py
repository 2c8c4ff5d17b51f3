"""Profiles as TOML files: written whole, and a point put into one that people edit too."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import MISSING, fields
from enum import Enum
from typing import Any

from multidrop.errors import UsageError
from multidrop.profile import PointDescription, Profile
from multidrop.toml_values import toml_key, toml_table, toml_value


def toml_text(profile: Profile, comment: str = "") -> str:
    """The profile as a file: what is as it would be anyway is left away; one line a point."""
    lines = [f"# {line}".rstrip() for line in comment.splitlines()]
    lines.append("[profile]")
    lines += [f"{key} = {toml_value(value)}" for key, value in said(profile).items()]
    if profile.points:
        lines += ["", "[points]"]
        lines += [point_line(point) for point in profile.points.values()]
    return "\n".join(lines) + "\n"


def point_line(point: PointDescription) -> str:
    """A point as a line of `[points]`."""
    return f"{toml_key(point.name)} = {toml_table(said_of_point(point))}"


def said(profile: Profile) -> dict[str, Any]:
    """The keys of `[profile]` that are not as they would be anyway."""
    return _said(profile, ("points",))


def said_of_point(point: PointDescription) -> dict[str, Any]:
    """The same of a point's table; `described_point` reads it."""
    return _said(point, ("name",))


def _said(described: Profile | PointDescription, without: tuple[str, ...]) -> dict[str, Any]:
    found = {}
    for item in fields(described):
        value = getattr(described, item.name)
        made = item.default_factory
        usual = item.default if made is MISSING else made()
        if item.name not in without and value != usual:
            found[item.name] = value.value if isinstance(value, Enum) else value
    return found


def with_points(
    text: str, file: str, points: Mapping[str, PointDescription], instead_of: Mapping[str, str]
) -> str:
    """A profile's text with more points, each in the place of another where one is named.

    `instead_of` is the name of a point -> the name of that which it replaces.
    What else the file holds stays as it is, comments too; only a point that
    stands in a table of its own, `[points.NAME]`, makes the file be written anew.
    Raises `UsageError` where the file is no profile, or has another point of a name.
    """
    before = Profile.from_toml(text, file)
    wanted = dict(before.points)
    for name, point in points.items():
        old = instead_of.get(name)
        if name in wanted and name != old:
            raise UsageError(f"{file}: points.{name}: there is a point of this name")
        if old is None:
            wanted[name] = point
        else:
            wanted = {
                (name if key == old else key): (point if key == old else known)
                for key, known in wanted.items()
            }
    edited = text.rstrip("\n") + "\n"
    for name, point in points.items():
        edited = _edited(edited, point, instead_of.get(name))
    after = Profile(**{**_fields(before), "points": wanted})
    try:
        if Profile.from_toml(edited, file) == after:
            return edited
    except UsageError:
        pass
    return toml_text(after)


def _fields(profile: Profile) -> dict[str, Any]:
    return {item.name: getattr(profile, item.name) for item in fields(profile)}


def _edited(text: str, point: PointDescription, old: str | None) -> str:
    if old is not None:
        whole = rf"^{re.escape(toml_key(old))}[ \t]*=[ \t]*\{{.*\}}([ \t]*(?:#.*)?)$"
        line = re.compile(whole, re.MULTILINE)
        return line.sub(lambda found: point_line(point) + found[1], text, count=1)
    if re.search(r"^\[points\][ \t]*$", text, re.MULTILINE) is None:
        return f"{text}\n[points]\n{point_line(point)}\n"
    head, points, rest = re.split(r"(^\[points\][ \t]*\n)", text, maxsplit=1, flags=re.MULTILINE)
    table = re.search(r"^\[", rest, re.MULTILINE)  # what comes behind the inline points
    at = table.start() if table else len(rest)
    inside = rest[:at].rstrip("\n")
    inside = f"{inside}\n" if inside else ""
    behind = f"\n{rest[at:]}" if table else ""
    return f"{head}{points}{inside}{point_line(point)}\n{behind}"
