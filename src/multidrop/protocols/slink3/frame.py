"""The SLINK3 frame: FlexMax manual (A) chapter 2, AX-V manual (B) chapter 2.

::

    byte  1      2        3        4       5      6, 7              8..LENGTH-1  LENGTH
          START  ADDRESS  CONTROL  LENGTH  ORDER  COMMAND/RESPONSE  DATA         CHECKSUM

No byte stuffing: 01h may stand anywhere, and LENGTH says where a frame ends.
"""

from __future__ import annotations

import struct
from functools import reduce
from operator import xor
from typing import ClassVar, NamedTuple

from multidrop.checksums import xor8
from multidrop.decoder import Decoder
from multidrop.errors import UsageError
from multidrop.events import FrameReceived

START = 0x01
OVERHEAD = 8  # bytes of a frame without DATA
MOST_DATA = 255 - OVERHEAD

ANSWER = 0x01  # ORDER bit 0: 0 master, 1 slave
FAULT = 0x10  # ORDER bit 4: the slave is in fault
READ_COMMANDS = (0x26, 0x24)  # the reads, whose OK answers repeat the INDEX (A 5.4.1, 5.8.1)

_HEAD = struct.Struct("<BBBBH")  # ADDRESS, CONTROL, LENGTH, ORDER, COMMAND/RESPONSE
_FIELDS_AT_1 = struct.Struct("<xBBxBH")  # the same in a whole frame, START and LENGTH skipped


class _Fields(NamedTuple):
    address: int
    control: int = 0
    order: int = 0
    code: int = 0
    data: bytes = b""


class Frame(_Fields):
    """One frame. LENGTH and CHECKSUM are computed, never stored.

    `address` 0..255 (slaves 0..127, 255 or 128 broadcast), `control` 0..255 (a
    master sends 00xxxx00, x the sequence number), `order` 0..255, `code` is the
    COMMAND of a master or the RESPONSE of a slave, 0..FFFFh, `data` 0..247 bytes.
    """

    # A tuple, not a dataclass: decoding is twice as fast (bench/README.md).
    __slots__ = ()
    NUMBERS: ClassVar[int] = 16

    def __new__(
        cls, address: int, control: int = 0, order: int = 0, code: int = 0, data: bytes = b""
    ) -> Frame:
        if (address | control | order) & ~0xFF or code & ~0xFFFF or len(data) > MOST_DATA:
            raise _out_of_range(address, control, order, code, data)
        return tuple.__new__(cls, (address, control, order, code, bytes(data)))

    @property
    def is_answer(self) -> bool:
        """Sent by a slave (ORDER bit 0)."""
        return bool(self.order & ANSWER)

    @property
    def in_fault(self) -> bool:
        """The slave that sent it is in fault (ORDER bit 4)."""
        return bool(self.order & FAULT)

    @property
    def destination(self) -> int:
        """Destination ID, 0..7 (ORDER bits 1-3): 0 the slave itself, 2 the DGFC386 behind a drive."""
        return self.order >> 1 & 7

    @property
    def about(self) -> int:
        """The address; the sequence number in CONTROL tells answers apart."""
        return self[0]

    def encode(self) -> bytes:
        """The bytes on the wire."""
        address, control, order, code, data = self
        body = _HEAD.pack(address, control, len(data) + OVERHEAD, order, code) + data
        return b"\x01%b%c" % (body, reduce(xor, body))

    @classmethod
    def decode(cls, raw: bytes) -> Frame:
        """The frame of exactly these bytes. Raises `UsageError` if they are not one whole frame."""
        if not raw:
            raise UsageError("not one whole SLINK3 frame: no bytes")
        found = read_front(raw, 0)
        if found is None:
            raise UsageError(f"not one whole SLINK3 frame: cut short ({raw.hex(' ')})")
        if isinstance(found, str):
            raise UsageError(f"not one whole SLINK3 frame: {found} ({raw.hex(' ')})")
        frame, size = found
        if size != len(raw):
            raise UsageError(f"not one whole SLINK3 frame: {len(raw) - size} bytes too many")
        return frame

    def numbered(self, number: int) -> Frame:
        """The same frame with sequence number 0..15 in CONTROL."""
        address, _, order, code, data = self
        return tuple.__new__(Frame, (address, (number & 0x0F) << 2, order, code, data))

    def answers(self, question: Frame) -> bool:
        """Whether a master that sent `question` may believe this frame.

        ADDRESS, CONTROL, ORDER bit 0 and destination ID must match, and an OK
        answer to a read must carry the INDEX (and SUBINDEX) that was asked for.
        """
        if self[2] & 0x0F != question[2] & 0x0E | ANSWER:  # so never a question of its own
            return False
        address, control, _, code, data = self
        asked_address, asked_control, _, command, asked = question
        if address != asked_address or control != asked_control:
            return False
        if code or command not in READ_COMMANDS or len(asked) < 3:
            return True
        if command == 0x24:  # INDEX, SUBINDEX
            return data[:3] == asked[:3]
        if data[1:3] != asked[1:3]:  # behind FORMAT
            return False
        both_have_subindex = data[0] & asked[0] & 0x80
        return not both_have_subindex or data[3:4] == asked[3:4]


def _out_of_range(address: int, control: int, order: int, code: int, data: bytes) -> UsageError:
    for name, value in (("address", address), ("control", control), ("order", order)):
        if not 0 <= value <= 0xFF:
            return UsageError(f"{name} {value} is out of range: 0..255")
    if not 0 <= code <= 0xFFFF:
        return UsageError(f"command or response {code} is out of range: 0..FFFFh")
    return UsageError(f"{len(data)} bytes of data are too many: at most {MOST_DATA}")


def read_front(buffer: bytes, at: int) -> tuple[Frame, int] | str | None:
    """The frame that starts at `buffer[at]` and its size, why none does, or None for "more"."""
    if buffer[at] != START:
        return "no START"
    left = len(buffer) - at
    if left < 4:
        return None
    length = buffer[at + 3]
    if length < OVERHEAD:
        return f"LENGTH {length}, under 8"
    if left < length:
        return None
    raw = buffer[at : at + length]
    if reduce(xor, raw) != START:  # the checksum cancels bytes 2..LENGTH-1; START is left
        return f"checksum {raw[-1]:02X}h, computed {xor8(raw[1:-1]):02X}h"
    address, control, order, code = _FIELDS_AT_1.unpack_from(raw)
    return tuple.__new__(Frame, (address, control, order, code, raw[7:-1])), length


def missing(buffer: bytes, at: int) -> int:
    """So many bytes the frame that begins at `buffer[at]` still lacks, as far as its LENGTH has come."""
    left = len(buffer) - at
    return (buffer[at + 3] if left > 3 else OVERHEAD) - left


def decoder() -> Decoder[Frame]:
    """A receive loop for SLINK3: `receive_data(bytes)` and `silence()` return events."""
    return Decoder(read_front, missing)


__all__ = ["Frame", "FrameReceived", "decoder", "read_front"]
