"""The Ultra3000 frame: manual 2098-RM003A page 1-1 and 1-2.

::

    :  aa       ppp        f         d...d  cc        CR
       address  parameter  function  data   checksum

Characters 0-9 and A-F, upper case; the checksum is over their ASCII codes, not
over what they stand for. No line feed: one before a colon is skipped.
"""

from __future__ import annotations

import re
from typing import ClassVar, NamedTuple
from zlib import adler32

from multidrop.checksums import negated_sum8
from multidrop.decoder import Decoder
from multidrop.errors import UsageError
from multidrop.events import Damaged, FrameReceived

COLON, CARRIAGE_RETURN, LINE_FEED = 0x3A, 0x0D, 0x0A
LONGEST = 255  # characters from colon to carriage return; the longest known parameter makes 138
OVERHEAD = 10  # characters of a frame without data
MOST_DATA = LONGEST - OVERHEAD

REFUSED = 0x800  # added to the parameter in a refusal (page 1-3)
READS = frozenset({0x0, 0x2, 0x6, 0x8, 0x9, 0xA, 0xB})
"""The functions whose answer holds a value."""

_FIELDS = rb":([0-9A-F]{6})([0-9A-F]{0,%d})([0-9A-F]{2})\r" % MOST_DATA
_FRAME = re.compile(rb"\n?(" + _FIELDS + rb")").match
_FRAMES = re.compile(rb"(" + _FIELDS + rb"|[\s\S]+)").findall  # and what is left, without fields
_BEGUN = re.compile(rb":[0-9A-F]{0,%d}" % (LONGEST - 2)).fullmatch
_DIGITS = re.compile(rb"[0-9A-F]*").match
_DATA = re.compile(r"[0-9A-F]*").fullmatch
_new = tuple.__new__

# adler32 holds the sum of the bytes plus one in its low half, and takes half the time of sum().
# For each checksum: what brings that of a frame, from colon to carriage return, to 0.
_CHECK = {
    digits: int(digits, 16) - sum(b":" + digits + b"\r") - 1
    for digits in (b"%02X" % value for value in range(256))
}


class _Heads(dict[bytes, tuple[int, int, int]]):
    """Address, parameter and function of six digits: on one line there are few, again and again."""

    MOST = 4096

    def __missing__(self, digits: bytes) -> tuple[int, int, int]:
        if len(self) == self.MOST:
            self.clear()
        number = int(digits, 16)
        found = self[digits] = number >> 16, number >> 4 & 0xFFF, number & 0xF
        return found


_HEADS = _Heads()


class _Fields(NamedTuple):
    address: int
    parameter: int
    function: int = 0
    data: str = ""


class Frame(_Fields):
    """One frame. The checksum is computed, never stored.

    `address` 0..255 (drives 0..253, broadcast 255), `parameter` 000..7FFh, or
    with 800h added in a refusal, `function` 0..Fh, `data` at most 245 digits.
    """

    # A tuple, not a dataclass: decoding is twice as fast.
    __slots__ = ()
    NUMBERS: ClassVar[int] = 1

    def __new__(cls, address: int, parameter: int, function: int = 0, data: str = "") -> Frame:
        if not 0 <= address <= 0xFF:
            raise UsageError(f"address {address} is out of range: 0..255")
        if not 0 <= parameter <= 0xFFF:
            raise UsageError(f"parameter {parameter:#x} is out of range: 0..0xFFF")
        if not 0 <= function <= 0xF:
            raise UsageError(f"function {function} is out of range: 0..15")
        if len(data) > MOST_DATA:
            raise UsageError(f"{len(data)} digits of data are too many: at most {MOST_DATA}")
        if _DATA(data) is None:
            raise UsageError(f"data {data!r} are not digits 0-9 A-F, upper case")
        return tuple.__new__(cls, (address, parameter, function, data))

    @property
    def is_refusal(self) -> bool:
        """Whether a drive says with it that it does not do what it was asked."""
        return self.parameter >= REFUSED

    @property
    def about(self) -> tuple[int, int, int]:
        """What an answer repeats: address, parameter and function, but not an array's index."""
        return self[0], self[1] % REFUSED, self[2]

    def encode(self) -> bytes:
        """The bytes on the wire."""
        address, parameter, function, data = self
        text = f"{address:02X}{parameter:03X}{function:X}{data}".encode()
        return b":%b%02X\r" % (text, negated_sum8(text))

    @classmethod
    def decode(cls, raw: bytes) -> Frame:
        """The frame of exactly these bytes. Raises `UsageError` if they are not one whole frame."""
        found = read_front(raw, 0) if raw else "no bytes"
        if found is None:
            raise UsageError(f"not one whole Ultra3000 frame: cut short ({raw!r})")
        if isinstance(found, str):
            raise UsageError(f"not one whole Ultra3000 frame: {found} ({raw!r})")
        frame, size = found
        if raw[size:] not in (b"", b"\n"):
            raise UsageError(f"not one whole Ultra3000 frame: {len(raw) - size} bytes too many")
        return frame

    def numbered(self, number: int) -> Frame:
        """The same frame: this protocol does not number."""
        return self

    def answers(self, question: Frame) -> bool:
        """Whether a master that sent `question` may believe this frame.

        The right answer to a write, an action or a copy may be the request over
        again, so such a frame answers itself; so does the read of an element.
        """
        address, parameter, function, data = self
        asked = question[1]
        if address != question[0] or function != question[2]:
            return False
        if parameter != asked:
            return parameter == asked + REFUSED and len(data) == 2
        return bool(data) or function not in READS


