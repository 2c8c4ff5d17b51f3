"""The Datalink frame: 53SL6000 manual (S) p. 125, byte stuffing from its neighbours' (N).

::

    byte  1    2         3    4       5       6..      last
          SOH  CMD+I.A.  NUM  LO ADD  HI ADD  data     LRC
          SOH  CMD+I.A.                                     (Acknowledge)

NUM says how many data bytes there are, or how many an Interrogate wants. Every
7Eh that is not the SOH is followed by an inserted 00h, the LRC included; NUM and
LRC know nothing of it. An instrument can have this switched off.
"""

from __future__ import annotations

import re
import struct
from enum import IntEnum
from typing import ClassVar, NamedTuple
from zlib import adler32

from multidrop.checksums import sum8
from multidrop.decoder import Decoder
from multidrop.errors import UsageError
from multidrop.events import Damaged, FrameReceived

SOH = 0x7E
OVERHEAD = 6  # bytes of a frame without data; Acknowledge has 2
MOST_DATA = 32  # "20H" (S)
MOST_ADDRESS = 31  # five bits of CMD+I.A.

_COMMAND_BITS = 0xE0
_ADDRESS_BITS = 0x1F


class Command(IntEnum):
    """The top three bits of CMD+I.A. (S); 00h, 40h and 60h are unused."""

    INTERROGATE = 0xE0
    CHANGE = 0xA0
    CHANGE_BITS = 0xC0
    ACKNOWLEDGE = 0x80
    RESPONSE = 0x20


_COMMANDS = {command.value: command for command in Command}
_INTERROGATE = Command.INTERROGATE
_ACKNOWLEDGE = Command.ACKNOWLEDGE
_HEAD = struct.Struct("<BBH")  # CMD+I.A., NUM, address low byte first
_STUFFED = b"\x7e\x00"
_LITERAL = b"\x7e"
_BEHIND_SOH = rb"[\s\S]?[^~]*(?:~\0[^~]*)*"  # ~ is 7Eh
_TO_NEXT_SOH = re.compile(_BEHIND_SOH).match
_FROM_SOH_TO_SOH = re.compile(rb"~" + _BEHIND_SOH).findall
_new = tuple.__new__


class _Fields(NamedTuple):
    command: Command
    address: int
    memory_address: int = 0
    count: int = 0  # type: ignore[assignment]  # NUM by its name, over a method of tuple
    data: bytes = b""


class Frame(_Fields):
    """One frame. The LRC is computed, never stored.

    `address` 0..31 (I.A.), `memory_address` 0..FFFFh, `count` (NUM) 0..32: the
    bytes that an Interrogate wants, else the length of `data`. An Acknowledge has
    only `command` and `address`.
    """

    # A tuple, not a dataclass: decoding is twice as fast (bench/README.md).
    __slots__ = ()
    NUMBERS: ClassVar[int] = 1

    def __new__(
        cls,
        command: int,
        address: int,
        memory_address: int = 0,
        count: int = 0,
        data: bytes = b"",
    ) -> Frame:
        known = _COMMANDS.get(command)
        if known is None:
            raise UsageError(f"{command} is no Datalink command")
        if not 0 <= address <= MOST_ADDRESS:
            raise UsageError(f"address {address} is out of range: 0..{MOST_ADDRESS}")
        if not 0 <= memory_address <= 0xFFFF:
            raise UsageError(f"memory address {memory_address} is out of range: 0..FFFFh")
        if not 0 <= count <= MOST_DATA:
            raise UsageError(f"{count} bytes are too many for a message: at most {MOST_DATA}")
        if len(data) != (0 if known is _INTERROGATE else count):
            raise UsageError(f"NUM {count} does not fit {len(data)} bytes of data")
        if known is _ACKNOWLEDGE and (memory_address or count):
            raise UsageError("an Acknowledge has neither memory address nor data")
        return tuple.__new__(cls, (known, address, memory_address, count, bytes(data)))

    @property
    def about(self) -> tuple[int, int, int]:
        """What a Response repeats: the address, the memory address and NUM."""
        return self[1], self[2], self[3]

    def encode(self, stuffing: bool = True) -> bytes:
        """The bytes on the wire."""
        command, address, memory_address, count, data = self
        if command is _ACKNOWLEDGE:
            return bytes((SOH, command | address))
        body = _HEAD.pack(command | address, count, memory_address) + data
        body += bytes((sum8(body),))
        return _LITERAL + (body.replace(_LITERAL, _STUFFED) if stuffing else body)

    @classmethod
    def decode(cls, raw: bytes, stuffing: bool = True) -> Frame:
        """The frame of exactly these bytes. Raises `UsageError` if they are not one whole frame."""
        if not raw:
            raise UsageError("not one whole Datalink frame: no bytes")
        found = (read_front if stuffing else read_front_unstuffed)(raw, 0)
        if found is None:
            raise UsageError(f"not one whole Datalink frame: cut short ({raw.hex(' ')})")
        if isinstance(found, str):
            raise UsageError(f"not one whole Datalink frame: {found} ({raw.hex(' ')})")
        frame, size = found
        if size != len(raw):
            raise UsageError(f"not one whole Datalink frame: {len(raw) - size} bytes too many")
        return frame

    def numbered(self, number: int) -> Frame:
        """Itself: the protocol does not number its messages."""
        return self

    def answers(self, question: Frame) -> bool:
        """Whether this is a Response to `question`: the same address, memory address and NUM."""
        return self[0] is Command.RESPONSE and self[1:4] == question[1:4]


