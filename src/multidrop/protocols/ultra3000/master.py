"""The master's side: every function of the manual as a conversation.

Methods describe, they do not send: `line.run(Master(0).read(0x073))` does. They
speak in digits; what these mean is a profile's. A refusal is raised as
`DeviceError`. Reads are repeated, everything else is sent once.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import TypeVar

from multidrop.conversation import Ask, Conversation, Learn, Tell
from multidrop.errors import DeviceError, NoReply, ProtocolError, UsageError
from multidrop.protocols.ultra3000.frame import READS, Frame
from multidrop.protocols.ultra3000.messages import (
    BROADCAST,
    LAST_ADDRESS,
    LAST_PARAMETER,
    PRODUCT_TYPE,
    Function,
    index_digits,
    refusal_meaning,
)

ValueT = TypeVar("ValueT")


class Master:
    """Speaks to the drive at `address`, 0..253, and to all of them at `broadcast`."""

    def __init__(self, address: int, *, broadcast: int = BROADCAST) -> None:
        if not 0 <= address <= LAST_ADDRESS:
            raise UsageError(f"address {address} is out of range: a drive has 0..{LAST_ADDRESS}")
        if not 0 <= broadcast <= 0xFF:
            raise UsageError(f"broadcast address {broadcast} is out of range: 0..255")
        self.address = address
        self.broadcast = broadcast

    # -- reading ---------------------------------------------------------------------------

    def read(
        self, parameter: int, index: int | None = None, function: int = Function.READ_WORKING
    ) -> Conversation[Frame, str]:
        """The digits of a value; `function` says which: working, non-volatile, default, a limit.

        An array's answer may begin with the index. Raises `DeviceError`, `NoReply`.
        """
        if function not in READS:
            raise UsageError(f"function {function:X}h does not read")
        question = _read(self.address, parameter, int(function), index)
        if index is not None:  # an answer that repeats it may equal the question
            yield from self.learn_echo()
        answer = yield from self._ask(question)
        return answer.data

    def read_as(
        self,
        decode: Callable[[str], ValueT],
        parameter: int,
        index: int | None = None,
        function: int = Function.READ_WORKING,
    ) -> Conversation[Frame, ValueT]:
        """Read what `decode` makes of the digits; those that it cannot take are asked for once more.

        Of damaged frames, such as halves of two answers, one in 256 has a right
        checksum. A drive that means it says it twice: then `ProtocolError` is raised.
        """
        digits = yield from self.read(parameter, index, function)
        try:
            return decode(digits)
        except ProtocolError:
            return decode((yield from self.read(parameter, index, function)))

    def read_number(self, parameter: int, digits: int) -> Conversation[Frame, int]:
        """A working value as a whole number. Raises `ProtocolError` where it has another width."""

        def number(data: str) -> int:
            if len(data) != digits:
                raise ProtocolError(
                    f"parameter {parameter:03X} has {digits} digits, {len(data)} came",
                    data.encode(),
                )
            return int(data, 16)

        return self.read_as(number, parameter)

    # -- writing ---------------------------------------------------------------------------

    def write(
        self, parameter: int, data: str, index: int | None = None, *, non_volatile: bool = False
    ) -> Conversation[Frame, None]:
        """Write the working value, or the non-volatile and the working one."""
        function = Function.WRITE_NON_VOLATILE if non_volatile else Function.WRITE_WORKING
        yield from self.send(self._frame(parameter, function, index_digits(index) + data))

    def act(self, parameter: int) -> Conversation[Frame, None]:
        """An action: a write without data."""
        yield from self.write(parameter, "")

    def load(self, parameter: int) -> Conversation[Frame, None]:
        """Copy the non-volatile value, or those of a whole array, to the working one."""
        yield from self.copy(parameter, Function.COPY_NON_VOLATILE_TO_WORKING)

    def save(self, parameter: int) -> Conversation[Frame, None]:
        """Copy the working value, or those of a whole array, to the non-volatile one."""
        yield from self.copy(parameter, Function.COPY_WORKING_TO_NON_VOLATILE)

    def restore_default(
        self, parameter: int, index: int | None = None
    ) -> Conversation[Frame, None]:
        """Copy the default to the non-volatile and the working value."""
        yield from self.copy(parameter, Function.COPY_DEFAULT, index)

    def copy(
        self, parameter: int, function: int, index: int | None = None
    ) -> Conversation[Frame, None]:
        """One of functions 4, 5 and 7; only 7 takes an array's index."""
        yield from self.send(self._frame(parameter, function, index_digits(index)))

    def broadcast_write(
        self, parameter: int, data: str, index: int | None = None, *, non_volatile: bool = False
    ) -> Conversation[Frame, None]:
        """Write a parameter of every drive. Nobody answers."""
        function = Function.WRITE_NON_VOLATILE if non_volatile else Function.WRITE_WORKING
        frame = self._frame(parameter, function, index_digits(index) + data)
        yield Tell(Frame(self.broadcast, *frame[1:]))

    # -- how everything is asked -----------------------------------------------------------

    def learn_echo(self) -> Conversation[Frame, None]:
        """Find out whether the line hears itself, where that is not known: read 000.

        The right answer to a write or an action may be the request over again, so
        nothing of the kind is sent before. Raises `NoReply`: then nothing was.
        """
        try:
            yield Learn(Frame(self.address, PRODUCT_TYPE, Function.READ_WORKING))
        except NoReply as failure:
            raise NoReply(
                failure.attempts,
                failure.damaged,
                failure.heard,
                because="nothing was sent but the read of 000 that shows whether the line hears "
                f"itself: {failure.because}",
            ) from failure

    def send(self, frame: Frame) -> Conversation[Frame, Frame]:
        """Anything that is no plain read, once. Raises `DeviceError`, and `NoReply` when it was lost."""
        yield from self.learn_echo()
        return (yield from self._ask(Ask(frame)))

    def _ask(self, question: Ask[Frame]) -> Conversation[Frame, Frame]:
        answer = yield question
        if answer.is_refusal:
            code = int(answer.data, 16)
            raise DeviceError(code, refusal_meaning(code))
        return answer

    def _frame(self, parameter: int, function: int, data: str) -> Frame:
        return _question(self.address, parameter, function, data)


def _question(address: int, parameter: int, function: int, data: str) -> Frame:
    if not 0 <= parameter <= LAST_PARAMETER:
        raise UsageError(f"parameter 0x{parameter:X} is out of range: 0x000..0x7FF")
    return Frame(address, parameter, function, data)


QUESTIONS = 4096
"""Reads that are remembered: what is polled is asked again and again."""


@lru_cache(QUESTIONS)
def _read(address: int, parameter: int, function: int, index: int | None) -> Ask[Frame]:
    return Ask(_question(address, parameter, function, index_digits(index)), repeatable=True)
