"""What may still be answered, and what that keeps from being asked."""

from __future__ import annotations

from typing import Any

import pytest
from words import Word, ask, new_session, tell

from multidrop.conversation import Ask, Conversation
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


def test_nor_once_a_device_was_told_to_do_something() -> None:
    """A late answer to a read from before shows what was before."""
    for told in (ask("do", repeatable=False), tell("do")):
        session = new_session()
        given_up = timed_out(session, "a")
        exchange = Exchange(told, session)
        assert exchange.start(given_up) == b"(do)"
        exchange.advance(b"(DO)", given_up + 0.1)
        assert exchange.done
        again = Exchange(ask("a"), session)
        assert again.start(given_up + 0.2) == b""
        assert again.deadline == given_up + MAY_COME


def test_nor_where_it_was_given_up_behind_something_that_was_done() -> None:
    """What was done may show only then."""
    session = new_session()
    exchange = Exchange(write_and_read("do", "a"), session)
    exchange.start(NOW)
    assert exchange.advance(b"(DO)", NOW + 0.1) == b""
    sent, now = [], NOW + 0.1
    while not exchange.done:
        now = exchange.deadline
        sent += [(exchange.advance(b"", now), now)]
    times = [at for raw, at in sent if raw == b"(a)"]
    assert max(times[1] - times[0], times[2] - times[1]) < MAY_COME  # its attempts wait for nothing
    again = Exchange(ask("a"), session)
    assert again.start(now) == b""
    assert again.deadline == now + MAY_COME


def test_what_acts_is_not_asked_again_at_once() -> None:
    """A late answer to the first would speak for the second."""
    session = new_session()
    exchange = Exchange(ask("do", repeatable=False), session)
    exchange.start(NOW)
    given_up = exchange.deadline
    exchange.advance(b"", given_up)
    assert exchange.done
    again = Exchange(ask("do", repeatable=False), session)
    assert again.start(given_up) == b""
    assert again.deadline == given_up + MAY_COME


def test_what_rests_waits_before_each_attempt() -> None:
    session = new_session()
    exchange = Exchange(resting("a"), session)
    assert exchange.start(NOW) == b"(a)"
    for _ in range(2):
        given_up = exchange.deadline
        assert exchange.advance(b"", given_up) == b""
        assert exchange.deadline == given_up + MAY_COME
        assert exchange.advance(b"(A)", given_up + 1.4) == b""  # late, and not believed
        assert exchange.advance(b"", given_up + MAY_COME) == b"(a)"
    exchange.advance(b"(A)", exchange.deadline - 0.1)
    assert exchange.result() == "A"
    assert session.counters.foreign == 2


def test_a_line_on_which_something_comes_when_the_rest_is_over_gets_its_time_to_fall_silent() -> (
    None
):
    session = new_session()
    exchange = Exchange(resting("a"), session)
    exchange.start(NOW)
    exchange.advance(b"", exchange.deadline)
    rested = exchange.deadline
    exchange.advance(b"(", rested - 0.001)
    assert exchange.advance(b"", rested) == b""
    assert exchange.advance(b"", exchange.deadline) == b"(a)"


def resting(word: str) -> Conversation[Word, str]:
    return (yield Ask(Word(word), repeatable=True, rests=True)).content


def write_and_read(write: str, read: str) -> Conversation[Word, str]:
    yield Ask(Word(write))
    return (yield Ask(Word(read), repeatable=True)).content


def test_what_can_no_longer_come_is_forgotten() -> None:
    unanswered: Unanswered[Word] = Unanswered()
    unanswered.give_up(Word("a"), NOW, as_good=True)
    unanswered.answered(Word("b"))
    later = NOW + MAY_COME
    assert unanswered.clear_from(Word("A"), later - 0.1) == later
    assert unanswered.clear_from(Word("A"), later) == later
    assert unanswered.known == {}


def test_what_one_device_was_told_makes_no_difference_to_the_others() -> None:
    unanswered: Unanswered[datalink.Frame] = Unanswered()
    reads = [datalink.Frame(datalink.Command.INTERROGATE, address, 0x1000, 2) for address in (3, 4)]
    for read in reads:
        unanswered.give_up(read, NOW, as_good=True)
    unanswered.acted(3)
    assert [unanswered.clear_from(read, NOW) for read in reads] == [NOW + MAY_COME, NOW]
    unanswered.acted(None)  # all of them
    assert [unanswered.clear_from(read, NOW) for read in reads] == [NOW + MAY_COME] * 2


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
