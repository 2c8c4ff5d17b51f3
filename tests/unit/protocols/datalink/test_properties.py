"""Properties on data full of 7E and 00, stuffed and not."""

from __future__ import annotations

from typing import Any

import pytest
from datalink_wire import Instrument
from hypothesis import given
from hypothesis import strategies as st

from multidrop.events import Damaged, FrameReceived
from multidrop.profile import Profile
from multidrop.protocols.datalink import Command, Frame, Slave, UnstuffedFrame, decoder
from multidrop.protocols.datalink.device import device
from multidrop.protocols.datalink.slave import Reply
from multidrop.writing import Outcome

BYTE = st.sampled_from([0x7E, 0x00]) | st.integers(0, 0xFF)
TELLING = st.sampled_from([0x7E, 0x00, 0x83, 0xE3, 0x23, 0xA3, 0xC3, 0x01, 0x20])
ADDRESS = st.sampled_from([0, 3, 30, 31])
MEMORY = st.sampled_from([0x7E7E, 0x007E, 0x7E00, 0x8002]) | st.integers(0, 0xFFFF)
DATA = st.lists(BYTE, max_size=32).map(bytes)
WITH_DATA = st.sampled_from([Command.CHANGE, Command.CHANGE_BITS, Command.RESPONSE])

ACKNOWLEDGES = ADDRESS.map(lambda address: Frame(Command.ACKNOWLEDGE, address))
INTERROGATES = st.tuples(ADDRESS, MEMORY, st.integers(0, 32)).map(
    lambda fields: Frame(Command.INTERROGATE, *fields)
)
OTHERS = st.tuples(WITH_DATA, ADDRESS, MEMORY, DATA).map(
    lambda fields: Frame(*fields[:3], len(fields[3]), fields[3])
)
FRAMES = ACKNOWLEDGES | INTERROGATES | OTHERS
NOISE = st.lists(TELLING | BYTE, max_size=12).map(bytes)
SIZES = st.lists(st.integers(1, 20), min_size=1, max_size=8)

both_ways = pytest.mark.parametrize("stuffing", [True, False], ids=["stuffed", "unstuffed"])


def pieces(stream: bytes, sizes: list[int]) -> list[bytes]:
    found, at, turn = [], 0, 0
    while at < len(stream):
        size = sizes[turn % len(sizes)]
        found.append(stream[at : at + size])
        at, turn = at + size, turn + 1
    return found


def events_of(chunks: list[bytes], stuffing: bool) -> list[Any]:
    receiver = decoder(stuffing)
    events = [event for chunk in chunks for event in receiver.receive_data(chunk)]
    return events + receiver.silence()


@st.composite
def streams(draw: st.DrawFn, stuffing: bool) -> bytes:
    """Frames, frames with a changed, lost or added byte, and noise."""
    stream = b""
    for frame in draw(st.lists(FRAMES, max_size=4)):
        raw = bytearray(frame.encode(stuffing))
        kind = draw(st.sampled_from(["whole", "changed", "lost", "added", "noise before"]))
        at = draw(st.integers(0, len(raw) - 1))
        if kind == "changed":
            raw[at] = draw(TELLING)
        elif kind == "lost":
            del raw[at]
        elif kind == "added":
            raw.insert(at, draw(TELLING))
        elif kind == "noise before":
            stream += draw(NOISE)
        stream += bytes(raw)
    return stream


@both_ways
@given(frame=FRAMES)
def test_decode_undoes_encode(stuffing: bool, frame: Frame) -> None:
    raw = frame.encode(stuffing)
    found = Frame.decode(raw, stuffing)
    assert found == frame
    assert found.encode() == raw
    assert isinstance(found, UnstuffedFrame) is not stuffing


@given(frame=FRAMES)
def test_only_the_start_is_a_7e_without_00_behind_it(frame: Frame) -> None:
    raw = frame.encode()
    assert raw[0] == 0x7E
    assert b"\x7e" not in raw[1:].replace(b"\x7e\x00", b"")


@both_ways
@given(frames=st.lists(FRAMES, max_size=5), sizes=SIZES)
def test_whole_frames_come_through_every_split(
    stuffing: bool, frames: list[Frame], sizes: list[int]
) -> None:
    raws = [frame.encode(stuffing) for frame in frames]
    events = events_of(pieces(b"".join(raws), sizes), stuffing)
    assert events == [FrameReceived(*pair) for pair in zip(frames, raws, strict=True)]


@both_ways
@given(data=st.data(), sizes=SIZES)
def test_chunking_changes_no_event_and_no_byte_is_lost(
    stuffing: bool, data: st.DataObject, sizes: list[int]
) -> None:
    stream = data.draw(streams(stuffing) | NOISE)
    events = events_of(pieces(stream, sizes), stuffing)
    assert events == events_of([stream], stuffing)
    assert b"".join(event.raw for event in events) == stream


@given(noise=NOISE, frame=FRAMES)
def test_with_stuffing_no_noise_hides_the_frame_behind_it(noise: bytes, frame: Frame) -> None:
    """All but a 7E at its end, which the frame's own 7E makes a false start of."""
    raw = frame.encode()
    events = decoder().receive_data(noise.rstrip(b"\x7e") + raw)
    assert FrameReceived(frame, raw) in events


@both_ways
@given(noise=NOISE, frame=FRAMES)
def test_after_silence_the_next_frame_is_found(stuffing: bool, noise: bytes, frame: Frame) -> None:
    receiver = decoder(stuffing)
    receiver.receive_data(noise)
    receiver.silence()
    raw = frame.encode(stuffing)
    assert receiver.receive_data(raw) == [FrameReceived(frame, raw)]


@both_ways
@given(stream=NOISE | st.binary(max_size=80), reply=DATA)
def test_a_slave_never_raises_and_is_never_fooled_by_a_response(
    stuffing: bool, stream: bytes, reply: bytes
) -> None:
    slave = Slave(3, stuffing=stuffing)
    for request in [*slave.receive_data(stream), *slave.silence()]:
        assert request.frame.command is not Command.RESPONSE
        assert request.frame.address == 3
        answer = slave.answer(request, request.settled or Reply(reply))
        if request.acknowledged:
            assert answer == b""
        else:
            assert Frame.decode(answer, stuffing).command is Command.RESPONSE


@given(frame=FRAMES, at=st.integers(0, 80), bit=st.integers(0, 7))
def test_one_wrong_bit_never_gives_the_same_frame(frame: Frame, at: int, bit: int) -> None:
    raw = bytearray(frame.encode())
    raw[at % len(raw)] ^= 1 << bit
    found = [event for event in events_of([bytes(raw)], True) if isinstance(event, FrameReceived)]
    assert all(event.frame != frame for event in found)


@both_ways
@given(
    at=st.integers(0x8003, 0xFFE0) | st.sampled_from([0x7E7E, 0x007E, 0xFFFF, 0xFFE0]),
    data=DATA.filter(bool),
)
def test_what_is_written_is_in_memory(stuffing: bool, at: int, data: bytes) -> None:
    data = data[: 0x10000 - at]
    instrument = Instrument(stuffing=stuffing, scans=1)
    one = device(3, Profile("datalink", "datalink"), {"stuffing": "on" if stuffing else "off"})
    record = instrument.run(one.write(one.prepare_write(f"mem/{at}/{len(data)}", data)))
    assert record.outcome is Outcome.CONFIRMED
    assert instrument.memory[at : at + len(data)] == data


@given(stream=st.binary(max_size=60))
def test_damage_says_why(stream: bytes) -> None:
    for event in events_of([stream], True):
        assert not isinstance(event, Damaged) or event.reason
