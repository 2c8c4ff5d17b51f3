"""Profiles as tables for spreadsheets: what these write is read, and what they would spoil is marked.

The first rows hold what is said of the profile (`profile.name`, `profile.protocol`, ...),
then a row of headings, then a row for each point; docs/howto/discover.md shows one.

Text that a spreadsheet would take for a number or a formula has an apostrophe in
front, as in `'8E1`; a list's items stand between bars, a table's as `raw=name`.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

from multidrop.errors import UsageError
from multidrop.numerals import decimal_number
from multidrop.profile import PointDescription, Profile, check_keys, described_point, nearest
from multidrop.tools.profiles.text import said, said_of_point

POINT_TYPES = {item.name: str(item.type) for item in fields(PointDescription)}
HEAD_TYPES = {item.name: str(item.type) for item in fields(Profile) if item.name != "points"}
HEAD = "profile."
DELIMITERS = (",", ";", "\t")

_TRUE = {"yes", "true", "1", "x", "wahr", "ja", "vrai", "oui"}
_FALSE = {"no", "false", "0", "falsch", "nein", "faux", "non"}
_NUMBER = re.compile(r"[+-]?([0-9]+([.,][0-9]*)?|[.,][0-9]+)([eE][+-]?[0-9]+)?").fullmatch
_PLAIN = re.compile(r"0|[1-9][0-9]{0,14}").fullmatch  # what a spreadsheet gives back as it is


# -- writing ----------------------------------------------------------------------------------


def csv_text(profile: Profile, *, semicolons: bool = False) -> str:
    """The profile as a table; with `semicolons` also decimal commas, as half of Europe has them."""
    file = io.StringIO()
    writer = csv.writer(file, delimiter=";" if semicolons else ",")
    comma = "," if semicolons else "."
    for key, value in said(profile).items():
        writer.writerow([f"{HEAD}{key}", _cell(value, HEAD_TYPES[key], comma)])
    writer.writerow([])
    tables = [{"name": point.name, **said_of_point(point)} for point in profile.points.values()]
    columns = [
        key
        for key in POINT_TYPES
        if key in ("name", "at", "role", "meaning", "unit") or any(key in item for item in tables)
    ]
    writer.writerow(columns)
    for item in tables:
        writer.writerow(
            _cell(item[key], POINT_TYPES[key], comma) if key in item else "" for key in columns
        )
    return file.getvalue()


def _cell(value: Any, kind: str, comma: str) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int | float):
        return repr(value).replace(".", comma)
    if isinstance(value, Mapping):
        text = " | ".join(f"{key}={_escaped(str(item))}" for key, item in value.items())
    elif isinstance(value, list):
        items = (repr(item).replace(".", comma) if kind != "list[str]" else item for item in value)
        text = " | ".join(_escaped(item) for item in items)
    else:
        text = value
    ambiguous = kind == "float | str | None" and _NUMBER(text) is not None
    return f"'{text}" if ambiguous or _would_be_spoiled(text) else text


def _would_be_spoiled(text: str) -> bool:
    if text != text.strip() or not text:
        return True
    return text[0] in "=+-@'" or (_NUMBER(text) is not None and _PLAIN(text) is None)


def _escaped(item: str) -> str:
    return item.replace("\\", "\\\\").replace("|", "\\|")


# -- reading ----------------------------------------------------------------------------------


def decoded(data: bytes, file: str) -> str:
    """A table's bytes as text: UTF-8, UTF-16 with its mark, or the Windows code page 1252."""
    marked = data[:2] in (b"\xff\xfe", b"\xfe\xff")
    for encoding in ("utf-16",) if marked else ("utf-8-sig", "cp1252"):
        try:
            text = data.decode(encoding)
        except UnicodeDecodeError:
            continue
        if "\0" not in text:
            return text
    raise UsageError(f"{file}: no text: save it as CSV UTF-8")


