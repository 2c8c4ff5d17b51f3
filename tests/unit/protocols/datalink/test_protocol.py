"""Datalink as everything above sees it."""

from __future__ import annotations

import pytest

from multidrop.device import ProtocolModule
from multidrop.errors import UsageError
from multidrop.events import FrameReceived
from multidrop.profile import Profile
from multidrop.protocols import PROTOCOLS
from multidrop.protocols.datalink import LINE, Command, Frame
from multidrop.protocols.datalink.protocol import Datalink

DATALINK: ProtocolModule = PROTOCOLS["datalink"]


def test_it_is_in_the_table() -> None:
    assert DATALINK.name == "datalink"
    assert DATALINK.line is LINE
    assert set(DATALINK.options) == {"stuffing", "settle"}
    assert DATALINK.device(3, Profile("datalink", "datalink"), {}).address == 3
    assert DATALINK.describe(Frame(Command.ACKNOWLEDGE, 3)) == "3 acknowledge"


def test_times_of_the_line() -> None:
    assert str(LINE.format) == "8E1"
    assert LINE.baud == 9600
    serial, network = LINE.timing(network=False), LINE.timing(network=True)
    assert serial.answer == pytest.approx(0.100)
    assert network.answer == pytest.approx(0.400)
    assert serial.silence == pytest.approx(11 / 9600 + 0.100 + 0.090)
    assert network.silence == pytest.approx(11 / 9600 + 0.100 + 0.390)


def test_who_speaks() -> None:
    assert DATALINK.from_master(Frame(Command.INTERROGATE, 3, 0, 1))
    assert DATALINK.from_master(Frame(Command.ACKNOWLEDGE, 3))
    assert not DATALINK.from_master(Frame(Command.RESPONSE, 3))


def test_decoders_with_and_without_stuffing() -> None:
    raw = bytes.fromhex("7E E3 01 7E 02 64")
    question = Frame(Command.INTERROGATE, 3, 638, 1)
    assert DATALINK.decoder().receive_data(raw) != [FrameReceived(question, raw)]
    plain = Datalink.line_for({"stuffing": "off"})
    assert plain.decoder().receive_data(raw) == [FrameReceived(question, raw)]
    assert Datalink.line_for({"stuffing": "on", "settle": "2"}) is LINE
    with pytest.raises(UsageError, match="stuffing='maybe'"):
        Datalink.line_for({"stuffing": "maybe"})


def test_there_is_no_broadcast() -> None:
    with pytest.raises(UsageError, match="Datalink has no broadcast"):
        DATALINK.prepare_broadcast(Profile("datalink", "datalink"), [("C101", "5")], [0, 1], {})
