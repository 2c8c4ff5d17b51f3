"""Which protocol a line speaks."""

from __future__ import annotations

import random

import pytest

from multidrop.protocols import PROTOCOLS, datalink, slink3, ultra3000
from multidrop.tools.captures.telling import MOST_KEPT, Telling
from multidrop.tools.ears import Piece

TALK = {
    "slink3": [
        slink3.Frame(1, 4, 0, 0x26, bytes.fromhex("00 7E 80")).encode(),  # an Acknowledge in it
        slink3.Frame(1, 4, 1, 0, bytes.fromhex("03 7E 80 7D 00")).encode(),
    ],
    "datalink": [
        datalink.Frame(0xE0, 1, 0x0101, 9).encode(),
        datalink.Frame(0x20, 1, 0x0101, 9, bytes(range(9))).encode(),
    ],
    "ultra3000": [
        ultra3000.Frame(1, 0x06D).encode(),
        ultra3000.Frame(1, 0x06D, 0, "0000000A").encode(),
    ],
}


@pytest.mark.parametrize("name", TALK)
def test_each_protocol_is_told_by_its_frames(name: str) -> None:
    telling = Telling(PROTOCOLS)
    for frame in TALK[name]:
        telling.receive(Piece(frame, 0.0, False))
    assert telling.protocol is None
    for at in range(len(TALK[name][0])):
        assert telling.protocol is None
        telling.receive(Piece(TALK[name][0][at : at + 1], 0.0, False))
    assert telling.protocol is not None
    assert telling.protocol.name == name
    assert b"".join(piece.data for piece in telling.finish()) == b"".join(
        [*TALK[name], TALK[name][0]]
    )


def test_garbage_is_no_protocol_and_is_given_up_in_order() -> None:
    telling = Telling(PROTOCOLS)
    noise = random.Random(3).randbytes(10 * MOST_KEPT)
    given_up = []
    for at in range(0, len(noise), 16):
        given_up += telling.receive(Piece(noise[at : at + 16], 0.0, False))
        assert sum(len(piece.data) for piece in telling.kept) <= MOST_KEPT
    assert telling.protocol is None
    assert telling.heard == len(noise)
    given_up += telling.finish()
    assert b"".join(piece.data for piece in given_up) == noise


def test_damage_alone_decides_nothing_and_frames_behind_it_do() -> None:
    telling = Telling(PROTOCOLS)
    telling.receive(Piece(bytes(5000), 0.0, False))
    telling.silence()
    telling.receive(Piece(b"\x01", 0.0, True))
    for frame in TALK["slink3"] * 2:
        telling.receive(Piece(frame, 1.0, False))
    assert telling.protocol is not None
    assert telling.protocol.name == "slink3"


def test_frames_between_much_garbage_are_chance() -> None:
    telling = Telling(PROTOCOLS)
    for frame in TALK["slink3"] * 2:
        telling.receive(Piece(frame + b"\x55" * 30, 0.0, False))
        telling.silence()
    assert telling.protocol is None


def test_frames_without_a_checksum_prove_nothing() -> None:
    telling = Telling(PROTOCOLS)
    for _ in range(50):
        telling.receive(Piece(datalink.Frame(0x80, 1).encode(), 0.0, False))
    assert telling.protocol is None
