"""Reads captures. `multidrop.io.capture` writes them, and says what is in them."""

from __future__ import annotations

import os
import struct
from collections.abc import Callable, Iterator, Mapping
from copy import copy
from dataclasses import dataclass, field, replace
from mmap import ACCESS_READ, mmap
from pathlib import Path
from typing import NamedTuple

from multidrop.device import ProtocolModule
from multidrop.errors import UsageError
from multidrop.io import pcapng
from multidrop.numerals import is_digits
from multidrop.protocols import PROTOCOLS
from multidrop.timing import Format, LineSettings

RAW = 150
"""Link type (LINKTYPE_USER3) of bytes of no known protocol, in pieces as they came."""

CHUNK = 1 << 20  # bytes of a file that are read at once
_LEAST_BLOCK = 12  # type and two lengths
_ONLY_FLAGS = 12  # bytes of options that hold flags alone, as those of our own packets mostly do
_FLAGS_HEAD = 4 << 16 | pcapng.PACKET_FLAGS  # length and code as one little-endian number
_new = tuple.__new__


@dataclass(frozen=True, slots=True)
class Known:
    """A device of the line that was known when the capture was made."""

    address: int
    profile: str
    name: str = ""


@dataclass(frozen=True, slots=True)
class Interface:
    """One line of a capture. `description` is protocol and settings, `slink3 9600 8E1`."""

    link_type: int
    name: str = ""
    description: str = ""
    baud: int | None = None
    devices: Mapping[int, Known] = field(default_factory=dict)
    own: Mapping[str, str] = field(default_factory=dict)  # keys of its protocol's own
    ticks: int = 10**9  # of the file's clock in a second
    offset: int = 0  # s that its times are to be moved by

    @property
    def protocol(self) -> ProtocolModule | None:
        """The protocol of its packets; None for raw bytes."""
        for name in PROTOCOLS:
            if PROTOCOLS[name].link_type == self.link_type:
                return PROTOCOLS[name]
        return None

    def settings(self, protocol: ProtocolModule) -> LineSettings:
        """Those of a protocol, with baud rate, format and keys that the capture was made with."""
        try:
            settings = protocol.line_for(self.own)
            words = self.description.split()
            character = Format.parse(words[2]) if len(words) == 3 else None
            return settings.with_options(baud=self.baud, format=character)
        except UsageError:  # of another program
            return protocol.line


class Packet(NamedTuple):
    """One frame, or one run of damaged bytes."""

    data: bytes
    time_ns: int  # since 1970, end of the last byte
    flags: int
    comment: str  # why it is damaged
    interface: int  # its place in `CaptureReader.interfaces`

    @property
    def sent(self) -> bool | None:
        """Sent by whoever made the capture; None where nobody knows."""
        direction = self.flags & pcapng.DIRECTION
        return None if direction not in (1, 2) else direction == pcapng.OUTBOUND

    @property
    def damaged(self) -> bool:
        return bool(self.flags & pcapng.ERRORS)