class UnstuffedFrame(Frame):
    """The same frame for a line without byte stuffing: equal to the stuffed one, written without."""

    __slots__ = ()

    def encode(self, stuffing: bool = False) -> bytes:
        return super().encode(stuffing)

    @classmethod
    def decode(cls, raw: bytes, stuffing: bool = False) -> Frame:
        return super().decode(raw, stuffing)


def read_front(buffer: bytes, at: int) -> tuple[Frame, int] | str | None:
    """The frame that starts at `buffer[at]` and its size, why none does, or None for "more"."""
    if buffer[at] != SOH:
        return "no SOH"
    to_next = _TO_NEXT_SOH(buffer, at + 1)
    assert to_next is not None
    end = to_next.end()
    body = buffer[at + 1 : end].replace(_STUFFED, _LITERAL)
    found = _read_body(Frame, body)
    if type(found) is tuple:
        frame, size = found
        return frame, size + body.count(_LITERAL, 0, size - 1)
    if found is None and end + 1 < len(buffer):  # a 7Eh that ends the buffer may be a stuffed one
        return f"a new SOH after {end - at} bytes"
    return found


def read_front_unstuffed(buffer: bytes, at: int) -> tuple[Frame, int] | str | None:
    """The same where 7Eh may stand anywhere and nothing is inserted: NUM alone says the size."""
    if buffer[at] != SOH:
        return "no SOH"
    return _read_body(UnstuffedFrame, buffer[at + 1 : at + OVERHEAD + MOST_DATA])


def _read_body(kind: type[Frame], body: bytes) -> tuple[Frame, int] | str | None:
    """The frame of the bytes behind SOH, without inserted ones, and its size with SOH."""
    if not body:
        return None
    head = body[0]
    command = _COMMANDS.get(head & _COMMAND_BITS)
    if command is None:
        return f"no command {head:02X}h"
    if command is _ACKNOWLEDGE:
        return _new(kind, (command, head & _ADDRESS_BITS, 0, 0, b"")), 2
    if len(body) < 2:
        return None
    count = body[1]
    if count > MOST_DATA:
        return f"NUM {count}, over {MOST_DATA}"
    size = OVERHEAD if command is _INTERROGATE else OVERHEAD + count
    if len(body) < size - 1:
        return None
    body = body[: size - 1]
    lrc = body[-1]
    if (adler32(body) - 1 - 2 * lrc) & 0xFF:
        return f"LRC {lrc:02X}h, computed {sum8(body[:-1]):02X}h"
    fields = (command, head & _ADDRESS_BITS, body[2] | body[3] << 8, count, body[4:-1])
    return _new(kind, fields), size


def missing(buffer: bytes, at: int) -> int:
    """At least so many bytes the frame that begins at `buffer[at]` still lacks, as far as its NUM has come.

    An Acknowledge is shorter, and nothing that a host waits for.
    """
    return _missing(buffer[at : at + 1] + buffer[at + 1 :].replace(_STUFFED, _LITERAL))


def missing_unstuffed(buffer: bytes, at: int) -> int:
    """The same where nothing is inserted."""
    return _missing(buffer[at:])


def _missing(frame: bytes) -> int:
    size = OVERHEAD
    if len(frame) > 2 and frame[1] & _COMMAND_BITS != _INTERROGATE:
        size += frame[2]
    return max(1, size - len(frame))  # all but an inserted byte may be there


def read_frames(buffer: bytes) -> tuple[list[FrameReceived[Frame] | Damaged], bytes]:
    """The frames at the front of the buffer, one close behind the other, and what is left."""
    events: list[FrameReceived[Frame] | Damaged] = []
    if buffer[:1] != _LITERAL:
        return events, buffer
    size = 0
    for raw in _FROM_SOH_TO_SOH(buffer):
        body = raw[1:].replace(_STUFFED, _LITERAL)
        found = _read_body(Frame, body)
        if type(found) is not tuple or found[1] <= len(body):
            break
        events.append(_new(FrameReceived, (found[0], raw)))
        size += len(raw)
    return events, buffer[size:]


class _Decoder(Decoder[Frame]):
    """Frames without damage between them take a short way: two thirds of the time."""

    def receive_data(self, data: bytes) -> list[FrameReceived[Frame] | Damaged]:
        if self._dropped:
            return super().receive_data(data)
        events, self._buffer = read_frames(self._buffer + data)
        return events + super().receive_data(b"") if self._buffer else events


def decoder(stuffing: bool = True) -> Decoder[Frame]:
    """A receive loop for Datalink: `receive_data(bytes)` and `silence()` return events."""
    if stuffing:
        return _Decoder(read_front, missing)
    return Decoder(read_front_unstuffed, missing_unstuffed)
