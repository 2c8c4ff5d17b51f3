"""How a SLINK3 point is written: `[DEST/]INDEX[.SUBINDEX][:TYPE]`, `std/INDEX.SUBINDEX:TYPE`, or a name."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace

from multidrop.device import Sizes
from multidrop.errors import UsageError
from multidrop.numerals import is_digits, whole_number
from multidrop.points import Point, Role
from multidrop.profile import PointDescription, Profile, nearest
from multidrop.protocols.slink3.dialects import BEHIND, DIALECTS, SLINK3, Dialect
from multidrop.protocols.slink3.frame import OVERHEAD
from multidrop.protocols.slink3.messages import Command, StandardParameter, TypedParameter
from multidrop.protocols.slink3.status import CONTROL_WORD
from multidrop.protocols.slink3.values import FORMATS_BY_TYPE_NAME, Format, width

GRAMMAR = (
    "[DEST/]INDEX[.SUBINDEX][:TYPE] as in 8236:int16 or dgfc/511, "
    "std/INDEX.SUBINDEX:TYPE as in std/0x6041.0:uint16, or a name of the profile"
)

_CONTROL_WORD = PointDescription(
    name="control_word",
    at=f"std/0x{CONTROL_WORD:04X}.0:uint16",
    role=Role.COMMAND,
    meaning="DRIVECOM control word",
    source="DRIVECOM profile 21",
)
"""It moves a drive, also where a profile knows no points: a write of it is never repeated."""

_NUMBER = r"(0[xX][0-9a-fA-F]+|[0-9]+)"
_POINT = re.compile(rf"(?:(\w+)/)?{_NUMBER}(?:\.{_NUMBER})?(?::(\w+))?")
_NAME = re.compile(r"([A-Za-z_][\w-]*)(?::(\w+))?")


@dataclass(frozen=True, slots=True)
class ParameterPoint(Point):
    """A typed parameter behind a destination ID, or a standard (Drivecom) one.

    `type_code` is None where neither the text nor the profile names the type.
    """

    index: int = 0
    subindex: int | None = None
    destination: int = 0
    standard: bool = False
    type_code: Format | None = None
    inferred: bool = False  # its index follows from a rule that no document states for this model

    @property
    def within(self) -> str:
        return f"dest{self.destination}" if self.destination else ""


def parse_point(text: str, profile: Profile, dialect: Dialect) -> ParameterPoint:
    """The point that `text` names. Raises `UsageError` with the grammar, or the nearest name."""
    text = text.strip()
    found = _POINT.fullmatch(text)
    if found is not None:
        point = _from_numbers(found, text, dialect)
        return _described(point, profile, dialect)
    named = _NAME.fullmatch(text)
    if named is None:
        raise UsageError(f"{text!r} is not a point: {GRAMMAR}")
    return _from_name(named[1], named[2], profile, dialect)


def _from_numbers(found: re.Match[str], text: str, dialect: Dialect) -> ParameterPoint:
    where, index_text, subindex_text, type_text = found.groups()
    index = whole_number(index_text)
    subindex = None if subindex_text is None else whole_number(subindex_text)
    if index > 0xFFFF:
        raise UsageError(f"index {index} of {text!r} is out of range: 0..65535")
    if subindex is not None and subindex > 0xFF:
        raise UsageError(f"subindex {subindex} of {text!r} is out of range: 0..255")
    if where is not None and where.lower() == "std":
        if Command.READ_STANDARD_PARAMETER not in dialect.commands:
            raise UsageError(f"{text!r}: {dialect.name} has no standard parameters")
        type_code = _type(type_text, None, text)
        return _point(index, subindex or 0, 0, True, type_code, dialect)
    destination = _destination(where, dialect, text)
    there = dialect_at(dialect, destination)
    if subindex is not None and there is not None and not there.subindex:
        raise UsageError(f"{text!r}: {there.name} has no subindex")
    return _point(index, subindex, destination, False, _type(type_text, there, text), dialect)


def _destination(where: str | None, dialect: Dialect, text: str) -> int:
    if where is None:
        return 0
    word = where.lower()
    if (word == "dgfc" and dialect.behind == "dgfc386") or (
        word == "drive" and dialect.behind == "flexmax"
    ):
        return BEHIND
    numbered = re.fullmatch(r"dest([1-7])", word)
    if numbered is None:
        raise UsageError(
            f"{text!r}: {where!r} is no destination of {dialect.name}: dest1..dest7"
            + {"dgfc386": ", dgfc", "flexmax": ", drive"}.get(dialect.behind or "", "")
        )
    return int(numbered[1])


def dialect_at(dialect: Dialect, destination: int) -> Dialect | None:
    """The dialect at a destination; None where nobody knows what is there."""
    if destination == 0:
        return dialect
    behind = destination == BEHIND and dialect.behind
    return DIALECTS[behind] if behind else None


def _type(text: str | None, dialect: Dialect | None, point: str) -> Format | None:
    if text is None:
        return None
    type_code = FORMATS_BY_TYPE_NAME.get(text.lower())
    if type_code is None:
        names = " ".join(FORMATS_BY_TYPE_NAME)
        raise UsageError(
            f"{point!r}: {text!r} is no type{nearest(text, FORMATS_BY_TYPE_NAME)}; types are {names}"
        )
    if dialect is not None and type_code is not Format.VOID and type_code not in dialect.formats:
        names = " ".join(sorted(code.type_name for code in dialect.formats))
        raise UsageError(f"{point!r}: {dialect.name} has no type {text}; it has {names}")
    return type_code


def _shown(destination: int, dialect: Dialect) -> str:
    """A destination as a point's text has it: `dgfc/`, `drive/`, `dest3/`, or nothing."""
    if destination == BEHIND and dialect.behind:
        return "dgfc/" if dialect.behind == "dgfc386" else "drive/"
    return f"dest{destination}/" if destination else ""


