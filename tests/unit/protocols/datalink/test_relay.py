"""Datalink messages on a line that many masters share: whose change, whose Acknowledge."""

from __future__ import annotations

from typing import Any

import pytest
from datalink_wire import Instrument, response, steps_of

from multidrop.conversation import Ask, Tell, TooLate
from multidrop.errors import NoReply, NotApplied
from multidrop.protocols import PROTOCOLS
from multidrop.protocols.datalink import Command, Frame, UnstuffedFrame
from multidrop.protocols.datalink.relay import DatalinkRelay
from multidrop.relay import Passage
from multidrop.writing import Outcome

RELAY = DatalinkRelay()
READ = Frame(Command.INTERROGATE, 3, 0x73E, 3)
CHANGE = Frame(Command.CHANGE, 3, 0x73E, 3, b"\x4b\x40\x08")
BITS = Frame(Command.CHANGE_BITS, 3, 0x50D, 2, b"\xfe\x01")
ACKNOWLEDGE = Frame(Command.ACKNOWLEDGE, 3)
ELSEWHERE = Frame(Command.INTERROGATE, 4, 0x73E, 3)
NOT_OURS = "no change of this master waits for it"


def test_a_read_passes() -> None:
    assert RELAY.passage(READ, None) == RELAY.passage(READ, CHANGE) == Passage()
    assert steps_of(RELAY.carry(READ, None), response(0x73E, "64 40 07"))[0] == [Ask(READ, True)]


@pytest.mark.parametrize("change", [CHANGE, BITS])
def test_a_change_holds_the_line_and_changes_nothing_yet(change: Frame) -> None:
    assert RELAY.passage(change, None) == Passage(acts=True, hold=0.080)
    echo = response(change.memory_address, change.data.hex())
    steps, answer = steps_of(RELAY.carry(change, None), echo)
    assert steps == [Ask(change, repeatable=True, rests=True)]
    assert answer == echo


def test_an_acknowledge_passes_for_its_own_change_only() -> None:
    assert RELAY.passage(ACKNOWLEDGE, CHANGE) == Passage(acts=True, answered=False, written=CHANGE)
    assert RELAY.passage(ACKNOWLEDGE, None) == NOT_OURS
    assert RELAY.passage(Frame(Command.ACKNOWLEDGE, 4), CHANGE) == NOT_OURS
    steps, answer = steps_of(RELAY.carry(ACKNOWLEDGE, CHANGE))
    assert steps == [Tell(ACKNOWLEDGE, within=0.080)]
    assert answer is None
    assert RELAY.outcome(None) is Outcome.UNVERIFIED


def test_a_late_acknowledge_drops_its_change() -> None:
    with pytest.raises(NotApplied, match="more than 80 ms after the echo"):
        steps_of(RELAY.carry(ACKNOWLEDGE, CHANGE), TooLate(), response(0x73E, "64 40 07 00"))


def test_a_response_does_not_pass() -> None:
    assert RELAY.passage(response(0x73E, "00"), None) == "an answer, and no request"


def test_what_shows_the_protocol() -> None:
    assert RELAY.shows(READ)
    assert RELAY.shows(CHANGE)
    assert not RELAY.shows(ACKNOWLEDGE)
    assert not RELAY.shows(response(0x73E, "00"))


def test_a_master_that_goes_on_with_another_instrument_lets_its_change_go() -> None:
    """Its own next command to the same instrument would drop it anyway."""
    answers: list[Any] = [response(0x73E, "64 40 07 00"), response(0x73E, "00 00 00", 4)]
    steps, answer = steps_of(RELAY.carry(ELSEWHERE, CHANGE), *answers)
    assert steps == [
        Ask(Frame(Command.INTERROGATE, 3, 0x73E, 4), repeatable=True),
        Ask(ELSEWHERE, repeatable=True),
    ]
    assert answer == answers[1]
    assert len(steps_of(RELAY.carry(READ, CHANGE), response(0x73E, "64 40 07"))[0]) == 1


@pytest.mark.parametrize("stuffing", [True, False])
def test_letting_go_drops_the_change(stuffing: bool) -> None:
    instrument = Instrument(stuffing=stuffing)
    kind = Frame if stuffing else UnstuffedFrame
    change = kind(Command.CHANGE, 3, 0x7E7E, 1, b"\x7e")
    instrument.run(RELAY.carry(change, None))
    assert instrument.slave.pending == change
    instrument.run(RELAY.let_go(change))
    assert instrument.slave.pending is None
    assert instrument.memory[0x7E7E] == 0


def test_letting_go_of_an_instrument_that_is_silent() -> None:
    steps, result = steps_of(RELAY.let_go(CHANGE), NoReply(1))
    assert len(steps) == 1
    assert result is None


def test_the_protocol_has_it() -> None:
    assert isinstance(PROTOCOLS["datalink"].relay({}), DatalinkRelay)
