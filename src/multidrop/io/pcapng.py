"""Blocks of a pcapng file, as far as a capture of a serial line needs them.

::

    type  length  body ... (padded to four bytes)  length

Source: the pcapng specification (draft-ietf-opsawg-pcapng). A section header
begins a section and says its byte order; interface descriptions follow, and
enhanced packets, which name their interface by its place. Options are code,
length, value, padded. Every other type of block is skipped by its length.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable, Iterator

SECTION, INTERFACE, PACKET = 0x0A0D0D0A, 1, 6  # enhanced packet block
BYTE_ORDER = 0x1A2B3C4D
MOST_BLOCK = 1 << 24
"""Bytes: what is longer is no block but damage."""

END_OF_OPTIONS = 0
COMMENT = 1
SECTION_OS, SECTION_APPLICATION = 3, 4
INTERFACE_NAME, INTERFACE_DESCRIPTION, INTERFACE_SPEED = 2, 3, 8
INTERFACE_RESOLUTION, INTERFACE_OFFSET = 9, 14
PACKET_FLAGS = 2

INBOUND, OUTBOUND = 1, 2  # of the flags of a packet; 0 unknown
DIRECTION = 3
SYMBOL_ERROR, UNALIGNED_ERROR = 1 << 31, 1 << 28
ERRORS = 0xFFFF0000  # of the link layer

Option = tuple[int, bytes]


def block(kind: int, body: bytes) -> bytes:
    """A whole block around its body."""
    body += bytes(-len(body) % 4)
    length = len(body) + 12
    return struct.pack("<II", kind, length) + body + struct.pack("<I", length)


def options(given: Iterable[Option]) -> bytes:
    """Options with their end mark; nothing where there are none."""
    packed = b"".join(
        struct.pack("<HH", code, len(value)) + value + bytes(-len(value) % 4)
        for code, value in given
    )
    return packed + bytes(4) if packed else b""


def section(application: str, system: str) -> bytes:
    """The header of a section of unknown length, little-endian."""
    said = options([(SECTION_OS, system.encode()), (SECTION_APPLICATION, application.encode())])
    return block(SECTION, struct.pack("<IHHq", BYTE_ORDER, 1, 0, -1) + said)


def interface(link_type: int, given: Iterable[Option]) -> bytes:
    """An interface whose packets are kept whole, with times in nanoseconds."""
    said = options([*given, (INTERFACE_RESOLUTION, b"\x09")])
    return block(INTERFACE, struct.pack("<HHI", link_type, 0, 0) + said)


def packet(number: int, time_ns: int, data: bytes, flags: int, comment: str = "") -> bytes:
    """A packet of interface `number`; `time_ns` since 1970."""
    said: list[Option] = [(PACKET_FLAGS, struct.pack("<I", flags))]
    if comment:
        said.append((COMMENT, comment.encode()))
    size = len(data)
    head = struct.pack("<IIIII", number, time_ns >> 32, time_ns & 0xFFFFFFFF, size, size)
    return block(PACKET, head + data + bytes(-size % 4) + options(said))


def read_options(body: bytes, at: int, order: str) -> Iterator[Option]:
    """The options from `at` on; what is broken ends them."""
    while at + 4 <= len(body):
        code, length = struct.unpack_from(order + "HH", body, at)
        if code == END_OF_OPTIONS or at + 4 + length > len(body):
            return
        yield code, body[at + 4 : at + 4 + length]
        at += 4 + length + -length % 4
