"""How a discovery finds the parameters of a SLINK3 slave.

Where the slave names types (FORMAT 00), one read tells all. A FlexMax says 0001
for a parameter that it does not have, and 0006 or 001E for one of another type,
so its types are asked for in turn (A chapters 4 and 5, B chapters 4 and 5).
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
from multidrop.protocols.slink3.values import FORMATS_BY_TYPE_NAME, Format
from multidrop.sweeping import DISCOVERED, Discovered

RANGE = "[DEST/]FIRST..LAST, as in 8000..9999 or dgfc/0..1023"
_RANGE = re.compile(r"(?:(\w+)/)?(0[xX][0-9a-fA-F]+|[0-9]+)(?:\.\.(0[xX][0-9a-fA-F]+|[0-9]+))?")
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


class Slink3Sweep:
    """The indices of a slave, or of what is at one of its destinations. Subindices are not looked for."""

    what = "indices"

    def __init__(self, device: Slink3Device, text: str | None) -> None:
        """Raises `UsageError` for what is no range of the device."""
        self.profile: Profile = device.profile
        first, last = f"0..{LAST_INDEX}".split("..")
        where = None
        if text is not None:
            found = _RANGE.fullmatch(text.strip())
            if found is None:
                raise UsageError(f"{text!r} is not a range of indices: {RANGE}")
            where, first, last = found[1], found[2], found[3] or found[2]
        if where is not None and where.lower() == "std":
            raise UsageError(
                f"{text!r}: a Drivecom parameter does not carry its type, so none can be discovered"
            )
        prefix = f"{where}/" if where else ""
        ends = [device.point(f"{prefix}{end}") for end in (first, last)]
        if ends[0].index > ends[1].index:
            raise UsageError(f"{text!r} runs backwards")
        self._device = device
        self._destination = ends[0].destination
        self._prefix = ends[0].text.rpartition("/")[0]
        self.places = range(ends[0].index, ends[1].index + 1)
        self._known: dict[int, list[ParameterPoint]] = {}
        for name in self.profile.points:
            point = device.point(name)
            if self._covers(point):
                self._known.setdefault(point.index, []).append(point)
        self._types = tuple(self._to_try())

    def _to_try(self) -> Iterator[Format]:
        there = dialect_at(self._device.dialect, self._destination)
        if there is None or there.names_types:
            yield Format.VOID
        for type_code in (*TYPES_TO_TRY, Format.BOOLEAN, Format.CHAR, Format.UNSIGNED_CHAR):
            if there is None or type_code in there.formats:
                yield type_code

    def where(self, place: int) -> str:
        return f"{self._prefix}/{place}" if self._prefix else str(place)

    def covers(self, description: PointDescription) -> bool:
        return self._covers(self._device.point(description.name))

    def _covers(self, point: ParameterPoint) -> bool:
        """A point with a subindex is another one."""
        plain = not point.standard and point.subindex is None
        return plain and point.destination == self._destination and point.index in self.places

    def begin(self) -> Conversation[Frame, None]:
        return
        yield

    def look(self, place: int) -> Conversation[Frame, list[Discovered]]:
        known = self._known.get(place, [])
        first = {point.type_code: None for point in known if point.type_code is not None}
        refusal = None
        for type_code in {**first, **dict.fromkeys(self._types)}:
            try:
                found = yield from self._device.master.read_typed(
                    place, type_code, None, self._destination
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
        note = f"there, and not read: {refusal}"
        return [
            Discovered(item.description or self._new(place, None, note))
            for item in known or [ParameterPoint("")]
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


def sweep(
    address: int, profile: Profile, options: Mapping[str, str], text: str | None
) -> Slink3Sweep:
    """The places of a device that `text` names, all of them for None. Raises `UsageError`."""
    return Slink3Sweep(device(address, profile, options), text)


__all__ = ["RANGE", "Slink3Sweep", "sweep"]
