"""The frame: vectors both ways, every split, and what is no frame."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import pytest

from multidrop.checksums import negated_sum8
from multidrop.errors import UsageError
from multidrop.events import Damaged, FrameReceived
from multidrop.protocols.ultra3000 import Frame, decoder

VECTORS: list[dict[str, Any]] = tomllib.loads(
    (Path(__file__).parents[3] / "vectors" / "ultra3000.toml").read_text(encoding="utf-8")
)["vector"]

READ = Frame(0, 0x073)
STATUS = Frame(0, 0x073, 0, "00008180")


def by_name(vector: dict[str, Any]) -> str:
    return str(vector["name"])


def frame_of(vector: dict[str, Any]) -> Frame:
    return Frame(*(vector[field] for field in Frame._fields))


@pytest.mark.parametrize("vector", VECTORS, ids=by_name)
def test_a_vector_is_encoded(vector: dict[str, Any]) -> None:
    assert frame_of(vector).encode() == vector["text"].encode() + b"\r"


@pytest.mark.parametrize("vector", VECTORS, ids=by_name)
def test_a_vector_is_decoded(vector: dict[str, Any]) -> None:
    assert Frame.decode(vector["text"].encode() + b"\r") == frame_of(vector)


def test_the_manuals_example_and_its_checksum() -> None:
    assert negated_sum8(b"0006110") != 0x77
    assert negated_sum8(b"000611" + b"01") == 0x77


def test_a_frame_keeps_its_fields_and_has_no_number() -> None:
    frame = Frame(42, 0x843, 1, "05")
    assert (frame.address, frame.parameter, frame.function, frame.data) == (42, 0x843, 1, "05")
    assert frame.is_refusal
    assert not READ.is_refusal
    assert frame.numbered(7) is frame
    assert Frame.NUMBERS == 1


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ((-1, 0, 0, ""), "address -1"),
        ((256, 0, 0, ""), "address 256"),
        ((0, -1, 0, ""), "parameter -0x1"),
        ((0, 0x1000, 0, ""), "parameter 0x1000"),
        ((0, 0, -1, ""), "function -1"),
        ((0, 0, 16, ""), "function 16"),
        ((0, 0, 0, "0" * 246), "246 digits"),
        ((0, 0, 0, "0a"), "digits 0-9 A-F, upper case"),
        ((0, 0, 0, "0\r"), "digits 0-9 A-F, upper case"),
        ((0, 0, 0, "00\n"), "digits 0-9 A-F, upper case"),
    ],
)
def test_a_field_out_of_range(fields: tuple[int, int, int, str], message: str) -> None:
    with pytest.raises(UsageError, match=message):
        Frame(*fields)


@pytest.mark.parametrize(
    "frame",
    [READ, STATUS, Frame(255, 0xFFF, 15, ""), Frame(1, 2, 3, "F" * 245), Frame(0, 6, 0, "20" * 64)],
    ids=lambda frame: f"{len(frame.encode())} characters",
)
def test_a_frame_is_found_in_every_split(frame: Frame) -> None:
    raw = frame.encode()
    for cut in range(len(raw) + 1):
        found = decoder()
        events = [*found.receive_data(raw[:cut]), *found.receive_data(raw[cut:])]
        assert events == [FrameReceived(frame, raw)]
        assert not found.pending


def test_255_characters_are_accepted_and_no_more() -> None:
    assert len(Frame(0, 0, 0, "0" * 245).encode()) == 255
    longer = b":00006" + b"0" * 249
    found = decoder()
    assert found.receive_data(longer[:-1]) == []
    assert found.receive_data(longer[-1:] + b"\r") == []
    assert found.silence() == [Damaged(longer + b"\r", "no carriage return in 255 characters")]


# -- line feeds --------------------------------------------------------------------------------


def test_a_line_feed_between_frames_is_skipped() -> None:
    one, other = READ.encode(), STATUS.encode()
    for pieces in ([one + b"\n" + other], [one, b"\n", other], [one + b"\n", other]):
        found = decoder()
        events = [event for piece in pieces for event in found.receive_data(piece)]
        assert events == [FrameReceived(READ, one), FrameReceived(STATUS, b"\n" + other)]


def test_a_line_feed_behind_the_last_frame_is_skipped() -> None:
    found = decoder()
    assert len(found.receive_data(READ.encode() + b"\n")) == 1
    assert not found.unfinished  # so no master waits for what may follow it
    assert found.silence() == []
    assert not found.pending
    assert len(found.receive_data(READ.encode())) == 1


def test_a_line_feed_behind_no_frame_is_damage() -> None:
    found = decoder()
    assert found.receive_data(b"\n") == []
    assert found.pending
    assert found.silence() == [Damaged(b"\n", "cut short")]
    found.receive_data(READ.encode())
    assert found.silence() == []
    found.receive_data(b"\n")
    assert found.silence() == [Damaged(b"\n", "cut short")]


def test_a_second_line_feed_is_damage() -> None:
    found = decoder()
    found.receive_data(READ.encode() + b"\n\n")
    assert found.silence() == [Damaged(b"\n\n", "no colon")]
    assert decoder().receive_data(b"\nx" + READ.encode())[0] == Damaged(b"\nx", "no colon")


def test_frame_decode_takes_one_line_feed() -> None:
    assert Frame.decode(READ.encode() + b"\n") == READ
    assert Frame.decode(b"\n" + READ.encode()) == READ


# -- damage ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("raw", "reason"),
    [
        (b"x", "no colon"),
        (b":000730D7\r", "checksum D7h, computed D6h"),
        (b":000730d6\r", "'d' is no digit 0-9 A-F"),
        (b":0007g0D6\r", "'g' is no digit 0-9 A-F"),
        (b":0007\xb30D6\r", "'\\xb3' is no digit 0-9 A-F"),
        (b":00073D6\r", "9 characters, under 10"),
        (b":\r", "2 characters, under 10"),
        (b":000730D6", "cut short"),
        (b":000730D6:", "':' is no digit 0-9 A-F"),
        (b":000730D6\n", "'\\n' is no digit 0-9 A-F"),
    ],
)
def test_damage_and_its_reason(raw: bytes, reason: str) -> None:
    for pieces in ([raw], [bytes([byte]) for byte in raw]):
        found = decoder()
        for piece in pieces:
            assert found.receive_data(piece) == []
        (event,) = found.silence()
        assert event == Damaged(raw, reason)


@pytest.mark.parametrize("noise", [b"\xff", b":", b":00", b":000730D7\r", b":000730d6\r", b"0\r"])
def test_damage_costs_no_frame_behind_it(noise: bytes) -> None:
    events = decoder().receive_data(noise + STATUS.encode())
    assert [event for event in events if isinstance(event, FrameReceived)] == [
        FrameReceived(STATUS, STATUS.encode())
    ]
    assert events[0].raw == noise


@pytest.mark.parametrize(
    ("raw", "message"),
    [
        (b"", "no bytes"),
        (b":000730", "cut short"),
        (b":000730D7\r", "checksum D7h"),
        (b":000730D6\r:", "1 bytes too many"),
        (b":000730D6\r\n\n", "2 bytes too many"),
    ],
)
def test_bytes_that_are_not_one_whole_frame(raw: bytes, message: str) -> None:
    with pytest.raises(UsageError, match=message):
        Frame.decode(raw)


# -- what answers what -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("question", "answer"),
    [
        (READ, STATUS),
        (READ, Frame(0, 0x873, 0, "08")),
        (Frame(0, 0x05B, 0, "07"), Frame(0, 0x05B, 0, "000186A0")),
        (Frame(0, 0x0B6, 0, "01"), Frame(0, 0x0B6, 0, "01")),
        (Frame(0, 0x05B, 11), Frame(0, 0x05B, 11, "07")),
        (Frame(0, 0x06D, 1, "000186A0"), Frame(0, 0x06D, 1)),
        (Frame(0, 0x06D, 1, "000186A0"), Frame(0, 0x06D, 1, "000186A0")),
        (Frame(0, 0x06F, 1), Frame(0, 0x06F, 1)),
        (Frame(0, 0x011, 5), Frame(0, 0x011, 5)),
        (Frame(0, 0x05B, 7, "03"), Frame(0, 0x05B, 7)),
        (Frame(0, 0x06F, 1), Frame(0, 0x86F, 1, "06")),
    ],
)
def test_an_answer(question: Frame, answer: Frame) -> None:
    assert answer.answers(question)


@pytest.mark.parametrize(
    "answer",
    [
        READ,  # a read never answers itself
        Frame(1, 0x073, 0, "00008180"),
        Frame(0, 0x074, 0, "00008180"),
        Frame(0, 0x073, 2, "00008180"),
        Frame(0, 0x874, 0, "08"),
        Frame(0, 0x873, 1, "08"),
        Frame(0, 0x873, 0, ""),
        Frame(0, 0x873, 0, "0008"),
    ],
)
def test_no_answer(answer: Frame) -> None:
    assert not answer.answers(READ)
