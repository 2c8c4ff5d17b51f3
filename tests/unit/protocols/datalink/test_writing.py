"""What is known of a write when it is over."""

from __future__ import annotations

from typing import Any

import pytest
from datalink_wire import Instrument, response, steps_of

from multidrop.conversation import Tell, TooLate, Wait
from multidrop.errors import NoReply, NotApplied, OutcomeUnknown, ProtocolError
from multidrop.profile import Profile
from multidrop.protocols.datalink import Command
from multidrop.protocols.datalink.device import DatalinkDevice, device
from multidrop.writing import Outcome, Written

OLD, NEW, OTHER = "64 40 07", "4B 40 08", "50 00 01"


def written(
    *answers: Any, point: str = "C106", value: str = "150.5", verify: bool = True, settle: str = "0"
) -> tuple[list[Any], Written]:
    """Steps and record of a write, the map being known."""
    one = device(3, Profile("datalink", "datalink"), {"settle": settle})
    steps_of(one.read(one.point("B0")), response(0x8002, "06"), response(0x200, "00"))
    return steps_of(one.write(one.prepare_write(point, value), verify=verify), *answers)


def memory(data: str) -> Any:
    """The answer to a read of C106 that asks for one byte more."""
    return response(0x73E, data + " FF")


ECHO = response(0x73E, NEW)


def test_confirmed() -> None:
    steps, record = written(memory(OLD), ECHO, memory(NEW))
    assert record.outcome is Outcome.CONFIRMED
    assert record.error is None
    assert record.old is not None
    assert record.found is not None
    assert (record.old.value, record.asked, record.found.value) == (100.25, 150.5, 150.5)
    assert record.found.raw == bytes.fromhex(NEW)
    assert sum(isinstance(step, Tell) for step in steps) == 1


def test_confirmed_after_a_scan() -> None:
    steps, record = written(memory(OLD), ECHO, memory(OLD), memory(OTHER), memory(NEW), settle="1")
    assert record.outcome is Outcome.CONFIRMED
    assert sum(isinstance(step, Wait) for step in steps) == 2


def test_not_verified() -> None:
    _, record = written(memory(OLD), ECHO, verify=False)
    assert record.outcome is Outcome.UNVERIFIED
    assert record.found is None
    assert record.error is None


def test_the_old_value_cannot_be_read_so_nothing_is_written() -> None:
    with pytest.raises(NoReply):
        written(NoReply(3))


def test_not_applied() -> None:
    _, record = written(memory(OLD), ECHO, memory(OLD))
    assert record.outcome is Outcome.NOT_APPLIED
    assert isinstance(record.error, NotApplied)
    assert record.error.found == 100.25
    assert "C106: the change to 150.5 was acknowledged" in str(record.error)
    assert "after 0 s the old value 100.25 is still read back" in str(record.error)


def test_not_applied_by_an_instrument_that_heard_of_it_late() -> None:
    one = device(3, Profile("datalink", "datalink"), {"settle": "0"})
    steps_of(one.read(one.point("B0")), response(0x8002, "06"), response(0x200, "00"))
    conversation = one.write(one.prepare_write("C106", "150.5"))
    next(conversation)
    conversation.send(memory(OLD))
    acknowledge = conversation.send(ECHO)
    assert isinstance(acknowledge, Tell)
    conversation.send(None)  # type: ignore[arg-type]
    acknowledge.delay.seconds = 0.0724
    with pytest.raises(StopIteration) as end:
        conversation.send(memory(OLD))
    said = str(end.value.value.error)
    assert "was acknowledged 72 ms after its echo, and after 0 s the old value" in said


def test_the_same_value_again_is_confirmed() -> None:
    _, record = written(memory(NEW), ECHO, memory(NEW))
    assert record.outcome is Outcome.CONFIRMED


