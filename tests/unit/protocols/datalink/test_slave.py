"""The instrument's side: what it answers, what it keeps silent about, and pending changes."""

from __future__ import annotations

import pytest

from multidrop.errors import UsageError
from multidrop.protocols.datalink import Command, Frame, Reply, Slave
from multidrop.protocols.datalink.slave import Request


def received(slave: Slave, *messages: str) -> list[Request]:
    return slave.receive_data(bytes.fromhex("".join(messages)))


CHANGE = "7E A3 02 00 10 08 0C C9"
ECHO = "7E 23 02 00 10 08 0C 49"
ACKNOWLEDGE = "7E 83"


@pytest.mark.parametrize("address", [-1, 32])
def test_addresses(address: int) -> None:
    with pytest.raises(UsageError, match=r"an instrument has 0\.\.31"):
        Slave(address)


def test_an_interrogate_is_answered_with_memory() -> None:
    slave = Slave(3)
    (request,) = received(slave, "7E E3 09 00 10 FC")
    assert (request.memory_address, request.count) == (0x1000, 9)
    assert request.settled is None
    assert not request.acknowledged
    answer = slave.answer(request, Reply(bytes(range(9))))
    assert answer == Frame(Command.RESPONSE, 3, 0x1000, 9, bytes(range(9))).encode()


def test_a_change_is_echoed_and_carried_out_when_acknowledged() -> None:
    slave = Slave(3)
    (echo,) = received(slave, CHANGE)
    assert echo.settled == Reply(b"\x08\x0c")
    assert not echo.acknowledged
    assert slave.answer(echo, echo.settled) == bytes.fromhex(ECHO)
    assert slave.pending == echo.frame
    (request,) = received(slave, ACKNOWLEDGE)
    assert request.acknowledged
    assert (request.memory_address, request.count) == (0x1000, 2)
    assert request.changed(b"ab") == b"\x08\x0c"
    assert slave.answer(request, Reply(b"ab")) == b""
    assert slave.pending is None


def test_change_bits_is_echoed_with_its_pairs() -> None:
    slave = Slave(3)
    (echo,) = received(slave, "7E C3 04 01 05 BF 40 FE 00 CA")
    assert echo.settled is not None
    assert slave.answer(echo, echo.settled) == bytes.fromhex("7E 23 04 01 05 BF 40 FE 00 2A")
    (request,) = received(slave, ACKNOWLEDGE)
    assert (request.memory_address, request.count) == (0x501, 2)
    assert request.changed(b"\x01\x01") == b"\x41\x00"


def test_an_acknowledge_acts_once() -> None:
    slave = Slave(3)
    assert received(slave, ACKNOWLEDGE) == []
    assert len(received(slave, CHANGE, ACKNOWLEDGE, ACKNOWLEDGE)) == 2


@pytest.mark.parametrize(
    ("between", "carried_out"),
    [
        ("7E E3 09 00 10 FC", []),  # another command drops it
        ("7E A3 01 00 10 55 09", [b"\x55"]),  # another change takes its place
        ("7E E4 09 00 10 FD", [b"\x08\x0c"]),  # a message to somebody else
        ("7E E3 00 00 10 F3", [b"\x08\x0c"]),  # an illegal message is none
        ("7E E3 09 00 10 FD", [b"\x08\x0c"]),  # nor is a damaged one
        ("7E 24 01 00 10 77 AC", [b"\x08\x0c"]),  # somebody else's answer
    ],
)
def test_what_drops_a_pending_change(between: str, carried_out: list[bytes]) -> None:
    found = received(Slave(3), CHANGE, between, ACKNOWLEDGE)
    assert [request.changed(b"??") for request in found if request.acknowledged] == carried_out


def test_an_overdue_acknowledge_drops_it_too() -> None:
    slave = Slave(3)
    received(slave, CHANGE)
    slave.acknowledge_overdue()
    assert received(slave, ACKNOWLEDGE) == []


@pytest.mark.parametrize(
    "message",
    [
        "7E E4 09 00 10 FD",  # another address
        "7E E3 09 00 10 FD",  # a wrong LRC
        "7E E3 21 00 10 14",  # NUM 33
        "7E E3 00 00 10 F3",  # NUM 0
        "7E A3 00 00 10 B3",
        "7E C3 00 01 05 C9",
        "7E C3 01 01 05 BF 89",  # half a pair
        "7E E3 02 FF FF E3",  # behind the end of memory
        "7E A3 02 FF FF 01 02 A6",
        "7E 23 02 00 10 08 0C 49",  # its own address, but a Response
        "7E 43 02 00 10 08 0C 69",  # no command
        "7E 83",  # nothing pending
    ],
)
def test_silence(message: str) -> None:
    slave = Slave(3)
    assert received(slave, message) == []
    assert slave.silence() == []
    assert slave.pending is None


def test_change_bits_at_the_end_of_memory() -> None:
    (request,) = received(Slave(3), "7E C3 02 FF FF BF 40 C2")
    assert (request.memory_address, request.count) == (0xFFFF, 1)


def test_a_message_that_is_cut_short_is_forgotten_in_silence() -> None:
    slave = Slave(3)
    assert received(slave, "7E A3 20 00 10") == []
    assert slave.silence() == []
    assert len(received(slave, "7E E3 09 00 10 FC")) == 1


def test_without_stuffing() -> None:
    slave = Slave(3, stuffing=False)
    (request,) = received(slave, "7E E3 01 7E 02 64")
    assert slave.answer(request, Reply(b"\x7e")) == bytes.fromhex("7E 23 01 7E 02 7E 22")
