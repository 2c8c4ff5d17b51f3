"""What holds for every protocol, whatever is on the line."""

from __future__ import annotations

import copy
import re
from contextlib import suppress
from functools import cache
from typing import Any

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from hypothesis.strategies import DataObject
from strategies import ROWS, SIZES, Row, cut, streams

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
@given(data=st.data())
def test_decode_undoes_encode(row: Row, data: DataObject) -> None:
    frame = data.draw(row.frames)
    assert row.decode(frame.encode()) == frame


@every_protocol
@given(data=st.data(), sizes=SIZES)
def test_chunking_changes_no_event(row: Row, data: DataObject, sizes: list[int]) -> None:
    stream = data.draw(streams(row))
    assert events_of(row, cut(stream, sizes)) == events_of(row, [stream])


@every_protocol
@given(data=st.data(), sizes=SIZES)
def test_every_byte_comes_out_once(row: Row, data: DataObject, sizes: list[int]) -> None:
    stream = data.draw(streams(row))
    assert b"".join(event.raw for event in events_of(row, cut(stream, sizes))) == stream


@every_protocol
@given(data=st.data())
def test_after_silence_the_next_frame_is_found(row: Row, data: DataObject) -> None:
    decoder = row.decoder()
    decoder.receive_data(data.draw(streams(row)))
    decoder.silence()
    assert not decoder.pending
    frame = data.draw(row.frames)
    raw = frame.encode()
    assert [*decoder.receive_data(raw), *decoder.silence()] == [FrameReceived(frame, raw)]


@every_protocol
@given(data=st.data())
def test_never_is_more_awaited_than_a_frame_still_lacks(row: Row, data: DataObject) -> None:
    decoder = row.decoder()
    raw = data.draw(row.frames).encode()
    assume(len(raw) >= decoder.missing)  # an Acknowledge is shorter, and no answer
    decoder.receive_data(data.draw(harmless(row)[0]))
    for at in range(len(raw)):
        assert 1 <= decoder.missing <= len(raw) - at
        decoder.receive_data(raw[at : at + 1])


@every_protocol
@given(data=st.data())
def test_bytes_that_begin_no_frame_cost_no_frame(row: Row, data: DataObject) -> None:
    noise, some_frames = harmless(row)
    frames = data.draw(some_frames)
    stream = b"".join(data.draw(noise) + frame.encode() for frame in frames) + data.draw(noise)
    found = [event.frame for event in events_of(row, [stream]) if type(event) is FrameReceived]
    assert found == frames


@cache
def harmless(row: Row) -> tuple[st.SearchStrategy[bytes], st.SearchStrategy[list[Any]]]:
    noise = st.lists(st.sampled_from(row.harmless), max_size=5).map(bytes)
    return noise, st.lists(row.frames, max_size=4)


@every_protocol
@given(data=st.data(), sizes=SIZES)
def test_no_input_raises_in_a_slave(row: Row, data: DataObject, sizes: list[int]) -> None:
    slave = data.draw(row.slaves)
    decoder = row.decoder()
    for piece in [*cut(data.draw(streams(row)), sizes), b""]:
        for request in slave.receive_data(piece) if piece else slave.silence():
            reply = request.settled or data.draw(row.replies)
            answer = slave.answer(request, reply)
            events = [*decoder.receive_data(answer), *decoder.silence()]
            assert [type(event) for event in events] == [FrameReceived] * bool(answer)


@every_protocol
@given(data=st.data())
def test_no_input_raises_in_a_master(row: Row, data: DataObject) -> None:
    """A line that answers well, badly, late or not at all; the one after it is served as ever."""
    now = 10.0
    session = new_session(row, data.draw(ECHO))
    slave, reply = data.draw(row.slaves), data.draw(row.replies)
    exchange = Exchange(data.draw(row.conversations)(), session)
    sent = exchange.start(now)
    for _ in range(data.draw(STEPS)):
        if exchange.done:
            break
        heard = _heard(data, row, answers(slave, sent, reply), sent)
        now += data.draw(PAUSE)
        sent = exchange.advance(heard, now, damaged=data.draw(DAMAGED) and bool(heard))
    now = let_end(exchange, now)
    with suppress(errors.Error):
        exchange.result()
    converse = data.draw(row.conversations)
    assert served(session, converse(), slave, reply, now + 2) == served(
        new_session(row, session.echo), converse(), slave, reply, now + 2
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
    except errors.Error as error:
        found = error
    return type(found), re.sub(r"\b([0-9A-F]{2} )*[0-9A-F]{2}\b", "", repr(found) + str(found))


def _heard(data: DataObject, row: Row, answer: bytes, sent: bytes) -> bytes:
    """Bytes after a request: a slave's answer, as it is or with something wrong, or anything."""
    what = data.draw(HEARD)
    if what == "noise":
        return data.draw(streams(row))
    if what == "behind noise":
        return data.draw(streams(row)) + answer
    if what == "echo":
        return sent + answer
    return {"nothing": b"", "answer": answer, "half": answer[: len(answer) // 2]}[what]


ECHO = st.none() | st.booleans()
STEPS = st.integers(0, 8)
PAUSE = st.floats(0, 0.05) | st.floats(0, 2)
DAMAGED = st.booleans()
HEARD = st.sampled_from(
    ["answer", "nothing", "echo", "half", "noise", "noise", "noise", "behind noise", "behind noise"]
)
