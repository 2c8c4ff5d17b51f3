"""The frame: ranges, reasons, and which answer a master may believe."""

from __future__ import annotations

from typing import Any

import pytest

from multidrop.errors import UsageError
from multidrop.events import Damaged
from multidrop.protocols.slink3 import Frame, decoder

READ = Frame(2, 0x08, 0x04, 0x26, bytes.fromhex("83 2C 20 01"))
OK = Frame(2, 0x08, 0x05, 0, bytes.fromhex("83 2C 20 01 D2 04"))


@pytest.mark.parametrize(
    ("field", "least", "most"),
    [("address", 0, 255), ("control", 0, 255), ("order", 0, 255), ("code", 0, 0xFFFF)],
)
def test_the_ranges_of_the_fields(field: str, least: int, most: int) -> None:
    fields: dict[str, Any] = {"address": 1}
    for value in (least, most):
        frame = Frame(**fields | {field: value})
        assert Frame.decode(frame.encode()) == frame
    for value in (least - 1, most + 1):
        with pytest.raises(UsageError, match=f"{value} is out of range"):
            Frame(**fields | {field: value})


def test_the_most_data() -> None:
    """LENGTH is one byte: 255 less the 8 bytes around DATA."""
    assert len(Frame(1, data=bytes(247)).encode()) == 255
    with pytest.raises(UsageError, match="248 bytes of data are too many: at most 247"):
        Frame(1, data=bytes(248))


def test_what_need_not_be_said() -> None:
    assert Frame(1) == Frame(1, 0, 0, 0, b"")


def test_length_and_checksum_are_computed() -> None:
    raw = Frame(2, 0, 0, 0x26, b"\x00\xf1\x03").encode()
    assert raw[3] == len(raw) == 11
    assert raw[-1] == 0xDD


@pytest.mark.parametrize(
    ("raw", "reason"),
    [
        ("", "no bytes"),
        ("01", "cut short"),
        ("01 00 3C 08 01 00 00", "cut short"),
        ("02 00 3C 08 01 00 00 35", "no START"),
        ("01 00 3C 07 01 00 00 3A", "LENGTH 7, under 8"),
        ("01 00 3C 08 01 00 00 36", "checksum 36h, computed 35h"),
        ("01 00 3C 08 01 00 00 35 00", "1 bytes too many"),
    ],
)
def test_bytes_that_are_not_one_whole_frame(raw: str, reason: str) -> None:
    with pytest.raises(UsageError, match=f"not one whole SLINK3 frame: {reason}"):
        Frame.decode(bytes.fromhex(raw))


@pytest.mark.parametrize(
    ("raw", "reason"),
    [
        ("02 03", "no START"),
        ("01 02 04 07", "LENGTH 7, under 8"),
        ("01 02 3C 08 01 00 20 36", "checksum 36h, computed 17h"),
        ("01 00 3C 08 01 00", "cut short"),
        ("01 00 3C", "cut short"),
    ],
)
def test_the_reason_of_damage(raw: str, reason: str) -> None:
    receiver = decoder()
    events = receiver.receive_data(bytes.fromhex(raw)) + receiver.silence()
    assert events == [Damaged(bytes.fromhex(raw), reason)]


def test_what_order_says() -> None:
    frame = Frame(1, order=0b1111_0101)
    assert (frame.is_answer, frame.in_fault, frame.destination) == (True, True, 2)
    assert not Frame(1, order=0b0000_0001).in_fault
    frame = Frame(1, order=0b1110_1110)
    assert (frame.is_answer, frame.in_fault, frame.destination) == (False, False, 7)


@pytest.mark.parametrize(("number", "control"), [(0, 0x00), (1, 0x04), (15, 0x3C), (16, 0x00)])
def test_the_sequence_number_stands_in_control(number: int, control: int) -> None:
    assert Frame(1, 0xFF, 2, 3, b"4").numbered(number) == Frame(1, control, 2, 3, b"4")


def test_the_answer() -> None:
    assert OK.answers(READ)
    assert OK._replace(order=0xF5).answers(READ), "fault and reserved bits are no part of it"


@pytest.mark.parametrize(
    "wrong",
    [
        {"address": 3},
        {"control": 0x04},
        {"control": 0x09},
        {"order": 0x04},
        {"order": 0x01},
        {"order": 0x07},
        {"data": bytes.fromhex("83 2D 20 01 D2 04")},
        {"data": bytes.fromhex("83 2C 21 01 D2 04")},
        {"data": bytes.fromhex("83 2C 20 02 D2 04")},
        {"data": bytes.fromhex("83 2C 20")},
        {"data": bytes.fromhex("83 2C")},
        {"data": b""},
    ],
)
def test_no_answer(wrong: dict[str, Any]) -> None:
    assert not OK._replace(**wrong).answers(READ)


@pytest.mark.parametrize(
    ("asked", "data"),
    [
        ("03 2C 20", "83 2C 20 07 00 00"),  # the slave's own SUBINDEX
        ("83 2C 20 01", "03 2C 20 00 00"),  # an answer without one
        ("00 2C 20", "08 2C 20 00 00 00 00"),  # the type is not what is compared
    ],
)
def test_subindex_is_compared_where_both_have_one(asked: str, data: str) -> None:
    question = Frame(2, code=0x26, data=bytes.fromhex(asked))
    assert Frame(2, order=1, data=bytes.fromhex(data)).answers(question)


def test_a_standard_answer_repeats_index_and_subindex() -> None:
    question = Frame(2, code=0x24, data=bytes.fromhex("41 60 00"))
    assert Frame(2, order=1, data=bytes.fromhex("41 60 00 37 02")).answers(question)
    for data in ("41 60 01 37 02", "40 60 00 37 02", "41 60", ""):
        assert not Frame(2, order=1, data=bytes.fromhex(data)).answers(question)


def test_a_refusal_and_the_ok_of_a_write_carry_no_index() -> None:
    assert OK._replace(code=0x12, data=b"").answers(READ)
    assert OK._replace(data=b"").answers(READ._replace(code=0x27))
    assert OK._replace(data=b"").answers(READ._replace(code=0x25))


@pytest.mark.parametrize("asked", ["", "03", "03 2C"])
@pytest.mark.parametrize("data", ["", "03", "03 2C", "03 2C 20 D2 04"])
def test_a_read_without_an_index_has_none_to_repeat(asked: str, data: str) -> None:
    for code in (0x24, 0x26):
        question = Frame(2, code=code, data=bytes.fromhex(asked))
        assert Frame(2, order=1, data=bytes.fromhex(data)).answers(question)
