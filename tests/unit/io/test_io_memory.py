"""The in-process wire: its time passes by reading, and only so far as something happens."""

from __future__ import annotations

import pytest

from multidrop.io.memory import FOREVER, MemoryPort


class Timetable:
    """A peer that sends what it was told to, when it was told to."""

    def __init__(self, *entries: tuple[float, bytes]) -> None:
        self.entries = list(entries)
        self.received: list[tuple[float, bytes]] = []

    def receive(self, data: bytes, now: float) -> None:
        self.received.append((now, data))

    @property
    def deadline(self) -> float:
        return self.entries[0][0] if self.entries else FOREVER

    def send(self, now: float) -> bytes:
        if self.entries and self.entries[0][0] <= now:
            return self.entries.pop(0)[1]
        return b""


def test_reading_lets_the_time_pass_until_something_comes() -> None:
    port = MemoryPort(Timetable((0.5, b"a"), (0.5, b"b"), (2.0, b"c")))
    assert (port.read(10.0), port.now()) == (b"a", 0.5)
    assert (port.read(10.0), port.now()) == (b"b", 0.5)
    assert (port.read(1.0), port.now()) == (b"", 1.5)
    assert (port.read(0.5), port.now()) == (b"c", 2.0)
    assert (port.read(3.0), port.now()) == (b"", 5.0)


@pytest.mark.parametrize("timeout", [0.0, -1.0])
def test_reading_without_waiting(timeout: float) -> None:
    port = MemoryPort(Timetable((0.0, b"a"), (0.1, b"b")))
    assert port.read(timeout) == b"a"
    assert (port.read(timeout), port.now()) == (b"", 0.0)


def test_what_is_overdue_comes_at_once() -> None:
    peer = Timetable()
    port = MemoryPort(peer)
    port.read(5.0)
    peer.entries.append((1.0, b"late"))
    assert (port.read(1.0), port.now()) == (b"late", 5.0)


def test_writing_takes_no_time_of_its_own() -> None:
    peer = Timetable((1.0, b"a"))
    port = MemoryPort(peer)
    port.write(b"x")
    port.read(5.0)
    port.write(b"y")
    assert peer.received == [(0.0, b"x"), (1.0, b"y")]
    port.close()


def test_its_kind() -> None:
    assert MemoryPort(Timetable()).marks is None
    assert MemoryPort(Timetable(), marks=True).marks is not None
    assert MemoryPort(Timetable(), network=True).network
