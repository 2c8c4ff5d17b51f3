"""An in-process wire with a time of its own: no sleeps, no sockets, and every fault on demand.

What answers is a `Peer`: a simulated line, or a script of a test. The wire
keeps the time; reading from it lets the time pass.
"""

from __future__ import annotations

from typing import Protocol

from multidrop.io.parity import ParityMarks

FOREVER = float("inf")


class Peer(Protocol):
    """The other end of a wire, with time as an argument."""

    def receive(self, data: bytes, now: float) -> None: ...

    @property
    def deadline(self) -> float:
        """When it has something to send or to do next; infinity for never."""
        ...

    def send(self, now: float) -> bytes:
        """What it sends up to `now`."""
        ...


class MemoryPort:
    """A blocking port on a wire in this process."""

    def __init__(self, peer: Peer, *, network: bool = False, marks: bool = False) -> None:
        self.network = network
        self.marks = ParityMarks() if marks else None
        self._peer = peer
        self._now = 0.0

    def now(self) -> float:
        return self._now

    def read(self, timeout: float) -> bytes:
        until = self._now + max(timeout, 0.0)
        while True:
            data = self._peer.send(self._now)
            if data:
                return data
            next_time = max(self._peer.deadline, self._now)
            if next_time > until or next_time == FOREVER:
                self._now = until
                return self._peer.send(until)
            self._now = next_time

    def write(self, data: bytes) -> None:
        self._peer.receive(data, self._now)

    def close(self) -> None:
        pass
