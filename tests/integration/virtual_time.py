"""An event loop whose clock moves only when nothing is left to do, and wires in it."""

from __future__ import annotations

import asyncio
import selectors
from typing import Any

from multidrop.io.memory import FOREVER, Peer

TICK = 1e-9
"""s: what is called at a time must find that the time has come, in spite of rounding."""


class _NoWaiting(selectors.DefaultSelector):
    """Lets the loop's time pass instead of waiting for files."""

    def __init__(self) -> None:
        super().__init__()
        self.now = 1000.0

    def select(self, timeout: float | None = None) -> list[Any]:
        assert timeout is not None, "the loop would wait for ever"
        if timeout > 0:
            self.now += timeout + TICK
        return super().select(0)


class VirtualTimeLoop(asyncio.SelectorEventLoop):
    def __init__(self) -> None:
        self._clock = _NoWaiting()
        super().__init__(self._clock)

    def time(self) -> float:
        return self._clock.now

    def pass_time(self, seconds: float) -> None:
        """Let the loop run for so long."""
        self.run_until_complete(asyncio.sleep(seconds))

    def stand_still(self, seconds: float) -> None:
        """Time passes and nothing runs, as when a call blocks or a machine stalls."""
        self._clock.now += seconds


class WireTransport(asyncio.WriteTransport):
    """A transport whose other end is a `Peer`; delivers to `protocol` what the peer sends."""

    def __init__(self, peer: Peer, protocol: asyncio.Protocol) -> None:
        super().__init__()
        self._peer = peer
        self._protocol = protocol
        self._loop = asyncio.get_running_loop()
        self._timer: asyncio.TimerHandle | None = None
        protocol.connection_made(self)

    def write(self, data: bytes | bytearray | memoryview) -> None:
        self._peer.receive(bytes(data), self._loop.time())
        self.arm()

    def arm(self) -> None:
        """Ask the peer when it has something to send."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        if self._peer.deadline != FOREVER:
            when = max(self._peer.deadline, self._loop.time())
            self._timer = self._loop.call_at(when, self._deliver)

    def _deliver(self) -> None:
        data = self._peer.send(self._loop.time())
        self._timer = None
        if data:
            self._protocol.data_received(data)
        self.arm()

    def close(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
        self._loop.call_soon(self._protocol.connection_lost, None)
