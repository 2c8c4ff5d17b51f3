"""An echo says what one Change was heard as: it vouches for no other attempt.

The instrument here mishears a Change with a right LRC, as two flipped bits make
it. Only the comparison of the echo protects its memory then.
"""

from __future__ import annotations

from typing import Any

import pytest

from multidrop.errors import ProtocolError
from multidrop.events import FrameReceived
from multidrop.exchange import Exchange
from multidrop.protocols.datalink import LINE, Command, Frame, Master, Slave
from multidrop.session import Session

AT, WANTED, MISHEARD = 0x73E, bytes.fromhex("4B 40 08"), bytes.fromhex("0A 40 08")
NOW = 10.0
LATE = 0.15
"""s from a Change to its echo, or to the second one: later than a master waits for it."""


class Line:
    """An instrument whose echoes come when the test says, and what it was told to carry out."""

    def __init__(self) -> None:
        self.session: Session[Frame] = Session(LINE.decoder(), LINE.timing(network=False))
        self.slave = Slave(3)
        self.echoes: list[bytes] = []  # of each Change, unless the test takes them
        self.acknowledged: list[bytes] = []
        self.mishears: set[int] = set()  # which Change it mishears: 0 is the first

    def hear(self, raw: bytes) -> None:
        event = FrameReceived(Frame.decode(raw), raw)
        if event.frame.command is Command.CHANGE and len(self.echoes) in self.mishears:
            event = FrameReceived(event.frame._replace(data=MISHEARD), raw)
        for request in self.slave.receive_events([event]):
            if request.acknowledged:
                self.acknowledged.append(request.frame.data)
            else:
                assert request.settled is not None
                self.echoes.append(self.slave.answer(request, request.settled))


def begun(line: Line, now: float = NOW) -> Exchange[Frame, Any]:
    """A change that is asked for."""
    exchange = Exchange(Master(3).change(AT, WANTED), line.session)
    sent = exchange.start(now)
    if sent:
        line.hear(sent)
    return exchange


def until(line: Line, exchange: Exchange[Frame, Any], end: float) -> None:
    """Time passes in which nothing comes."""
    while not exchange.done and exchange.deadline < end:
        sent = exchange.advance(b"", exchange.deadline)
        if sent:
            line.hear(sent)


def comes(line: Line, exchange: Exchange[Frame, Any], echo: bytes, at: float) -> None:
    until(line, exchange, at)
    sent = exchange.advance(echo, at)
    if sent:
        line.hear(sent)


def test_a_late_echo_does_not_vouch_for_the_second_attempt() -> None:
    line = Line()
    line.mishears = {1}
    exchange = begun(line)
    comes(line, exchange, line.echoes[0], NOW + LATE)
    assert line.acknowledged == []


def test_the_second_attempt_is_carried_out_once_its_own_echo_is_right() -> None:
    line = Line()
    exchange = begun(line)
    comes(line, exchange, line.echoes[0], NOW + LATE)
    until(line, exchange, NOW + 1.5)
    assert len(line.echoes) == 1
    until(line, exchange, NOW + 1.7)
    assert len(line.echoes) == 2
    line.hear(exchange.advance(line.echoes[1], exchange.asked_at + 0.010))
    assert line.acknowledged == [WANTED]
    assert exchange.result() is None


def test_nor_does_it_vouch_for_somebody_elses_change_to_the_same() -> None:
    """Nobody waits for the first any more."""
    line = Line()
    line.mishears = {1}
    first = begun(line)
    first.abandon(NOW + 0.05)
    second = begun(line, NOW + 0.06)
    comes(line, second, line.echoes[0], NOW + LATE)
    until(line, second, NOW + 1.6)
    second.advance(line.echoes[1], NOW + 1.6)
    assert line.acknowledged == []
    with pytest.raises(ProtocolError):
        second.result()


def test_an_echo_that_comes_twice_is_no_answer_to_what_is_asked_behind_the_acknowledge() -> None:
    line = Line()
    exchange = begun(line)
    line.hear(exchange.advance(line.echoes[0] * 2, NOW + 0.05))
    assert line.acknowledged == [WANTED]
    change = Master(3).change_message(AT, WANTED)
    reading = Exchange(Master(3).memory_of(change), line.session)
    reading.start(NOW + 0.06)
    reading.advance(line.echoes[0], NOW + 0.07)
    assert not reading.done
