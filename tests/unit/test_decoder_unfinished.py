"""Held-back damage is not waited for; the beginning of a frame is."""

from __future__ import annotations

from multidrop.exchange import Exchange
from multidrop.protocols import datalink, ultra3000
from multidrop.protocols.slink3 import LINE, Frame, Master, decoder
from multidrop.session import Session


def test_damage_alone_is_pending_and_not_unfinished() -> None:
    receiver = decoder()
    receiver.receive_data(b"\x55\x55")
    assert (receiver.pending, receiver.unfinished) == (True, False)


def test_the_beginning_of_a_frame_behind_damage_is_unfinished() -> None:
    receiver = decoder()
    receiver.receive_data(b"\x55\x01\x00")
    assert (receiver.pending, receiver.unfinished) == (True, True)


def test_nothing_is_neither() -> None:
    receiver = decoder()
    receiver.receive_data(Frame(1).encode())
    assert (receiver.pending, receiver.unfinished) == (False, False)


def test_noise_does_not_put_off_the_end_of_an_attempt() -> None:
    session = Session(decoder(), LINE.with_options(timeout=0.1, attempts=1).timing(network=True))
    exchange = Exchange(Master(1).status_word(), session)
    exchange.start(10.0)
    end = exchange.deadline
    exchange.advance(b"\x55", end - 0.001)
    assert exchange.deadline == end
    exchange.advance(b"", end)
    assert exchange.done


def test_the_shortest_answer_is_awaited_and_then_what_its_length_says() -> None:
    receiver = decoder()
    assert receiver.missing == 8
    receiver.receive_data(b"\x55")  # damage is no part of it
    assert receiver.missing == 8
    receiver.receive_data(b"\x01\x02\x00")
    assert receiver.missing == 5
    receiver.receive_data(b"\x0d")
    assert receiver.missing == 9


def test_a_response_is_awaited_as_long_as_its_num_says() -> None:
    for stuffing in (True, False):
        receiver = datalink.decoder(stuffing)
        assert receiver.missing == 6
        receiver.receive_data(b"\x7e\x23\x03")
        assert receiver.missing == 6
        receiver.receive_data(b"\x34\x12\x7e\x00")  # one byte where it is stuffed
        assert receiver.missing == (3 if stuffing else 2)


def test_a_reply_of_a_servo_ends_where_its_end_is() -> None:
    receiver = ultra3000.decoder()
    assert receiver.missing == 10
    receiver.receive_data(b":00")
    assert receiver.missing == 7
    receiver.receive_data(b"06D0000000")
    assert receiver.missing == 1


def test_an_exchange_wants_an_answer_only_while_it_waits_for_one() -> None:
    session = Session(decoder(), LINE.timing(network=True))
    session.quiet_from = 10.0
    exchange = Exchange(Master(1).status_word(), session)
    exchange.start(9.0)
    assert exchange.wants == 1  # the line rests
    exchange.advance(b"", 10.0)
    assert exchange.wants == 8
    exchange.advance(b"\x01\x01\x00\x0a", 10.1)
    assert exchange.wants == 6
