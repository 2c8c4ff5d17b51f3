"""What is true of every protocol's probe."""

from __future__ import annotations

from typing import Any

import pytest

from multidrop.events import FrameReceived
from multidrop.protocols import PROTOCOLS

MASTERS_READS = {"slink3": {0x23, 0x26}, "datalink": {0xE0}, "ultra3000": {0}}


def kind(frame: Any) -> int:
    """Command or function of a frame, by the field that its protocol has for it."""
    fields = frame._asdict()
    return int(fields[{"code", "command", "function"}.intersection(fields).pop()])


@pytest.mark.parametrize("name", PROTOCOLS)
def test_every_address_has_a_probe_that_only_reads(name: str) -> None:
    protocol = PROTOCOLS[name]
    for address in protocol.prober.addresses:
        frame = protocol.prober.probe(address)
        assert frame.address == address
        (event,) = protocol.decoder().receive_data(frame.encode())
        assert isinstance(event, FrameReceived)
        assert protocol.from_master(event.frame)
        assert kind(event.frame) in MASTERS_READS[name]


@pytest.mark.parametrize("name", PROTOCOLS)
def test_an_echo_is_no_answer(name: str) -> None:
    prober = PROTOCOLS[name].prober
    for address in prober.addresses:
        assert not prober.probe(address).answers(prober.probe(address))


@pytest.mark.parametrize("name", PROTOCOLS)
def test_the_usual_settings_stand_first(name: str) -> None:
    protocol = PROTOCOLS[name]
    assert protocol.prober.bauds[0] == protocol.line.baud
    assert protocol.prober.formats[0] == protocol.line.format
    for given in (protocol.prober.bauds, protocol.prober.formats):
        assert len(set(given)) == len(given)


def test_what_is_asked() -> None:
    probes = {name: PROTOCOLS[name].prober.probe(1).encode() for name in PROTOCOLS}
    assert probes["slink3"] == bytes.fromhex("01 01 00 08 00 23 00 2A")
    assert probes["datalink"] == bytes.fromhex("7E E1 01 02 80 64")
    assert probes["ultra3000"] == b":010000DF\r"
    assert [len(PROTOCOLS[name].prober.addresses) for name in PROTOCOLS] == [128, 32, 254]
