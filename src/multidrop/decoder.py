"""The one receive loop: buffering, resynchronising and limits for every protocol.

A protocol gives one pure function, `read_front`, that looks at the bytes from a
position on and says one of three things: a frame and its size, the reason why
no frame can start there, or `None`, "more bytes are needed".

On damage one byte is dropped, not the frame: a false start must not swallow the
real frame behind it. Dropped bytes are held back until the next frame or the
next silence, so they come out as one `Damaged` however the stream was cut.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, TypeVar

from multidrop.events import Damaged, FrameReceived

FrameT = TypeVar("FrameT")

ReadFront = Callable[[bytes, int], "tuple[FrameT, int] | str | None"]
"""`read_front(buffer, at)`: frame and size, a reason, or None for "more". `at < len(buffer)`."""

Missing = Callable[[bytes, int], int]
"""`missing(buffer, at)`: at least so many bytes must come before the answer that begins at `at`
is whole, where `read_front` says "more"; at the end of the buffer: the shortest answer."""

_new = tuple.__new__  # what a named tuple's own constructor calls; a tenth of a frame's time

MOST_DAMAGE = 1024
"""Held-back damage is reported at this size, so a babbling line costs no memory."""


class Decoder(Generic[FrameT]):
    """Turns bytes, cut anywhere, into events. Nothing received ever raises."""

    def __init__(self, read_front: ReadFront[FrameT], missing: Missing = lambda *_: 1) -> None:
        self._read_front = read_front
        self._missing = missing
        self._buffer = b""
        self._dropped = 0  # so many bytes at the front of the buffer are damage
        self._reason = ""  # why the first of them was dropped

    @property
    def pending(self) -> bool:
        """Whether bytes are held that have not come out as events."""
        return bool(self._buffer)

    @property
    def held(self) -> int:
        """How many bytes that is."""
        return len(self._buffer)

    @property
    def unfinished(self) -> bool:
        """Whether some of them may be the beginning of a frame; the rest is damage that is held back."""
        return len(self._buffer) > self._dropped

    @property
    def missing(self) -> int:
        """At least so many bytes must come before another answer is whole."""
        return self._missing(self._buffer, self._dropped)

    def receive_data(self, data: bytes) -> list[FrameReceived[FrameT] | Damaged]:
        """Take the next bytes of the stream; returns the events that they complete."""
        if data and not self._buffer:
            found = self._read_front(data, 0)
            if type(found) is tuple and found[1] == len(data):  # one whole frame: most often so
                return [_new(FrameReceived, (found[0], data))]
        return self._read(self._buffer + data, final=False)

    def silence(self) -> list[FrameReceived[FrameT] | Damaged]:
        """The line fell silent: what is incomplete now stays incomplete. Empties the buffer."""
        return self._read(self._buffer, final=True) if self._buffer else []

    def line_error(self, raw: bytes) -> list[FrameReceived[FrameT] | Damaged]:
        """Bytes that the port marked as wrong (parity, framing, break): damage, and so is what they cut."""
        return [*self.silence(), Damaged(raw, "parity or framing error")]

    def _read(self, buffer: bytes, *, final: bool) -> list[FrameReceived[FrameT] | Damaged]:
        events: list[FrameReceived[FrameT] | Damaged] = []
        read_front = self._read_front
        # buffer[start:at] is damage that is not reported yet
        start, at, end = 0, self._dropped, len(buffer)
        while at < end:
            found = read_front(buffer, at)
            if type(found) is tuple:
                if at > start:
                    events.append(Damaged(buffer[start:at], self._reason))
                frame, size = found
                start = at + size
                events.append(_new(FrameReceived, (frame, buffer[at:start])))
                at = start
                continue
            if found is None:
                if not final:
                    break
                found = "cut short"
            if at == start:
                self._reason = str(found)
            at += 1
            if at - start == MOST_DAMAGE:
                events.append(Damaged(buffer[start:at], self._reason))
                start = at
        if final and at > start:
            events.append(Damaged(buffer[start:at], self._reason))
            start = at
        self._buffer = buffer[start:]
        self._dropped = at - start
        return events
