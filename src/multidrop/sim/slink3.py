"""Simulated SLINK3 slaves: parameter tables, and what FlexMax, AX-V and DGFC386 do with them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from multidrop.errors import UsageError
from multidrop.events import Damaged, FrameReceived
from multidrop.profile import Profile
from multidrop.protocols.slink3 import AX_V, DGFC386, FLEXMAX, SLINK3, Dialect, Format, Frame, Slave
from multidrop.protocols.slink3.frame import ANSWER
from multidrop.protocols.slink3.messages import (
    READS,
    WRITES,
    Command,
    Response,
    StandardParameter,
    TypedParameter,
)
from multidrop.protocols.slink3.points import parse_point
from multidrop.protocols.slink3.slave import Reply, Request
from multidrop.protocols.slink3.status import (
    ACTUAL_SPEED,
    CONTROL_WORD,
    MALFUNCTION_CODE,
    SPEED_SETPOINT,
    STATUS_WORD,
)
from multidrop.protocols.slink3.values import Value, decode_value, encode_value
from multidrop.sim.drivecom import TOP_SPEED, Drive
from multidrop.sim.faults import Fault

TRIP = 65000
"""A parameter of the simulation alone: writing a malfunction code to it trips the drive."""

Where = tuple[int, int]  # index, subindex


@dataclass(slots=True)
class Parameter:
    """One parameter of a simulated slave. `get` and `set` replace the stored value."""

    type_code: Format
    value: Value = 0
    minimum: float | None = None
    maximum: float | None = None
    read_only: bool = False
    get: Callable[[float], Value] | None = None
    set: Callable[[Value, float], None] | None = None

    def read(self, now: float) -> bytes:
        return encode_value(self.type_code, self.get(now) if self.get else self.value)

    def write(self, raw: bytes, now: float) -> Response:
        value = decode_value(self.type_code, raw)
        if self.read_only:
            return Response.READ_ONLY_PARAMETER
        if not isinstance(value, str | bytes):
            if self.maximum is not None and value > self.maximum:
                return Response.ABOVE_MAXIMUM
            if self.minimum is not None and value < self.minimum:
                return Response.BELOW_MINIMUM
        if self.set is not None:
            self.set(value, now)
        self.value = value
        return Response.OK


class Parameters:
    """Parameters by index and subindex; a frame without subindex means subindex 0."""

    def __init__(self, known: dict[Where, Parameter]) -> None:
        self.known = known

    def respond(self, request: Request, now: float) -> Reply:
        """Read or write the parameter that a request names."""
        asked = request.parameter
        assert asked is not None
        parameter = self.known.get((asked.index, asked.subindex or 0))
        if parameter is None:
            return Reply(Response.PARAMETER_NOT_EXIST)
        if isinstance(asked, TypedParameter) and asked.type_code not in (
            Format.VOID,
            parameter.type_code,
        ):
            return Reply(Response.TYPE_VALUE_ERROR)
        if request.command not in WRITES:
            return request.found(parameter.type_code, parameter.read(now))
        if isinstance(asked, StandardParameter) and len(request.value) != len(parameter.read(now)):
            return Reply(Response.LENGTH_ERROR)
        return Reply(parameter.write(request.value, now))


class SimulatedSlave:
    """A slave with parameters: an AX-V, a DGFC386, or anything else without a drive inside.

    `behind` is what destination ID 2 leads to: the card of a drive, the drive of a card.
    """

    def __init__(
        self,
        address: int,
        dialect: Dialect,
        parameters: Parameters,
        behind: SimulatedSlave | None = None,
    ) -> None:
        self.slave = Slave(address, dialect, option=behind is not None)
        self.parameters = parameters
        self.behind = behind
        self._next_address = address

    @property
    def address(self) -> int:
        return self.slave.address

    def move(self, address: Value, now: float = 0.0) -> None:
        """Take another address, once the request at hand is answered from the old one."""
        self._next_address = int(address)

    def receive(self, events: list[FrameReceived[Frame] | Damaged], now: float) -> list[bytes]:
        answers = []
        for request in self.slave.receive_events(events):
            asked = self.behind if request.destination and self.behind else self
            reply = request.settled or asked.respond(request, now)
            self.slave.fault = self.in_fault
            self.slave.fault_behind = self.behind is not None and self.behind.in_fault
            answer = self.slave.answer(request, reply)
            self.slave.address = self._next_address
            if answer:
                answers.append(answer)
        return answers

    @property
    def in_fault(self) -> bool:
        return False

    def disguise(self, answer: bytes, fault: Fault) -> bytes:
        """Another slave's answer, or one with another sequence number."""
        frame = Frame.decode(answer)
        if fault is Fault.OTHER_SLAVE:
            return Frame((frame.address + 1) % 128, *frame[1:]).encode()
        return frame.numbered((frame.control >> 2) + 7).encode()

    def respond(self, request: Request, now: float) -> Reply:
        """What this device says to a request that the protocol lets through."""
        if request.command == Command.SPECIAL_ACCESS:
            return Reply(Response.OK, request.value)
        if request.parameter is not None:
            return self.parameters.respond(request, now)
        return self._service(request, now)

    def _service(self, request: Request, now: float) -> Reply:
        return Reply(Response.OK)  # reset: nothing of a simulated serial interface needs it


