"""What the properties are tried with: one row for each protocol, and streams made from its frames.

A new protocol adds one `Row` to `ROWS`; every property then holds for it too.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, cached_property, partial
from typing import Any

from choices import Choices, decoded
from hypothesis.strategies import SearchStrategy

from multidrop.catalog import load_profile
from multidrop.conversation import Conversation
from multidrop.decoder import Decoder
from multidrop.protocols import PROTOCOLS, slink3
from multidrop.protocols.slink3.slave import Reply
from multidrop.timing import LineSettings

Converse = Callable[[], Conversation[Any, Any]]


@dataclass(frozen=True, repr=False, eq=False)
class Row:
    """A protocol as the properties need it."""

    name: str
    frame: Callable[[Choices], Any]  # every frame that can be said
    decode: Callable[[bytes], Any]  # the frame of exactly these bytes
    line: LineSettings  # with its decoder
    telling: bytes  # bytes that mean something to a receiver: starts, lengths, ends
    harmless: bytes  # bytes that begin no frame
    slave: Callable[[Choices], Any]  # with receive_data, silence and answer
    reply: Callable[[Choices], Any]  # what a device may say
    conversation: Callable[[Choices], Converse]  # addressed to 0..3

    @cached_property
    def frames(self) -> SearchStrategy[Any]:
        return decoded(self.frame)

    @cached_property
    def streams(self) -> SearchStrategy[bytes]:
        return decoded(partial(stream, self), STREAM)

    def decoder(self) -> Decoder[Any]:
        return self.line.decoder()

    def __repr__(self) -> str:
        return self.name


# -- SLINK3 --------------------------------------------------------------------------------

_CODES = [*map(int, slink3.Command), *map(int, slink3.Response)]
_RESPONSES = [code for code in _CODES if code <= 0xFF]
_DIALECTS = [slink3.FLEXMAX, slink3.AX_V, slink3.DGFC386, slink3.SLINK3]
_FOUND = [b"", bytes.fromhex("03 2C 20 D2 04"), b"\x37\x02"]


def _frame(choices: Choices) -> slink3.Frame:
    return slink3.Frame(
        address=choices.to(3) if choices.flag() else choices.byte(),
        control=choices.to(15) << 2 if choices.flag() else choices.byte(),
        order=choices.of((0, 1, 4, 5, 16, 17)) if choices.flag() else choices.byte(),
        code=choices.of(_CODES) if choices.flag() else choices.word(),
        data=choices.data(247),
    )


def _slave(choices: Choices) -> slink3.Slave:
    return slink3.Slave(
        choices.to(3),
        choices.of(_DIALECTS),
        option=choices.flag(),
        answer_damage=choices.flag(),
    )


def _reply(choices: Choices) -> Reply:
    response = choices.of((lambda: 0, lambda: choices.of(_RESPONSES), choices.word))()
    return Reply(response, choices.of(_FOUND) if choices.flag() else choices.data(247))


_DEVICE_CALLS: list[Callable[[Any], Conversation[Any, Any]]] = [
    lambda device: device.read(device.point("8236:int16")),
    lambda device: device.read(device.point("8236")),
    lambda device: device.read(device.point("8236.1:string")),
    lambda device: device.read(device.point("dgfc/511")),
    lambda device: device.read(device.point("std/0x6041.0:uint16")),
    lambda device: device.write(device.prepare_write("8236:int16", 1234)),
    lambda device: device.write(device.prepare_write("8236", "1234")),
    lambda device: device.write(device.prepare_write("std/0x6042.0:int16", 5), verify=False),
    lambda device: device.status(),
    lambda device: device.clear_faults(),
    lambda device: device.reset_comm(),
    lambda device: device.prepare_raw("26 00 03 2C 20")(),
    lambda device: device.prepare_raw("26 00")(),
    lambda device: device.master.special_access(b"\x11\x22"),
    lambda device: device.master.broadcast_verify(),
]


profile_of = cache(load_profile)
"""A profile that is read once for all cases."""


def _conversation(choices: Choices) -> Converse:
    protocol = PROTOCOLS["slink3"]
    if choices.to(3) == 3:
        profile = profile_of(choices.of(("slink3", "flexmax", "ax-v")))
        addresses = choices.times(2, lambda choices: choices.to(3))
        return protocol.prepare_broadcast(
            profile, [("8236:int16", "7")], addresses, {}, keep_going=choices.flag()
        )
    profile = profile_of(choices.of(("slink3", "flexmax")))
    address, call = choices.to(3), choices.of(_DEVICE_CALLS)
    return lambda: call(protocol.device(address, profile, {}))


ROWS = [
    Row(
        name="slink3",
        frame=_frame,
        decode=slink3.Frame.decode,
        line=slink3.LINE,
        telling=b"\x01\x00\x08\x0b\xff",
        harmless=bytes([0x00, *range(0x02, 0x100)]),
        slave=_slave,
        reply=_reply,
        conversation=_conversation,
    ),
]


# -- streams, for every protocol --------------------------------------------------------------


STREAM = 256
"""Bytes of choices for a stream, six frames with what may befall them, and how it is cut."""


def damaged(choices: Choices, raw: bytes) -> bytes:
    """These bytes with one changed, one lost, or the end cut off."""
    kind, at = choices.to(2), choices.to(300) % len(raw)
    if kind == 0:
        return raw[:at] + bytes([raw[at] ^ 1 + choices.to(0xFE)]) + raw[at + 1 :]
    return raw[:at] + (raw[at + 1 :] if kind == 1 else b"")


def noise(choices: Choices, telling: bytes) -> bytes:
    """Anything, and what may be taken for the beginning of a frame."""
    kind = choices.to(2)
    if kind == 0:
        return choices.data(12)
    if kind == 1:
        return bytes(choices.times(8, lambda choices: choices.of(telling)))
    return bytes(choices.byte() for _ in range(1 + choices.to(2))) * 400


def stream(row: Row, choices: Choices) -> bytes:
    """What a line may carry: frames, damaged frames and noise."""

    def piece(choices: Choices) -> bytes:
        kind = choices.to(2)
        if kind == 2:
            return noise(choices, row.telling)
        raw = bytes(row.frame(choices).encode())
        return damaged(choices, raw) if kind else raw

    return b"".join(choices.times(6, piece))


def cut(stream: bytes, sizes: list[int]) -> list[bytes]:
    """The stream in pieces of these sizes, over and over."""
    if not sizes:
        return [stream]
    pieces, at, turn = [], 0, 0
    while at < len(stream):
        pieces.append(stream[at : at + sizes[turn % len(sizes)]])
        at += sizes[turn % len(sizes)]
        turn += 1
    return pieces


def sizes(choices: Choices) -> list[int]:
    """Of pieces, 1..40 bytes each; none: all in one."""
    return choices.times(8, lambda choices: 1 + choices.to(39))


SIZES = decoded(sizes, 16)
