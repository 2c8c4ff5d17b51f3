"""The host's conversations, step by step, and against an instrument with memory."""

from __future__ import annotations

import pytest
from datalink_wire import Instrument, response, steps_of

from multidrop.conversation import Ask, Tell, TooLate, Wait
from multidrop.errors import NoReply, NotApplied, ProtocolError, UsageError
from multidrop.protocols.datalink import Command, Frame, Master, UnstuffedFrame
from multidrop.protocols.datalink.master import SETTLE, outcome
from multidrop.writing import Outcome

MASTER = Master(3)
DATA = bytes.fromhex("4B 40 08")
ACKNOWLEDGE = Frame(Command.ACKNOWLEDGE, 3)


def interrogate(memory_address: int, count: int) -> Frame:
    return Frame(Command.INTERROGATE, 3, memory_address, count)


@pytest.mark.parametrize("address", [-1, 32])
def test_addresses(address: int) -> None:
    with pytest.raises(UsageError, match=r"an instrument has 0\.\.31"):
        Master(address)


def test_a_read_is_one_message_that_may_be_repeated() -> None:
    steps, found = steps_of(MASTER.interrogate(0x1000, 2), response(0x1000, "08 0C"))
    assert steps == [Ask(interrogate(0x1000, 2), repeatable=True)]
    assert found == b"\x08\x0c"


def test_a_long_read_is_split_at_32_bytes() -> None:
    steps, found = steps_of(
        MASTER.interrogate(0x1000, 40), response(0x1000, "01" * 32), response(0x1020, "02" * 8)
    )
    assert [step.frame[2:4] for step in steps if isinstance(step, Ask)] == [
        (0x1000, 32),
        (0x1020, 8),
    ]
    assert found == b"\1" * 32 + b"\2" * 8


def test_the_map_identifier() -> None:
    steps, found = steps_of(MASTER.map_identifier(), response(0x8002, "06"))
    assert steps == [Ask(interrogate(0x8002, 1), repeatable=True)]
    assert found == 6


def test_a_change_is_acknowledged_in_time_once_its_echo_is_right() -> None:
    steps, found = steps_of(MASTER.change(0x73E, DATA), response(0x73E, "4B 40 08"))
    change = Frame(Command.CHANGE, 3, 0x73E, 3, DATA)
    assert steps == [Ask(change, repeatable=True, rests=True), Tell(ACKNOWLEDGE, within=0.080)]
    assert found is None


def test_change_bits_selects_with_zeros_in_the_mask() -> None:
    steps, _ = steps_of(
        MASTER.change_bits(0x501, [(0x40, 0xFF), (0x01, 0x00)]), response(0x501, "BF 40 FE 00")
    )
    change = Frame(Command.CHANGE_BITS, 3, 0x501, 4, bytes.fromhex("BF 40 FE 00"))
    assert steps[0] == Ask(change, repeatable=True, rests=True)


def test_a_wrong_echo_is_not_acknowledged_and_both_are_shown() -> None:
    with pytest.raises(ProtocolError) as raised:
        steps_of(MASTER.change(0x73E, DATA), response(0x73E, "4B 41 08"))
    assert raised.value.raw == bytes.fromhex("4B 41 08")
    assert "4B 40 08 was sent" in str(raised.value)
    assert "(bytes 4B 41 08)" in str(raised.value)


def test_no_echo_means_that_nothing_was_changed() -> None:
    with pytest.raises(
        NoReply, match="not echoed, so nothing was changed: no reply in 3"
    ) as raised:
        steps_of(MASTER.change(0x73E, DATA), NoReply(3, (b"\1",), (b"\2",)))
    assert raised.value.damaged == (b"\1",)
    assert raised.value.heard == (b"\2",)


def test_a_late_acknowledge_is_not_sent_and_the_change_is_dropped() -> None:
    conversation = MASTER.change(0x73E, DATA)
    with pytest.raises(NotApplied, match="80 ms were over after the echo") as raised:
        steps_of(
            conversation,
            response(0x73E, "4B 40 08"),
            TooLate(),
            response(0x73E, "64 00 07 FF"),
        )
    assert raised.value.found == bytes.fromhex("64 00 07")


def test_the_interrogate_that_drops_a_change_may_stay_unanswered() -> None:
    with pytest.raises(NotApplied) as raised:
        steps_of(MASTER.change(0x73E, DATA), response(0x73E, "4B 40 08"), TooLate(), NoReply(3))
    assert raised.value.found is None


@pytest.mark.parametrize("size", [0, 33])
def test_sizes_of_a_change(size: int) -> None:
    with pytest.raises(UsageError):
        steps_of(MASTER.change(0x1000, bytes(size)))
    with pytest.raises(UsageError):
        steps_of(MASTER.change_bits(0x1000, [(1, 1)] * (size and 17)))


def test_changes_end_where_memory_does() -> None:
    with pytest.raises(UsageError, match="not in memory"):
        steps_of(MASTER.change(0xFFFF, b"12"))
    with pytest.raises(UsageError, match="not in memory"):
        steps_of(MASTER.change_bits(0xFFFF, [(1, 1), (1, 1)]))
    assert MASTER.bits_message(0xFFFF, [(1, 1)]).count == 2


