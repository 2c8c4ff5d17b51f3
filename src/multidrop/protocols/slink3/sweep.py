"""How a discovery finds the parameters of a SLINK3 slave.

Where the slave names types (FORMAT 00), one read tells all. A FlexMax says 0001
for a parameter that it does not have, and 0006 or 001E for one of another type,
so its types are asked for in turn (A chapters 4 and 5, B chapters 4 and 5). A
standard (Drivecom) parameter comes without a type: one read tells its width.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import replace

from multidrop.conversation import Conversation
from multidrop.errors import DeviceError, UsageError
from multidrop.points import Point, PointDescription, Sample, shown_value
from multidrop.profile import Profile
from multidrop.protocols.slink3.device import Slink3Device, device
from multidrop.protocols.slink3.dialects import TYPES_TO_TRY
from multidrop.protocols.slink3.frame import Frame
from multidrop.protocols.slink3.master import ParameterValue
from multidrop.protocols.slink3.messages import Response
from multidrop.protocols.slink3.points import ParameterPoint, dialect_at
from multidrop.protocols.slink3.values import FORMATS_BY_TYPE_NAME, Format, width
from multidrop.sweeping import DISCOVERED, Discovered

RANGE = (
    "[DEST/]FIRST..LAST[.SUBINDEX..SUBINDEX], as in 8000..9999, dgfc/0..1023, 8236.0..15, "
    "or of standard parameters std/0x6000..0x67FF"
)
_NUMBER = r"(0[xX][0-9a-fA-F]+|[0-9]+)"
_NUMBERS = rf"{_NUMBER}(?:\.\.{_NUMBER})?"
_RANGE = re.compile(rf"(?:(\w+)/)?{_NUMBERS}(?:\.{_NUMBERS})?")
LAST_INDEX = 0xFFFF

_OTHER_TYPE = (Response.TYPE_VALUE_ERROR, Response.TYPE_UNKNOWN)
_THERE = {
    Response.CONTROL_ACCESS_DENIED,
    Response.ATTRIBUTE_ACCESS_DENIED,
    Response.PARAMETER_ACCESS_CONFLICT,
    Response.VALUE_NOT_SUPPORTED,
    Response.CONFIGURATION_CONFLICT,
    Response.STATE_NOT_CORRECT,
    Response.PASSWORD,
}
"""Refusals of a read that only a parameter that exists is worth."""

_BY_WIDTH = {
    width(type_code): type_code
    for type_code in (Format.UNSIGNED_CHAR, Format.UNSIGNED_SHORT_INT, Format.UNSIGNED_LONG_INT)
}
"""What a standard parameter of so many bytes is shown as."""


class Slink3Sweep:
    """The indices of a slave or of what is at one of its destinations, or some subindices of each.

    Without subindices they are parameters that have none; standard parameters
    always have one, 0 where none is named.
    """

    def __init__(self, device: Slink3Device, text: str | None) -> None:
        """Raises `UsageError` for what is no range of the device."""
        self.profile: Profile = device.profile
        first, last = _ends(device, f"0..{LAST_INDEX}" if text is None else text)
        self._device = device
        self._first = first
        self._count = 1 if first.subindex is None else (last.subindex or 0) - first.subindex + 1
        self.what = "indices" if self._count == 1 else "subindices"
        self.places = range(first.index * self._count, (last.index + 1) * self._count)
        self._known: dict[int, list[ParameterPoint]] = {}
        for name in self.profile.points:
            point = device.point(name)
            if (place := self._place(point)) is not None:
                self._known.setdefault(place, []).append(point)
        self._types = tuple(self._to_try())

    def _to_try(self) -> Iterator[Format]:
        there = dialect_at(self._device.dialect, self._first.destination)
        if there is None or there.names_types:
            yield Format.VOID
        for type_code in (*TYPES_TO_TRY, Format.BOOLEAN, Format.CHAR, Format.UNSIGNED_CHAR):
            if there is None or type_code in there.formats:
                yield type_code

    def where(self, place: int) -> str:
        prefix = self._first.text.rpartition("/")[0]
        index, subindex = self._at(place)
        number = f"0x{index:04X}" if self._first.standard else str(index)
        number = number if subindex is None else f"{number}.{subindex}"
        return f"{prefix}/{number}" if prefix else number

    def _at(self, place: int) -> tuple[int, int | None]:
        """Index and subindex."""
        index, further = divmod(place, self._count)
        first = self._first.subindex
        return index, None if first is None else first + further

    def _place(self, point: ParameterPoint) -> int | None:
        """The place of a point; None for one that is elsewhere."""
        first = self._first
        if (point.standard, point.destination) != (first.standard, first.destination):
            return None
        further = (point.subindex or 0) - (first.subindex or 0)
        place = point.index * self._count + further
        there = 0 <= further < self._count and place in self.places
        return place if there and self._at(place)[1] == point.subindex else None

    def covers(self, description: PointDescription) -> bool:
        """A point with a subindex is another one."""
        return self._place(self._device.point(description.name)) is not None

    def begin(self) -> Conversation[Frame, None]:
        return
        yield

    def look(self, place: int) -> Conversation[Frame, list[Discovered]]:
        if self._first.standard:
            return (yield from self._look_at_standard(place))
        known = self._known.get(place, [])
        index, subindex = self._at(place)
        first = {point.type_code: None for point in known if point.type_code is not None}
        refusal = None
        for type_code in {**first, **dict.fromkeys(self._types)}:
            try:
                found = yield from self._device.master.read_typed(
                    index, type_code, subindex, self._first.destination
                )
            except DeviceError as refused:
                if refused.code == Response.PARAMETER_NOT_EXIST:
                    return []
                refusal = refused
                if refused.code in _OTHER_TYPE:
                    continue
                if refused.code not in _THERE:
                    raise
                break
            return self._found(place, known, found)
        assert refusal is not None
        return self._unread(place, refusal)

    def _look_at_standard(self, place: int) -> Conversation[Frame, list[Discovered]]:
        index, subindex = self._at(place)
        try:
            found = yield from self._device.master.read_standard(index, subindex or 0)
        except DeviceError as refused:
            if refused.code == Response.PARAMETER_NOT_EXIST:
                return []
            if refused.code not in _THERE:
                raise
            return self._unread(place, refused)
        raw = found.raw
        by_width = ParameterValue(_BY_WIDTH.get(len(raw), Format.OCTET_STRING), raw, found.fault)
        known = self._known.get(place, [])
        if not known:
            sample = by_width.sample(None)
            note = f"its type is not known, only its width; it held {shown_value(sample.value)}"
            return [Discovered(self._new(place, sample.type, note), sample)]
        return [self._of_width(point, by_width) for point in known]

    def _of_width(self, point: ParameterPoint, found: ParameterValue) -> Discovered:
        """What the profile says, unless its type is of another width."""
        description, type_code = point.description, point.type_code
        assert description is not None, "a point of the profile"
        assert type_code is not None, "a standard parameter of a profile has a type"
        if width(type_code) in (None, len(found.raw)):
            return Discovered(description, found._replace(type_code=type_code).sample(None))
        sample = found.sample(None)
        note = f"the profile has type {point.type}, the device {len(found.raw)} bytes"
        at = f"{point.text}:{sample.type}"
        return Discovered(replace(description, at=at, note=note), sample)

    def _unread(self, place: int, refusal: DeviceError) -> list[Discovered]:
        """What is there by its refusal."""
        note = f"there, and not read: {refusal}"
        type_name = Format.OCTET_STRING.type_name if self._first.standard else None
        return [
            Discovered(item.description or self._new(place, type_name, note))
            for item in self._known.get(place) or [ParameterPoint("")]
        ]

    def _found(
        self, place: int, known: list[ParameterPoint], found: ParameterValue
    ) -> list[Discovered]:
        sample = found.sample(None)
        if not known:
            note = f"it held {shown_value(sample.value)}"
            return [Discovered(self._new(place, sample.type, note), sample)]
        return [Discovered(self._of_type(point, sample.type), sample) for point in known]

    def _of_type(self, point: ParameterPoint, type_name: str) -> PointDescription:
        """What the profile says, with the type that the slave has."""
        description = point.description
        assert description is not None, "a point of the profile"
        if point.type in (type_name, None) or type_name not in FORMATS_BY_TYPE_NAME:
            return description
        note = f"the profile has type {point.type}, the device {type_name}"
        return replace(description, at=f"{point.text}:{type_name}", note=note)

    def heard(self, point: Point, sample: Sample) -> PointDescription:
        assert isinstance(point, ParameterPoint)
        return point.description or self._described(point.text, sample.type, "")

    def _new(self, place: int, type_name: str | None, note: str) -> PointDescription:
        return self._described(self.where(place), type_name, note)

    def _described(self, text: str, type_name: str | None, note: str) -> PointDescription:
        """A point that nobody knows; with its type, where the device's dialect lets one name that."""
        *where, number = text.split("/")
        name = "_".join([*where, "index", *number.split(".")])
        if type_name is None:
            return PointDescription(name, text, source=DISCOVERED, note=note)
        at = f"{text}:{type_name}"
        try:
            self._device.point(at)
        except UsageError:
            at, note = text, f"of type {type_name}; {note}"
        return PointDescription(name, at, source=DISCOVERED, note=note)


def _ends(device: Slink3Device, text: str) -> tuple[ParameterPoint, ParameterPoint]:
    """The first and the last point of a range. Raises `UsageError`."""
    found = _RANGE.fullmatch(text.strip())
    if found is None:
        raise UsageError(f"{text!r} is not a range of indices: {RANGE}")
    where, first, last, first_sub, last_sub = found.groups()
    standard = where is not None and where.lower() == "std"
    ends = [
        device.point(
            (f"{where}/" if where else "")
            + index
            + (f".{subindex}" if subindex else "")
            + (":bytes" if standard else "")
        )
        for index, subindex in ((first, first_sub), (last or first, last_sub or first_sub))
    ]
    if ends[0].index > ends[1].index or (ends[0].subindex or 0) > (ends[1].subindex or 0):
        raise UsageError(f"{text!r} runs backwards")
    return ends[0], ends[1]


def sweep(
    address: int, profile: Profile, options: Mapping[str, str], text: str | None
) -> Slink3Sweep:
    """The places of a device that `text` names, all of them for None. Raises `UsageError`."""
    return Slink3Sweep(device(address, profile, options), text)


__all__ = ["RANGE", "Slink3Sweep", "sweep"]