class FlexMax(SimulatedSlave):
    """A FlexMax with a drive inside; `behind` is its DGFC386."""

    def __init__(
        self, address: int, behind: SimulatedSlave | None = None, dialect: Dialect = FLEXMAX
    ) -> None:
        super().__init__(address, dialect, self._drive_parameters(address), behind)

    def _drive_parameters(self, address: int) -> Parameters:
        drive = self.drive = Drive()
        word = Format.UNSIGNED_SHORT_INT

        def read_only(get: Callable[[float], Value], type_code: Format = word) -> Parameter:
            return Parameter(type_code, read_only=True, get=get)

        return Parameters(
            {
                (8236, 0): Parameter(Format.SHORT_INT, 0),
                (8511, 0): Parameter(word, address, 0, 127, set=self.move),
                (TRIP, 0): Parameter(word, set=lambda code, now: drive.trip(int(code), now)),
                (CONTROL_WORD, 0): Parameter(
                    word,
                    get=lambda now: drive.control_word,
                    set=lambda value, now: drive.control(int(value), now),
                ),
                (STATUS_WORD, 0): read_only(drive.status_word),
                (SPEED_SETPOINT, 0): Parameter(
                    Format.SHORT_INT,
                    minimum=-TOP_SPEED,
                    maximum=TOP_SPEED,
                    get=lambda now: drive.speed_setpoint,
                    set=lambda value, now: drive.set_speed(int(value), now),
                ),
                (ACTUAL_SPEED, 0): read_only(drive.actual_speed, Format.SHORT_INT),
                (MALFUNCTION_CODE, 0): read_only(lambda now: drive.malfunction_code),
            }
        )

    @property
    def in_fault(self) -> bool:
        return self.drive.in_fault

    def _service(self, request: Request, now: float) -> Reply:
        if request.command == Command.STATUS_WORD:
            return Reply(Response.OK, self.drive.status_word(now).to_bytes(2, "little"))
        if request.command == Command.MALFUNCTION_CODE:
            return Reply(Response.OK, self.drive.malfunction_code.to_bytes(2, "little"))
        return super()._service(request, now)


def ax_v(address: int) -> SimulatedSlave:
    """An AX-V with the two parameters that its manual prints."""
    return SimulatedSlave(
        address,
        AX_V,
        Parameters(
            {
                (1009, 0): Parameter(Format.SHORT_INT, 125),
                (1111, 0): Parameter(Format.SHORT_INT, 100),
            }
        ),
    )


def dgfc386(address: int, behind: SimulatedSlave | None = None) -> SimulatedSlave:
    """A DGFC386 that is wired directly, or behind a drive; `behind` is the drive of a direct one."""
    own = Parameter(Format.UNSIGNED_CHAR, address, 0, 127)
    card = SimulatedSlave(address, DGFC386, Parameters({(511, 0): own}), behind)
    own.set = card.move
    return card


def simulated(profile: Profile, address: int, behind: str | None) -> SimulatedSlave:
    """The device of a profile's dialect. Raises `UsageError`."""
    dialect = profile.dialect or "slink3"
    if behind is not None and (dialect, behind) not in (
        ("flexmax", "dgfc386"),
        ("slink3", "dgfc386"),
        ("dgfc386", "flexmax"),
    ):
        raise UsageError(
            f"{profile.name} has no {behind} behind it; flexmax+dgfc386 and dgfc386+flexmax exist"
        )
    if dialect == AX_V.name:
        slave = ax_v(address)
    elif dialect == DGFC386.name:
        slave = dgfc386(address, FlexMax(address) if behind else None)
    else:
        card = dgfc386(address) if behind else None
        slave = FlexMax(address, card, SLINK3 if dialect == SLINK3.name else FLEXMAX)
    _add_described(slave, profile)
    return slave


def _add_described(slave: SimulatedSlave, profile: Profile) -> None:
    """Points that a plant file or a profile of one's own adds: they begin with 0, or their default."""
    for name, item in profile.points.items():
        point = parse_point(name, profile, slave.slave.dialect)
        where = (point.index, point.subindex or 0)
        if point.destination or where in slave.parameters.known:
            continue
        type_code = point.type_code or Format.SHORT_INT
        text = type_code in (Format.STRING, Format.OCTET_STRING)
        slave.parameters.known[where] = Parameter(
            type_code,
            "" if text else item.unscaled(item.default or 0),
            None if item.minimum is None else float(item.unscaled(item.minimum)),
            None if item.maximum is None else float(item.unscaled(item.maximum)),
            read_only="w" not in item.access,
        )


def unknown(question: Frame) -> bytes | None:
    """What a slave says to a question that it knows nothing about."""
    asked = question.code in READS or question.code in WRITES
    code = Response.PARAMETER_NOT_EXIST if asked else Response.UNKNOWN_COMMAND
    order = question.order & 0x0E | ANSWER
    return Frame(question.address, question.control, order, code).encode()
