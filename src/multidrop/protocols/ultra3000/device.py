"""An Ultra3000 drive for everything above: points by name, values in units, the write rule, services."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

from multidrop.conversation import Conversation
from multidrop.device import Copy, Memory, OneByOne, Report, Sizes, Write
from multidrop.errors import (
    DeviceError,
    Error,
    OutcomeUnknown,
    UsageError,
)
from multidrop.numerals import is_digits, whole_number
from multidrop.points import Point, Role, Sample, Value, shown_value
from multidrop.profile import Profile, nearest
from multidrop.protocols.ultra3000 import memory, services
from multidrop.protocols.ultra3000.frame import Frame
from multidrop.protocols.ultra3000.master import Master
from multidrop.protocols.ultra3000.messages import (
    BROADCAST,
    Function,
    Refusal,
)
from multidrop.protocols.ultra3000.points import ParameterPoint, View, parse_point, size_of
from multidrop.protocols.ultra3000.values import (
    ACTION,
    HEX,
    INTEGERS,
    encode_hex,
    encode_value,
    parse_value,
)
from multidrop.writing import Outcome, Written, write_once


class Ultra3000Device(OneByOne):
    """The drive at `address`, 0..253."""

    def __init__(self, address: int, profile: Profile, broadcast: int = BROADCAST) -> None:
        self.address = address
        self.profile = profile
        self.master = Master(address, broadcast=broadcast)

    # -- points ----------------------------------------------------------------------------

    def point(self, text: str) -> ParameterPoint:
        return parse_point(text, self.profile)

    def points(self, text: str) -> list[ParameterPoint]:
        """The point that `text` names, or every element of an array."""
        return list(memory.elements(parse_point(text, self.profile, whole=True)))

    def readable(self) -> list[Point]:
        """Every point of the profile that has a working value, arrays element by element."""
        return list(memory.points_offering(self.profile, Function.READ_WORKING))

    def read(self, point: Point) -> Conversation[Frame, Sample]:
        assert isinstance(point, ParameterPoint)
        if not point.offers(point.view.read):
            raise UsageError(f"{point} can only be written")
        return self.sample(point)

    def size(self, point: Point) -> Sizes:
        return size_of(point)

    def sample(self, point: ParameterPoint) -> Conversation[Frame, Sample]:
        """Read a point, also one that the profile calls write-only: the drive decides."""
        return memory.sample(self.master, point)

    # -- writing ---------------------------------------------------------------------------

    def prepare_write(self, text: str, value: Value | str, *, force: bool = False) -> Write:
        point = self.point(text)
        function = point.view.write
        if function is None:
            raise UsageError(f"{point} cannot be written: only the working and the nv value can")
        if not point.offers(function) and not force:
            saved = point.of(View.NV)
            if point.view is View.WORKING and saved.offers(Function.WRITE_NON_VOLATILE):
                raise UsageError(f"{point} takes only non-volatile writes: {saved.text}")
            raise UsageError(
                f"{point} is read-only in profile {self.profile.name}; --force writes it"
            )
        write = Write(point, value, force)
        self.digits(write, None)
        return write

    def write(self, write: Write, *, verify: bool = True) -> Conversation[Frame, Written]:
        point = write.point
        assert isinstance(point, ParameterPoint)
        if point.kind is ACTION:
            return self._write_action(point)
        return self._write_value(write, point, verify)

    def _write_action(self, point: ParameterPoint) -> Conversation[Frame, Written]:
        """An action has no value to read before or after."""
        record = Written(point, "", Outcome.UNVERIFIED)
        try:
            yield from services.act(self.master, point.parameter, str(point))
        except DeviceError as refusal:
            return replace(record, outcome=Outcome.NOT_APPLIED, error=refusal)
        except OutcomeUnknown as unknown:
            return replace(record, outcome=Outcome.UNKNOWN, error=unknown)
        return record

    def _write_value(
        self, write: Write, point: ParameterPoint, verify: bool
    ) -> Conversation[Frame, Written]:
        def send(old: Sample | None) -> Conversation[Frame, bool]:
            digits = self.digits(write, old)
            try:
                yield from self.master.write(
                    point.parameter, digits, point.element, non_volatile=point.view is View.NV
                )
            except DeviceError as refusal:
                raise (yield from self._with_limits(point, refusal)) from refusal
            return False

        def wanted(found: Sample) -> bytes:
            return self.wanted(write, found)

        yield from self.master.learn_echo()
        asked = self.asked(write)
        record: Written = yield from write_once(
            _sent_once(point), asked, lambda: self.sample(point), send, wanted, verify=verify
        )
        return replace(record, point=point)

    def asked(self, write: Write) -> Value:
        """The physical value that a write wants."""
        point = write.point
        assert isinstance(point, ParameterPoint)
        return _physical(point, write.value)

    def digits(self, write: Write, old: Sample | None) -> str:
        """What a write puts into the data field. Raises `UsageError`.

        The width of a parameter that nobody describes is that of its `old` value.
        """
        point = write.point
        assert isinstance(point, ParameterPoint)
        if point.kind is ACTION:
            if write.value != "":
                raise UsageError(f"{point} is an action and takes no value: {point.name}=")
            return ""
        if point.kind is HEX:
            if isinstance(write.value, int) and old is None:
                return ""  # its width is not known yet
            return encode_hex(write.value, len(old.raw) if old is not None else None)
        return encode_value(point.kind, self._raw_value(write, point))

    def wanted(self, write: Write, found: Sample) -> bytes:
        """The digits that a read-back must show, in the width and with the padding of `found`."""
        point = write.point
        assert isinstance(point, ParameterPoint)
        if point.kind is HEX:
            return self.digits(write, found).encode()
        raw = self._raw_value(write, point)
        if found.value == raw:
            return found.raw
        return encode_value(INTEGERS.get(found.type, point.kind), raw).encode()

    def _raw_value(self, write: Write, point: ParameterPoint) -> Value:
        physical = _physical(point, write.value)
        assert point.description is not None, "only a profile gives a type"
        if not write.force:
            point.description.check_limits(physical)
        return point.description.unscaled(physical)

    def _with_limits(
        self, point: ParameterPoint, refusal: DeviceError
    ) -> Conversation[Frame, DeviceError]:
        """A refusal of a value with the limits that the drive itself gives."""
        functions = {
            Refusal.BELOW_MINIMUM: (Function.READ_MINIMUM, Function.READ_MAXIMUM),
            Refusal.ABOVE_MAXIMUM: (Function.READ_MINIMUM, Function.READ_MAXIMUM),
            Refusal.INVALID_INDEX: (Function.READ_INDEX_MINIMUM, Function.READ_INDEX_MAXIMUM),
        }
        asked = functions.get(refusal.code)  # type: ignore[call-overload]
        if asked is None or not all(point.offers(function) for function in asked):
            return refusal
        limits = []
        try:
            for function in asked:
                limits.append((yield from self._limit(point, function)))
        except Error:
            return refusal  # the refusal itself is what counts
        unit = f" {point.unit}" if point.unit and refusal.code != Refusal.INVALID_INDEX else ""
        return DeviceError(
            refusal.code, f"{refusal.meaning}; the drive allows {limits[0]}..{limits[1]}{unit}"
        )

    def _limit(self, point: ParameterPoint, function: Function) -> Conversation[Frame, str]:
        if function in (Function.READ_INDEX_MINIMUM, Function.READ_INDEX_MAXIMUM):
            data = yield from self.master.read(point.parameter, None, function)
            return str(int(data, 16))
        found = yield from self.master.read_as(
            point.sample, point.parameter, point.element, function
        )
        return shown_value(point.physical(found.value))

    # -- services --------------------------------------------------------------------------

    def status(self) -> Conversation[Frame, Report]:
        return services.status(self.master)

    def running(self) -> Conversation[Frame, str | None]:
        return services.running(self.master)

    def clear_faults(self) -> Conversation[Frame, Report]:
        return services.clear_faults(self.master)

    def reset_comm(self) -> Conversation[Frame, Report]:
        return services.reset_comm(self.master)

    @property
    def actions(self) -> Mapping[str, str]:
        """What the drive does at once: name -> meaning."""
        return {
            point.name or point.text: point.description.meaning if point.description else ""
            for point in memory.points_offering(self.profile, Function.WRITE_WORKING)
            if point.kind is ACTION
        }

    def prepare_action(self, name: str) -> Callable[[], Conversation[Frame, Report]]:
        """One of `actions`, by name. Raises `UsageError` with the nearest."""
        known = self.actions
        try:
            point = self.point(name)
        except UsageError:
            raise UsageError(
                f"there is no action {name!r}{nearest(name, known)}; actions are {', '.join(known)}"
            ) from None
        if point.kind is not ACTION:
            raise UsageError(f"{point} is no action; actions are {', '.join(known)}")

        def converse() -> Conversation[Frame, Report]:
            yield from services.act(self.master, point.parameter, str(point))
            return Report({"action": point.name}, (f"{point.name}: the drive took it",))

        return converse

    def prepare_raw(self, text: str) -> Callable[[], Conversation[Frame, Report]]:
        return services.prepare_raw(self.master, text)

    # -- memory ----------------------------------------------------------------------------

    def prepare_copy(self, text: str, *, save: bool, force: bool = False) -> Copy:
        """The copy of a parameter to (`save`) or from its non-volatile value. Raises `UsageError`."""
        return memory.prepare_copy(self.profile, text, save, force)

    def copy(self, copy: Copy, *, verify: bool = True) -> Conversation[Frame, list[Written]]:
        return memory.copy(self.master, copy, verify)

    def comparable(self) -> list[Point]:
        """Every point of the profile that has a non-volatile value, arrays element by element."""
        return list(memory.points_offering(self.profile, Function.READ_NON_VOLATILE))

    def compare(self, point: Point) -> Conversation[Frame, Memory]:
        assert isinstance(point, ParameterPoint)
        return memory.compare(self.master, point)


def _physical(point: ParameterPoint, value: Value | str) -> Value:
    """What was asked for, as a physical value; a name of the profile stands for its value."""
    description = point.description
    if not isinstance(value, str) or description is None:
        return value
    named = description.raw_of_name(value)
    if named is not None:
        return description.physical(named)
    return parse_value(point.kind, value, scaled=description.scale != 1.0)


def _sent_once(point: ParameterPoint) -> ParameterPoint:
    """A non-volatile write wears memory: never repeated, whatever the point is for."""
    if point.view is not View.NV or point.description is None:
        return point
    return replace(point, description=replace(point.description, role=Role.UNKNOWN))


def device(address: int, profile: Profile, options: Mapping[str, str]) -> Ultra3000Device:
    """The device of a profile, with the broadcast address of its line if that was set."""
    broadcast = broadcast_of(options)
    if address == broadcast:
        raise UsageError(f"address {address} is the broadcast address of the line")
    return Ultra3000Device(address, profile, broadcast)


def broadcast_of(options: Mapping[str, str]) -> int:
    """The broadcast address. Raises `UsageError`."""
    text = options.get("broadcast", str(BROADCAST))
    if not is_digits(text) or not 0 <= whole_number(text) <= 0xFF:
        raise UsageError(f"broadcast={text!r} is out of range: 0..255")
    return whole_number(text)
