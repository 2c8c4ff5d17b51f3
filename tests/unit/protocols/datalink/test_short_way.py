"""Frames close behind one another take a short way: the same events, whatever comes between them."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from multidrop.decoder import Decoder
from multidrop.events import FrameReceived
from multidrop.protocols.datalink import Command, Frame, decoder
from multidrop.protocols.datalink.frame import read_frames, read_front

BYTE = st.sampled_from([0x7E, 0x00, 0x23, 0x83]) | st.integers(0, 0xFF)
DATA = st.lists(BYTE, max_size=32).map(bytes)
FRAMES = (
    DATA.map(lambda data: Frame(Command.RESPONSE, 3, 0x7E00, len(data), data))
    | st.integers(0, 32).map(lambda count: Frame(Command.INTERROGATE, 30, 0x007E, count))
    | st.just(Frame(Command.ACKNOWLEDGE, 30))
)
PIECES = FRAMES.map(Frame.encode) | st.lists(BYTE, max_size=4).map(bytes)
CUTS = st.lists(st.integers(1, 40), max_size=12)


@given(st.lists(PIECES, max_size=6).map(b"".join), CUTS)
def test_the_short_way_tells_the_same(stream: bytes, cuts: list[int]) -> None:
    short, long = decoder(), Decoder(read_front)
    for size in cuts:
        piece, stream = stream[:size], stream[size:]
        assert short.receive_data(piece) == long.receive_data(piece)
        assert short.pending == long.pending
    assert short.receive_data(stream) == long.receive_data(stream)
    assert short.silence() == long.silence()


def test_whole_frames_go_the_short_way() -> None:
    whole = [
        Frame(Command.RESPONSE, 3, 0x1000, 4, b"\x7e\x00\x7e\x7e"),
        Frame(Command.ACKNOWLEDGE, 3),
        Frame(Command.INTERROGATE, 3, 0x1000, 9),
    ]
    raw = b"".join(frame.encode() for frame in whole)
    events, left = read_frames(raw + b"\x7e\x23\x04")
    assert [event.frame for event in events if isinstance(event, FrameReceived)] == whole
    assert left == b"\x7e\x23\x04"


def test_what_is_behind_damage_does_not() -> None:
    raw = Frame(Command.RESPONSE, 3, 0x1000, 1, b"\x01").encode()
    assert read_frames(b"\x00" + raw) == ([], b"\x00" + raw)
    events, left = read_frames(raw + b"\x55" + raw)
    assert (events, left) == ([], raw + b"\x55" + raw)
    wrong = raw[:-1] + b"\x00"
    events, left = read_frames(raw + wrong + raw)
    assert (len(events), left) == (1, wrong + raw)
