"""The frame: vectors both ways, every split, literal 7E everywhere, and what is no frame."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import pytest

from multidrop.checksums import sum8
from multidrop.errors import UsageError
from multidrop.events import Damaged, FrameReceived
from multidrop.protocols.datalink import Command, Frame, UnstuffedFrame, decoder

VECTORS = tomllib.loads(
    (Path(__file__).parents[3] / "vectors" / "datalink.toml").read_text(encoding="utf-8")
)["vector"]
BOTH = [(vector, stuffing) for vector in VECTORS for stuffing in (True, False)]
NAMES = [f"{vector['name']}, {'stuffed' if stuffing else 'not'}" for vector, stuffing in BOTH]


def frame_of(vector: dict[str, Any]) -> Frame:
    return Frame(
        Command[vector["command"].upper()],
        vector["address"],
        vector.get("memory_address", 0),
        vector.get("count", 0),
        bytes.fromhex(vector.get("data", "")),
    )


def raw_of(vector: dict[str, Any], stuffing: bool) -> bytes:
    return bytes.fromhex(vector["bytes"] if stuffing else vector.get("unstuffed", vector["bytes"]))


def received(stream: bytes, *, stuffing: bool = True) -> list[FrameReceived[Frame] | Damaged]:
    receiver = decoder(stuffing)
    return receiver.receive_data(stream) + receiver.silence()


@pytest.mark.parametrize(("vector", "stuffing"), BOTH, ids=NAMES)
def test_a_vector_both_ways(vector: dict[str, Any], stuffing: bool) -> None:
    frame, raw = frame_of(vector), raw_of(vector, stuffing)
    assert frame.encode(stuffing=stuffing) == raw
    assert Frame.decode(raw, stuffing=stuffing) == frame
    assert received(raw, stuffing=stuffing) == [FrameReceived(frame, raw)]


@pytest.mark.parametrize(("vector", "stuffing"), BOTH, ids=NAMES)
def test_a_vector_in_every_split(vector: dict[str, Any], stuffing: bool) -> None:
    frame, raw = frame_of(vector), raw_of(vector, stuffing)
    stream = b"\x11" + raw + raw
    expected = [Damaged(b"\x11", "no SOH"), *[FrameReceived(frame, raw)] * 2]
    for first in range(len(stream) + 1):
        for second in range(first, len(stream) + 1):
            receiver = decoder(stuffing)
            events = receiver.receive_data(stream[:first])
            events += receiver.receive_data(stream[first:second])
            events += receiver.receive_data(stream[second:])
            assert events == expected
            assert not receiver.pending


def test_a_whole_frame_does_not_wait_for_the_next_byte() -> None:
    raw = bytes.fromhex("7E E0 01 9B 02 7E 00")  # the LRC is 7E
    receiver = decoder()
    assert receiver.receive_data(raw[:-1]) == []
    assert len(receiver.receive_data(raw[-1:])) == 1


def test_an_acknowledge_is_two_bytes() -> None:
    raw = bytes.fromhex("7E 83")
    assert received(raw + raw) == [FrameReceived(Frame(Command.ACKNOWLEDGE, 3), raw)] * 2
    assert Frame(Command.ACKNOWLEDGE, 3)[2:] == (0, 0, b"")


@pytest.mark.parametrize(
    ("raw", "reason"),
    [
        ("7D E3", "no SOH"),
        ("7E 00", "no command 00h"),
        ("7E 43", "no command 43h"),
        ("7E 63 01", "no command 63h"),
        ("7E 7E", "no command 7Eh"),
        ("7E E3 21", "NUM 33, over 32"),
        ("7E E3 7E 00", "NUM 126, over 32"),
        ("7E E3 09 00 10 FD", "LRC FDh, computed FCh"),
        ("7E E3 09 00 7E 83", "a new SOH after 4 bytes"),
        ("7E 23 01 0C 02 7E B0", "a new SOH after 5 bytes"),
        ("7E", "cut short"),
        ("7E E3", "cut short"),
        ("7E E3 09 00 10", "cut short"),
        ("7E E0 01 9B 02 7E", "cut short"),
        ("7E 23 02 0C 02 7E 00 01", "cut short"),
    ],
)
def test_what_is_no_frame(raw: str, reason: str) -> None:
    first = received(bytes.fromhex(raw))[0]
    assert isinstance(first, Damaged)
    assert first.reason == reason


def test_a_message_cut_short_does_not_hold_back_the_next() -> None:
    cut, whole = bytes.fromhex("7E 23 20 00 02 11 22"), bytes.fromhex("7E E3 09 00 10 FC")
    events = decoder().receive_data(cut + whole)
    assert events[0] == Damaged(cut, "a new SOH after 7 bytes")
    assert events[1] == FrameReceived(Frame(Command.INTERROGATE, 3, 0x1000, 9), whole)


def test_without_stuffing_num_alone_says_where_a_message_ends() -> None:
    raw = bytes.fromhex("7E 23 02 0C 02 7E 83 34")
    frame = Frame(Command.RESPONSE, 3, 0x20C, 2, b"\x7e\x83")
    assert received(raw, stuffing=False) == [FrameReceived(frame, raw)]
    assert not any(event == FrameReceived(frame, raw) for event in received(raw))


def test_an_unstuffed_frame_writes_itself_without_stuffing() -> None:
    stuffed = Frame(Command.INTERROGATE, 3, 638, 1)
    plain = UnstuffedFrame(Command.INTERROGATE, 3, 638, 1)
    assert plain == stuffed
    assert hash(plain) == hash(stuffed)
    assert plain.encode() == bytes.fromhex("7E E3 01 7E 02 64")
    assert plain.encode(stuffing=True) == stuffed.encode()
    assert UnstuffedFrame.decode(plain.encode()) == stuffed
    assert plain.numbered(1) is plain


def test_what_is_decoded_encodes_to_what_was_received() -> None:
    for raw, stuffing in ((bytes.fromhex("7E E3 01 7E 02 64"), False),):
        event = received(raw, stuffing=stuffing)[0]
        assert isinstance(event, FrameReceived)
        assert event.frame.encode() == raw


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((0x60, 3), "96 is no Datalink command"),
        ((0xE0, 32, 0, 1), "address 32 is out of range: 0..31"),
        ((0xE0, -1, 0, 1), "address -1 is out of range"),
        ((0xE0, 3, 0x10000, 1), "memory address 65536 is out of range"),
        ((0xE0, 3, 0, 33), "33 bytes are too many for a message: at most 32"),
        ((0xE0, 3, 0, -1), "at most 32"),
        ((0xE0, 3, 0, 1, b"x"), "NUM 1 does not fit 1 bytes of data"),
        ((0xA0, 3, 0, 2, b"x"), "NUM 2 does not fit 1 bytes of data"),
        ((0x80, 3, 1), "an Acknowledge has neither memory address nor data"),
        ((0x80, 3, 0, 1, b"x"), "an Acknowledge has neither memory address nor data"),
    ],
)
def test_what_cannot_be_said(arguments: tuple[Any, ...], message: str) -> None:
    with pytest.raises(UsageError, match=message):
        Frame(*arguments)


@pytest.mark.parametrize(
    ("raw", "message"),
    [
        ("", "no bytes"),
        ("7E E3", "cut short"),
        ("7E E3 09 00 10 FD", "LRC FDh"),
        ("7E 83 00", "1 bytes too many"),
    ],
)
def test_bytes_that_are_not_one_frame(raw: str, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        Frame.decode(bytes.fromhex(raw))


def test_what_answers_what() -> None:
    question = Frame(Command.INTERROGATE, 3, 0x1000, 2)
    answer = Frame(Command.RESPONSE, 3, 0x1000, 2, b"ab")
    assert answer.answers(question)
    assert answer.answers(Frame(Command.CHANGE, 3, 0x1000, 2, b"xy"))
    assert not question.answers(question)
    assert not Frame(Command.RESPONSE, 4, 0x1000, 2, b"ab").answers(question)
    assert not Frame(Command.RESPONSE, 3, 0x1001, 2, b"ab").answers(question)
    assert not Frame(Command.RESPONSE, 3, 0x1000, 1, b"a").answers(question)
    assert not Frame(Command.CHANGE, 3, 0x1000, 2, b"ab").answers(question)


def test_the_longest_frame_is_what_the_line_says() -> None:
    from multidrop.protocols.datalink import LINE

    longest = Frame(Command.RESPONSE, 3, 0x7E7E, 32, b"\x7e" * 32)
    assert len(longest.encode()) <= LINE.longest_frame
    # 7E as the LRC too: 0x23 + 0x20 + 2 * 0x7E + the data has to end in 7E
    assert LINE.longest_frame == 1 + 2 + 2 * (2 + 32 + 1)


def test_the_checksum() -> None:
    assert sum8(bytes.fromhex("E3 09 00 10")) == 0xFC
    assert sum8(b"\xff\x01") == 0
    assert sum8(b"") == 0
