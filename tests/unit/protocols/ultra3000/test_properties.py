"""What holds for Ultra3000, whatever is on the line, and what a master reports of a bad one."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

from choices import Choices, decoded
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.strategies import DataObject
from strategies import SIZES, Row, cut

from multidrop import errors
from multidrop.catalog import load_profile
from multidrop.decoder import Decoder
from multidrop.events import Damaged, FrameReceived
from multidrop.exchange import Exchange
from multidrop.profile import Profile
from multidrop.protocols import ultra3000
from multidrop.protocols.ultra3000 import Frame, Reply, Request, Slave
from multidrop.protocols.ultra3000.describe import describe, from_master
from multidrop.protocols.ultra3000.device import Ultra3000Device
from multidrop.protocols.ultra3000.frame import READS
from multidrop.protocols.ultra3000.points import parse_point
from multidrop.protocols.ultra3000.values import (
    INTEGERS,
    decode_value,
    encode_hex,
    encode_value,
    parse_value,
    string,
)
from multidrop.session import Session
from multidrop.writing import Outcome

PROFILE = load_profile("ultra3000")

DIGITS = "0123456789ABCDEF"
PARAMETERS = (0x000, 0x011, 0x05B, 0x06F, 0x073, 0x873)


def a_frame(choices: Choices) -> Frame:
    return Frame(
        address=choices.of((0, 1, 253, 255)) if choices.flag() else choices.byte(),
        parameter=choices.of(PARAMETERS) if choices.flag() else choices.to(0xFFF),
        function=choices.to(15),
        data=some_digits(choices, 245),
    )


def some_digits(choices: Choices, most: int) -> str:
    digits = choices.data(most // 2).hex().upper()
    return digits + choices.of(DIGITS) if choices.flag() and len(digits) < most else digits


def a_slave(choices: Choices) -> Slave:
    return Slave(choices.to(1), profile=choices.of((PROFILE, None)))


def a_reply(choices: Choices) -> Reply:
    return Reply(refusal=choices.byte(), data=some_digits(choices, 8))


def no_conversation(choices: Choices) -> Any:
    raise AssertionError("the master has properties of its own")


ROW = Row(
    name="ultra3000",
    frame=a_frame,
    decode=Frame.decode,
    line=ultra3000.LINE,
    telling=b":\r\n0123456789ABCDEFabc",
    harmless=bytes(byte for byte in range(0x100) if byte not in b":\n"),
    slave=a_slave,
    reply=a_reply,
    conversation=no_conversation,
)
FRAMES, STREAMS = ROW.frames, ROW.streams


def events_of(pieces: list[bytes]) -> list[FrameReceived[Frame] | Damaged]:
    decoder = ultra3000.decoder()
    events = [event for piece in pieces for event in decoder.receive_data(piece)]
    return events + decoder.silence()


# -- the four properties of every protocol -----------------------------------------------------


@given(FRAMES)
def test_decode_undoes_encode(frame: Frame) -> None:
    assert Frame.decode(frame.encode()) == frame


@given(STREAMS, SIZES)
def test_chunking_changes_no_event(stream: bytes, sizes: list[int]) -> None:
    assert events_of(cut(stream, sizes)) == events_of([stream])


@given(STREAMS, SIZES)
def test_every_byte_comes_out_once_but_a_last_line_feed(stream: bytes, sizes: list[int]) -> None:
    events = events_of(cut(stream, sizes))
    found = b"".join(event.raw for event in events)
    if found != stream:
        assert found + b"\n" == stream
        assert isinstance(events[-1], FrameReceived)


@given(STREAMS, FRAMES)
def test_after_silence_the_next_frame_is_found(stream: bytes, frame: Frame) -> None:
    decoder = ultra3000.decoder()
    decoder.receive_data(stream)
    decoder.silence()
    assert not decoder.pending
    raw = frame.encode()
    assert decoder.receive_data(raw) == [FrameReceived(frame, raw)]


@given(FRAMES)
def test_never_is_more_awaited_than_a_frame_still_lacks(frame: Frame) -> None:
    receiver, raw = ultra3000.decoder(), frame.encode()
    for at in range(len(raw)):
        assert 1 <= receiver.missing <= len(raw) - at
        receiver.receive_data(raw[at : at + 1])


@given(st.lists(FRAMES, max_size=4), st.data())
def test_bytes_that_begin_no_frame_cost_no_frame(frames: list[Frame], data: DataObject) -> None:
    noise = st.lists(st.sampled_from(ROW.harmless), max_size=5).map(bytes)
    stream = b"".join(data.draw(noise) + frame.encode() for frame in frames) + data.draw(noise)
    events = events_of([stream])
    assert [event.frame for event in events if isinstance(event, FrameReceived)] == frames


@given(FRAMES, st.integers(0, 300), st.integers(0, 7))
def test_one_wrong_bit_is_seen(frame: Frame, at: int, bit: int) -> None:
    raw = bytearray(frame.encode())
    raw[at % len(raw)] ^= 1 << bit
    assert not [event for event in events_of([bytes(raw)]) if isinstance(event, FrameReceived)]


# -- no input raises ---------------------------------------------------------------------------


@given(decoded(a_slave), STREAMS, SIZES, decoded(a_reply))
def test_no_input_raises_in_a_slave(
    slave: Slave, stream: bytes, sizes: list[int], reply: Reply
) -> None:
    for piece in [*cut(stream, sizes), b""]:
        for request in slave.receive_data(piece) if piece else slave.silence():
            answer = slave.answer(request, request.settled or reply)
            events = events_of([answer])
            assert [type(event) for event in events] == [FrameReceived] * bool(answer)


@given(FRAMES)
def test_every_frame_can_be_described(frame: Frame) -> None:
    assert describe(frame)
    assert isinstance(from_master(frame), bool)


@given(FRAMES, FRAMES)
def test_an_answer_has_the_questions_address_and_function(question: Frame, answer: Frame) -> None:
    if answer.answers(question):
        assert answer.address == question.address
        assert answer.function == question.function
        assert answer.parameter % 0x800 == question.parameter % 0x800


@given(st.text(st.sampled_from("0x1fF.@nvkp_ 7"), max_size=12) | st.text(max_size=8))
def test_any_text_is_a_point_or_is_refused(text: str) -> None:
    for profile in (PROFILE, Profile("ultra3000", "ultra3000")):
        with suppress(errors.UsageError):
            point = parse_point(text, profile)
            assert parse_point(point.text, profile) == point


# -- values ------------------------------------------------------------------------------------


@given(st.sampled_from(list(INTEGERS.values())), st.data())
def test_a_number_comes_back_from_its_digits(kind: Any, data: DataObject) -> None:
    value = data.draw(st.integers(*kind.limits))
    digits = encode_value(kind, value)
    assert len(digits) == kind.digits
    assert decode_value(kind, digits) == value
    assert parse_value(kind, str(value), scaled=False) == value


@given(st.text(st.characters(max_codepoint=0xFF), max_size=64))
def test_text_comes_back_from_its_digits(text: str) -> None:
    digits = encode_value(string(64), text)
    assert len(digits) == 128
    assert decode_value(string(64), digits) == text.rstrip("\0 ")


@given(st.integers(0, 0xFFFFFFFF), st.sampled_from([2, 4, 8]))
def test_hex_keeps_its_width(value: int, digits: int) -> None:
    with suppress(errors.UsageError):
        assert int(encode_hex(f"0x{value:X}", digits), 16) == value
        assert len(encode_hex(value, digits)) == digits


@given(st.sampled_from([name for name, item in PROFILE.points.items() if item.scale != 1.0]))
def test_every_step_of_a_scaled_value_can_be_written(name: str) -> None:
    about = PROFILE.points[name]
    point = parse_point(f"{name}.0" if about.elements else name, PROFILE)
    least, greatest = point.kind.limits
    for raw in (least, least + 1, 0, 1, 3, greatest // 3, greatest - 1, greatest):
        assert about.unscaled(about.physical(raw)) == raw


# -- a bad line --------------------------------------------------------------------------------


@dataclass
class Memory:
    """A drive with two values of kp, working and saved, and a count of its actions."""

    kp: dict[str, str] = field(default_factory=lambda: {"working": "0200", "nv": "0200"})
    homed: int = 0
    writes: int = 0

    def reply(self, request: Request) -> Reply:
        if request.settled is not None:
            return request.settled
        number, function = request.parameter, request.function
        if number == 0x071:
            self.homed += 1
            return Reply()
        if number != 0x011:
            return Reply(data="0A000001")
        if function in READS:
            return Reply(data=self.kp["nv" if function == 2 else "working"])
        self.writes += 1
        if function in (1, 3):
            self.kp["working"] = request.value
        if function == 3:
            self.kp["nv"] = request.value
        if function == 5:
            self.kp["nv"] = self.kp["working"]
        return Reply()


FAULTS = st.sampled_from(["", "", "", "deaf", "silent", "damaged", "noise", "other", "late"])


class BadLine:
    """A line with a drive, or none, that hears itself or not; `faults` are drawn request by request."""

    def __init__(self, data: DataObject, decoder: Decoder[Frame], echo: bool | None) -> None:
        self.data = data
        self.memory = Memory()
        self.slave = Slave(0, profile=PROFILE)
        self.connected = data.draw(st.booleans(), label="connected")
        self.hears_itself = data.draw(st.booleans(), label="hears itself")
        told = self.hears_itself if echo is not None else None
        self.session: Session[Frame] = Session(
            decoder, ultra3000.LINE.timing(network=False), echo=told
        )
        self.now = 100.0

    def run(self, conversation: Any) -> Any:
        exchange = Exchange(conversation, self.session)
        to_send = exchange.start(self.now)
        while not exchange.done:
            arrived = self._hear(to_send)
            if not arrived:
                self.now = max(self.now, exchange.deadline)
            to_send = exchange.advance(arrived, self.now)
        return exchange.result()

    def _hear(self, raw: bytes) -> bytes:
        if not raw:
            return b""
        self.now += len(raw) * ultra3000.LINE.character
        fault = self.data.draw(FAULTS, label="fault")
        echo = raw if self.hears_itself else b""
        if not self.connected or fault == "deaf":
            return echo
        answer = b"".join(
            self.slave.answer(request, self.memory.reply(request))
            for request in self.slave.receive_data(raw)
        )
        if fault == "silent":
            return echo
        if fault == "late":
            self.now += 0.5
        if fault == "damaged":
            answer = answer[:-1] + b"x"
        if fault == "other":
            answer = Frame(1, *Frame.decode(answer)[1:]).encode()
        return echo + (b"\xff" if fault == "noise" else b"") + answer


@given(st.data(), st.sampled_from([None, True]))
def test_an_action_is_reported_as_done_only_if_it_was(data: DataObject, echo: bool | None) -> None:
    line = BadLine(data, ultra3000.decoder(), echo)
    drive = Ultra3000Device(0, PROFILE)
    try:
        line.run(drive.prepare_action("define_home")())
    except errors.NoReply:
        assert line.memory.homed == 0
    except errors.OutcomeUnknown:
        assert line.memory.homed <= 1
    else:
        assert line.memory.homed == 1


@given(st.data(), st.sampled_from([None, True]), st.sampled_from(["kp", "kp@nv"]))
def test_a_write_is_reported_as_what_it_was(
    data: DataObject, echo: bool | None, point: str
) -> None:
    line = BadLine(data, ultra3000.decoder(), echo)
    drive = Ultra3000Device(0, PROFILE)
    try:
        record = line.run(drive.write(drive.prepare_write(point, 5)))
    except errors.NoReply:
        assert line.memory.writes == 0
        return
    assert line.memory.writes <= (2 if point == "kp" else 1)
    if record.outcome is Outcome.CONFIRMED:
        assert line.memory.kp["nv" if point == "kp@nv" else "working"] == "0280"
    elif line.memory.writes == 0:
        assert record.outcome is Outcome.UNKNOWN


@given(st.data(), st.sampled_from([None, True]))
def test_a_save_is_reported_as_what_it_was(data: DataObject, echo: bool | None) -> None:
    line = BadLine(data, ultra3000.decoder(), echo)
    line.memory.kp["working"] = "0280"
    drive = Ultra3000Device(0, PROFILE)
    try:
        (record,) = line.run(drive.copy(drive.prepare_copy("kp", save=True)))
    except errors.NoReply:
        assert line.memory.writes == 0
        return
    assert line.memory.writes <= 1
    if record.outcome is Outcome.CONFIRMED:
        assert line.memory.kp == {"working": "0280", "nv": "0280"}
