"""How a discovery finds the parameters of an Ultra3000: by its reads alone (manual pages 1-2 and 1-3).

The answer to function 0 shows how wide a value is, or refusal 07 that it is an
array; functions 6, 8 and 9 give default and limits, A and B the bounds of the
index. What can only be written (an action) does not show itself.
"""

from __future__ import annotations

import re
from collections.abc import Mapping

from multidrop.conversation import Conversation
from multidrop.errors import DeviceError, UsageError
from multidrop.points import Point, PointDescription, Sample, Value, shown_value
from multidrop.profile import Profile
from multidrop.protocols.ultra3000.device import Ultra3000Device, device
from multidrop.protocols.ultra3000.frame import Frame
from multidrop.protocols.ultra3000.messages import LAST_PARAMETER, Function, Refusal
from multidrop.protocols.ultra3000.points import ParameterPoint, parse_point
from multidrop.protocols.ultra3000.values import INTEGERS, Kind, decode_value, string
from multidrop.sweeping import DISCOVERED, Discovered

RANGE = "0xFIRST..0xLAST, as in 0x000..0x0FF"
_RANGE = re.compile(r"0[xX]([0-9a-fA-F]{1,4})(?:\.\.0[xX]([0-9a-fA-F]{1,4}))?")
_LONGEST_NUMBER = 8  # digits; what is longer is text


