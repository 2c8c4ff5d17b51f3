"""A Datalink instrument for everything above: points by name, values in units, confirmed writes."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence

from multidrop.conversation import Conversation
from multidrop.device import Report, Sizes, Write
from multidrop.errors import NoReply, ProtocolError, UsageError
from multidrop.numerals import decimal_number
from multidrop.points import Point, Sample, Value
from multidrop.profile import Profile
from multidrop.protocols.datalink import entry, status
from multidrop.protocols.datalink.describe import describe
from multidrop.protocols.datalink.frame import (
    MOST_ADDRESS,
    MOST_DATA,
    OVERHEAD,
    Command,
    Frame,
)
from multidrop.protocols.datalink.master import SETTLE, Master
from multidrop.protocols.datalink.memory import (
    MAP_IDENTIFIER_AT,
    MAPS,
    MemoryMap,
    pieces,
    plan,
    span,
)
from multidrop.protocols.datalink.points import DataPoint, Points
from multidrop.protocols.datalink.values import encode_value, parse_value
from multidrop.protocols.datalink.writing import write_point
from multidrop.writing import Written


class DatalinkDevice:
    """The instrument at `address`, with the memory map of its profile."""

    def __init__(
        self,
        address: int,
        profile: Profile,
        memory_map: MemoryMap,
        *,
        stuffing: bool = True,
        settle: float = SETTLE,
    ) -> None:
        self.address = address
        self.profile = profile
        self.map = memory_map
        self.settle = settle
        self.master = Master(address, stuffing=stuffing)
        self._points = Points(profile, memory_map)
        self._map_found = memory_map.identifier is None  # nothing to look for

    # -- points ----------------------------------------------------------------------------

    def point(self, text: str) -> DataPoint:
        found = self._points.find(text)
        if len(found) != 1:
            raise UsageError(f"{text} names {len(found)} points, where one is wanted")
        return found[0]

    def points(self, text: str) -> list[DataPoint]:
        """The points that `text` names: several for a range."""
        return self._points.find(text)

    def plan(self, points: Iterable[Point]) -> list[tuple[DataPoint, ...]]:
        """The points in groups that `read_group` reads with one message each."""
        return plan(_data_point(point) for point in points)

    def read(self, point: Point) -> Conversation[Frame, Sample]:
        return (yield from self.read_group((point,)))[0]

    def read_group(self, group: Sequence[Point]) -> Conversation[Frame, list[Sample]]:
        """Read points together, with whatever lies between them."""
        points = [_data_point(point) for point in group]
        yield from self._check_map(points)
        start, count = span(points)
        memory = yield from self.master.interrogate(start, count)
        return [point.sample(memory[point.memory_address - start :]) for point in points]

    def sizes(self, group: Sequence[Point]) -> list[Sizes]:
        """Without the bytes that stuffing inserts: one in 256, and none in most answers."""
        messages = pieces(*span([_data_point(point) for point in group]))
        return [Sizes(OVERHEAD, OVERHEAD + count) for _, count in messages]

    def _check_map(self, points: Iterable[DataPoint]) -> Conversation[Frame, None]:
        if not self._map_found and any(point.mapped for point in points):
            yield from self.check_map()

    def check_map(self) -> Conversation[Frame, None]:
        """Before the first use of the map: does the instrument have it? Raises `ProtocolError`."""
        if self._map_found:
            return
        where = f"the memory map identifier at {MAP_IDENTIFIER_AT:04X}h"
        try:
            found = yield from self.master.map_identifier()
        except NoReply as failure:
            raise NoReply(
                failure.attempts,
                failure.damaged,
                failure.heard,
                because=f"{where} could not be read: {failure.because}",
            ) from failure
        if found != self.map.identifier:
            raise ProtocolError(
                f"{where} is {found}, and map {self.map.name} has {self.map.identifier}: this is no"
                f" {self.profile.name} as its profile knows it; mem/ADDRESS/COUNT needs no map"
            )
        self._map_found = True

    # -- writing ---------------------------------------------------------------------------

    def prepare_write(self, text: str, value: Value | str, *, force: bool = False) -> Write:
        point = self.point(text)
        description = point.description
        if description is not None and "w" not in description.access and not force:
            raise UsageError(
                f"{point} is read-only in profile {self.profile.name}; --force writes it"
            )
        write = Write(point, value, force)
        self._change(write)
        return write

    def write(self, write: Write, *, verify: bool = True) -> Conversation[Frame, Written]:
        point = _data_point(write.point)
        change = self._change(write)
        yield from self._check_map((point,))
        asked = _physical(point, write.value)
        return (
            yield from write_point(self.master, point, asked, change, self.settle, verify=verify)
        )

    def _change(self, write: Write) -> Frame:
        """The message of a write: Change Bits for a bit, else Change. Raises `UsageError`."""
        point = _data_point(write.point)
        if point.count > MOST_DATA:
            raise UsageError(
                f"{point}: one change takes at most {MOST_DATA} bytes; of two, one could be lost"
            )
        value = _physical(point, write.value)
        if point.description is not None and not write.force:
            point.description.check_limits(value)
        raw = encode_value(point.letter, point.unscaled(value), point.count)
        if point.letter != "L":
            return self.master.change_message(point.memory_address, raw)
        return self.master.bits_message(
            point.memory_address, [(1 << point.bit, raw[0] << point.bit)]
        )

    # -- services --------------------------------------------------------------------------

    def status(self) -> Conversation[Frame, Report]:
        if self.map.identifier is None:
            return self._unmapped_status()
        return self._status()

    def _status(self) -> Conversation[Frame, Report]:
        points = [self.point(text) for text in status.status_points(self._points)]
        found: dict[str, bytes] = {}
        for group in self.plan(points):
            samples = yield from self.read_group(group)
            found.update(
                {point.text: sample.raw for point, sample in zip(group, samples, strict=True)}
            )
        names = {point.text: point.name or point.text for point in points}
        return status.report(self.map.name, found, names)

    def _unmapped_status(self) -> Conversation[Frame, Report]:
        """No source says where such an instrument keeps its state: a byte shows that it answers."""
        yield from self.master.interrogate(self._first_address(), 1)
        return status.unknown(self.map.name)

    def running(self) -> Conversation[Frame, str | None]:
        """The loops that are in automatic: they move their outputs; None where no source says."""
        bits = [self.point(text) for text in status.automatic_points(self._points)]
        loops = []
        for group in self.plan(bits):
            samples = yield from self.read_group(group)
            loops += [str(bit) for bit, sample in zip(group, samples, strict=True) if sample.value]
        return f"in automatic: {', '.join(loops)}" if loops else None

    def clear_faults(self) -> Conversation[Frame, Report]:
        raise UsageError(
            "Datalink has no command that clears faults; an alarm is acknowledged by writing 0 to"
            " its own point"
        )

    def reset_comm(self) -> Conversation[Frame, Report]:
        raise UsageError("Datalink has no command that resets an instrument's serial interface")

    @property
    def actions(self) -> Mapping[str, str]:
        return {entry.ACTION: entry.MEANING}

    def prepare_action(self, name: str) -> Callable[[], Conversation[Frame, Report]]:
        """The only one of `actions`, by name. Raises `UsageError`."""
        if name != entry.ACTION:
            raise UsageError(f"{name!r} is no action; the only one is {entry.ACTION}")

        def converse() -> Conversation[Frame, Report]:
            yield from entry.open_port(self.master, self._first_address())
            line = "the configuration port answers, until 30 s have passed without a byte"
            return Report({"action": name}, (line,))

        return converse

    def _first_address(self) -> int:
        """Of a byte that an instrument with this map has."""
        return min(area.base for area in self.map.areas.values())

    def prepare_raw(self, text: str) -> Callable[[], Conversation[Frame, Report]]:
        question = _raw_message(text, self.address)

        def converse() -> Conversation[Frame, Report]:
            reply = yield from self.master.ask(question)
            lines = [describe(reply)]
            if question.command is not Command.INTERROGATE:
                lines.append("this is the echo; it was not acknowledged, so nothing was changed")
            return Report(
                {
                    "command": question.command.name.lower(),
                    "memory_address": reply.memory_address,
                    "count": reply.count,
                    "data": reply.data.hex(),
                },
                tuple(lines),
            )

        return converse


def _data_point(point: Point) -> DataPoint:
    assert isinstance(point, DataPoint)
    return point


def _physical(point: DataPoint, value: Value | str) -> Value:
    """What was asked for, as a physical value."""
    if not isinstance(value, str):
        return value
    description = point.description
    named = description.raw_of_name(value) if description is not None else None
    if named is not None:
        return bool(named) if point.letter == "L" else named
    if description is not None and description.scale != 1.0:
        return parse_value("C", value)
    return parse_value(point.letter, value)


def _raw_message(text: str, address: int) -> Frame:
    """The message whose bytes between SOH and LRC are `text` in hex, the I.A. filled in."""
    try:
        body = bytes.fromhex(text)
    except ValueError:
        raise UsageError(
            f"{text!r} is not hex bytes: CMD, NUM, LO ADD, HI ADD, data, as in 'E0 09 00 10'"
        ) from None
    command, named = (body[0] & ~MOST_ADDRESS, body[0] & MOST_ADDRESS) if body else (0, 0)
    if command in (Command.RESPONSE, Command.ACKNOWLEDGE):
        raise UsageError(
            f"{text!r}: a host sends no Response, and an Acknowledge belongs to its write;"
            " E0, A0 and C0 can be sent"
        )
    if len(body) < 4:
        raise UsageError(f"{text!r} is too short: CMD, NUM, LO ADD, HI ADD at least")
    if named not in (0, address):
        raise UsageError(f"{text!r} is for address {named}, not {address}")
    return Frame(command, address, body[2] | body[3] << 8, body[1], body[4:])


def device(address: int, profile: Profile, options: Mapping[str, str]) -> DatalinkDevice:
    """The instrument with its profile's map. Raises `UsageError` for a dialect or option unknown."""
    return DatalinkDevice(
        address,
        profile,
        memory_map_of(profile),
        stuffing=stuffing_of(options),
        settle=_settle_of(options),
    )


def memory_map_of(profile: Profile) -> MemoryMap:
    """The map of a profile's dialect. Raises `UsageError`."""
    name = profile.dialect or "map-a"
    if name not in MAPS:
        raise UsageError(f"profile {profile.name}: dialect {name!r} is none of {', '.join(MAPS)}")
    return MAPS[name].with_bases(profile.bases)


def stuffing_of(options: Mapping[str, str]) -> bool:
    text = options.get("stuffing", "on")
    if text not in ("on", "off"):
        raise UsageError(f"stuffing={text!r} is none of on, off")
    return text == "on"


def _settle_of(options: Mapping[str, str]) -> float:
    text = options.get("settle", str(SETTLE))
    try:
        settle = decimal_number(text)
    except ValueError:
        raise UsageError(f"settle={text!r} is not a number of seconds") from None
    if not 0 <= settle <= 60:
        raise UsageError(f"settle={text} s is out of range: 0..60")
    return settle
