"""The master's side: every service of the documents as a conversation.

Methods describe, they do not send: `line.run(Master(0).status_word())` does.
A refusal is raised as `DeviceError` where a value was asked for.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

from multidrop.conversation import Ask, Conversation, Tell
from multidrop.errors import DeviceError, ProtocolError, UsageError
from multidrop.points import Sample
from multidrop.protocols.slink3.dialects import SLINK3, Dialect
from multidrop.protocols.slink3.frame import Frame
from multidrop.protocols.slink3.messages import (
    WRITES,
    Command,
    Response,
    StandardParameter,
    TypedParameter,
    command_name,
    response_meaning,
    type_name,
)
from multidrop.protocols.slink3.status import State, bits_set, malfunction_family, state
from multidrop.protocols.slink3.values import FORMATS, Format, Value, decode_value, encode_value

FRAME_ERROR_ATTEMPTS = 3

NO_REFUSALS = (Response.OK, Response.COMMAND_SUBMITTED, Response.OK_BROADCAST)
"""What answers some commands well, and to the others says nothing."""


_OK, _OK_BROADCAST = int(Response.OK), int(Response.OK_BROADCAST)
_BROADCAST_VERIFY = int(Command.BROADCAST_COMMAND_VERIFY)

QUESTIONS = 4096
"""Reads that are remembered: what is polled is asked again and again."""


class ParameterValue(NamedTuple):
    """A parameter as a slave gave it: `raw` is VALUE's bytes, `fault` the answer's fault bit."""

    type_code: int
    raw: bytes
    fault: bool

    @property
    def value(self) -> Value:
        """Raises `ProtocolError` where the bytes do not fit the type."""
        known = FORMATS.get(self.type_code)
        return decode_value(known, self.raw) if known is not None else self.raw

    def sample(self, fault: bool | None) -> Sample:
        """The same as a sample; `fault` is None in a dialect without the bit."""
        return Sample(self.value, type_name(self.type_code), self.raw, fault)


@dataclass(frozen=True, slots=True)
class StatusWord:
    """The DRIVECOM status word, 0..FFFFh, and the fault bit of its answer."""

    word: int
    fault: bool

    @property
    def state(self) -> State:
        return state(self.word)

    @property
    def bits(self) -> list[str]:
        """Names of the bits that are set."""
        return bits_set(self.word)


@dataclass(frozen=True, slots=True)
class MalfunctionCode:
    """The malfunction code, 0..FFFFh, and the fault bit of its answer."""

    code: int
    fault: bool

    @property
    def family(self) -> str | None:
        """The DRIVECOM family; the codes of single faults are in no document."""
        return malfunction_family(self.code)


@dataclass(frozen=True, slots=True)
class Acknowledged:
    """A write was answered: `submitted` says that the slave does not know the outcome (0016)."""

    submitted: bool
    fault: bool


class Master:
    """Speaks to the slave at `address`, 0..127.

    `destination` 0..7 is the default destination ID of every service: 0 the
    slave itself, 2 what is behind it.
    """

    def __init__(self, address: int, dialect: Dialect = SLINK3, *, destination: int = 0) -> None:
        if not 0 <= address <= 127:
            raise UsageError(f"address {address} is out of range: a slave has 0..127")
        self.address = address
        self.dialect = dialect
        self.destination = destination

    # -- parameters ------------------------------------------------------------------------

    def read_typed(
        self,
        index: int,
        type_code: Format = Format.VOID,
        subindex: int | None = None,
        destination: int | None = None,
    ) -> Conversation[Frame, ParameterValue]:
        """Read a parameter (0026). `type_code` VOID lets the slave name the type, where it can.

        Raises `DeviceError`, `NoReply`, and `ProtocolError` when the slave
        answers with another type than the one asked for.
        """
        self._check_subindex(subindex)
        where = self._where(destination)
        question = _typed_read(self.address, where, int(type_code), index, subindex)
        reply = yield from self._answered(question)
        found = TypedParameter.decode(reply.data)
        if found is None:
            raise ProtocolError("the answer to a read is too short", reply.encode())
        answered, raw = found
        if type_code and answered.type_code != type_code:  # VOID is 0
            raise ProtocolError(
                f"type {type_name(answered.type_code)} came, {type_code.type_name} was asked for",
                reply.encode(),
            )
        return ParameterValue(answered.type_code, raw, reply.in_fault)

    def write_typed(
        self,
        index: int,
        type_code: Format,
        value: Value,
        subindex: int | None = None,
        destination: int | None = None,
        *,
        repeatable: bool = False,
    ) -> Conversation[Frame, Acknowledged]:
        """Write a parameter (0027), once. `repeatable` allows a second try after 0097 only."""
        self._check_subindex(subindex)
        if type_code is Format.VOID:
            raise UsageError("a write needs a type")
        data = TypedParameter(type_code, index, subindex).encode() + encode_value(type_code, value)
        return (
            yield from self._write(Command.WRITE_TYPED_PARAMETER, data, destination, repeatable)
        )

    def read_standard(
        self,
        index: int,
        subindex: int = 0,
        type_code: Format = Format.OCTET_STRING,
        destination: int | None = None,
    ) -> Conversation[Frame, ParameterValue]:
        """Read a Drivecom parameter (0024). The frame carries no type: the caller must know it."""
        where = self._where(destination)
        reply = yield from self._answered(_standard_read(self.address, where, index, subindex))
        value = reply.data[3:]  # behind the INDEX and SUBINDEX that made it the answer
        return ParameterValue(type_code, value, reply.in_fault)

    def write_standard(
        self,
        index: int,
        subindex: int,
        type_code: Format,
        value: Value,
        destination: int | None = None,
        *,
        repeatable: bool = False,
    ) -> Conversation[Frame, Acknowledged]:
        """Write a Drivecom parameter (0025), once."""
        data = StandardParameter(index, subindex).encode() + encode_value(type_code, value)
        return (
            yield from self._write(Command.WRITE_STANDARD_PARAMETER, data, destination, repeatable)
        )

    # -- state -----------------------------------------------------------------------------

    def status_word(self) -> Conversation[Frame, StatusWord]:
        """The status word (0023) with its DRIVECOM state."""
        reply = yield from self._ask(Command.STATUS_WORD, repeatable=True)
        return StatusWord(_word(reply, "status word"), reply.in_fault)

    def malfunction_code(self) -> Conversation[Frame, MalfunctionCode]:
        """The malfunction code (002F)."""
        reply = yield from self._ask(Command.MALFUNCTION_CODE, repeatable=True)
        return MalfunctionCode(_word(reply, "malfunction code"), reply.in_fault)

    def reset(self) -> Conversation[Frame, None]:
        """Reset the slave's serial interface (0020), not its faults. Sent once."""
        yield from self._ask(Command.RESET_SLAVE)

    # -- broadcast -------------------------------------------------------------------------

    def broadcast_typed(
        self, index: int, type_code: Format, value: Value, subindex: int | None = None
    ) -> Conversation[Frame, None]:
        """Write a parameter of every slave (0027 to the broadcast address). Nobody answers."""
        self._check_subindex(subindex)
        data = TypedParameter(type_code, index, subindex).encode() + encode_value(type_code, value)
        yield Tell(Frame(self.dialect.broadcast, 0, 0, Command.WRITE_TYPED_PARAMETER, data))

    def broadcast_standard(
        self, index: int, subindex: int, type_code: Format, value: Value
    ) -> Conversation[Frame, None]:
        """Write a Drivecom parameter of every slave (0025). Nobody answers."""
        data = StandardParameter(index, subindex).encode() + encode_value(type_code, value)
        yield Tell(Frame(self.dialect.broadcast, 0, 0, Command.WRITE_STANDARD_PARAMETER, data))

    def broadcast_verify(self) -> Conversation[Frame, bool]:
        """Whether a broadcast was received since the last other command (0028): received, not applied."""
        try:
            yield from self._ask(Command.BROADCAST_COMMAND_VERIFY, repeatable=True)
        except DeviceError as refusal:
            if refusal.code == Response.NOT_OK:
                return False
            raise
        return True

    # -- anything else ---------------------------------------------------------------------

    def special_access(
        self, data: bytes, destination: int | None = None
    ) -> Conversation[Frame, bytes]:
        """DGFC386 special access (ABCD): opaque data out, opaque data back. Sent once."""
        reply = yield from self._ask(Command.SPECIAL_ACCESS, data, destination)
        return reply.data

    def command(
        self, code: int, data: bytes = b"", destination: int | None = None
    ) -> Conversation[Frame, Frame]:
        """Any COMMAND with any DATA, sent once; the answer as it came, refusals included."""
        return (yield Ask(self._frame(code, data, destination)))

    # -- how every service is asked --------------------------------------------------------

    def _where(self, destination: int | None) -> int:
        where = self.destination if destination is None else destination
        if not 0 <= where <= 7:
            raise UsageError(f"destination {where} is out of range: 0..7")
        return where

    def _frame(self, code: int, data: bytes, destination: int | None) -> Frame:
        return Frame(self.address, 0, self._where(destination) << 1, code, data)

    def _ask(
        self,
        command: Command,
        data: bytes = b"",
        destination: int | None = None,
        *,
        repeatable: bool = False,
        again_after_frame_error: bool = False,
    ) -> Conversation[Frame, Frame]:
        question = Ask(self._frame(command, data, destination), repeatable)
        return self._answered(question, again_after_frame_error=again_after_frame_error)

    def _answered(
        self, question: Ask[Frame], *, again_after_frame_error: bool = False
    ) -> Conversation[Frame, Frame]:
        """The answer to a question, where that is not a refusal."""
        command = question.frame.code
        expected = _OK_BROADCAST if command == _BROADCAST_VERIFY else _OK
        reply = yield question
        if reply.code == expected:
            return reply
        if self.dialect.frame_error_means_unread and (
            question.repeatable or again_after_frame_error
        ):
            attempts = 1
            while reply.code == Response.FRAME_ERROR and attempts < FRAME_ERROR_ATTEMPTS:
                reply = yield question
                attempts += 1
        if reply.code == expected or (
            reply.code == Response.COMMAND_SUBMITTED and command in WRITES
        ):
            return reply
        if reply.code in NO_REFUSALS:
            raise ProtocolError(
                f"{command_name(command)} was answered with {reply.code:04X}h, {response_meaning(reply.code)}",
                reply.encode(),
            )
        raise DeviceError(reply.code, response_meaning(reply.code), fault=reply.in_fault)

    def _write(
        self, command: Command, data: bytes, destination: int | None, repeatable: bool
    ) -> Conversation[Frame, Acknowledged]:
        reply = yield from self._ask(command, data, destination, again_after_frame_error=repeatable)
        return Acknowledged(reply.code == Response.COMMAND_SUBMITTED, reply.in_fault)

    def _check_subindex(self, subindex: int | None) -> None:
        if subindex is not None and not self.dialect.subindex:
            raise UsageError(f"{self.dialect.name} has no subindex")