class Ultra3000Sweep:
    """The parameters of a drive."""

    what = "parameters"

    def __init__(self, device: Ultra3000Device, text: str | None) -> None:
        """Raises `UsageError` for what is no range of parameters."""
        self.profile: Profile = device.profile
        first, last = 0, LAST_PARAMETER
        if text is not None:
            found = _RANGE.fullmatch(text.strip())
            if found is None:
                raise UsageError(f"{text!r} is not a range of parameters: {RANGE}")
            first, last = int(found[1], 16), int(found[2] or found[1], 16)
        if last > LAST_PARAMETER:
            raise UsageError(f"parameter 0x{last:X} is out of range: 0x000..0x{LAST_PARAMETER:X}")
        if first > last:
            raise UsageError(f"{text!r} runs backwards")
        self.places = range(first, last + 1)
        self._master = device.master
        self._known: dict[int, list[ParameterPoint]] = {}
        for name in self.profile.points:
            point = parse_point(name, self.profile, whole=True)
            self._known.setdefault(point.parameter, []).append(point)

    def where(self, place: int) -> str:
        return f"0x{place:03X}"

    def covers(self, description: PointDescription) -> bool:
        return parse_point(description.name, self.profile, whole=True).parameter in self.places

    def begin(self) -> Conversation[Frame, None]:
        return
        yield

    def look(self, place: int) -> Conversation[Frame, list[Discovered]]:
        known = self._known.get(place)
        if known is not None:
            return (yield from self._look_at_known(known))
        try:
            data = yield from self._master.read(place)
        except DeviceError as refusal:
            if refusal.code == Refusal.INVALID_FUNCTION:
                return []
            if refusal.code == Refusal.INVALID_INDEX:
                return [(yield from self._look_at_array(place))]
            note = f"there, and not read: {refusal}"
            return [Discovered(self._description(place, {"note": note}))]
        facts, sample = yield from self._facts(place, data, None)
        last = yield from self._asked(place, Function.READ_INDEX_MAXIMUM, None)
        if last is not None:  # an array that answers without an index too
            facts["elements"] = int(last, 16) + 1
        return [Discovered(self._description(place, facts), sample)]

    def _look_at_known(self, known: list[ParameterPoint]) -> Conversation[Frame, list[Discovered]]:
        """Is it there? What cannot be read is believed to be."""
        point = known[0].of(known[0].view, 0) if known[0].elements else known[0]
        sample = None
        if point.offers(Function.READ_WORKING):
            try:
                sample = yield from self._master.read_as(
                    point.sample, point.parameter, point.element
                )
            except DeviceError as refusal:
                if refusal.code == Refusal.INVALID_FUNCTION:
                    return []
        found = (item.description for item in known)
        return [Discovered(item, sample) for item in found if item is not None]

    def _look_at_array(self, place: int) -> Conversation[Frame, Discovered]:
        last = yield from self._asked(place, Function.READ_INDEX_MAXIMUM, None)
        first = yield from self._asked(place, Function.READ_INDEX_MINIMUM, None)
        element = int(first or "0", 16)
        data = yield from self._asked(place, Function.READ_WORKING, element)
        if data is None or last is None:
            note = "there, and not read: an array without an element"
            return Discovered(self._description(place, {"note": note}))
        facts, sample = yield from self._facts(place, data, element)
        facts["elements"] = int(last, 16) + 1
        return Discovered(self._description(place, facts), sample)

    def _asked(
        self, place: int, function: Function, element: int | None
    ) -> Conversation[Frame, str | None]:
        """What a function gives; None where it is refused."""
        try:
            return (yield from self._master.read(place, element, function)) or None
        except DeviceError:
            return None

    def _facts(
        self, place: int, data: str, element: int | None
    ) -> Conversation[Frame, tuple[dict[str, object], Sample]]:
        """Type, limits and default of a parameter whose value has these digits."""
        digits = _without_index(data, element)
        found: dict[str, str] = {}
        for key, function in _LIMITS.items():
            limit = yield from self._asked(place, function, element)
            limit = None if limit is None else _without_index(limit, element)
            if limit is not None and len(limit) == len(digits):
                found[key] = limit
        kind = _kind(digits, found)
        if kind is None:
            raw = Sample(f"0x{digits}", "hex", digits.encode())
            return {"note": f"it held 0x{digits}"}, raw
        value = decode_value(kind, digits)
        facts: dict[str, object] = {"type": kind.name}
        if kind.name == "string":
            facts["length"] = kind.digits // 2
        for key, limit in found.items():
            known: Value = decode_value(kind, limit)
            if known != "" and (key == "default" or kind.name != "string"):
                facts[key] = known
        unsure = "" if {"minimum", "maximum"} <= set(found) else "; its sign is not known"
        facts["note"] = f"it held {shown_value(value)}" + (unsure * (kind.name != "string"))
        if value == "":
            del facts["note"]
        return facts, Sample(value, kind.name, digits.encode())

    def _description(self, place: int, facts: Mapping[str, object]) -> PointDescription:
        return PointDescription(
            f"parameter_{place:03x}",
            self.where(place),
            source=DISCOVERED,
            **facts,  # type: ignore[arg-type]
        )

    def heard(self, point: Point, sample: Sample) -> PointDescription:
        """Of a whole array, which has at least the element that was heard."""
        assert isinstance(point, ParameterPoint)
        if point.description is not None:
            return point.description
        facts: dict[str, object] = {}
        kind = _kind(sample.raw.decode(), {})
        if kind is not None:
            facts = {"type": kind.name, "note": "its sign is not known"}
            if kind.name == "string":
                facts = {"type": kind.name, "length": kind.digits // 2}
        if point.element is not None:
            facts["elements"] = point.element + 1
        return self._description(point.parameter, facts)


_LIMITS = {
    "minimum": Function.READ_MINIMUM,
    "maximum": Function.READ_MAXIMUM,
    "default": Function.READ_DEFAULT,
}


def _without_index(data: str, element: int | None) -> str:
    """The value's digits; an array's answer may begin with the index, which its width shows."""
    front = "" if element is None else f"{element:02X}"
    indexed = front and len(data) in (6, 10) and data.startswith(front)
    return data[2:] if indexed else data


def _kind(digits: str, limits: Mapping[str, str]) -> Kind | None:
    """The type: a minimum that is above the maximum without its sign has one."""
    if len(digits) > _LONGEST_NUMBER and not len(digits) % 2:
        return string(len(digits) // 2)
    sign = limits.get("minimum", "") > limits.get("maximum", "~")
    for kind in INTEGERS.values():
        if kind.digits == len(digits) and kind.signed == sign:
            return kind
    return None


def sweep(
    address: int, profile: Profile, options: Mapping[str, str], text: str | None
) -> Ultra3000Sweep:
    """The parameters of a drive that `text` names, all of them for None. Raises `UsageError`."""
    return Ultra3000Sweep(device(address, profile, options), text)


__all__ = ["RANGE", "Ultra3000Sweep", "sweep"]
