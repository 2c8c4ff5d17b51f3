"""The host's side: every service of the document as a conversation.

Methods describe, they do not send: `line.run(Master(3).interrogate(0x1000, 9))`
does. Nothing in the protocol refuses: what an instrument does not like, it does
not answer.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from math import ceil

from multidrop.conversation import Ask, Conversation, Delay, Tell, TooLate, Wait
from multidrop.errors import NoReply, NotApplied, ProtocolError, UsageError
from multidrop.protocols.datalink.frame import (
    MOST_ADDRESS,
    MOST_DATA,
    Command,
    Frame,
    UnstuffedFrame,
)
from multidrop.protocols.datalink.memory import END, MAP_IDENTIFIER_AT, pieces
from multidrop.protocols.datalink.messages import bit_pair, extent, shows, untouched
from multidrop.writing import Outcome

ACKNOWLEDGE_WITHIN = 0.080
"""s after the echo: an instrument drops a change after 100 ms (53IT5100A), and a late one may act."""

SETTLE = 1.0
"""s that an instrument is given to show a change: it applies it at the end of its scan (S)."""

QUESTIONS = 4096
"""Interrogates that are remembered: what is polled is asked again and again."""

READ_BACK_EVERY = 0.050
"""s between two looks at a change that does not show yet."""


class Master:
    """Speaks to the instrument at `address`, 0..31; `stuffing` is off where the line has none."""

    def __init__(self, address: int, *, stuffing: bool = True) -> None:
        if not 0 <= address <= MOST_ADDRESS:
            raise UsageError(
                f"address {address} is out of range: an instrument has 0..{MOST_ADDRESS}"
            )
        self.address = address
        self._frame = Frame if stuffing else UnstuffedFrame

    # -- reading ---------------------------------------------------------------------------

    def interrogate(self, memory_address: int, count: int) -> Conversation[Frame, bytes]:
        """Read `count` bytes of memory, at most 32 with each message. Raises `NoReply`."""
        found = b""
        for at, size in pieces(memory_address, count):
            reply = yield _interrogation(self._frame, self.address, at, size)
            found += reply.data
        return found

    def map_identifier(self) -> Conversation[Frame, int]:
        """The byte that names the memory map, 0..255: 6 is map A."""
        found = yield from self.interrogate(MAP_IDENTIFIER_AT, 1)
        return found[0]

    # -- changing --------------------------------------------------------------------------

    def change(self, memory_address: int, data: bytes) -> Conversation[Frame, None]:
        """Write up to 32 bytes; the instrument acts only once its echo was found right.

        Raises `NoReply` and `ProtocolError` (another echo) where nothing was
        acknowledged, `NotApplied` where the Acknowledge would have been late:
        each time nothing was changed.
        """
        yield from self.carry_out(self.change_message(memory_address, data))

    def change_bits(
        self, memory_address: int, bits: Sequence[tuple[int, int]]
    ) -> Conversation[Frame, None]:
        """Write chosen bits of up to 16 bytes: (selected, wanted) for each, 0..FFh. As `change`."""
        yield from self.carry_out(self.bits_message(memory_address, bits))

    def change_and_confirm(
        self, memory_address: int, data: bytes, settle: float = SETTLE
    ) -> Conversation[Frame, Outcome]:
        """Write up to 32 bytes and read them back. Raises as `change` and `interrogate` do."""
        change = self.change_message(memory_address, data)
        old = yield from self.memory_of(change)
        yield from self.carry_out(change)
        found = yield from self.confirm(change, settle)
        return outcome(change, old, found)

    # -- the steps of a change -------------------------------------------------------------

    def change_message(self, memory_address: int, data: bytes) -> Frame:
        """The Change of up to 32 bytes. Raises `UsageError`."""
        pieces(memory_address, len(data))
        return self._frame(Command.CHANGE, self.address, memory_address, len(data), data)

    def bits_message(self, memory_address: int, bits: Sequence[tuple[int, int]]) -> Frame:
        """The Change Bits of up to 16 bytes, (selected, wanted) for each. Raises `UsageError`."""
        pieces(memory_address, len(bits))
        pairs = b"".join(bit_pair(selected, wanted) for selected, wanted in bits)
        return self._frame(Command.CHANGE_BITS, self.address, memory_address, len(pairs), pairs)

    def carry_out(self, change: Frame) -> Conversation[Frame, Delay]:
        """Send a Change or Change Bits, compare its echo, acknowledge it in time.

        Returns where the line notes how long after the echo the Acknowledge was written.
        """
        try:
            # nothing happens before the Acknowledge, and its own echo alone says what was heard
            echo = yield Ask(change, repeatable=True, rests=True)
        except NoReply as failure:
            raise NoReply(
                failure.attempts,
                failure.damaged,
                failure.heard,
                because=f"the change was not echoed, so nothing was changed: {failure.because}",
            ) from failure
        if echo.data != change.data:
            raise ProtocolError(
                f"{change.data.hex(' ').upper()} was sent and another echo came back;"
                " it was not acknowledged, so nothing was changed",
                echo.data,
            )
        acknowledge = Tell(
            self._frame(Command.ACKNOWLEDGE, self.address), within=ACKNOWLEDGE_WITHIN
        )
        try:
            yield acknowledge
        except TooLate:
            found = yield from self.drop(change)
            raise NotApplied(
                f"{ACKNOWLEDGE_WITHIN * 1000:.0f} ms were over after the echo, so the change was"
                " dropped with an Interrogate instead of acknowledged; nothing was changed",
                found=found,
            ) from None
        return acknowledge.delay

    def drop(self, change: Frame) -> Conversation[Frame, bytes | None]:
        """Drop a change that was not acknowledged; returns its memory, None if nobody answers.

        Any command drops it. This one also takes in an echo that is still on its way.
        """
        try:
            return (yield from self.memory_of(change))
        except NoReply:
            return None

    def confirm(self, change: Frame, settle: float = SETTLE) -> Conversation[Frame, bytes]:
        """Read the memory of an acknowledged change until it shows, for `settle` s of waiting.

        Returns the bytes that were found last.
        """
        found = yield from self.memory_of(change)
        for _ in range(ceil(settle / READ_BACK_EVERY)):
            if shows(change, found):
                break
            yield Wait(READ_BACK_EVERY)
            found = yield from self.memory_of(change)
        return found

    def memory_of(self, change: Frame) -> Conversation[Frame, bytes]:
        """Read the memory of a change in a message whose answer no echo can pass for.

        An echo is a Response with address and NUM too, and a late one would
        confirm a change that was never carried out: so another NUM is asked for.
        """
        at, size = change.memory_address, extent(change)
        if size != change.count:
            return (yield from self.interrogate(at, size))
        if size == MOST_DATA:
            first = yield from self.interrogate(at, size // 2)
            return first + (yield from self.interrogate(at + size // 2, size // 2))
        start = min(at, END - size - 1)
        found = yield from self.interrogate(start, size + 1)
        return found[at - start : at - start + size]

    # -- anything else ---------------------------------------------------------------------

    def ask(self, frame: Frame) -> Conversation[Frame, Frame]:
        """Any message that is answered, sent once, to this instrument; its Response."""
        command, _, memory_address, count, data = frame
        return (yield Ask(self._frame(command, self.address, memory_address, count, data)))


@lru_cache(QUESTIONS)
def _interrogation(kind: type[Frame], address: int, at: int, size: int) -> Ask[Frame]:
    return Ask(kind(Command.INTERROGATE, address, at, size), repeatable=True)


def outcome(change: Frame, old: bytes, found: bytes) -> Outcome:
    """What memory says of an acknowledged change: as wanted, as before, or neither."""
    if shows(change, found):
        return Outcome.CONFIRMED
    return Outcome.NOT_APPLIED if untouched(change, old, found) else Outcome.UNKNOWN
