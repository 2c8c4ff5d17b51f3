"""Held-back damage is not waited for; the beginning of a frame is."""

from __future__ import annotations

from multidrop.exchange import Exchange
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
