"""SLINK3 frames on a line that many masters share: what passes, what is refused, whose number."""

from __future__ import annotations

import pytest

from multidrop.conversation import Ask, Tell
from multidrop.exchange import Exchange
from multidrop.protocols import PROTOCOLS
from multidrop.protocols.slink3 import LINE, Command, Frame, Response
from multidrop.protocols.slink3.relay import BROADCAST_HOLD, HARMLESS, Slink3Relay
from multidrop.relay import Passage
from multidrop.session import Session
from multidrop.writing import Outcome

RELAY = Slink3Relay()
READ = Frame(2, 0x14, 0, Command.READ_TYPED_PARAMETER, b"\x03\xf1\x03")
WRITE = Frame(2, 0x14, 0x04, Command.WRITE_TYPED_PARAMETER, b"\x03\xf1\x03\x01\x00")


def test_reads_pass() -> None:
    assert RELAY.passage(READ, None) == Passage()
    for command in HARMLESS:
        passage = RELAY.passage(Frame(2, code=command), None)
        assert isinstance(passage, Passage)
        assert not passage.acts
        assert passage.written is None


@pytest.mark.parametrize("code", [*sorted(set(range(0x110)) - HARMLESS), 0xABCD, 0xFFFF])
def test_everything_that_is_not_known_as_a_read_may_act(code: int) -> None:
    frame = Frame(2, 0x14, 0x04, code)
    passage = RELAY.passage(frame, None)
    assert isinstance(passage, Passage)
    assert passage.acts
    assert passage.written == frame


def test_a_refusal_answers_what_was_asked() -> None:
    passage = RELAY.passage(WRITE, None)
    assert isinstance(passage, Passage)
    assert passage.refusal == Frame(2, 0x14, 0x05, Response.WRITE_NOT_ALLOWED)
    assert passage.refusal.answers(WRITE)


@pytest.mark.parametrize("address", [128, 200, 255])
def test_nobody_answers_a_broadcast(address: int) -> None:
    """A read among them: whatever lies behind the last slave's address is for many, or for nobody."""
    for command in (Command.WRITE_TYPED_PARAMETER, Command.READ_TYPED_PARAMETER):
        frame = Frame(address, code=command)
        expected = Passage(acts=True, answered=False, hold=BROADCAST_HOLD, written=frame)
        assert RELAY.passage(frame, None) == expected
        carrying = RELAY.carry(frame, None)
        assert next(carrying) == Tell(frame)
        with pytest.raises(StopIteration) as end:
            carrying.send(None)  # type: ignore[arg-type]
        assert end.value.value is None


def test_who_received_it_is_asked_while_the_line_is_held() -> None:
    passage = RELAY.passage(Frame(2, code=Command.BROADCAST_COMMAND_VERIFY), None)
    assert passage == Passage(hold=None)
    assert list(RELAY.let_go(Frame(255, code=Command.WRITE_TYPED_PARAMETER))) == []


def test_an_answer_does_not_pass() -> None:
    answer = Frame(2, 0x14, 1)
    assert RELAY.passage(answer, None) == "an answer, and no request"
    assert not RELAY.shows(answer)
    assert RELAY.shows(READ)


def test_only_reads_may_be_asked_again() -> None:
    assert next(RELAY.carry(READ, None)) == Ask(READ, repeatable=True)
    assert next(RELAY.carry(WRITE, None)) == Ask(WRITE, repeatable=False)


@pytest.mark.parametrize("control", [0x00, 0x14, 0x3C, 0xFF])
def test_the_line_numbers_and_the_master_hears_its_own_number(control: int) -> None:
    """Two masters ask with the same number; on the wire no two requests have it."""
    session: Session[Frame] = Session(LINE.decoder(), LINE.timing(network=False))
    numbers = []
    for now in (1.0, 2.0):
        asked = Frame(2, control, 0x04, Command.READ_TYPED_PARAMETER, b"\x03\xf1\x03")
        exchange = Exchange(RELAY.carry(asked, None), session)
        sent = Frame.decode(exchange.start(now))
        numbers.append(sent.control)
        answer = Frame(2, sent.control, 0x15, 0, b"\x03\xf1\x03\x7d\x00")
        exchange.advance(answer.encode(), now + 0.1)
        assert exchange.result() == Frame(2, control, 0x15, 0, b"\x03\xf1\x03\x7d\x00")
    assert numbers == [0x00, 0x04]


@pytest.mark.parametrize(
    ("code", "outcome"),
    [
        (Response.OK, Outcome.UNVERIFIED),
        (Response.OK_BROADCAST, Outcome.UNVERIFIED),
        (Response.COMMAND_SUBMITTED, Outcome.UNKNOWN),
        (Response.ABOVE_MAXIMUM, Outcome.NOT_APPLIED),
    ],
)
def test_what_an_answer_says_of_a_write(code: int, outcome: Outcome) -> None:
    assert RELAY.outcome(Frame(2, 0, 1, code)) is outcome


def test_a_broadcast_is_never_verified_by_the_line() -> None:
    assert RELAY.outcome(None) is Outcome.UNVERIFIED


def test_the_protocol_has_it() -> None:
    assert isinstance(PROTOCOLS["slink3"].relay({}), Slink3Relay)
