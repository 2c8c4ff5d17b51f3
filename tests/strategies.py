"""What the properties are tried with: one row for each protocol, and streams made from its frames.

A new protocol adds one `Row` to `ROWS`; every property then holds for it too.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

from hypothesis import strategies as st
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
    frames: SearchStrategy[Any]  # every frame that can be said
    decode: Callable[[bytes], Any]  # the frame of exactly these bytes
    line: LineSettings  # with its decoder
    telling: bytes  # bytes that mean something to a receiver: starts, lengths, ends
    harmless: bytes  # bytes that begin no frame
    slaves: SearchStrategy[Any]  # with receive_data, silence and answer
    replies: SearchStrategy[Any]  # what a device may say
    conversations: SearchStrategy[Converse]  # addressed to 0..3

    def decoder(self) -> Decoder[Any]:
        return self.line.decoder()

    def __repr__(self) -> str:
        return self.name


# -- SLINK3 --------------------------------------------------------------------------------

BYTE = st.integers(0, 0xFF)
WORD = st.integers(0, 0xFFFF)

_CODES = st.sampled_from([*slink3.Command, *slink3.Response]).map(int)

_FRAMES = st.builds(
    slink3.Frame,
    address=st.integers(0, 3) | BYTE,
    control=st.integers(0, 15).map(lambda number: number << 2) | BYTE,
    order=st.sampled_from([0, 1, 4, 5, 16, 17]) | BYTE,
    code=_CODES | WORD,
    data=st.binary(max_size=12) | st.binary(max_size=247),
)

_SLAVES = st.builds(
    slink3.Slave,
    address=st.integers(0, 3),
    dialect=st.sampled_from([slink3.FLEXMAX, slink3.AX_V, slink3.DGFC386, slink3.SLINK3]),
    option=st.booleans(),
    answer_damage=st.booleans(),
)

_REPLIES = st.builds(
    Reply,
    response=st.just(0) | _CODES.filter(lambda code: code <= 0xFF) | WORD,
    data=st.sampled_from([b"", bytes.fromhex("03 2C 20 D2 04"), b"\x37\x02"])
    | st.binary(max_size=12)
    | st.binary(max_size=247),
)

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


def _device_call(address: int, profile: str, call: int) -> Converse:
    protocol = PROTOCOLS["slink3"]
    return lambda: _DEVICE_CALLS[call](protocol.device(address, profile_of(profile), {}))


def _broadcast(profile: str, addresses: list[int], keep_going: bool) -> Converse:
    return PROTOCOLS["slink3"].prepare_broadcast(
        profile_of(profile), [("8236:int16", "7")], addresses, {}, keep_going=keep_going
    )


_PROFILES = st.sampled_from(["slink3", "flexmax"])
_CONVERSATIONS = st.builds(
    _device_call, st.integers(0, 3), _PROFILES, st.integers(0, len(_DEVICE_CALLS) - 1)
) | st.builds(
    _broadcast,
    _PROFILES | st.just("ax-v"),
    st.lists(st.integers(0, 3), max_size=2),
    st.booleans(),
)

ROWS = [
    Row(
        name="slink3",
        frames=_FRAMES,
        decode=slink3.Frame.decode,
        line=slink3.LINE,
        telling=b"\x01\x00\x08\x0b\xff",
        harmless=bytes([0x00, *range(0x02, 0x100)]),
        slaves=_SLAVES,
        replies=_REPLIES,
        conversations=_CONVERSATIONS,
    ),
]


# -- streams, for every protocol --------------------------------------------------------------


def damaged(raw: SearchStrategy[bytes]) -> SearchStrategy[bytes]:
    """Bytes with one changed, one lost, or the end cut off."""

    def change(raw: bytes, at: int, by: int) -> bytes:
        at %= len(raw)
        return raw[:at] + bytes([raw[at] ^ by]) + raw[at + 1 :]

    def lose(raw: bytes, at: int) -> bytes:
        at %= len(raw)
        return raw[:at] + raw[at + 1 :]

    def cut(raw: bytes, at: int) -> bytes:
        return raw[: at % len(raw)]

    where = st.integers(0, 300)
    return (
        st.builds(change, raw, where, st.integers(1, 0xFF))
        | st.builds(lose, raw, where)
        | st.builds(cut, raw, where)
    )


@cache
def noise(row: Row) -> SearchStrategy[bytes]:
    """Anything, and what may be taken for the beginning of a frame."""
    telling = st.lists(st.sampled_from(row.telling), max_size=8).map(bytes)
    long = st.binary(min_size=1, max_size=3).map(lambda piece: piece * 400)
    return st.binary(max_size=12) | telling | long


@cache
def streams(row: Row) -> SearchStrategy[bytes]:
    """What a line may carry: frames, damaged frames and noise.

    Made once, as all strategies that are drawn from within a test should be: making
    one anew for each draw takes longer than the draw.
    """
    raw = row.frames.map(lambda frame: bytes(frame.encode()))
    return st.lists(raw | damaged(raw) | noise(row), max_size=6).map(b"".join)


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


SIZES = st.lists(st.integers(1, 40), max_size=8)
