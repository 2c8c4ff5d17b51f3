"""The receive loop, with a protocol of three bytes: `(`, anything, `)`."""

from __future__ import annotations

import pytest

from multidrop.decoder import MOST_DAMAGE, Decoder
from multidrop.events import Damaged, FrameReceived


def read_front(buffer: bytes, at: int) -> tuple[str, int] | str | None:
    if buffer[at : at + 1] != b"(":
        return f"no start: {buffer[at]:c}"
    if len(buffer) - at < 3:
        return None
    if buffer[at + 2 : at + 3] != b")":
        return "no end"
    return chr(buffer[at + 1]), 3


@pytest.fixture
def decoder() -> Decoder[str]:
    return Decoder(read_front)


def frame(content: str) -> FrameReceived[str]:
    return FrameReceived(content, f"({content})".encode())


def test_frames_come_out_as_soon_as_they_are_whole(decoder: Decoder[str]) -> None:
    assert decoder.receive_data(b"(a)(b)(") == [frame("a"), frame("b")]
    assert decoder.pending
    assert decoder.receive_data(b"c") == []
    assert decoder.held == 2
    assert decoder.receive_data(b")") == [frame("c")]
    assert not decoder.pending


def test_one_byte_is_dropped_not_the_frame(decoder: Decoder[str]) -> None:
    """A false start must not swallow the real frame behind it."""
    assert decoder.receive_data(b"((a)") == [Damaged(b"(", "no end"), frame("a")]


def test_damage_is_held_back_until_the_next_frame_and_has_its_first_reason(
    decoder: Decoder[str],
) -> None:
    assert decoder.receive_data(b"xy") == []
    assert decoder.pending
    assert decoder.receive_data(b"z(a)") == [Damaged(b"xyz", "no start: x"), frame("a")]
    assert decoder.receive_data(b"u(b)") == [Damaged(b"u", "no start: u"), frame("b")]


def test_silence_ends_what_is_incomplete(decoder: Decoder[str]) -> None:
    assert decoder.silence() == []
    decoder.receive_data(b"(a")
    assert decoder.silence() == [Damaged(b"(a", "cut short")]
    assert not decoder.pending
    assert decoder.receive_data(b"(b)") == [frame("b")]


def test_silence_finds_the_frame_behind_a_false_start(decoder: Decoder[str]) -> None:
    long: Decoder[str] = Decoder(
        lambda buffer, at: None if buffer[at] == 0x5B else read_front(buffer, at)
    )
    assert long.receive_data(b"[(a)x") == []
    assert long.silence() == [Damaged(b"[", "cut short"), frame("a"), Damaged(b"x", "no start: x")]
    long.receive_data(b"[(b)")
    assert long.silence() == [Damaged(b"[", "cut short"), frame("b")]


def test_damage_that_is_held_back_is_pending_and_not_unfinished(decoder: Decoder[str]) -> None:
    assert (decoder.pending, decoder.unfinished) == (False, False)
    decoder.receive_data(b"x")
    assert (decoder.pending, decoder.unfinished) == (True, False)
    decoder.receive_data(b"(")
    assert (decoder.pending, decoder.unfinished) == (True, True)
    decoder.receive_data(b"a)")
    assert (decoder.pending, decoder.unfinished) == (False, False)


def test_bytes_that_the_port_marked_as_wrong_are_damage(decoder: Decoder[str]) -> None:
    assert decoder.line_error(b"(") == [Damaged(b"(", "parity or framing error")]
    decoder.receive_data(b"(a")
    assert decoder.line_error(b")") == [
        Damaged(b"(a", "cut short"),
        Damaged(b")", "parity or framing error"),
    ]
    assert decoder.receive_data(b"(b)") == [frame("b")]


@pytest.mark.parametrize("chunk", [1, 7, 1000, 5000])
def test_a_babbling_line_costs_no_memory(decoder: Decoder[str], chunk: int) -> None:
    """Damage comes out in pieces of a fixed size, however it was cut on the way in."""
    events = []
    for _ in range(5000 // chunk):
        events += decoder.receive_data(b"x" * chunk)
        assert len(decoder._buffer) < MOST_DAMAGE
    events += decoder.silence()
    sizes = [len(event.raw) for event in events]
    assert sizes == [MOST_DAMAGE] * (sum(sizes) // MOST_DAMAGE) + [sum(sizes) % MOST_DAMAGE]
    assert sum(sizes) == 5000 // chunk * chunk
    assert {event.reason for event in events if isinstance(event, Damaged)} == {"no start: x"}


def test_a_new_piece_of_damage_has_its_own_reason(decoder: Decoder[str]) -> None:
    events = decoder.receive_data(b"x" * MOST_DAMAGE + b"y") + decoder.silence()
    assert events == [Damaged(b"x" * MOST_DAMAGE, "no start: x"), Damaged(b"y", "no start: y")]
