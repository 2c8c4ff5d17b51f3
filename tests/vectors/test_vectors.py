"""The byte-exact examples of each protocol, both ways. A new protocol adds its file and a line here."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from multidrop.events import Damaged, FrameReceived
from multidrop.protocols import PROTOCOLS, slink3


def slink3_frame(vector: dict[str, Any]) -> slink3.Frame:
    return slink3.Frame(
        vector["address"],
        vector["control"],
        vector["order"],
        vector["code"],
        bytes.fromhex(vector["data"]),
    )


FRAMES: dict[str, Callable[[dict[str, Any]], Any]] = {"slink3": slink3_frame}
NOISE = {"slink3": bytes.fromhex("00 FF 80 55")}  # begins no frame

VECTORS = [
    (path.stem, vector)
    for path in sorted(Path(__file__).parent.glob("*.toml"))
    if path.stem in FRAMES
    for vector in tomllib.loads(path.read_text(encoding="utf-8"))["vector"]
]


@pytest.fixture(params=VECTORS, ids=[f"{name}: {vector['name']}" for name, vector in VECTORS])
def case(request: pytest.FixtureRequest) -> tuple[str, Any, bytes]:
    """Protocol, frame and bytes of one vector."""
    protocol, vector = request.param
    return protocol, FRAMES[protocol](vector), bytes.fromhex(vector["bytes"])


def test_encode(case: tuple[str, Any, bytes]) -> None:
    _, frame, raw = case
    assert frame.encode() == raw


def test_decode(case: tuple[str, Any, bytes]) -> None:
    _, frame, raw = case
    assert type(frame).decode(raw) == frame


def test_received_whole(case: tuple[str, Any, bytes]) -> None:
    protocol, frame, raw = case
    decoder = PROTOCOLS[protocol].line.decoder()
    assert decoder.receive_data(raw) == [FrameReceived(frame, raw)]
    assert not decoder.pending


def test_received_byte_by_byte(case: tuple[str, Any, bytes]) -> None:
    protocol, frame, raw = case
    decoder = PROTOCOLS[protocol].line.decoder()
    for byte in raw[:-1]:
        assert decoder.receive_data(bytes([byte])) == []
    assert decoder.receive_data(raw[-1:]) == [FrameReceived(frame, raw)]
    assert decoder.silence() == []


def test_received_with_noise_before_it(case: tuple[str, Any, bytes]) -> None:
    protocol, frame, raw = case
    noise = NOISE[protocol]
    damage, received = PROTOCOLS[protocol].line.decoder().receive_data(noise + raw)
    assert isinstance(damage, Damaged)
    assert damage.raw == noise
    assert received == FrameReceived(frame, raw)


def test_received_twice(case: tuple[str, Any, bytes]) -> None:
    protocol, frame, raw = case
    events = PROTOCOLS[protocol].line.decoder().receive_data(raw + raw)
    assert events == [FrameReceived(frame, raw)] * 2


def test_a_flipped_bit_is_seen(case: tuple[str, Any, bytes]) -> None:
    """Nor is a frame with a byte lost taken for one; only a wrong LENGTH may find a short one in it."""
    protocol, _, raw = case
    flipped = [
        raw[:at] + bytes([raw[at] ^ 1 << bit]) + raw[at + 1 :]
        for at in range(len(raw))
        for bit in range(8)
    ]
    lost = [raw[:at] + raw[at + 1 :] for at in range(len(raw))]
    for wrong in flipped + lost:
        decoder = PROTOCOLS[protocol].line.decoder()
        events = decoder.receive_data(wrong) + decoder.silence()
        assert b"".join(event.raw for event in events) == wrong
        assert not any(type(event) is FrameReceived and event.raw == wrong for event in events)
