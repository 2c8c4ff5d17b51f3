"""What may still be answered, and what that keeps from being asked."""

from __future__ import annotations

from typing import Any

import pytest
from words import Word, ask, new_session

from multidrop.errors import NoReply
from multidrop.exchange import Exchange
from multidrop.protocols import datalink, slink3, ultra3000
from multidrop.session import Session
from multidrop.unanswered import MAY_COME, Unanswered

NOW = 100.0


def timed_out(session: Session[Word], *words: str, now: float = NOW) -> float:
    """Ask words that nobody answers; returns when the last attempt was given up."""
    exchange = Exchange(ask(*words, repeatable=True), session)
    exchange.start(now)
    while not exchange.done:
        now = exchange.deadline
        exchange.advance(b"", now)
    with pytest.raises(NoReply):
        exchange.result()
    return now


def test_another_question_about_the_same_waits_until_no_late_answer_can_come() -> None:
    session = new_session()
    given_up = timed_out(session, "ab")
    exchange = Exchange(ask("aB"), session)
    assert exchange.start(given_up) == b""
    assert exchange.deadline == given_up + MAY_COME
    assert exchange.advance(b"(AB)", given_up + 1.0) == b""  # it comes, and is not believed
    assert session.counters.foreign == 1
    assert exchange.advance(b"", exchange.deadline) == b"(aB)"


def test_the_same_question_is_asked_again_at_once() -> None:
    session = new_session()
    given_up = timed_out(session, "a")
    assert Exchange(ask("a"), session).start(given_up) == b"(a)"


def test_but_not_once_it_was_answered() -> None:
    """Perhaps that was the late answer, and the right one is still to come."""
    session = new_session()
    exchange = Exchange(ask("a", "a"), session)
    exchange.start(NOW)
    first_deadline = exchange.deadline
    assert exchange.advance(b"", first_deadline) == b"(a)"
    assert exchange.advance(b"(A)", first_deadline + 0.1) == b""
    assert exchange.advance(b"(A)", first_deadline + 0.2) == b""
    assert exchange.advance(b"", exchange.deadline) == b"(a)"
    assert exchange.asked_at == first_deadline + MAY_COME


def test_a_question_about_something_else_does_not_wait() -> None:
    session = new_session()
    given_up = timed_out(session, "a")
    exchange = Exchange(ask("b", "c"), session)
    assert exchange.start(given_up) == b"(b)"
    exchange.advance(b"(B)", given_up + 0.1)
    assert exchange.advance(b"", exchange.deadline) == b"(c)"


def test_whoever_has_gone_leaves_a_question_too() -> None:
    session = new_session()
    exchange = Exchange(ask("a"), session)
    exchange.start(NOW)
    exchange.abandon(NOW + 0.5)
    waiting = Exchange(ask("A"), session)
    assert waiting.start(NOW + 0.6) == b""
    assert waiting.deadline == NOW + 0.5 + MAY_COME


def test_what_can_no_longer_come_is_forgotten() -> None:
    unanswered: Unanswered[Word] = Unanswered()
    unanswered.give_up(Word("a"), NOW)
    unanswered.answered(Word("b"))
    later = NOW + MAY_COME
    assert unanswered.clear_from(Word("A"), later - 0.1) == later
    assert unanswered.clear_from(Word("A"), later) == later
    assert unanswered.known == {}


@pytest.mark.parametrize(
    ("question", "answer"),
    [
        (slink3.Frame(1, 4), slink3.Frame(1, 4, 1, 0, b"\x37\x02")),
        (
            datalink.Frame(datalink.Command.CHANGE, 3, 0x1000, 1, b"\x01"),
            datalink.Frame(datalink.Command.RESPONSE, 3, 0x1000, 1, b"\x01"),
        ),
        (ultra3000.Frame(0, 0x05C, 0, "07"), ultra3000.Frame(0, 0x05C, 0, "0080")),
        (ultra3000.Frame(0, 0x011, 1, "0080"), ultra3000.Frame(0, 0x811, 1, "05")),
    ],
)
def test_an_answer_is_about_what_its_question_is_about(question: Any, answer: Any) -> None:
    assert answer.answers(question)
    assert answer.about == question.about


def test_what_an_answer_does_not_repeat_makes_no_difference() -> None:
    element, other = ultra3000.Frame(0, 0x05C, 0, "00"), ultra3000.Frame(0, 0x05C, 0, "07")
    assert element.about == other.about
    read = datalink.Frame(datalink.Command.INTERROGATE, 3, 0x1000, 1)
    change = datalink.Frame(datalink.Command.CHANGE, 3, 0x1000, 1, b"\x01")
    assert read.about == change.about
    assert read.about != datalink.Frame(datalink.Command.INTERROGATE, 3, 0x1000, 2).about
