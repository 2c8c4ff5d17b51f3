"""One conversation against bytes and time: the arithmetic of its limits, with round numbers."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import pytest
from words import TIMING, Word, ask, new_session, tell

from multidrop.conversation import Ask, Conversation, Tell, TooLate, Wait
from multidrop.errors import NoReply, UsageError
from multidrop.exchange import Exchange
from multidrop.protocols.slink3 import Frame, decoder
from multidrop.session import Session

NOW = 100.0
SENT = NOW + 0.003  # three characters of 1 ms


@pytest.fixture
def exchange() -> Exchange[Word, str]:
    return Exchange(ask("a"), new_session())


# -- the answer limit ------------------------------------------------------------------------


def test_a_fresh_line_is_asked_at_once(exchange: Exchange[Word, str]) -> None:
    assert exchange.start(NOW) == b"(a)"
    assert exchange.asked_at == NOW
    assert not exchange.done


def test_the_answer_limit_counts_from_the_calculated_end_of_the_request(
    exchange: Exchange[Word, str],
) -> None:
    exchange.start(NOW)
    assert exchange.deadline == pytest.approx(SENT + TIMING.answer)
    assert exchange.advance(b"", exchange.deadline - 0.001) == b""
    assert not exchange.done
    assert exchange.advance(b"", exchange.deadline) == b"(a)"


def test_every_attempt_has_its_own_limit(exchange: Exchange[Word, str]) -> None:
    exchange.start(NOW)
    for _ in range(TIMING.attempts - 1):
        now = exchange.deadline
        assert exchange.advance(b"", now) == b"(a)"
        assert exchange.deadline == pytest.approx(now + 0.003 + TIMING.answer)
    assert exchange.advance(b"", exchange.deadline) == b""
    assert exchange.done
    with pytest.raises(NoReply, match="no reply in 3 attempts"):
        exchange.result()


def test_a_whole_frame_is_never_delayed(exchange: Exchange[Word, str]) -> None:
    exchange.start(NOW)
    exchange.advance(b"(A)", NOW + 0.010)
    assert exchange.done
    assert exchange.result() == "A"
    assert exchange.received_at == NOW + 0.010


def test_bytes_that_arrive_with_a_late_runner_are_still_taken(
    exchange: Exchange[Word, str],
) -> None:
    exchange.start(NOW)
    exchange.advance(b"(A)", exchange.deadline + 0.5)
    assert exchange.result() == "A"


def test_once_a_frame_began_only_silence_cuts_it(exchange: Exchange[Word, str]) -> None:
    exchange.start(NOW)
    last = exchange.deadline - 0.001
    for piece in (b"(", b"A"):
        exchange.advance(piece, last)
        assert exchange.deadline == pytest.approx(last + TIMING.silence)
        last = exchange.deadline - 0.001
    exchange.advance(b")", last)
    assert exchange.result() == "A"


def test_silence_before_the_limit_does_not_end_the_attempt(
    exchange: Exchange[Word, str],
) -> None:
    exchange.start(NOW)
    limit = exchange.deadline
    exchange.advance(b"(", NOW + 0.010)
    assert exchange.advance(b"", exchange.deadline) == b""
    assert exchange.deadline == pytest.approx(limit)
    exchange.advance(b"(A)", limit - 0.001)
    assert exchange.result() == "A"


def test_silence_after_the_limit_does(exchange: Exchange[Word, str]) -> None:
    exchange.start(NOW)
    exchange.advance(b"(", exchange.deadline - 0.001)
    assert exchange.advance(b"", exchange.deadline) == b"(a)"


def test_a_frame_that_the_silence_uncovers_is_taken(exchange: Exchange[Word, str]) -> None:
    exchange.start(NOW)
    exchange.advance(b"[(A)", NOW + 0.010)  # `[` claims that more follows
    assert not exchange.done
    exchange.advance(b"", exchange.deadline)
    assert exchange.result() == "A"


def test_a_babbling_line_ends_an_attempt(exchange: Exchange[Word, str]) -> None:
    """At the answer limit, the longest frame and twice the silence, whatever still comes."""
    exchange.start(NOW)
    latest = SENT + TIMING.answer + TIMING.longest_frame * TIMING.character + 2 * TIMING.silence
    now = NOW
    while now < latest:
        assert exchange.advance(b"(", now) == b""
        assert exchange.deadline <= latest + 1e-9
        now += 0.049
    assert exchange._session.counters.no_reply == 0
    exchange.advance(b"(", now)
    assert exchange._session.counters.no_reply == 1


def test_a_line_that_never_falls_silent_is_not_spoken_over(exchange: Exchange[Word, str]) -> None:
    exchange._session.drain(b"x", NOW)
    assert exchange.start(NOW + 0.001) == b""
    now = NOW
    while not exchange.done:
        now += 0.010
        assert exchange.advance(b"x", now) == b""
    assert TIMING.answer < now - NOW <= TIMING.answer + TIMING.silence + 0.001
    with pytest.raises(NoReply, match="the line never fell silent in 0 attempts"):
        exchange.result()


# -- the rest before a request ---------------------------------------------------------------


def test_the_gap_after_the_last_byte_heard() -> None:
    session = new_session()
    session.drain(b"(z)", NOW)
    exchange = Exchange(ask("a"), session)
    assert exchange.start(NOW + 0.001) == b""
    assert exchange.deadline == pytest.approx(NOW + TIMING.gap)
    assert exchange.advance(b"", NOW + 0.0015) == b""
    assert exchange.advance(b"", exchange.deadline) == b"(a)"


def test_the_gap_between_two_questions_of_one_conversation() -> None:
    exchange = Exchange(ask("a", "b"), new_session())
    exchange.start(NOW)
    assert exchange.advance(b"(A)", NOW + 0.010) == b""
    assert exchange.deadline == pytest.approx(NOW + 0.010 + TIMING.gap)
    assert exchange.advance(b"", exchange.deadline) == b"(b)"
    exchange.advance(b"(B)", NOW + 0.030)
    assert exchange.result() == "AB"


def test_a_frame_that_is_still_coming_is_waited_for() -> None:
    session = new_session()
    session.drain(b"(z", NOW)
    exchange = Exchange(ask("a"), session)
    assert exchange.start(NOW + 0.010) == b""
    assert exchange.deadline == pytest.approx(NOW + TIMING.silence)
    assert exchange.advance(b")", NOW + 0.020) == b""
    assert exchange.advance(b"", exchange.deadline) == b"(a)"
    assert session.counters.foreign == 1


def test_what_is_left_of_a_frame_is_dropped_before_the_next_request() -> None:
    session = new_session()
    session.drain(b"(A", NOW)
    exchange = Exchange(ask("a"), session)
    exchange.start(NOW)
    assert exchange.advance(b"", exchange.deadline) == b"(a)"
    assert session.counters.damaged == 1
    exchange.advance(b")", exchange.asked_at + 0.010)
    while not exchange.done:
        exchange.advance(b"", exchange.deadline)
    with pytest.raises(NoReply) as raised:
        exchange.result()
    assert raised.value.damaged == (b")",)


# -- frames that nobody answers, and waiting ---------------------------------------------------


def test_nobody_answers_what_was_told() -> None:
    exchange = Exchange(tell("a"), new_session())
    assert exchange.start(NOW) == b"(a)"
    assert exchange.done
    assert exchange.result() == "told"


def test_what_was_told_is_a_request_like_others() -> None:
    session = new_session()
    exchange = Exchange(tell("a"), session)
    exchange.start(NOW)
    assert exchange.asked_at == NOW
    session.drain(b"(a)(b)", NOW + 0.010)
    assert (session.counters.requests, session.counters.answers) == (1, 0)
    assert (session.counters.echoes, session.counters.foreign) == (1, 1)


def test_the_next_request_waits_for_the_end_of_what_was_told() -> None:
    def conversation() -> Conversation[Word, str]:
        yield Tell(Word("a"))
        return (yield Ask(Word("b"))).content

    exchange = Exchange(conversation(), new_session())
    assert exchange.start(NOW) == b"(a)"
    assert exchange.deadline == pytest.approx(SENT + TIMING.gap)
    assert exchange.advance(b"", exchange.deadline) == b"(b)"


def test_a_wait_counts_from_the_end_of_what_was_told() -> None:
    def conversation() -> Conversation[Word, None]:
        yield Tell(Word("a" * 98))
        yield Wait(0.050)

    exchange = Exchange(conversation(), new_session())
    exchange.start(NOW)
    assert exchange.deadline == pytest.approx(NOW + 0.100 + 0.050)


def test_a_wait_after_an_answer_counts_from_the_answer() -> None:
    def conversation() -> Conversation[Word, None]:
        yield Ask(Word("a"))
        yield Wait(0.050)

    exchange = Exchange(conversation(), new_session())
    exchange.start(NOW)
    exchange.advance(b"(A)", NOW + 0.020)
    assert exchange.deadline == pytest.approx(NOW + 0.070)
    exchange.advance(b"(", NOW + 0.030)
    assert not exchange.done
    exchange.advance(b"", NOW + 0.070)
    assert exchange.done
    assert exchange._session.counters.damaged == 1


def test_waiting_no_time_lets_none_pass() -> None:
    def conversation() -> Conversation[Word, str]:
        yield Wait(0.0)
        return "at once"

    exchange = Exchange(conversation(), new_session())
    exchange.start(NOW)
    exchange.advance(b"", NOW)
    assert exchange.result() == "at once"


def acknowledging(within: float, pause: float) -> Conversation[Word, str]:
    yield Ask(Word("a"))
    yield Wait(pause)
    try:
        yield Tell(Word("b"), within=within)
    except TooLate:
        return "too late"
    return "told"


@pytest.mark.parametrize(
    ("pause", "sent", "result"), [(0.070, b"(b)", "told"), (0.090, b"", "too late")]
)
def test_what_may_only_be_told_soon(pause: float, sent: bytes, result: str) -> None:
    exchange = Exchange(acknowledging(0.080, pause), new_session())
    exchange.start(NOW)
    exchange.advance(b"(A)", NOW + 0.010)
    assert exchange.advance(b"", exchange.deadline) == sent
    assert exchange.result() == result


def test_how_late_something_was_counts_until_it_is_written() -> None:
    """`advance` says what to send, and whoever writes it may take its time."""
    step = Tell(Word("b"), within=0.080)

    def conversation() -> Conversation[Word, None]:
        yield Ask(Word("a"))
        yield step

    session = new_session(gap=0.0)
    for now, took in ((NOW, 0.030), (NOW + 1, 0.012)):
        exchange = Exchange(conversation(), session)
        exchange.start(now)
        assert exchange.told is None
        assert exchange.advance(b"(A)", now + 0.010) == b"(b)"
        assert exchange.told is step
        exchange.written(now + 0.010 + took)
        assert exchange.told is None
        assert step.delay.seconds == pytest.approx(took)
    delays = session.delays
    assert delays.number == 2
    assert delays.last == pytest.approx(0.012)
    assert delays.longest == pytest.approx(0.030)


def test_what_may_be_told_at_any_time_is_not_measured() -> None:
    exchange = Exchange(tell("a"), new_session())
    assert exchange.start(NOW) == b"(a)"
    assert exchange.told is None


def test_a_stray_byte_gives_what_may_only_be_told_soon_no_more_time_than_its_own() -> None:
    """`within` counts from the last byte: one that comes while waiting makes the line rest again."""
    exchange = Exchange(acknowledging(0.001, 0.0), new_session())
    exchange.start(NOW)
    exchange.advance(b"(A)", NOW + 0.010)
    exchange.advance(b"", exchange.deadline)
    assert exchange.result() == "too late"  # the gap of 2 ms is longer than 1 ms


def test_who_does_not_expect_to_be_late_gets_it_raised() -> None:
    def conversation() -> Conversation[Word, None]:
        yield Tell(Word("a"), within=0.010)

    exchange = Exchange(conversation(), new_session())
    exchange.start(NOW)
    with pytest.raises(TooLate):
        exchange.result()


def test_only_reads_leave_a_line_that_broke_off_untouched() -> None:
    reading = Exchange(ask("a"), new_session())
    writing = Exchange(ask("a", repeatable=False), new_session())
    telling = Exchange(tell("a"), new_session())
    for exchange in (reading, writing, telling):
        assert not exchange.acted
        exchange.start(NOW)
    assert (reading.acted, writing.acted, telling.acted) == (False, True, True)


# -- what is believed ------------------------------------------------------------------------


def test_what_came_before_a_request_does_not_answer_it() -> None:
    """Even in one delivery, and on a line that needs no gap."""
    session = new_session(gap=0.0)
    exchange = Exchange(ask("a", "b"), session)
    exchange.start(NOW)
    assert exchange.advance(b"(A)(B)", NOW + 0.010) == b"(b)"
    assert not exchange.done
    assert session.counters.foreign == 1
    exchange.advance(b"(B)", NOW + 0.020)
    assert exchange.result() == "AB"


def test_what_comes_between_two_attempts_answers_neither(exchange: Exchange[Word, str]) -> None:
    exchange.start(NOW)
    limit = exchange.deadline
    exchange.advance(b"(Z)", limit - 0.001)
    assert exchange.advance(b"", limit) == b""  # the line must rest until 1 ms later
    assert exchange.advance(b"(A)", limit + 0.0005) == b""
    assert not exchange.done
    sent = b""
    while not sent:
        sent = exchange.advance(b"", exchange.deadline)
    assert exchange.asked_at == pytest.approx(limit + 0.0005 + TIMING.gap)


def test_a_line_that_begins_to_babble_is_given_up_on_as_if_nothing_was_sent(
    exchange: Exchange[Word, str],
) -> None:
    exchange.start(NOW)
    given_up = exchange.deadline
    exchange.advance(b"", given_up - 0.001)
    now = given_up - 0.001
    while not exchange.done:
        exchange.advance(b"x", now)
        now += 0.001
    assert now - given_up == pytest.approx(TIMING.answer, abs=0.01)
    with pytest.raises(NoReply, match="the line never fell silent in 1 attempt"):
        exchange.result()


def test_what_the_port_marked_as_wrong_is_not_believed(exchange: Exchange[Word, str]) -> None:
    exchange.start(NOW)
    exchange.advance(b"(A", NOW + 0.010)
    exchange.advance(b")", NOW + 0.010, damaged=True)
    assert not exchange.done
    assert exchange.advance(b"", SENT + TIMING.answer) == b"(a)"
    exchange.advance(b"(A)", NOW + 2)
    assert exchange.result() == "A"
    assert exchange._session.counters.damaged == 2


def test_what_came_instead_is_kept_for_the_message(exchange: Exchange[Word, str]) -> None:
    exchange.start(NOW)
    exchange.advance(b"(Z)x(Y)", NOW + 0.010)
    while not exchange.done:
        exchange.advance(b"", exchange.deadline)
    with pytest.raises(NoReply) as raised:
        exchange.result()
    assert raised.value.heard == (b"(Z)", b"(Y)")
    assert raised.value.damaged == (b"x",)


def test_each_question_has_a_message_of_its_own() -> None:
    def conversation() -> Conversation[Word, tuple[bytes, ...]]:
        yield Ask(Word("a"))
        try:
            yield Ask(Word("b"))
        except NoReply as failure:
            return failure.heard + failure.damaged
        return ()

    exchange = Exchange(conversation(), new_session())
    exchange.start(NOW)
    exchange.advance(b"x(Z)(A)", NOW + 0.010)
    while not exchange.done:
        exchange.advance(b"", exchange.deadline)
    assert exchange.result() == ()


def test_what_is_counted() -> None:
    session = new_session()
    exchange = Exchange(ask("a"), session)
    exchange.start(NOW)
    exchange.advance(b"x(Z)", NOW + 0.010)
    exchange.advance(b"", exchange.deadline)
    exchange.advance(b"(A)(Y)", NOW + 2)
    counters = session.counters
    assert (counters.requests, counters.answers, counters.no_reply) == (2, 1, 1)
    assert (counters.damaged, counters.foreign, counters.echoes) == (1, 2, 0)


def test_strays_between_two_conversations() -> None:
    session = new_session()
    session.drain(b"(Z)", NOW)
    session.drain(b"(Y", NOW + 1)
    assert (session.counters.foreign, session.counters.damaged) == (1, 0)
    session.drain(b"", NOW + 1 + TIMING.silence - 0.001)
    assert session.counters.damaged == 0
    session.drain(b"", NOW + 1 + TIMING.silence + 0.001)
    assert session.counters.damaged == 1
    session.drain(b"(X)", NOW + 2, damaged=True)
    assert (session.counters.foreign, session.counters.damaged) == (1, 2)


# -- how a conversation ends -----------------------------------------------------------------


def test_a_conversation_without_a_step() -> None:
    exchange = Exchange(ask(), new_session())
    assert exchange.start(NOW) == b""
    assert exchange.done
    assert exchange.result() == ""


def test_what_a_conversation_raises_is_raised() -> None:
    def conversation() -> Conversation[Word, str]:
        answer = yield Ask(Word("a"))
        raise UsageError(answer.content)

    exchange = Exchange(conversation(), new_session())
    exchange.start(NOW)
    exchange.advance(b"(A)", NOW + 0.010)
    assert exchange.done
    with pytest.raises(UsageError, match="A"):
        exchange.result()


def test_bytes_behind_the_end_are_strays(exchange: Exchange[Word, str]) -> None:
    exchange.start(NOW)
    exchange.advance(b"(A)", NOW + 0.010)
    assert exchange.advance(b"(A)", NOW + 0.011) == b""
    assert exchange.result() == "A"
    assert exchange._session.counters.foreign == 1


def test_who_waits_no_longer_closes_the_conversation() -> None:
    closed = []

    def conversation() -> Iterator[Any]:
        try:
            yield Ask(Word("a"))
        finally:
            closed.append("closed")

    exchange: Exchange[Word, str] = Exchange(conversation(), new_session())  # type: ignore[arg-type]
    exchange.start(NOW)
    exchange.abandon(NOW + 0.010)
    assert exchange.done
    assert closed == ["closed"]


def test_an_end_that_was_abandoned_is_an_end() -> None:
    exchange = Exchange(ask("a"), new_session())
    exchange.start(NOW)
    exchange.advance(b"(A)", NOW + 0.010)
    exchange.abandon(NOW + 0.020)
    assert exchange.result() == "A"


# -- sequence numbers ------------------------------------------------------------------------


def slink3_session() -> Session[Frame]:
    return Session(decoder(), replace(TIMING, answer=0.2))


def status_word(address: int = 1) -> Conversation[Frame, Frame]:
    return (yield Ask(Frame(address, code=0x23), repeatable=True))


def number_of(sent: bytes) -> int:
    return Frame.decode(sent).control >> 2


def test_each_attempt_and_each_request_takes_the_next_number() -> None:
    session = slink3_session()
    numbers, now = [], NOW
    for _ in range(6):
        exchange = Exchange(status_word(), session)
        sent = exchange.start(now)
        while not exchange.done:
            numbers += [number_of(sent)] if sent else []
            now = exchange.deadline
            sent = exchange.advance(b"", now)
    assert numbers == [*range(16), 0, 1]


def test_each_address_has_numbers_of_its_own() -> None:
    session = slink3_session()
    for address in (1, 2, 1):
        exchange = Exchange(status_word(address), session)
        sent = exchange.start(NOW + session.quiet_from)
        exchange.abandon(NOW)
        session.quiet_from = 0.0
    assert Frame.decode(sent).control >> 2 == 1


def test_a_number_that_was_abandoned_rests() -> None:
    session = slink3_session()
    exchange = Exchange(status_word(), session)
    assert number_of(exchange.start(NOW)) == 0
    exchange.abandon(NOW)
    numbers = session.numbers(Frame(1))
    assert [numbers.take() for _ in range(16)] == [*range(1, 16), 1]
    assert numbers.free_at(NOW + 1.499) == NOW + 1.499
    assert 0 in numbers.resting
    assert numbers.free_at(NOW + 1.5) == NOW + 1.5
    assert numbers.resting == {}


def test_a_number_that_was_answered_does_not_rest() -> None:
    session = slink3_session()
    exchange = Exchange(status_word(), session)
    exchange.start(NOW)
    exchange.advance(Frame(1, order=1, data=b"\x37\x02").encode(), NOW + 0.010)
    assert exchange.done
    assert session.numbers(Frame(1)).resting == {}


def test_without_a_free_number_the_line_waits_for_one() -> None:
    session = slink3_session()
    numbers = session.numbers(Frame(1))
    for number in range(16):
        numbers.resting[number] = NOW + 1.0 + number / 100
    exchange = Exchange(status_word(), session)
    assert exchange.start(NOW) == b""
    assert exchange.deadline == NOW + 1.0
    assert exchange.advance(b"", NOW + 0.5) == b""
    assert not exchange.done
    assert number_of(exchange.advance(b"", NOW + 1.0)) == 0


def test_a_protocol_without_numbers_has_none_that_rest(exchange: Exchange[Word, str]) -> None:
    exchange.start(NOW)
    exchange.advance(b"", exchange.deadline)
    assert exchange._session.numbers(Word("a")).resting == {}
