"""The instrument's side: bytes in, requests out; responses in, bytes out. It calls no instrument.

::

    for request in slave.receive_data(data):
        reply = request.settled or ...   # memory, or nothing: see `Request`
        to_send = slave.answer(request, reply)

An instrument never refuses: whatever it does not like, it does not answer, and
such a message does not arrive here at all.
"""

from __future__ import annotations

from dataclasses import dataclass

from multidrop.errors import UsageError
from multidrop.protocols.datalink.frame import (
    MOST_ADDRESS,
    Command,
    Frame,
    decoder,
)
from multidrop.protocols.datalink.memory import END
from multidrop.protocols.datalink.messages import applied, extent
from multidrop.serving import BaseSlave


@dataclass(frozen=True, slots=True)
class Reply:
    """The data of a Response."""

    data: bytes = b""


@dataclass(frozen=True, slots=True)
class Request:
    """What an instrument has to do, by the message that says it.

    An Interrogate: answer with `count` bytes of memory from `memory_address` on.
    A Change or Change Bits that arrives with `settled`: send that, its echo, and
    do nothing. The same again with `acknowledged`: write `changed(old bytes)`
    there, at the end of the scan; nothing is answered.
    """

    frame: Frame
    settled: Reply | None = None
    acknowledged: bool = False

    @property
    def memory_address(self) -> int:
        return self.frame.memory_address

    @property
    def count(self) -> int:
        """How many bytes of memory are read or changed."""
        return extent(self.frame)

    def changed(self, old: bytes) -> bytes:
        """What the `count` bytes become, by S's formula for Change Bits."""
        return applied(self.frame, old)


class Slave(BaseSlave[Frame, Request]):
    """The instrument at `address`, 0..31. `stuffing` is off where its option says so.

    100 ms without a byte in the middle of a message are its `silence` (53IT5100A).
    """

    def __init__(self, address: int, *, stuffing: bool = True) -> None:
        if not 0 <= address <= MOST_ADDRESS:
            raise UsageError(
                f"address {address} is out of range: an instrument has 0..{MOST_ADDRESS}"
            )
        super().__init__(address, decoder(stuffing))
        self._pending: Frame | None = None

    @property
    def pending(self) -> Frame | None:
        """The change that waits for its Acknowledge."""
        return self._pending

    def acknowledge_overdue(self) -> None:
        """The time for the Acknowledge is over, 100 ms after the echo: the change is dropped."""
        self._pending = None

    def answer(self, request: Request, reply: Reply) -> bytes:
        """The bytes to send for a request, stuffed as it was; none for an acknowledged change."""
        if request.acknowledged:
            return b""
        frame, data = request.frame, reply.data
        return type(frame)(
            Command.RESPONSE, self.address, frame.memory_address, len(data), data
        ).encode()

    # -- what the protocol decides ---------------------------------------------------------

    def _receive(self, frame: Frame) -> Request | None:
        if frame.address != self.address or frame.command is Command.RESPONSE:
            return None
        pending = self._pending
        if frame.command is Command.ACKNOWLEDGE:
            self._pending = None
            return Request(pending, acknowledged=True) if pending is not None else None
        if not _legal(frame):
            return None
        if frame.command is Command.INTERROGATE:
            self._pending = None
            return Request(frame)
        self._pending = frame
        return Request(frame, settled=Reply(frame.data))


def _legal(frame: Frame) -> bool:
    """NUM is not 0, a Change Bits has whole pairs, and all of it is memory."""
    if frame.count == 0 or (frame.command is Command.CHANGE_BITS and frame.count % 2):
        return False
    return frame.memory_address + extent(frame) <= END