@lru_cache(QUESTIONS)
def _typed_read(
    address: int, destination: int, type_code: int, index: int, subindex: int | None
) -> Ask[Frame]:
    data = TypedParameter(type_code, index, subindex).encode()
    code = Command.READ_TYPED_PARAMETER
    return Ask(Frame(address, 0, destination << 1, code, data), repeatable=True)


@lru_cache(QUESTIONS)
def _standard_read(address: int, destination: int, index: int, subindex: int) -> Ask[Frame]:
    data = StandardParameter(index, subindex).encode()
    code = Command.READ_STANDARD_PARAMETER
    return Ask(Frame(address, 0, destination << 1, code, data), repeatable=True)


def believed(write: Conversation[Frame, Acknowledged]) -> Conversation[Frame, Acknowledged]:
    """A write whose refusals are certain. Raises `ProtocolError` for a code that no document defines.

    A refusal is 8 bytes under an 8-bit exclusive-or: the head of an OK that was
    cut short and the head of a late answer behind it can make one.
    """
    try:
        return (yield from write)
    except DeviceError as refusal:
        if refusal.code in Response._value2member_map_:
            raise
        raise ProtocolError(
            f"it was answered with code {refusal.code:04X}h, which no document defines"
        ) from refusal


def _word(reply: Frame, what: str) -> int:
    if len(reply.data) != 2:
        raise ProtocolError(f"a {what} has 2 bytes, {len(reply.data)} came", reply.encode())
    return reply.data[0] | reply.data[1] << 8