class CaptureReader:
    """The packets of a capture, one after the other; the file may be of any size.

    A file that ends in the middle, or is broken from somewhere on, gives all
    packets before that, and says so in `ending`.
    """

    def __init__(self, path: str | Path) -> None:
        """Raises `UsageError` where there is no such file, or it is no capture."""
        self.path = str(path)
        self.interfaces: list[Interface] = []
        self.ending = ""
        self.at = 0  # where in the file the last packet ended
        try:
            with open(path, "rb") as file:
                begin = file.read(12)
                self.size = os.fstat(file.fileno()).st_size
        except OSError as error:
            raise UsageError(f"{path}: {error.strerror}") from None
        _check_beginning(self.path, begin)
        self._order = "<"
        self._section = 0  # place of this section's first interface
        self._other_clocks = False

    def packets(self, start: int = 0, end: int | None = None) -> Iterator[Packet]:
        """The packets from the byte `start` on, which must begin a block, up to `end`.

        Raises `UsageError` for an interface that is none of multidrop's.
        """
        interfaces = self.interfaces
        head, flags_only = self._structs()
        for kind, body in self._blocks(start, end):
            if kind != pcapng.PACKET:
                self._describe(kind, body)
                head, flags_only = self._structs()
                continue
            number, high, low, size, _ = head(body) if len(body) >= 20 else (1 << 32, 0, 0, 0, 0)
            number += self._section
            behind = 20 + size + -size % 4
            if behind > len(body) or number >= len(interfaces):
                self._broken("a packet that cannot be", len(body) + 12)
                return
            flags, comment = 0, ""
            if len(body) - behind == _ONLY_FLAGS and flags_only(body, behind)[0] == _FLAGS_HEAD:
                flags = flags_only(body, behind)[1]
            elif len(body) > behind:
                flags, comment = _said_of_packet(body, behind, self._order)
            ticks = high << 32 | low
            time_ns = _nanoseconds(ticks, interfaces[number]) if self._other_clocks else ticks
            yield _new(Packet, (body[20 : 20 + size], time_ns, flags, comment, number))

    def copy(self) -> CaptureReader:
        """One that knows the same interfaces, for a reader of a part elsewhere."""
        other = copy(self)
        other.interfaces = self.interfaces.copy()
        return other

    def skip(self, start: int, target: int) -> tuple[int, int]:
        """The first block at or behind `target`, and how many packets are between; learns interfaces.

        The end of the file where that comes first, or something that is broken.
        """
        at, packets, size = start, 0, self.size
        with open(self.path, "rb") as file, mmap(file.fileno(), size, access=ACCESS_READ) as data:
            lengths = struct.Struct(f"{self._order}II").unpack_from
            while at < target:
                if size - at < _LEAST_BLOCK:
                    return size, packets
                kind, length = lengths(data, at)
                if kind == pcapng.SECTION:
                    self._order = _byte_order(data[at + 8 : at + 12])
                    lengths = struct.Struct(f"{self._order}II").unpack_from
                    kind, length = lengths(data, at)
                if not _LEAST_BLOCK <= length <= size - at:
                    return size, packets
                if kind == pcapng.PACKET:
                    packets += 1
                else:
                    self._describe(kind, data[at + 8 : at + length - 4])
                at += length
        return at, packets

    def _structs(self) -> tuple[Callable[..., tuple[int, ...]], Callable[..., tuple[int, ...]]]:
        order = self._order
        return struct.Struct(f"{order}IIIII").unpack_from, struct.Struct(f"{order}II").unpack_from

    def _blocks(self, start: int, end: int | None) -> Iterator[tuple[int, bytes]]:
        """Type and body of each block."""
        with open(self.path, "rb") as file:
            file.seek(start)
            self.at = start
            buffer, at = b"", 0
            lengths = struct.Struct(f"{self._order}II").unpack_from
            while end is None or self.at < end:
                left = len(buffer) - at
                if left < _LEAST_BLOCK:
                    buffer, at = buffer[at:] + file.read(CHUNK), 0
                    left = len(buffer)
                    if left < _LEAST_BLOCK:
                        if left:
                            self._cut(left)
                        return
                kind, length = lengths(buffer, at)
                if kind == pcapng.SECTION:
                    self._order = _byte_order(buffer[at + 8 : at + 12])
                    lengths = struct.Struct(f"{self._order}II").unpack_from
                    kind, length = lengths(buffer, at)
                if not _LEAST_BLOCK <= length <= pcapng.MOST_BLOCK or length % 4:
                    return self._broken(f"a block of {length} bytes")
                if left < length:
                    buffer, at = buffer[at:] + file.read(max(CHUNK, length)), 0
                    if len(buffer) < length:
                        return self._cut(len(buffer))
                if lengths(buffer, at + length - 8)[1] != length:
                    return self._broken("the two lengths of a block differ")
                body = buffer[at + 8 : at + length - 4]
                at += length
                self.at += length
                yield kind, body

    def _cut(self, left: int) -> None:
        self.ending = f"the file is cut short: the last {left} bytes are no whole block"

    def _broken(self, why: str, back: int = 0) -> None:
        self.ending = f"the file is broken from byte {self.at - back} on: {why}"

    def _describe(self, kind: int, body: bytes) -> None:
        """Take what is no packet: a section begins anew, an interface is one more."""
        if kind == pcapng.SECTION:
            self._section = len(self.interfaces)
        elif kind == pcapng.INTERFACE and len(body) >= 8:
            found = _interface(body, self._order)
            if not (found.link_type == RAW or found.protocol is not None):
                raise UsageError(
                    f"{self.path}: {found.name or 'an interface'} has link type {found.link_type},"
                    " which is no line of multidrop's (147..150: docs, reference/capture)"
                )
            self.interfaces.append(found)
            self._other_clocks |= (found.ticks, found.offset) != (10**9, 0)


