"""What holds for every protocol, whatever is on the line."""

from __future__ import annotations

import copy
import re
from contextlib import suppress
from typing import Any

import pytest
from choices import Choices, tried_with
from strategies import ROWS, STREAM, Row, cut, sizes, stream

from multidrop import errors
from multidrop.events import FrameReceived
from multidrop.exchange import Exchange
from multidrop.session import Session

every_protocol = pytest.mark.parametrize("row", ROWS, ids=str)


def events_of(row: Row, pieces: list[bytes]) -> list[Any]:
    decoder = row.decoder()
    events = [event for piece in pieces for event in decoder.receive_data(piece)]
    return events + decoder.silence()


@every_protocol
@tried_with(64)
def test_decode_undoes_encode(row: Row, choices: Choices) -> None:
    frame = row.frame(choices)
    assert row.decode(frame.encode()) == frame


@every_protocol
@tried_with(STREAM)
def test_chunking_changes_no_event(row: Row, choices: Choices) -> None:
    pieces = cut(raw := stream(row, choices), sizes(choices))
    assert events_of(row, pieces) == events_of(row, [raw])


@every_protocol
@tried_with(STREAM)
def test_every_byte_comes_out_once(row: Row, choices: Choices) -> None:
    pieces = cut(raw := stream(row, choices), sizes(choices))
    assert b"".join(event.raw for event in events_of(row, pieces)) == raw


@every_protocol
@tried_with(STREAM)
def test_after_silence_the_next_frame_is_found(row: Row, choices: Choices) -> None:
    frame, decoder = row.frame(choices), row.decoder()
    decoder.receive_data(stream(row, choices))
    decoder.silence()
    assert not decoder.pending
    raw = frame.encode()
    assert [*decoder.receive_data(raw), *decoder.silence()] == [FrameReceived(frame, raw)]


@every_protocol
@tried_with(128)
def test_never_is_more_awaited_than_a_frame_still_lacks(row: Row, choices: Choices) -> None:
    decoder = row.decoder()
    raw = row.frame(choices).encode()
    decoder.receive_data(bytes(choices.times(5, lambda choices: choices.of(row.harmless))))
    for at in range(len(raw)):
        assert 1 <= decoder.missing <= len(raw) - at
        decoder.receive_data(raw[at : at + 1])


@every_protocol
@tried_with(128)
def test_bytes_that_begin_no_frame_cost_no_frame(row: Row, choices: Choices) -> None:
    def noise(choices: Choices) -> bytes:
        return bytes(choices.times(5, lambda choices: choices.of(row.harmless)))

    pairs = choices.times(4, lambda choices: (noise(choices), row.frame(choices)))
    stream = b"".join(before + frame.encode() for before, frame in pairs) + noise(choices)
    found = [event.frame for event in events_of(row, [stream]) if type(event) is FrameReceived]
    assert found == [frame for _, frame in pairs]


@every_protocol
@tried_with(512)
def test_no_input_raises_in_a_slave(row: Row, choices: Choices) -> None:
    slave, decoder = row.slave(choices), row.decoder()
    for piece in [*cut(stream(row, choices), sizes(choices)), b""]:
        for request in slave.receive_data(piece) if piece else slave.silence():
            reply = request.settled or row.reply(choices)
            answer = slave.answer(request, reply)
            events = [*decoder.receive_data(answer), *decoder.silence()]
            assert [type(event) for event in events] == [FrameReceived] * bool(answer)


@every_protocol
@tried_with(512)
def test_no_input_raises_in_a_master(row: Row, choices: Choices) -> None:
    """A line that answers well, badly, late or not at all; the one after it is served as ever."""
    now = 10.0
    session = new_session(row, choices.of((None, False, True)))
    slave, reply = row.slave(choices), row.reply(choices)
    last = row.conversation(choices)
    exchange = Exchange(row.conversation(choices)(), session)
    sent = exchange.start(now)
    for _ in range(choices.to(8)):
        if exchange.done:
            break
        heard = _heard(row, choices, answers(slave, sent, reply), sent)
        now += choices.word() / (1 << 16) * (2.0 if choices.flag() else 0.05)
        sent = exchange.advance(heard, now, damaged=bool(heard) and choices.to(3) == 3)
    now = let_end(exchange, now)
    with suppress(errors.Error):
        exchange.result()
    assert served(session, last(), slave, reply, now + 2) == served(
        new_session(row, session.echo), last(), slave, reply, now + 2
    )


def new_session(row: Row, echo: bool | None) -> Session[Any]:
    return Session(row.decoder(), row.line.timing(network=False), echo=echo)


def answers(slave: Any, sent: bytes, reply: Any) -> bytes:
    """What a slave that always says `reply` answers."""
    return b"".join(
        slave.answer(request, request.settled or reply) for request in slave.receive_data(sent)
    )


def let_end(exchange: Exchange[Any, Any], now: float) -> float:
    """Nothing more arrives: it must come to its end by itself; returns when."""
    steps = 0
    while not exchange.done:
        now = max(now, exchange.deadline)
        exchange.advance(b"", now)
        steps += 1
        assert steps < 1000, "it goes on for ever"
    return now


def served(
    session: Session[Any], conversation: Any, slave: Any, reply: Any, now: float
) -> tuple[Any, str]:
    """Result or error of a conversation on a faultless line, without the bytes in its messages."""
    slave = copy.deepcopy(slave)
    slave.silence()
    session.drain(b"", now)
    exchange = Exchange(conversation, session)
    heard = answers(slave, exchange.start(now), reply)
    while not exchange.done:
        now = now + 0.3 if heard else max(now, exchange.deadline)
        heard = answers(slave, exchange.advance(heard, now), reply)
    try:
        found = exchange.result()
        said = repr(found)
    except errors.Error as error:
        found, said = error, repr(error) + str(error)
    return type(found), re.sub(r"\b([0-9A-F]{2} )*[0-9A-F]{2}\b", "", said)


def _heard(row: Row, choices: Choices, answer: bytes, sent: bytes) -> bytes:
    """Bytes after a request: a slave's answer, as it is or with something wrong, or anything."""
    what = choices.of(HEARD)
    if what == "noise":
        return stream(row, choices)
    if what == "behind noise":
        return stream(row, choices) + answer
    if what == "echo":
        return sent + answer
    return {"nothing": b"", "answer": answer, "half": answer[: len(answer) // 2]}[what]


HEARD = ("answer", "nothing", "echo", "half", "noise", "noise", "behind noise", "behind noise")