def _point(
    index: int,
    subindex: int | None,
    destination: int,
    standard: bool,
    type_code: Format | None,
    dialect: Dialect,
) -> ParameterPoint:
    if standard:
        text = f"std/0x{index:04X}.{subindex}"
    else:
        text = f"{_shown(destination, dialect)}{index}" + (
            "" if subindex is None else f".{subindex}"
        )
    return ParameterPoint(
        text=text,
        type=type_code.type_name if type_code is not None else None,
        index=index,
        subindex=subindex,
        destination=destination,
        standard=standard,
        type_code=type_code,
    )


def point_of(
    parameter: TypedParameter | StandardParameter,
    destination: int,
    profile: Profile,
    dialect: Dialect,
) -> ParameterPoint:
    """The point that a frame names, also one that the dialect would not let a user name."""
    standard = isinstance(parameter, StandardParameter)
    point = _point(parameter.index, parameter.subindex, destination, standard, None, dialect)
    return _known(point, profile, dialect) or point


def _known(point: ParameterPoint, profile: Profile, dialect: Dialect) -> ParameterPoint | None:
    """The same point with what the profile says of its index; None where it says nothing."""
    for description in profile.points.values():
        known = _location(description, dialect)
        if known.text == point.text:
            return _with_description(point, known, description)
    if point.standard and point.index == CONTROL_WORD:
        return _with_description(point, _location(_CONTROL_WORD, SLINK3), _CONTROL_WORD)
    return None


def _described(point: ParameterPoint, profile: Profile, dialect: Dialect) -> ParameterPoint:
    """The same point with what the profile says of its index."""
    known = _known(point, profile, dialect)
    if known is not None:
        return known
    if point.standard and point.type_code in (None, Format.VOID):
        raise UsageError(
            f"{point.text!r} needs a type: a Drivecom parameter does not carry one. {GRAMMAR}"
        )
    return point


def _from_name(
    name: str, type_text: str | None, profile: Profile, dialect: Dialect
) -> ParameterPoint:
    description = profile.find(name)
    if description is not None:
        known = _location(description, dialect)
        there = None if known.standard else dialect_at(dialect, known.destination)
        typed = replace(known, type_code=_type(type_text, there, name)) if type_text else known
        return _with_description(typed, known, description)
    for prefix, offset in profile.inferred.items():
        number = name.removeprefix(prefix)
        if name.startswith(prefix) and is_digits(number):
            point = _from_numbers(_match(f"{whole_number(number) + offset}"), name, dialect)
            point = replace(point, type_code=_type(type_text, dialect, name), inferred=True)
            return _described(_typed(point), profile, dialect)
    raise UsageError(
        f"{profile.name} has no point {name!r}{profile.nearest_name(name)}; a point is {GRAMMAR}"
    )


def _location(description: PointDescription, dialect: Dialect) -> ParameterPoint:
    found = _POINT.fullmatch(description.at)
    if found is None:
        raise UsageError(f"point {description.name}: at = {description.at!r} is not {GRAMMAR}")
    return _from_numbers(found, description.at, dialect)


def _match(text: str) -> re.Match[str]:
    found = _POINT.fullmatch(text)
    assert found is not None
    return found


def _with_description(
    point: ParameterPoint, known: ParameterPoint, description: PointDescription
) -> ParameterPoint:
    type_code = point.type_code
    if type_code is None or (point.standard and type_code is Format.VOID):
        type_code = known.type_code
    if point.standard and point.index == CONTROL_WORD:  # whatever a profile of one's own calls it
        description = replace(description, role=Role.COMMAND)
    return _typed(replace(point, type_code=type_code, description=description))


def _typed(point: ParameterPoint) -> ParameterPoint:
    name = point.type_code.type_name if point.type_code is not None else None
    return replace(point, type=name)


ASSUMED_WIDTH = 4
"""Bytes of a value whose type nobody has said yet, or whose length is free."""


def size_of(point: Point, types: Mapping[str, Format]) -> Sizes:
    """Characters that a read of a point takes; `types` are those that reads have shown."""
    assert isinstance(point, ParameterPoint)
    body = 3 if point.subindex is None else 4  # FORMAT or nothing, INDEX, SUBINDEX
    if point.standard:
        body = 3
    type_code = types.get(point.text) if point.type_code is None else point.type_code
    value = width(type_code) if type_code is not None else None
    question = OVERHEAD + body
    return Sizes(question, question + (ASSUMED_WIDTH if value is None else value))
