"""How an Ultra3000 point is written: `0xPARAMETER[.ELEMENT][@VIEW]`, or a name with the same suffixes."""

from __future__ import annotations

import re
from dataclasses import dataclass, replace
from enum import StrEnum

from multidrop.device import Sizes
from multidrop.errors import UsageError
from multidrop.numerals import is_digits, whole_number
from multidrop.points import Point, Sample
from multidrop.profile import PointDescription, Profile, nearest
from multidrop.protocols.ultra3000.frame import OVERHEAD
from multidrop.protocols.ultra3000.messages import LAST_PARAMETER, Function
from multidrop.protocols.ultra3000.values import (
    ACTION,
    HEX,
    Kind,
    decode_value,
    kind_of_answer,
    kinds_of,
)

GRAMMAR = (
    "0xPARAMETER[.ELEMENT][@VIEW] as in 0x06D, 0x05B.7 or 0x011@nv, VIEW one of working, nv, "
    "default, min, max, or a name of the profile with the same suffixes"
)

_NUMBER = r"(?:0[xX][0-9a-fA-F]+|[0-9]+)"
_SUFFIXES = rf"(?:\.({_NUMBER}))?(?:@(\w+))?"
_POINT = re.compile(rf"0[xX]([0-9a-fA-F]+){_SUFFIXES}")
_BARE = re.compile(rf"([0-9][0-9a-fA-F]*){_SUFFIXES}")
_NAME = re.compile(rf"([A-Za-z_][\w-]*){_SUFFIXES}")


class View(StrEnum):
    """Which of a parameter's values is meant."""

    WORKING = "working"
    NV = "nv"  # non-volatile, kept without power
    DEFAULT = "default"
    MIN = "min"
    MAX = "max"

    @property
    def read(self) -> Function:
        """The function that reads this value."""
        return _READ[self]

    @property
    def write(self) -> Function | None:
        """The function that writes it; None where none does."""
        return _WRITE.get(self)


_READ = {
    View.WORKING: Function.READ_WORKING,
    View.NV: Function.READ_NON_VOLATILE,
    View.DEFAULT: Function.READ_DEFAULT,
    View.MIN: Function.READ_MINIMUM,
    View.MAX: Function.READ_MAXIMUM,
}
_WRITE = {View.WORKING: Function.WRITE_WORKING, View.NV: Function.WRITE_NON_VOLATILE}


@dataclass(frozen=True, slots=True)
class ParameterPoint(Point):
    """A parameter, or one element of an array, in one of its views.

    `kinds` are the types that its values may have; the first is the one written.
    """

    parameter: int = 0
    element: int | None = None
    view: View = View.WORKING
    kinds: tuple[Kind, ...] = (HEX,)

    @property
    def kind(self) -> Kind:
        return self.kinds[0]

    @property
    def elements(self) -> int | None:
        """How many elements the whole array has; None where it is none, or nobody knows."""
        return self.description.elements if self.description else None

    def offers(self, function: Function) -> bool:
        """Whether the profile lists the function; where it says nothing, the drive decides."""
        listed = self.description.functions if self.description else ""
        return not listed or f"{function:X}" in listed

    def sample(self, data: str) -> Sample:
        """The value in an answer's digits. Raises `ProtocolError` where their number is wrong."""
        kind, digits = kind_of_answer(self.kinds, data, self.element)
        return Sample(decode_value(kind, digits), kind.name, digits.encode())

    def raw_text(self, raw: bytes) -> str:
        """A sample's raw bytes as people know them: digits."""
        return raw.decode()

    def of(self, view: View, element: int | None = None) -> ParameterPoint:
        """The same parameter in another view, or another element of it."""
        where = self.element if element is None else element
        text = _text(self.parameter, where, view)
        return replace(self, text=text, element=where, view=view)


def parse_point(text: str, profile: Profile, *, whole: bool = False) -> ParameterPoint:
    """The point that `text` names. Raises `UsageError` with the grammar, or the nearest name.

    `whole` is for what cannot say an element: an array is then named without one.
    """
    text = text.strip()
    found = _POINT.fullmatch(text)
    if found is not None:
        point = _from_number(found, text)
        return _checked(_described(point, profile), text, whole)
    bare = _BARE.fullmatch(text)
    if bare is not None:
        raise UsageError(_both_readings(bare[1], text))
    named = _NAME.fullmatch(text)
    if named is None:
        raise UsageError(f"{text!r} is not a point: {GRAMMAR}")
    return _checked(_from_name(named, text, profile), text, whole)


def point_of(
    parameter: int, data: str, view: View, profile: Profile, *, reads: bool
) -> tuple[ParameterPoint, str]:
    """The point that a question means, and its data without an array's index.

    What a user may not name is a point here too. Of a parameter that nobody
    describes, the two digits of a read are the index, and no write has one.
    """
    whole = _described(
        ParameterPoint(text=_text(parameter, None, view), parameter=parameter, view=view), profile
    )
    indexed = whole.elements is not None or (whole.kinds == (HEX,) and reads and len(data) == 2)
    if not indexed or len(data) < 2:
        return whole, data
    element = int(data[:2], 16)
    text = _text(parameter, element, view)
    point = ParameterPoint(text=text, parameter=parameter, element=element, view=view)
    return _described(point, profile), data[2:]


