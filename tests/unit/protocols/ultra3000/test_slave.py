"""The drive's side: what gets an answer, what a profile settles, and what gets silence."""

from __future__ import annotations

import pytest

from multidrop.catalog import load_profile
from multidrop.errors import UsageError
from multidrop.protocols.ultra3000 import Frame, Refusal, Reply, Request, Slave

PROFILE = load_profile("ultra3000")


def heard(frame: Frame, slave: Slave | None = None) -> list[Request]:
    return (slave or Slave(0, profile=PROFILE)).receive_data(frame.encode())


def test_a_request_and_its_answer() -> None:
    slave = Slave(42)
    (request,) = heard(Frame(42, 0x011), slave)
    assert (request.parameter, request.function, request.value) == (0x011, 0, "")
    assert request.settled is None
    assert slave.answer(request, Reply(data="0200")) == Frame(42, 0x011, 0, "0200").encode()


def test_a_write_is_answered_without_data() -> None:
    slave = Slave(0)
    (request,) = heard(Frame(0, 0x06D, 1, "000186A0"), slave)
    assert request.value == "000186A0"
    assert slave.answer(request, Reply(data="000186A0")) == Frame(0, 0x06D, 1).encode()


def test_a_refusal() -> None:
    slave = Slave(0)
    (request,) = heard(Frame(0, 0x043, 1, "0A"), slave)
    assert slave.answer(request, Reply(Refusal.ABOVE_MAXIMUM)) == b":008431056B\r"


@pytest.mark.parametrize(
    "raw",
    [
        b":000730D7\r",  # wrong checksum
        b":000730d6\r",  # lower case
        b":000730D6",  # no carriage return
        Frame(1, 0x073).encode(),  # another drive
        Frame(0, 0x873, 0, "08").encode(),  # a refusal of somebody's
        Frame(255, 0x073).encode(),  # a read of everybody
    ],
)
def test_silence(raw: bytes) -> None:
    slave = Slave(0)
    assert slave.receive_data(raw) == []
    assert slave.silence() == []


def test_a_broadcast_is_carried_out_and_not_answered() -> None:
    slave = Slave(3, profile=PROFILE)
    (request,) = heard(Frame(255, 0x06B, 1, "00"), slave)
    assert request.broadcast
    assert slave.answer(request, Reply()) == b""
    assert heard(Frame(255, 0x06B, 1, "02"), slave) == []
    slave.broadcast = 0x80
    assert heard(Frame(255, 0x06B, 1, "00"), slave) == []
    assert len(heard(Frame(0x80, 0x06B, 1, "00"), slave)) == 1


def test_without_a_profile_only_reserved_functions_are_refused() -> None:
    slave = Slave(0)
    (request,) = heard(Frame(0, 0x05B, 0xC, "07"), slave)
    assert request.settled == Reply(Refusal.INVALID_FUNCTION)
    (request,) = heard(Frame(0, 0x05B, 0, "07"), slave)
    assert (request.element, request.value, request.settled) == (None, "07", None)


@pytest.mark.parametrize(
    ("frame", "element", "value"),
    [
        (Frame(0, 0x05B, 0, "07"), 7, ""),
        (Frame(0, 0x05B, 1, "07000186A0"), 7, "000186A0"),
        (Frame(0, 0x05B, 7, "03"), 3, ""),
        (Frame(0, 0x05B, 4), None, ""),
        (Frame(0, 0x05B, 0xB), None, ""),
        (Frame(0, 0x06F, 1), None, ""),
        (Frame(0, 0x118, 1, "FF38"), None, "FF38"),
        (Frame(0, 0x118, 1, "FFFFFF38"), None, "FFFFFF38"),
        (Frame(0, 0x006, 1, "20" * 64), None, "20" * 64),
        (Frame(0, 0x044, 1, "0101"), None, "0101"),
    ],
)
def test_a_request_that_the_profile_allows(frame: Frame, element: int | None, value: str) -> None:
    (request,) = heard(frame)
    assert (request.element, request.value, request.settled) == (element, value, None)


@pytest.mark.parametrize(
    ("frame", "refusal"),
    [
        (Frame(0, 0x7FF), Refusal.INVALID_FUNCTION),
        (Frame(0, 0x073, 1, "00000000"), Refusal.INVALID_FUNCTION),
        (Frame(0, 0x06F), Refusal.INVALID_FUNCTION),
        (Frame(0, 0x011, 0xC), Refusal.INVALID_FUNCTION),
        (Frame(0, 0x05B), Refusal.INVALID_INDEX),
        (Frame(0, 0x05B, 0, "0"), Refusal.INVALID_INDEX),
        (Frame(0, 0x05B, 0, "08"), Refusal.INVALID_INDEX),
        (Frame(0, 0x05B, 1, "0800000000"), Refusal.INVALID_INDEX),
        (Frame(0, 0x011, 0, "00"), Refusal.INVALID_DATA),
        (Frame(0, 0x011, 5, "00"), Refusal.INVALID_DATA),
        (Frame(0, 0x06F, 1, "01"), Refusal.INVALID_DATA),
        (Frame(0, 0x011, 1, "00"), Refusal.INVALID_DATA),
        (Frame(0, 0x011, 1), Refusal.INVALID_DATA),
        (Frame(0, 0x006, 1, "20"), Refusal.INVALID_DATA),
        (Frame(0, 0x011, 1, "1000"), Refusal.ABOVE_MAXIMUM),
        (Frame(0, 0x043, 1, "0A"), Refusal.ABOVE_MAXIMUM),
        (Frame(0, 0x039, 1, "0000"), Refusal.BELOW_MINIMUM),
        (Frame(0, 0x06D, 1, "80000000"), Refusal.BELOW_MINIMUM),
        (Frame(0, 0x0DF, 3, "00"), Refusal.BELOW_MINIMUM),
        (Frame(0, 0x041, 1, "03"), Refusal.INVALID_DATA),
        (Frame(0, 0x01A, 1, "000000"), Refusal.INVALID_DATA),
    ],
)
def test_a_request_that_the_profile_refuses(frame: Frame, refusal: Refusal) -> None:
    (request,) = heard(frame)
    assert request.settled == Reply(refusal)


def test_addresses_of_a_drive() -> None:
    with pytest.raises(UsageError, match=r"a drive has 0..253"):
        Slave(254)