def test_neither_the_old_nor_the_new_value_is_unknown() -> None:
    _, record = written(memory(OLD), ECHO, memory(OTHER))
    assert record.outcome is Outcome.UNKNOWN
    assert isinstance(record.error, OutcomeUnknown)
    assert str(record.error) == (
        "C106: 150.5 was written, 1.25 is read back, and 100.25 was there before"
    )
    assert record.error.step == "the read-back"
    assert record.found is not None


def test_no_read_back_is_unknown() -> None:
    _, record = written(memory(OLD), ECHO, NoReply(3))
    assert record.outcome is Outcome.UNKNOWN
    assert isinstance(record.error, OutcomeUnknown)
    assert "was acknowledged and could not be read back (no reply in 3 attempts)" in str(
        record.error
    )


def test_a_wrong_echo_is_never_acknowledged() -> None:
    steps, record = written(memory(OLD), response(0x73E, OTHER), memory(OLD))
    assert record.outcome is Outcome.NOT_APPLIED
    assert isinstance(record.error, ProtocolError)
    assert record.found is not None
    assert record.found.value == 100.25
    assert not any(isinstance(step, Tell) for step in steps)


@pytest.mark.parametrize("later", [memory(OLD), NoReply(3)])
def test_no_echo(later: Any) -> None:
    steps, record = written(memory(OLD), NoReply(3), later)
    assert record.outcome is Outcome.NOT_APPLIED
    assert isinstance(record.error, NoReply)
    assert (record.found is None) == isinstance(later, NoReply)
    assert not any(isinstance(step, Tell) for step in steps)


@pytest.mark.parametrize("later", [memory(OLD), NoReply(3)])
def test_an_acknowledge_that_would_be_late(later: Any) -> None:
    _, record = written(memory(OLD), ECHO, TooLate(), later)
    assert record.outcome is Outcome.NOT_APPLIED
    assert isinstance(record.error, NotApplied)
    assert "80 ms were over" in str(record.error)
    assert (record.found is None) == isinstance(later, NoReply)


def test_only_the_bit_that_was_written_counts() -> None:
    echo = response(0x501, "BF 40")
    _, record = written(response(0x501, "01"), echo, response(0x501, "FE"), point="L14", value="on")
    assert record.outcome is Outcome.CONFIRMED
    assert record.old is not None
    assert (record.old.value, record.asked) == (False, True)
    _, record = written(response(0x501, "01"), echo, response(0x501, "BE"), point="L14", value="on")
    assert record.outcome is Outcome.NOT_APPLIED


def fresh() -> DatalinkDevice:
    return device(3, Profile("datalink", "datalink"), {})


@pytest.mark.parametrize("scans", [0, 1, 3])
def test_against_an_instrument(scans: int) -> None:
    instrument, one = Instrument(scans=scans), fresh()
    instrument.memory[0x73E:0x741] = bytes.fromhex(OLD)
    record = instrument.run(one.write(one.prepare_write("C106", "150.5")))
    assert record.outcome is Outcome.CONFIRMED
    assert instrument.memory[0x73E:0x741] == bytes.fromhex(NEW)


def test_a_late_echo_of_a_repeated_change_confirms_nothing() -> None:
    """Both echoes come late, and the instrument has dropped the change by then."""
    instrument, one = Instrument(), fresh()
    instrument.memory[0x73E:0x741] = bytes.fromhex(OLD)
    echoes: list[bytes] = []

    def alter(request: Any, answer: bytes) -> bytes:
        if request.settled is not None:
            instrument.slave.acknowledge_overdue()
            echoes.append(answer)
            return echoes[0] if len(echoes) == 2 else b""
        return (echoes.pop() if len(echoes) == 2 else b"") + answer

    instrument.alter = alter
    record = instrument.run(one.write(one.prepare_write("C106", "150.5")))
    assert [frame.command for frame in instrument.messages].count(Command.CHANGE) == 2
    assert record.outcome is Outcome.NOT_APPLIED
    assert instrument.memory[0x73E:0x741] == bytes.fromhex(OLD)
