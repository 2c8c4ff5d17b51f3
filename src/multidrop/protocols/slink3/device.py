"""A SLINK3 device for everything above: points by name, values in units, the write rule, services."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

from multidrop.conversation import Conversation
from multidrop.device import OneByOne, Report, Sizes, Write
from multidrop.errors import DeviceError, UsageError
from multidrop.numerals import is_digits, whole_number
from multidrop.points import Point, Role, Sample, Value
from multidrop.profile import Profile
from multidrop.protocols.slink3 import services
from multidrop.protocols.slink3.dialects import BEHIND, DIALECTS, TYPES_TO_TRY, Dialect
from multidrop.protocols.slink3.frame import MOST_DATA, Frame
from multidrop.protocols.slink3.master import Master, believed
from multidrop.protocols.slink3.messages import (
    Response,
)
from multidrop.protocols.slink3.points import ParameterPoint, parse_point, size_of
from multidrop.protocols.slink3.values import (
    FORMATS,
    FORMATS_BY_TYPE_NAME,
    Format,
    encode_value,
    parse_value,
)
from multidrop.writing import Written, write_once


class Slink3Device(OneByOne):
    """The slave at `address` as its profile's dialect speaks."""

    def __init__(self, address: int, profile: Profile, dialect: Dialect) -> None:
        self.address = address
        self.profile = profile
        self.dialect = dialect
        self.master = Master(address, dialect)
        self._types: dict[str, Format] = {}  # point text -> the type that a read has shown

    # -- points ----------------------------------------------------------------------------

    def point(self, text: str) -> ParameterPoint:
        return parse_point(text, self.profile, self.dialect)

    def read(self, point: Point) -> Conversation[Frame, Sample]:
        assert isinstance(point, ParameterPoint)
        type_code = self._type_of(point)
        if point.standard:
            return self._read_standard(point, type_code or Format.OCTET_STRING)
        if type_code:  # neither None nor VOID, which is 0
            return self._read_as(point, type_code)
        return self._read_naming(point) if self._names_types(point) else self._read_trying(point)

    def size(self, point: Point) -> Sizes:
        return size_of(point, self._types)

    def _type_of(self, point: ParameterPoint) -> Format | None:
        """The type that was given or that the profile has; else what a read has shown."""
        return self._types.get(point.text) if point.type_code is None else point.type_code

    def _names_types(self, point: ParameterPoint) -> bool:
        if point.destination == BEHIND and self.dialect.behind:
            return DIALECTS[self.dialect.behind].names_types
        return self.dialect.names_types

    def _read_standard(
        self, point: ParameterPoint, type_code: Format
    ) -> Conversation[Frame, Sample]:
        found = yield from self.master.read_standard(point.index, point.subindex or 0, type_code)
        return found.sample(self._fault(found.fault))

    def _read_as(self, point: ParameterPoint, type_code: Format) -> Conversation[Frame, Sample]:
        found = yield from self.master.read_typed(
            point.index, type_code, point.subindex, point.destination
        )
        if found.type_code in FORMATS:
            self._types[point.text] = FORMATS[found.type_code]
        return found.sample(self._fault(found.fault))

    def _read_naming(self, point: ParameterPoint) -> Conversation[Frame, Sample]:
        """The slave names the type, where it can: a profile that fits any drive may promise too much."""
        try:
            return (yield from self._read_as(point, Format.VOID))
        except DeviceError as refusal:
            if refusal.code not in (Response.TYPE_VALUE_ERROR, Response.TYPE_UNKNOWN):
                raise
        return (yield from self._read_trying(point))

    def _read_trying(self, point: ParameterPoint) -> Conversation[Frame, Sample]:
        """The dialect cannot name the type, so its types are asked for in turn."""
        for type_code in TYPES_TO_TRY:
            try:
                return (yield from self._read_as(point, type_code))
            except DeviceError as refusal:
                if refusal.code not in (Response.TYPE_VALUE_ERROR, Response.TYPE_UNKNOWN):
                    raise
                last = refusal
        raise last

    def _fault(self, bit: bool) -> bool | None:
        return bit if self.dialect.fault_bit else None

    # -- writing ---------------------------------------------------------------------------

    def prepare_write(self, text: str, value: Value | str, *, force: bool = False) -> Write:
        point = self.point(text)
        description = point.description
        if description is not None and "w" not in description.access and not force:
            raise UsageError(
                f"{point} is read-only in profile {self.profile.name}; --force writes it"
            )
        if point.inferred and not force:
            raise UsageError(
                f"{text} is {point.text} by an inferred rule, so it is read-only; --force writes it"
            )
        type_code = self._type_of(point)
        if type_code not in (None, Format.VOID):
            assert type_code is not None
            self._encode(point, type_code, value, force)
            value = _physical(point, type_code, value)
        return Write(point, value, force)

    def write(self, write: Write, *, verify: bool = True) -> Conversation[Frame, Written]:
        point = write.point
        assert isinstance(point, ParameterPoint)

        def type_shown_by(sample: Sample | None) -> Format:
            type_code = self._type_of(point)
            if type_code in (None, Format.VOID) and sample is not None:
                type_code = FORMATS_BY_TYPE_NAME.get(sample.type)
            if type_code is None or type_code is Format.VOID:
                raise UsageError(f"{point} needs a type to be written, such as {point.text}:int16")
            return type_code

        def send(old: Sample | None) -> Conversation[Frame, bool]:
            type_code = type_shown_by(old)
            value = self._raw_value(point, type_code, write.value, write.force)
            again = point.role is Role.SETTING
            if point.standard:
                writing = self.master.write_standard(
                    point.index, point.subindex or 0, type_code, value, repeatable=again
                )
            else:
                writing = self.master.write_typed(
                    point.index,
                    type_code,
                    value,
                    point.subindex,
                    point.destination,
                    repeatable=again,
                )
            return (yield from believed(writing)).submitted

        def wanted(sample: Sample) -> bytes:
            return self._encode(point, type_shown_by(sample), write.value, write.force)

        return self._written(
            write,
            write_once(
                point, self.asked(write), lambda: self.read(point), send, wanted, verify=verify
            ),
        )

    def _written(
        self, write: Write, conversation: Conversation[Frame, Written]
    ) -> Conversation[Frame, Written]:
        """The record with the value as its type reads it, where only a read has shown the type."""
        record = yield from conversation
        return replace(record, asked=self.asked(write))

    def asked(self, write: Write) -> Value:
        """The physical value that a write wants, as far as its type is known."""
        point = write.point
        assert isinstance(point, ParameterPoint)
        type_code = self._type_of(point)
        if type_code in (None, Format.VOID) or not isinstance(write.value, str):
            return write.value
        assert type_code is not None
        return _physical(point, type_code, write.value)

    def encoded(self, write: Write) -> tuple[Value, bytes]:
        """The unscaled value of a write whose type is known, and its bytes."""
        point = write.point
        assert isinstance(point, ParameterPoint)
        assert point.type_code is not None
        value = self._raw_value(point, point.type_code, write.value, write.force)
        return value, encode_value(point.type_code, value)

    def _encode(
        self, point: ParameterPoint, type_code: Format, value: Value | str, force: bool
    ) -> bytes:
        raw = encode_value(type_code, self._raw_value(point, type_code, value, force))
        most = MOST_DATA - (3 if point.standard or point.subindex is None else 4)
        if len(raw) > most:
            raise UsageError(f"{len(raw)} characters are too many for {point}: at most {most}")
        return raw

    def _raw_value(
        self, point: ParameterPoint, type_code: Format, value: Value | str, force: bool
    ) -> Value:
        physical = _physical(point, type_code, value)
        if point.description is None:
            return physical
        if not force:
            point.description.check_limits(physical)
        return point.description.unscaled(physical, whole=type_code is not Format.FLOAT)

    # -- services --------------------------------------------------------------------------

    def status(self) -> Conversation[Frame, Report]:
        return services.status(self.master)

    def running(self) -> Conversation[Frame, str | None]:
        return services.running(self.master)

    def clear_faults(self) -> Conversation[Frame, Report]:
        return services.clear_faults(self.master)

    def reset_comm(self) -> Conversation[Frame, Report]:
        return services.reset_comm(self.master)

    def prepare_raw(self, text: str) -> Callable[[], Conversation[Frame, Report]]:
        return services.prepare_raw(self.master, text)


def _physical(point: ParameterPoint, type_code: Format, value: Value | str) -> Value:
    """What was asked for, as a physical value."""
    if not isinstance(value, str):
        return value
    description = point.description
    if description is not None and description.scale != 1.0:
        return parse_value(Format.FLOAT, value)
    return parse_value(type_code, value)


def device(address: int, profile: Profile, options: Mapping[str, str]) -> Slink3Device:
    """The device of a profile whose dialect, and broadcast address if set, are this protocol's."""
    return Slink3Device(address, profile, dialect_of(profile, options))


def dialect_of(profile: Profile, options: Mapping[str, str]) -> Dialect:
    name = profile.dialect or "slink3"
    if name not in DIALECTS:
        raise UsageError(
            f"profile {profile.name}: dialect {name!r} is none of {', '.join(DIALECTS)}"
        )
    chosen = DIALECTS[name]
    if "broadcast" not in options:
        return chosen
    text = options["broadcast"]
    if not is_digits(text) or not 128 <= whole_number(text) <= 255:
        raise UsageError(f"broadcast={text!r} is out of range: 128..255")
    return replace(chosen, broadcast=whole_number(text))