def _from_number(found: re.Match[str], text: str) -> ParameterPoint:
    parameter = whole_number(f"0x{found[1]}")
    if parameter > LAST_PARAMETER:
        raise UsageError(f"parameter 0x{parameter:X} of {text!r} is out of range: 0x000..0x7FF")
    element, view = _element(found[2], text), _view(found[3], text)
    return ParameterPoint(
        text=_text(parameter, element, view), parameter=parameter, element=element, view=view
    )


def _from_name(found: re.Match[str], text: str, profile: Profile) -> ParameterPoint:
    name, element_text, view_text = found.groups()
    description = profile.find(name)
    if description is None:
        raise UsageError(
            f"{profile.name} has no point {name!r}{profile.nearest_name(name)}; a point is {GRAMMAR}"
        )
    known = _location(description)
    element = known.element if element_text is None else _element(element_text, text)
    view = known.view if view_text is None else _view(view_text, text)
    return _with_description(known.of(view, element), description, profile)


def _element(text: str | None, point: str) -> int | None:
    if text is None:
        return None
    element = whole_number(text)
    if element > 0xFF:
        raise UsageError(f"element {element} of {point!r} is out of range: 0..255")
    return element


def _view(text: str | None, point: str) -> View:
    if text is None:
        return View.WORKING
    try:
        return View(text.lower())
    except ValueError:
        views = ", ".join(View)
        raise UsageError(
            f"{point!r}: {text!r} is no view{nearest(text, [view.value for view in View])}; views are {views}"
        ) from None


def _text(parameter: int, element: int | None, view: View) -> str:
    where = "" if element is None else f".{element}"
    return f"0x{parameter:03X}{where}" + ("" if view is View.WORKING else f"@{view}")


def _both_readings(number: str, text: str) -> str:
    """The manual counts parameters in hex, most people do not."""
    rest = text[len(number) :]
    hexadecimal = f"0x{whole_number('0x' + number):03X}{rest} if {number} is hex, as in the manual"
    if not is_digits(number):
        return f"{text!r} is not a point: a parameter is written with 0x: {hexadecimal}"
    return (
        f"{text!r} is not a point: a parameter is written with 0x: {hexadecimal}, "
        f"or 0x{whole_number(number):03X}{rest} if it is decimal"
    )


def _location(description: PointDescription) -> ParameterPoint:
    found = _POINT.fullmatch(description.at)
    if found is None:
        raise UsageError(f"point {description.name}: at = {description.at!r} is not {GRAMMAR}")
    return _from_number(found, description.at)


def _described(point: ParameterPoint, profile: Profile) -> ParameterPoint:
    """The same point with what the profile says of it, or of the array that it is in."""
    for description in profile.points.values():
        known = _location(description)
        if known.parameter == point.parameter and known.element in (None, point.element):
            return _with_description(point, description, profile)
    return point


def _with_description(
    point: ParameterPoint, description: PointDescription, profile: Profile
) -> ParameterPoint:
    """A point that a user named without a type has that of its parameter in the profile."""
    if description.type is None:
        for other in profile.points.values():
            if other.type is not None and _location(other).parameter == point.parameter:
                description = replace(
                    description,
                    type=other.type,
                    length=other.length,
                    elements=other.elements,
                    functions=other.functions,
                    scale=other.scale if description.scale == 1.0 else description.scale,
                    unit=description.unit or other.unit,
                )
                break
    kinds = kinds_of(description.type, description.length)
    name = None if kinds == (HEX,) else kinds[0].name
    return replace(point, description=description, kinds=kinds, type=name)


def _checked(point: ParameterPoint, text: str, whole: bool) -> ParameterPoint:
    """Refuses an element, an array or a view that the profile does not have."""
    elements = point.elements
    if elements is None and point.element is not None and point.kinds != (HEX,):
        raise UsageError(f"{text!r}: {point.name} is no array and has no elements")
    if elements is not None:
        if point.element is None and not whole:
            raise UsageError(
                f"{text!r} is an array: name an element, {text.partition('@')[0]}.0 to .{elements - 1}"
            )
        if point.element is not None and point.element >= elements:
            raise UsageError(f"{text!r}: {point.name} has elements 0..{elements - 1}")
    if point.kind is ACTION and point.view is not View.WORKING:
        raise UsageError(f"{text!r}: {point.name} is an action, it has no values")
    functions = {point.view.read, point.view.write} - {None}
    if not any(point.offers(function) for function in functions if function is not None):
        raise UsageError(f"{text!r}: {point.name} has no {point.view} value")
    return point


ASSUMED_DIGITS = 4
"""Digits of a value whose type nobody has said."""


def size_of(point: Point) -> Sizes:
    """Characters that a read of a point takes."""
    assert isinstance(point, ParameterPoint)
    index = 0 if point.element is None else 2
    question = OVERHEAD + index
    return Sizes(question, question + (point.kind.digits or ASSUMED_DIGITS))
