"""Lines that hear themselves: telling an echo from an answer, even where both are the same bytes."""

from __future__ import annotations

import pytest
from words import TIMING, Word, ask, new_session

from multidrop.conversation import Ask, Conversation, Learn
from multidrop.errors import NoReply, UsageError
from multidrop.exchange import Exchange
from multidrop.session import Session

NOW = 100.0
LEFT = NOW + 0.003  # the request is on the wire until then


def asked(session: Session[Word], word: str = "a") -> Exchange[Word, str]:
    exchange = Exchange(ask(word), session)
    assert exchange.start(NOW) == f"({word})".encode()
    return exchange


# -- the echo of a request that its answer cannot equal ------------------------------------------


@pytest.mark.parametrize("echo", [None, True])
def test_the_echo_is_dropped_and_the_limit_counts_from_it(echo: bool | None) -> None:
    session = new_session(echo=echo)
    exchange = asked(session)
    exchange.advance(b"(a)", NOW + 0.100)
    assert exchange.deadline == pytest.approx(NOW + 0.100 + TIMING.answer)
    exchange.advance(b"(A)", NOW + 0.200)
    assert exchange.result() == "A"
    assert session.echo is True
    assert (session.counters.echoes, session.counters.foreign) == (1, 0)


def test_the_same_bytes_a_second_time_are_somebody_else() -> None:
    session = new_session()
    exchange = asked(session)
    exchange.advance(b"(a)(a)", NOW + 0.010)
    assert (session.counters.echoes, session.counters.foreign) == (1, 1)
    exchange.advance(b"(A)", NOW + 0.020)
    assert exchange.result() == "A"


def test_a_line_without_echo_has_none() -> None:
    session = new_session(echo=False)
    asked(session).advance(b"(a)", NOW + 0.010)
    assert (session.counters.echoes, session.counters.foreign) == (0, 1)


@pytest.mark.parametrize(("echo", "echoes", "foreign"), [(None, 1, 1), (True, 1, 1), (False, 0, 2)])
def test_the_echo_of_what_nobody_waits_for_is_no_foreign_frame(
    echo: bool | None, echoes: int, foreign: int
) -> None:
    session = new_session(echo=echo)
    exchange = asked(session)
    exchange.abandon(NOW)
    session.drain(b"(a)(a)", NOW + 0.010)
    assert (session.counters.echoes, session.counters.foreign) == (echoes, foreign)


# -- requests that their right answer equals -----------------------------------------------------


def learning() -> Conversation[Word, str]:
    """Learns with `a` what is needed to ask `1`, which is answered with `1`."""
    yield Learn(Word("a"))
    return (yield Ask(Word("1"))).content


def test_such_a_request_is_refused_before_it_is_known_whether_the_line_has_echo() -> None:
    exchange = Exchange(ask("1"), new_session())
    assert exchange.start(NOW) == b""
    with pytest.raises(UsageError, match="begin with a Learn step"):
        exchange.result()


def test_an_answer_without_an_echo_before_it_shows_that_there_is_none() -> None:
    session = new_session()
    exchange = Exchange(learning(), session)
    assert exchange.start(NOW) == b"(a)"
    exchange.advance(b"(A)", NOW + 0.010)
    assert session.echo is False
    assert exchange.advance(b"", exchange.deadline) == b"(1)"
    exchange.advance(b"(1)", NOW + 0.050)
    assert exchange.result() == "1"


def test_an_echo_shows_that_there_is_one() -> None:
    session = new_session()
    exchange = Exchange(learning(), session)
    exchange.start(NOW)
    exchange.advance(b"(a)(A)", NOW + 0.010)
    assert session.echo is True
    assert exchange.advance(b"", exchange.deadline) == b"(1)"
    exchange.advance(b"(1)", NOW + 0.050)
    assert not exchange.done
    exchange.advance(b"(1)", NOW + 0.060)
    assert exchange.result() == "1"


@pytest.mark.parametrize("echo", [True, False])
def test_what_is_known_is_not_asked_again(echo: bool) -> None:
    session = new_session(echo=echo)
    session.keeps_time = True
    exchange = Exchange(learning(), session)
    assert exchange.start(NOW) == b"(1)"


def test_a_line_said_to_have_no_echo_is_asked_once_to_learn_its_pace() -> None:
    session = new_session(echo=False)
    exchange = Exchange(learning(), session)
    assert exchange.start(NOW) == b"(a)"
    exchange.advance(b"(A)", LEFT + 0.010)
    assert session.keeps_time is True
    assert session.echo is False


def test_damage_hides_an_echo_so_it_is_asked_again() -> None:
    session = new_session()
    exchange = Exchange(learning(), session)
    exchange.start(NOW)
    assert exchange.advance(b"x(A)", NOW + 0.010) == b""
    assert session.echo is None
    assert exchange.advance(b"", exchange.deadline) == b"(a)"
    exchange.advance(b"(A)", NOW + 0.050)
    assert session.echo is False


def test_damage_every_time_is_no_reply() -> None:
    exchange = Exchange(learning(), new_session())
    sent, now = exchange.start(NOW), NOW
    while not exchange.done:
        now = now + 0.010 if sent else exchange.deadline
        sent = exchange.advance(b"x(A)" if sent else b"", now)
    with pytest.raises(NoReply, match="damage hides whether the line has local echo in 3 attempts"):
        exchange.result()


def test_on_a_line_that_keeps_time_a_copy_before_the_request_has_left_is_an_echo() -> None:
    session = new_session(echo=False)
    session.keeps_time = True
    exchange = asked(session, "1")
    exchange.advance(b"(1)", LEFT - 0.001)
    assert not exchange.done
    assert session.counters.echoes == 1
    exchange.advance(b"(1)", LEFT + 0.001)
    assert exchange.result() == "1"


def test_on_a_line_that_does_not_it_is_the_answer() -> None:
    session = new_session(echo=False)
    session.keeps_time = False
    exchange = asked(session, "1")
    exchange.advance(b"(1)", LEFT - 0.001)
    assert exchange.result() == "1"


@pytest.mark.parametrize(("at", "keeps"), [(LEFT - 0.001, False), (LEFT + 0.001, True)])
@pytest.mark.parametrize("answer", [b"(A)", b"(a)"])
def test_the_first_frame_shows_whether_a_line_keeps_time(
    answer: bytes, at: float, keeps: bool
) -> None:
    session = new_session()
    exchange = asked(session)
    exchange.advance(answer, at)
    assert session.keeps_time is keeps
    exchange.advance(b"(A)", LEFT + 1)
    assert session.keeps_time is keeps


def test_a_later_attempt_shows_nothing_of_the_pace() -> None:
    """Its answer may be a late one to the attempt before."""
    session = new_session()
    exchange = asked(session)
    exchange.advance(b"", exchange.deadline)
    exchange.advance(b"(A)", exchange.asked_at)
    assert exchange.result() == "A"
    assert session.keeps_time is None
