"""Frames close behind one another take a short way: the same events, whatever comes between them."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from multidrop.decoder import Decoder
from multidrop.events import FrameReceived
from multidrop.protocols.ultra3000 import Frame, decoder
from multidrop.protocols.ultra3000 import frame as frame_module
from multidrop.protocols.ultra3000.frame import read_frames, read_front

DIGITS = "0123456789ABCDEF"
FRAMES = st.builds(
    Frame,
    address=st.sampled_from([0, 1, 255]),
    parameter=st.integers(0, 0xFFF),
    function=st.integers(0, 15),
    data=st.text(DIGITS, max_size=9) | st.text(DIGITS, max_size=245),
)
NOISE = st.lists(st.sampled_from(b":\r0Fa\xff"), max_size=6).map(bytes)
LONG = st.integers(250, 256).map(lambda digits: b":" + b"0" * digits)
WRONG = FRAMES.map(lambda frame: frame.encode()[:-2] + b"g\r") | FRAMES.map(
    lambda frame: frame.encode()[:-4] + b"0000\r"
)
PIECES = FRAMES.map(Frame.encode) | FRAMES.map(Frame.encode) | NOISE | LONG | WRONG
CUTS = st.lists(st.integers(1, 40) | st.integers(200, 300), max_size=12)


@given(st.lists(PIECES, max_size=6).map(b"".join), CUTS)
def test_the_short_way_tells_the_same(stream: bytes, cuts: list[int]) -> None:
    """But for line feeds, which only the long way knows."""
    short, long = decoder(), Decoder(read_front)
    for size in cuts:
        piece, stream = stream[:size], stream[size:]
        assert short.receive_data(piece) == long.receive_data(piece)
        assert short.pending == long.pending
    assert short.receive_data(stream) == long.receive_data(stream)
    assert short.silence() == long.silence()


def test_whole_frames_go_the_short_way() -> None:
    whole = [Frame(0, 0x073), Frame(0, 0x073, 0, "00008180"), Frame(1, 0x873, 1, "08")]
    raw = b"".join(frame.encode() for frame in whole)
    events, left = read_frames(raw + b":0007")
    assert [event.frame for event in events if isinstance(event, FrameReceived)] == whole
    assert left == b":0007"
    assert read_frames(b"") == ([], b"")


def test_what_is_behind_damage_does_not() -> None:
    raw = Frame(0, 0x073).encode()
    assert read_frames(b"0" + raw) == ([], b"0" + raw)
    wrong = raw[:-2] + b"0\r"
    assert read_frames(raw + wrong + raw) == ([], raw + wrong + raw)


def test_a_line_on_which_everything_is_spoken_of(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(frame_module._Heads, "MOST", 3)
    frame_module._HEADS.clear()
    for parameter in [*range(10), 0]:
        frame = Frame(7, parameter, 3, "01")
        assert Frame.decode(frame.encode()) == frame
        assert len(frame_module._HEADS) <= 3