@pytest.mark.parametrize(
    ("at", "size", "asked"),
    [
        (0x1000, 3, [(0x1000, 4)]),
        (0x1000, 31, [(0x1000, 32)]),
        (0x1000, 32, [(0x1000, 16), (0x1010, 16)]),
        (0xFFFE, 2, [(0xFFFD, 3)]),
        (0xFFFF, 1, [(0xFFFE, 2)]),
        (0xFFE0, 32, [(0xFFE0, 16), (0xFFF0, 16)]),
    ],
)
def test_no_echo_can_pass_for_the_read_back(
    at: int, size: int, asked: list[tuple[int, int]]
) -> None:
    instrument = Instrument()
    instrument.memory[at : at + size] = bytes(range(size))
    change = MASTER.change_message(at, b"x" * size)
    assert instrument.run(MASTER.memory_of(change)) == bytes(range(size))
    assert [frame[2:4] for frame in instrument.messages] == asked
    echo = Frame(Command.RESPONSE, 3, at, size, b"x" * size)
    assert not any(echo.answers(frame) for frame in instrument.messages)


@pytest.mark.parametrize("bits", [1, 2, 16])
def test_no_echo_of_change_bits_can_either(bits: int) -> None:
    change = MASTER.bits_message(0x500, [(1, 1)] * bits)
    instrument = Instrument()
    assert instrument.run(MASTER.memory_of(change)) == bytes(bits)
    (question,) = instrument.messages
    assert question[2:4] == (0x500, bits)
    assert not Frame(Command.RESPONSE, 3, 0x500, 2 * bits, change.data).answers(question)


def test_confirm_looks_at_once_and_waits_no_longer_than_settle() -> None:
    change = MASTER.change_message(0x73E, DATA)
    shown, other = response(0x73E, "4B 40 08 00"), response(0x73E, "64 00 07 00")
    steps, found = steps_of(MASTER.confirm(change), shown)
    assert len(steps) == 1
    assert found == DATA

    steps, found = steps_of(MASTER.confirm(change), other, other, shown)
    assert [type(step) for step in steps] == [Ask, Wait, Ask, Wait, Ask]
    assert found == DATA

    looks = 1 + round(SETTLE / 0.05)
    steps, found = steps_of(MASTER.confirm(change), *[other] * looks)
    assert sum(step.seconds for step in steps if isinstance(step, Wait)) == pytest.approx(SETTLE)
    assert found == bytes.fromhex("64 00 07")

    steps, _ = steps_of(MASTER.confirm(change, settle=0), other)
    assert len(steps) == 1


@pytest.mark.parametrize("scans", [0, 1, 5])
def test_change_and_confirm(scans: int) -> None:
    instrument = Instrument(scans=scans)
    assert instrument.run(MASTER.change_and_confirm(0x73E, DATA)) is Outcome.CONFIRMED
    assert instrument.memory[0x73E:0x741] == DATA


def test_a_change_that_never_shows_was_not_applied() -> None:
    instrument = Instrument(scans=1000)
    assert instrument.run(MASTER.change_and_confirm(0x73E, DATA, 0.2)) is Outcome.NOT_APPLIED


def test_what_memory_says_of_a_change() -> None:
    change = MASTER.change_message(0x73E, DATA)
    old = bytes.fromhex("64 00 07")
    assert outcome(change, old, DATA) is Outcome.CONFIRMED
    assert outcome(change, old, old) is Outcome.NOT_APPLIED
    assert outcome(change, old, bytes.fromhex("64 00 08")) is Outcome.UNKNOWN
    assert outcome(change, DATA, DATA) is Outcome.CONFIRMED


def test_a_lost_echo_is_asked_for_again() -> None:
    instrument = Instrument()
    lost = iter([True])
    instrument.alter = lambda request, answer: (
        b"" if request.settled and next(lost, False) else answer
    )
    instrument.run(MASTER.change(0x73E, DATA))
    assert [frame.command for frame in instrument.messages] == [Command.CHANGE] * 2
    assert instrument.memory[0x73E:0x741] == DATA


def test_a_master_on_a_line_without_stuffing() -> None:
    instrument = Instrument(stuffing=False)
    master = Master(3, stuffing=False)
    data = b"\x7e\x7e\x00\x7e"
    assert instrument.run(master.change_and_confirm(0x7E7E, data)) is Outcome.CONFIRMED
    assert instrument.memory[0x7E7E:0x7E82] == data
    assert all(isinstance(frame, UnstuffedFrame) for frame in instrument.messages)


def test_any_message() -> None:
    question = Frame(Command.CHANGE, 9, 0x1000, 1, b"x")
    steps, found = steps_of(MASTER.ask(question), response(0x1000, "78"))
    assert steps == [Ask(Frame(Command.CHANGE, 3, 0x1000, 1, b"x"))]
    assert found == response(0x1000, "78")