@dataclass(frozen=True, slots=True)
class _Cell:
    """What stands in a cell, and where that is."""

    text: str
    where: str
    comma: bool  # whether numbers may have a decimal comma


def from_csv(text: str, file: str, defaults: Mapping[str, Any] | None = None) -> Profile:
    """The profile in a table. Raises `UsageError` that names file, row, column and reason.

    `defaults` are keys of `[profile]` for what the table does not say.
    """
    rows, delimiter = _rows(text, file)
    heading = next(
        (number for number, row in enumerate(rows) if {"name", "at"} <= set(_lower(row))), None
    )
    if heading is None:
        raise UsageError(
            f"{file}: no row has the headings 'name' and 'at'; a list needs these two at least"
        )
    comma = delimiter != ","
    head = {**(defaults or {}), **_head(rows[:heading], file, comma)}
    check_keys(head, HEAD_TYPES, f"{file}: profile")
    for key in ("name", "protocol"):
        if key not in head:
            raise UsageError(
                f"{file}: profile.{key} is not said: a row '{HEAD}{key}' above the headings says it"
            )
    points: dict[str, PointDescription] = {}
    seen: dict[str, int] = {}
    columns = _columns(rows[heading], heading + 1, file)
    for number, row in _filled(rows[heading + 1 :], heading + 2):
        point = _point(columns, row, f"{file}: row {number}", comma)
        if point.name in seen:
            raise UsageError(
                f"{file}: row {number}: row {seen[point.name]} has the name {point.name!r} too"
            )
        seen[point.name] = number
        points[point.name] = point
    return Profile(**head, points=points)


def _rows(text: str, file: str) -> tuple[list[list[str]], str]:
    """The rows, and what is between their cells: whatever gives a row of headings."""
    told = re.match(r"\s*sep=(.)\r?\n", text)
    candidates = (told[1],) if told else DELIMITERS
    body = "\n" + text[told.end() :] if told else text  # row numbers stay as they are
    best: tuple[list[list[str]], str] = ([], candidates[0])
    for delimiter in candidates:
        try:
            rows = list(csv.reader(io.StringIO(body, newline=""), delimiter=delimiter))
        except csv.Error as error:
            raise UsageError(f"{file}: no table: {error}") from None
        if any({"name", "at"} <= set(_lower(row)) for row in rows):
            return rows, delimiter
        best = best if best[0] else (rows, delimiter)
    return best


def _lower(row: Sequence[str]) -> list[str]:
    return [cell.strip().lower() for cell in row]


def _filled(rows: Sequence[list[str]], first: int) -> Iterator[tuple[int, list[str]]]:
    for number, row in enumerate(rows, first):
        if any(cell.strip() for cell in row):
            yield number, row


def _head(rows: Sequence[list[str]], file: str, comma: bool) -> dict[str, Any]:
    head: dict[str, Any] = {}
    for number, row in _filled(rows, 1):
        key = row[0].strip().lower()
        name = key.removeprefix(HEAD)
        if not key.startswith(HEAD) or name not in HEAD_TYPES:
            near = nearest(name, HEAD_TYPES)
            raise UsageError(
                f"{file}: row {number}: {row[0].strip()!r} is neither {HEAD}KEY nor a heading{near}"
            )
        text = row[1] if len(row) > 1 else ""
        if text.strip():
            cell = _Cell(text, f"{file}: row {number}, column B ({name})", comma)
            head[name] = _value(cell, HEAD_TYPES[name])
    return head


def _columns(row: Sequence[str], number: int, file: str) -> dict[int, str]:
    """Place of a column -> its key. One without a heading is a person's own and is not read."""
    columns: dict[int, str] = {}
    for place, key in enumerate(_lower(row)):
        if not key:
            continue
        where = f"{file}: row {number}, column {_letter(place)}"
        if key not in POINT_TYPES:
            raise UsageError(f"{where}: unknown heading {key!r}{nearest(key, POINT_TYPES)}")
        if key in columns.values():
            raise UsageError(f"{where}: there are two columns {key!r}")
        columns[place] = key
    return columns