def _check_beginning(path: str, begin: bytes) -> None:
    if begin[:4] == b"\n\r\r\n":
        if len(begin) == 12 and _byte_order(begin[8:12], strict=True):
            return
        raise UsageError(f"{path}: the beginning of a pcapng file, and no more")
    if not begin:
        raise UsageError(f"{path} is empty")
    if begin[:4] in (b"\xd4\xc3\xb2\xa1", b"\xa1\xb2\xc3\xd4", b"\x4d\x3c\xb2\xa1"):
        raise UsageError(
            f"{path} is in the older pcap format; editcap -F pcapng {path} NEW makes a pcapng of it"
        )
    if begin[:2] == b"\x1f\x8b":
        raise UsageError(f"{path} is compressed: gunzip it first")
    raise UsageError(f"{path} is no capture: a pcapng file begins with 0A 0D 0D 0A")


def _byte_order(magic: bytes, *, strict: bool = False) -> str:
    for order in "<>":
        if magic == struct.pack(f"{order}I", pcapng.BYTE_ORDER):
            return order
    return "" if strict else "<"


def _said_of_packet(body: bytes, at: int, order: str) -> tuple[int, str]:
    """Flags and comment."""
    flags, comments = 0, []
    for code, value in pcapng.read_options(body, at, order):
        if code == pcapng.PACKET_FLAGS and len(value) == 4:
            (flags,) = struct.unpack(f"{order}I", value)
        elif code == pcapng.COMMENT:
            comments.append(value.decode(errors="replace"))
    return flags, "; ".join(comments)


def _interface(body: bytes, order: str) -> Interface:
    (link_type,) = struct.unpack_from(f"{order}H", body)
    found = Interface(link_type, ticks=10**6)
    devices, own = {}, {}
    for code, value in pcapng.read_options(body, 8, order):
        if code == pcapng.INTERFACE_NAME:
            found = replace(found, name=value.decode(errors="replace"))
        elif code == pcapng.INTERFACE_DESCRIPTION:
            found = replace(found, description=value.decode(errors="replace"))
        elif code == pcapng.INTERFACE_SPEED and len(value) == 8:
            found = replace(found, baud=struct.unpack(f"{order}Q", value)[0])
        elif code == pcapng.INTERFACE_RESOLUTION and len(value) == 1:
            power = value[0] & 0x7F
            found = replace(found, ticks=2**power if value[0] & 0x80 else 10**power)
        elif code == pcapng.INTERFACE_OFFSET and len(value) == 8:
            found = replace(found, offset=struct.unpack(f"{order}q", value)[0])
        elif code == pcapng.COMMENT:
            comment = value.decode(errors="replace")
            known = _known(comment)
            if known is not None:
                devices[known.address] = known
            word, _, option = comment.partition(" ")
            if word == "option":
                key, _, setting = option.partition(" ")
                own[key] = setting
    return replace(found, devices=devices, own=own)


def _known(comment: str) -> Known | None:
    """`device ADDRESS PROFILE NAME`, as the writer has it; other comments are for people."""
    word, *rest = comment.split(" ", 3)
    if word != "device" or len(rest) < 2 or not is_digits(rest[0]):
        return None
    return Known(int(rest[0]), rest[1], rest[2] if len(rest) == 3 else "")


def _nanoseconds(ticks: int, interface: Interface) -> int:
    return ticks * 10**9 // interface.ticks + interface.offset * 10**9
