"""Properties on data full of 7E and 00, stuffed and not."""

from __future__ import annotations

from typing import Any

import pytest
from choices import Choices, tried_with
from datalink_wire import Instrument

from multidrop.events import Damaged, FrameReceived
from multidrop.profile import Profile
from multidrop.protocols.datalink import Command, Frame, Slave, UnstuffedFrame, decoder
from multidrop.protocols.datalink.device import device
from multidrop.protocols.datalink.frame import MOST_DATA
from multidrop.protocols.datalink.slave import Reply
from multidrop.writing import Outcome

TELLING = (0x7E, 0x00, 0x83, 0xE3, 0x23, 0xA3, 0xC3, 0x01, 0x20)
PLACES = (0x7E7E, 0x007E, 0x7E00, 0x8002)
PLACES_WRITTEN = (0x7E7E, 0x007E, 0x7E00, 0xFFFF, 0xFFE0)


def some_data(choices: Choices) -> bytes:
    """0..32 bytes, often 7E and 00."""
    return bytes(choices.times(MOST_DATA, a_byte))


def a_byte(choices: Choices) -> int:
    return choices.of((0x7E, 0x00)) if choices.flag() else choices.byte()


def telling(choices: Choices) -> int:
    return choices.of(TELLING)


def a_frame(choices: Choices) -> Frame:
    command, address = choices.of(list(Command)), choices.of((0, 3, 30, 31))
    if command is Command.ACKNOWLEDGE:
        return Frame(command, address)
    at = choices.of(PLACES) if choices.flag() else choices.word()
    if command is Command.INTERROGATE:
        return Frame(command, address, at, choices.to(MOST_DATA))
    data = some_data(choices)
    return Frame(command, address, at, len(data), data)


def some_noise(choices: Choices) -> bytes:
    return bytes(
        choices.times(12, lambda choices: (telling if choices.flag() else a_byte)(choices))
    )


def some_sizes(choices: Choices) -> list[int]:
    return [1 + choices.to(19), *choices.times(7, lambda choices: 1 + choices.to(19))]


def a_stream(stuffing: bool, choices: Choices) -> bytes:
    """Frames, frames with a changed, lost or added byte, and noise."""
    stream = b""
    for frame in choices.times(4, a_frame):
        raw = bytearray(frame.encode(stuffing))
        kind = choices.of(("whole", "changed", "lost", "added", "noise before"))
        at = choices.to(len(raw) - 1)
        if kind == "changed":
            raw[at] = telling(choices)
        elif kind == "lost":
            del raw[at]
        elif kind == "added":
            raw.insert(at, telling(choices))
        elif kind == "noise before":
            stream += some_noise(choices)
        stream += bytes(raw)
    return stream


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


@both_ways
@tried_with(80)
def test_decode_undoes_encode(stuffing: bool, choices: Choices) -> None:
    frame = a_frame(choices)
    raw = frame.encode(stuffing)
    found = Frame.decode(raw, stuffing)
    assert found == frame
    assert found.encode() == raw
    assert isinstance(found, UnstuffedFrame) is not stuffing


@tried_with(80)
def test_only_the_start_is_a_7e_without_00_behind_it(choices: Choices) -> None:
    raw = a_frame(choices).encode()
    assert raw[0] == 0x7E
    assert b"\x7e" not in raw[1:].replace(b"\x7e\x00", b"")


@both_ways
@tried_with(320)
def test_whole_frames_come_through_every_split(stuffing: bool, choices: Choices) -> None:
    frames = choices.times(5, a_frame)
    raws = [frame.encode(stuffing) for frame in frames]
    events = events_of(pieces(b"".join(raws), some_sizes(choices)), stuffing)
    assert events == [FrameReceived(*pair) for pair in zip(frames, raws, strict=True)]


@both_ways
@tried_with(320)
def test_chunking_changes_no_event_and_no_byte_is_lost(stuffing: bool, choices: Choices) -> None:
    stream = some_noise(choices) if choices.to(3) == 3 else a_stream(stuffing, choices)
    events = events_of(pieces(stream, some_sizes(choices)), stuffing)
    assert events == events_of([stream], stuffing)
    assert b"".join(event.raw for event in events) == stream


@both_ways
@tried_with(80)
def test_never_is_more_awaited_than_a_frame_still_lacks(stuffing: bool, choices: Choices) -> None:
    frame = a_frame(choices)
    receiver, raw = decoder(stuffing), frame.encode(stuffing)
    if frame.command is Command.ACKNOWLEDGE:  # shorter, and nothing that a host waits for
        return
    for at in range(len(raw)):
        assert 1 <= receiver.missing <= len(raw) - at
        receiver.receive_data(raw[at : at + 1])


@tried_with(120)
def test_with_stuffing_no_noise_hides_the_frame_behind_it(choices: Choices) -> None:
    """All but a 7E at its end, which the frame's own 7E makes a false start of."""
    noise, frame = some_noise(choices), a_frame(choices)
    raw = frame.encode()
    events = decoder().receive_data(noise.rstrip(b"\x7e") + raw)
    assert FrameReceived(frame, raw) in events


@both_ways
@tried_with(120)
def test_after_silence_the_next_frame_is_found(stuffing: bool, choices: Choices) -> None:
    receiver = decoder(stuffing)
    receiver.receive_data(some_noise(choices))
    receiver.silence()
    frame = a_frame(choices)
    raw = frame.encode(stuffing)
    assert receiver.receive_data(raw) == [FrameReceived(frame, raw)]


@both_ways
@tried_with(160)
def test_a_slave_never_raises_and_is_never_fooled_by_a_response(
    stuffing: bool, choices: Choices
) -> None:
    slave, reply = Slave(3, stuffing=stuffing), some_data(choices)
    stream = a_stream(stuffing, choices) if choices.flag() else some_noise(choices)
    for request in [*slave.receive_data(stream), *slave.silence()]:
        assert request.frame.command is not Command.RESPONSE
        assert request.frame.address == 3
        answer = slave.answer(request, request.settled or Reply(reply))
        if request.acknowledged:
            assert answer == b""
        else:
            assert Frame.decode(answer, stuffing).command is Command.RESPONSE


@tried_with(80)
def test_one_wrong_bit_never_gives_the_same_frame(choices: Choices) -> None:
    at, bit, frame = choices.byte(), choices.to(7), a_frame(choices)
    raw = bytearray(frame.encode())
    raw[at % len(raw)] ^= 1 << bit
    found = [event for event in events_of([bytes(raw)], True) if isinstance(event, FrameReceived)]
    assert all(event.frame != frame for event in found)


@both_ways
@tried_with(64)
def test_what_is_written_is_in_memory(stuffing: bool, choices: Choices) -> None:
    at = choices.of(PLACES_WRITTEN) if choices.flag() else 0x8003 + choices.to(0xFFE0 - 0x8003)
    data = (some_data(choices) or b"\x7e")[: 0x10000 - at]
    instrument = Instrument(stuffing=stuffing, scans=1)
    one = device(3, Profile("datalink", "datalink"), {"stuffing": "on" if stuffing else "off"})
    record = instrument.run(one.write(one.prepare_write(f"mem/{at}/{len(data)}", data)))
    assert record.outcome is Outcome.CONFIRMED
    assert instrument.memory[at : at + len(data)] == data


@tried_with(64)
def test_damage_says_why(choices: Choices) -> None:
    for event in events_of([choices.data(60)], True):
        assert not isinstance(event, Damaged) or event.reason