def read_front(buffer: bytes, at: int) -> tuple[Frame, int] | str | None:
    """The frame that starts at `buffer[at]` and its size, why none does, or None for "more"."""
    found = _FRAME(buffer, at)
    if found is None:
        return _why_not(buffer, at)
    raw, head, data, check = found.groups()
    if adler32(raw) + _CHECK[check] & 0xFF:
        return f"checksum {check.decode()}h, computed {negated_sum8(head + data):02X}h"
    return _new(Frame, _HEADS[head] + (data.decode(),)), found.end() - at


def read_frames(buffer: bytes) -> tuple[list[FrameReceived[Frame] | Damaged], bytes]:
    """The frames at the front of the buffer, one close behind the other, and what is left.

    Half of `read_front`'s time for each. No frames where the checksum of one is wrong.
    """
    found = _FRAMES(buffer)
    left = found.pop()[0] if found and not found[-1][3] else b""
    for raw, _, _, check in found:
        if adler32(raw) + _CHECK[check] & 0xFF:
            return [], buffer
    return [
        _new(FrameReceived, (_new(Frame, _HEADS[head] + (data.decode(),)), raw))
        for raw, head, data, _ in found
    ], left


def _why_not(buffer: bytes, at: int) -> str | None:
    """Why no frame starts here; None where more bytes may still make one."""
    start = at + 1 if buffer[at] == LINE_FEED else at
    if start == len(buffer):
        return None
    if buffer[start] != COLON:
        return "no colon"
    found = _DIGITS(buffer, start + 1, start + LONGEST)
    assert found is not None
    end = found.end()
    if end == start + LONGEST:
        return f"no carriage return in {LONGEST} characters"
    if end == len(buffer):
        return None
    if buffer[end] != CARRIAGE_RETURN:
        return f"{bytes([buffer[end]])!r} is no digit 0-9 A-F"[1:]
    return f"{end - start + 1} characters, under {OVERHEAD}"


class _Decoder(Decoder[Frame]):
    """A line feed behind a frame is skipped: it is no damage, and nobody waits for more of it.

    Frames without damage or line feeds between them take a short way.
    """

    _behind_frame = False

    @property
    def unfinished(self) -> bool:
        return super().unfinished and not self._skips

    @property
    def _skips(self) -> bool:
        return self._behind_frame and self._buffer == b"\n"

    def receive_data(self, data: bytes) -> list[FrameReceived[Frame] | Damaged]:
        events: list[FrameReceived[Frame] | Damaged] = []
        if not self._dropped:
            events, self._buffer = read_frames(self._buffer + data)
            data = b""
        if data or (self._buffer and not _BEGUN(self._buffer)):
            events += super().receive_data(data)
        if events:
            self._behind_frame = type(events[-1]) is FrameReceived
        return events

    def silence(self) -> list[FrameReceived[Frame] | Damaged]:
        skips, self._behind_frame = self._skips, False
        events = super().silence()
        return [] if skips else events


def missing(buffer: bytes, at: int) -> int:
    """At least so many characters the frame that begins at `buffer[at]` lacks: how long it is, its end says."""
    return max(1, OVERHEAD - (len(buffer) - at))


def decoder() -> Decoder[Frame]:
    """A receive loop for Ultra3000: `receive_data(bytes)` and `silence()` return events."""
    return _Decoder(read_front, missing)
