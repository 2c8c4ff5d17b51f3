"""A conversation with one attempt for each question."""

from __future__ import annotations

from typing import Any

import pytest

from multidrop.conversation import Ask, Conversation, Learn, Tell, Wait, once
from multidrop.errors import NoReply
from multidrop.exchange import Exchange
from multidrop.protocols import slink3
from multidrop.session import Session

ended: list[str] = []


def talk() -> Conversation[Any, str]:
    """Every kind of step; a question that fails is asked in another way."""
    try:
        first = yield Ask("first", repeatable=True)
        yield Wait(1.0)
        try:
            second = yield Learn("second")
        except NoReply:
            second = yield Ask("again")
        yield Tell("bye", within=0.5)
        return f"{first}{second}"
    finally:
        ended.append("ended")


def test_every_step_and_every_answer_passes() -> None:
    conversation = once(talk())
    assert next(conversation) == Ask("first", repeatable=True, attempts=1)
    assert conversation.send("1") == Wait(1.0)
    assert conversation.send(None) == Learn("second", attempts=1)
    assert conversation.throw(NoReply(1)) == Ask("again", attempts=1)
    assert conversation.send("2") == Tell("bye", within=0.5)
    with pytest.raises(StopIteration) as stop:
        conversation.send(None)
    assert stop.value.value == "12"


def test_what_it_does_not_catch_comes_out() -> None:
    conversation = once(talk())
    next(conversation)
    with pytest.raises(NoReply):
        conversation.throw(NoReply(1))


def test_closing_it_closes_the_other() -> None:
    conversation = once(talk())
    next(conversation)
    ended.clear()
    conversation.close()
    assert ended == ["ended"]


@pytest.mark.parametrize(("converse", "attempts"), [(lambda talk: talk, 3), (once, 1)])
def test_silence_costs_one_time_out(converse: Any, attempts: int) -> None:
    session = Session(slink3.decoder(), slink3.LINE.timing(network=False), echo=False)
    read = slink3.Master(1).read_typed(8236, slink3.Format.SHORT_INT)
    exchange = Exchange(converse(read), session)
    assert exchange.start(0.0)
    while not exchange.done:
        exchange.advance(b"", exchange.deadline)
    with pytest.raises(NoReply) as caught:
        exchange.result()
    assert caught.value.attempts == session.counters.requests == attempts
    assert not exchange.acted


def test_a_step_stays_all_that_it_is_but_for_its_attempts() -> None:
    """One that must rest before it is repeated must so in the next exchange too."""

    def change() -> Conversation[Any, None]:
        yield Ask("change", repeatable=True, rests=True)

    assert next(once(change())) == Ask("change", repeatable=True, attempts=1, rests=True)
