"""The slave's side: bytes in, requests out; responses in, bytes out. It calls no device.

::

    for request in slave.receive_data(data):
        response = request.settled or ...   # what the device says
        to_send = slave.answer(request, response)

What the protocol itself decides (unknown command, wrong LENGTH, a type that the
dialect does not have, broadcast verify) arrives with `settled` filled in; a
frame that gets silence does not arrive at all.
"""

from __future__ import annotations

from typing import NamedTuple

from multidrop.errors import UsageError
from multidrop.events import Damaged
from multidrop.protocols.slink3.dialects import BEHIND, DIALECTS, SLINK3, Dialect
from multidrop.protocols.slink3.frame import ANSWER, FAULT, START, Frame, decoder
from multidrop.protocols.slink3.messages import (
    READS,
    WRITES,
    Command,
    Response,
    StandardParameter,
    TypedParameter,
)
from multidrop.protocols.slink3.values import Format, width
from multidrop.serving import BaseSlave


class Reply(NamedTuple):
    """What a device says: a RESPONSE and the DATA behind it (only with OK, or ABCD)."""

    response: int = Response.OK
    data: bytes = b""


class Request(NamedTuple):
    """One request to this slave. `parameter` and `value` (VALUE's bytes) are of reads and writes."""

    frame: Frame
    parameter: TypedParameter | StandardParameter | None = None
    value: bytes = b""
    settled: Reply | None = None

    @property
    def command(self) -> int:
        return self.frame.code

    @property
    def destination(self) -> int:
        """Destination ID: 0 the slave itself, 2 what is behind it."""
        return self.frame.destination

    def found(self, type_code: int, raw: bytes) -> Reply:
        """The OK answer to a read: the parameter's type and VALUE's bytes."""
        if isinstance(self.parameter, TypedParameter):
            parameter = TypedParameter(type_code, self.parameter.index, self.parameter.subindex)
            return Reply(Response.OK, parameter.encode() + raw)
        assert self.parameter is not None, "only a read is answered with a value"
        return Reply(Response.OK, self.parameter.encode() + raw)


class Slave(BaseSlave[Frame, Request]):
    """The slave at `address`, 0..127. `fault` is the fault bit of every answer.

    `option` says that the dialect's partner is connected behind it (a DGFC386
    behind a drive): destination ID 2 then leads there.
    """

    def __init__(
        self,
        address: int,
        dialect: Dialect = SLINK3,
        *,
        option: bool = False,
        answer_damage: bool = False,
    ) -> None:
        if not 0 <= address <= 127:
            raise UsageError(f"address {address} is out of range: a slave has 0..127")
        super().__init__(address, decoder())
        self.dialect = dialect
        self.behind = DIALECTS[dialect.behind] if option and dialect.behind else None
        self.fault = False
        self.fault_behind = False
        self._answer_damage = answer_damage
        self._broadcast_received = False

    def answer(self, request: Request, reply: Reply) -> bytes:
        """The bytes to send for a request: none for a broadcast."""
        frame = request.frame
        address, control, asked_order, command, _ = frame
        response, data = reply
        if address != self.address:
            return b""
        if command == Command.RESET_SLAVE and response == Response.OK:
            self._broadcast_received = False
            self._decoder = decoder()
        dialect = self._dialect_of(frame) or self.dialect
        fault = self.fault_behind if frame.destination else self.fault
        order = asked_order & 0x0E | ANSWER | (FAULT if fault and dialect.fault_bit else 0)
        code = dialect.refusal(response)
        if code != Response.OK and command != Command.SPECIAL_ACCESS:
            data = b""
        return Frame(address, control, order, code, data).encode()

    # -- what the protocol decides ---------------------------------------------------------

    def _receive(self, frame: Frame) -> Request | None:
        address, _, order, code, _ = frame
        if order & ANSWER:
            return None
        if address == self.dialect.broadcast:
            return self._receive_broadcast(frame)
        if address != self.address:
            return None
        if code == Command.BROADCAST_COMMAND_VERIFY and not frame.destination:
            return self._verify(frame)
        self._broadcast_received = False
        dialect = self._dialect_of(frame)
        if dialect is None:
            return _refused(frame, Response.DESTINATION_NOT_EXIST)
        return _understood(frame, dialect)

    def _receive_broadcast(self, frame: Frame) -> Request | None:
        if (frame.code not in WRITES and frame.code != Command.RESET_SLAVE) or frame.destination:
            return None
        self._broadcast_received = True
        request = _understood(frame, self.dialect)
        return None if request.settled is not None else request

    def _verify(self, frame: Frame) -> Request:
        if Command.BROADCAST_COMMAND_VERIFY not in self.dialect.commands:
            return _refused(frame, Response.UNKNOWN_COMMAND)
        if frame.data:
            return _refused(frame, Response.LENGTH_ERROR)
        received = self._broadcast_received
        return _refused(frame, Response.OK_BROADCAST if received else Response.NOT_OK)

    def _damage(self, event: Damaged) -> Request | None:
        """Silence, since the address may be wrong; 0097 if that was chosen and the address is ours."""
        raw = event.raw
        if not self._answer_damage or len(raw) < 5 or raw[4] & ANSWER:
            return None
        if raw[:2] != bytes([START, self.address]):
            return None
        return _refused(Frame(self.address, raw[2], raw[4] & 0x0E), Response.FRAME_ERROR)

    def _dialect_of(self, frame: Frame) -> Dialect | None:
        destination = frame.destination
        if destination == 0:
            return self.dialect
        return self.behind if destination == BEHIND else None


def _refused(frame: Frame, response: Response) -> Request:
    return Request(frame, settled=Reply(response))


def _understood(frame: Frame, dialect: Dialect) -> Request:
    """The request that a frame makes of a slave of this dialect, or its settled refusal."""
    _, _, _, code, data = frame
    if code not in dialect.commands:
        return _refused(frame, Response.UNKNOWN_COMMAND)
    if code == Command.SPECIAL_ACCESS:
        return Request(frame, value=data)
    if code not in READS and code not in WRITES:
        return _refused(frame, Response.LENGTH_ERROR) if data else Request(frame)
    found: tuple[TypedParameter | StandardParameter, bytes] | None
    if code in (Command.READ_TYPED_PARAMETER, Command.WRITE_TYPED_PARAMETER):
        found = TypedParameter.decode(data)
    else:
        found = StandardParameter.decode(data)
    if found is None:
        return _refused(frame, Response.LENGTH_ERROR)
    parameter, value = found
    refusal = _refused_type(frame, parameter, dialect) or _refused_length(frame, parameter, value)
    return _refused(frame, refusal) if refusal else Request(frame, parameter, value)


def _refused_length(
    frame: Frame, parameter: TypedParameter | StandardParameter, value: bytes
) -> Response | None:
    """A read with something behind its parameter, a write with a value of the wrong width."""
    if frame.code in READS:
        return Response.LENGTH_ERROR if value else None
    if isinstance(parameter, StandardParameter):
        return None if value else Response.LENGTH_ERROR
    expected = width(Format(parameter.type_code))
    return Response.LENGTH_ERROR if expected not in (None, len(value)) else None


def _refused_type(
    frame: Frame, parameter: TypedParameter | StandardParameter, dialect: Dialect
) -> Response | None:
    if not isinstance(parameter, TypedParameter):
        return None
    if parameter.subindex is not None and not dialect.subindex:
        return Response.LENGTH_ERROR
    if parameter.type_code not in dialect.formats:
        return Response.TYPE_UNKNOWN
    if parameter.type_code == Format.VOID and frame.code in WRITES:
        return Response.TYPE_UNKNOWN
    return None