def _letter(place: int) -> str:
    """A column as spreadsheets call it: A, B, ... Z, AA."""
    letters = ""
    place += 1
    while place:
        place, rest = divmod(place - 1, 26)
        letters = chr(ord("A") + rest) + letters
    return letters


def _point(
    columns: Mapping[int, str], row: Sequence[str], where: str, comma: bool
) -> PointDescription:
    found: dict[str, Any] = {}
    for place, text in enumerate(row):
        if not text.strip():
            continue
        column = f"{where}, column {_letter(place)}"
        if place not in columns:
            continue
        key = columns[place]
        found[key] = _value(_Cell(text, f"{column} ({key})", comma), POINT_TYPES[key])
    name = found.pop("name", None)
    if name is None:
        raise UsageError(f"{where}: it has no name")
    return described_point(name, found, where)


def _value(cell: _Cell, kind: str) -> Any:
    text = cell.text.strip()
    marked = text.startswith("'")
    text = cell.text.lstrip()[1:] if marked else text
    if kind == "bool":
        return _truth(cell, text)
    if kind.startswith("dict"):
        return _table(cell, text, kind)
    if kind == "list[str]":
        return _items(text)
    if kind.startswith("list"):
        return [
            _number(cell, item, whole=kind == "list[int]") for item in re.split(r"[|\s]+", text)
        ]
    if kind == "float | str | None":
        return text if marked or _NUMBER(text) is None else _number(cell, text)
    if kind in ("float", "float | None", "int | None"):
        return _number(cell, text, whole=kind == "int | None")
    return text


def _truth(cell: _Cell, text: str) -> bool:
    if text.lower() not in _TRUE | _FALSE:
        raise UsageError(f"{cell.where}: {text!r} is neither yes nor no")
    return text.lower() in _TRUE


def _number(cell: _Cell, text: str, *, whole: bool = False) -> int | float:
    """A number, with a decimal comma where that is not what divides the cells."""
    plain = text.replace(" ", "").replace("\u00a0", "")
    if "," in plain and not cell.comma:
        raise UsageError(
            f"{cell.where}: {text!r} has a comma, and commas divide the cells here; write a point"
        )
    if plain.count(",") + plain.count(".") > 1:
        raise UsageError(f"{cell.where}: {text!r} is not a number: no marks of thousands")
    plain = plain.replace(",", ".")
    try:
        if re.fullmatch(r"[+-]?[0-9]+", plain):
            return int(plain) if len(plain) < 400 else float("inf")
        value = (
            int(plain, 16) if re.fullmatch(r"0[xX][0-9a-fA-F]+", plain) else decimal_number(plain)
        )
    except ValueError:
        raise UsageError(f"{cell.where}: {text!r} is not a number") from None
    if whole and value != int(value):
        raise UsageError(f"{cell.where}: {text!r} is not a whole number")
    return int(value) if whole else value


def _items(text: str) -> list[str]:
    """What stands between the bars; a bar that belongs to an item has a backslash in front."""
    items = [""]
    for part in re.findall(r"\\.|\||[^\\|]+|\\", text, re.DOTALL):
        if part == "|":
            items.append("")
        else:
            items[-1] += part[1] if part in ("\\\\", "\\|") else part
    return [item.strip() for item in items]


def _table(cell: _Cell, text: str, kind: str) -> dict[str, Any]:
    table: dict[str, Any] = {}
    for item in _items(text):
        key, equals, value = item.partition("=")
        if not equals:
            raise UsageError(f"{cell.where}: {item!r} is not of the form raw=name | raw=name")
        value = value.strip()
        table[key.strip()] = _number(cell, value, whole=True) if kind == "dict[str, int]" else value
    return table
