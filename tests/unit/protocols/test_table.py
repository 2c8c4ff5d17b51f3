"""The protocols as everything above them sees them."""

from __future__ import annotations

import pytest

from multidrop.protocols import PROTOCOLS, slink3


def test_the_table() -> None:
    assert "slink3" in list(PROTOCOLS)
    assert len(PROTOCOLS) == len(list(PROTOCOLS))
    with pytest.raises(KeyError):
        PROTOCOLS["modbus"]


@pytest.mark.parametrize("name", PROTOCOLS)
def test_every_protocol_has_its_own_name_and_line(name: str) -> None:
    protocol = PROTOCOLS[name]
    assert protocol.name == name
    assert protocol.line.decoder().receive_data(b"") == []


def test_slink3() -> None:
    protocol = PROTOCOLS["slink3"]
    question, answer = slink3.Frame(1, code=0x23), slink3.Frame(1, order=1)
    assert protocol.from_master(question)
    assert not protocol.from_master(answer)
    assert protocol.describe(question) == "1 #0 status word"
    assert protocol.line is slink3.LINE
    assert set(protocol.options) == {"broadcast"}


@pytest.mark.parametrize(
    ("name", "raw", "text"),
    [
        ("slink3", b"\x01\x0a:", "01 0A 3A"),
        ("datalink", b"\x7e\x00", "7E 00"),
        ("ultra3000", b":000000E0\r", r":000000E0\r"),
        ("ultra3000", b"\x00 \\\xb0~\x7f\n", r"\x00 \\\xB0~\x7F\x0A"),
    ],
)
def test_how_bytes_are_shown(name: str, raw: bytes, text: str) -> None:
    assert PROTOCOLS[name].shown(raw) == text
