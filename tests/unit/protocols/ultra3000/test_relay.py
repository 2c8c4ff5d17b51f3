"""Ultra3000 frames on a line that many masters share."""

from __future__ import annotations

import pytest

from multidrop.conversation import Ask, Tell
from multidrop.errors import NoReply
from multidrop.protocols import PROTOCOLS
from multidrop.protocols.ultra3000 import Frame
from multidrop.protocols.ultra3000.relay import Ultra3000Relay
from multidrop.relay import Passage
from multidrop.writing import Outcome
from unit.protocols.ultra3000.wire import Wire

RELAY = Ultra3000Relay()
READS = {0x0, 0x2, 0x6, 0x8, 0x9, 0xA, 0xB}


@pytest.mark.parametrize("function", range(16))
def test_everything_that_is_not_known_as_a_read_may_act(function: int) -> None:
    frame = Frame(0, 0x06D, function)
    acts = function not in READS
    assert RELAY.passage(frame, None) == Passage(acts=acts, written=frame if acts else None)
    assert RELAY.shows(frame)


@pytest.mark.parametrize(("address", "broadcast"), [(254, 255), (255, 255), (255, 7), (7, 7)])
def test_nobody_answers_a_broadcast(address: int, broadcast: int) -> None:
    relay = Ultra3000Relay(broadcast)
    for function in (0x0, 0x1):
        frame = Frame(address, 0x06D, function)
        assert relay.passage(frame, None) == Passage(acts=True, answered=False, written=frame)
        carrying = relay.carry(frame, None)
        assert next(carrying) == Tell(frame)
        with pytest.raises(StopIteration):
            carrying.send(None)  # type: ignore[arg-type]


def test_an_answer_does_not_pass() -> None:
    refusal = Frame(0, 0x86D, 1, "05")
    assert RELAY.passage(refusal, None) == "an answer, and no request"
    assert not RELAY.shows(refusal)


def test_a_read_is_asked_at_once() -> None:
    read = Frame(0, 0x06D)
    assert next(RELAY.carry(read, None)) == Ask(read, repeatable=True)
    assert Wire({"06D0": "0001"}, echo=None).run(RELAY.carry(read, None)) == Frame(
        0, 0x06D, 0, "0001"
    )


def test_before_a_write_the_line_learns_whether_it_hears_itself() -> None:
    write = Frame(0, 0x06D, 1, "0001")
    wire = Wire({"06D10001": ""}, echo=None)
    assert wire.run(RELAY.carry(write, None)) == Frame(0, 0x06D, 1)
    wire.run(RELAY.carry(write, None))
    assert wire.sent == ["0000", "06D10001", "06D10001"]


def test_the_same_for_an_action_and_for_an_element() -> None:
    """Their right answers equal their requests, or may."""
    for frame in (Frame(0, 0x06F, 1), Frame(0, 0x05B, 0, "07")):
        wire = Wire({"06F1": "", "05B007": "0012"}, echo=None, hears_itself=True)
        answer = wire.run(RELAY.carry(frame, None))
        assert answer.answers(frame)
        assert len(wire.sent) == 2


def test_nothing_is_written_where_that_is_not_found_out() -> None:
    wire = Wire({"0000": None}, echo=None)
    with pytest.raises(NoReply, match="nothing was sent but the read of 000"):
        wire.run(RELAY.carry(Frame(0, 0x06D, 1, "0001"), None))
    assert set(wire.sent) == {"0000"}


def test_what_an_answer_says_of_a_write() -> None:
    assert RELAY.outcome(None) is Outcome.UNVERIFIED
    assert RELAY.outcome(Frame(0, 0x06D, 1)) is Outcome.UNVERIFIED
    assert RELAY.outcome(Frame(0, 0x86D, 1, "05")) is Outcome.NOT_APPLIED


def test_nothing_is_said_at_the_end() -> None:
    assert list(RELAY.let_go(Frame(0, 0x06D, 1))) == []


def test_the_protocol_has_it() -> None:
    relay = PROTOCOLS["ultra3000"].relay({"broadcast": "7"})
    frame = Frame(7, 0x06D)
    assert relay.passage(frame, None) == Passage(acts=True, answered=False, written=frame)
