"""Puts a simulated line where programs can reach it: a TCP port or a pseudo-terminal."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable

from multidrop.io.listen import Listener, listen
from multidrop.sim.line import Connection, SimulatedLine

SPIN = 0.001
"""s before something is due from which a spinning line no longer sleeps."""


class _End:
    """One end of a simulated line, driven by the loop's clock."""

    def __init__(self, line: SimulatedLine, write: Callable[[bytes], object], spin: bool) -> None:
        self._end: Connection = line.attach()
        self._write = write
        self._spin = spin
        self._loop = asyncio.get_running_loop()
        self._timer: asyncio.TimerHandle | None = None

    def receive(self, data: bytes) -> None:
        self._end.receive(data, self._loop.time())
        self._pump()

    def close(self) -> None:
        if self._timer is not None:
            self._timer.cancel()

    def _pump(self) -> None:
        """Send what is due, and come back when more is."""
        end = self._end
        while True:
            data = end.send(self._loop.time())
            if data:
                self._write(data)
            deadline = end.deadline
            if deadline == float("inf"):
                return
            left = deadline - time.monotonic()
            if left > 0 and not (self._spin and left <= SPIN):
                break
            while time.monotonic() < deadline:
                pass
        if self._timer is not None:
            self._timer.cancel()
        early = SPIN if self._spin else 0.0
        self._timer = self._loop.call_at(deadline - early, self._pump)


class _Ear:
    """Hears everything that passes on a simulated line; what it is told is lost."""

    def __init__(self, line: SimulatedLine, write: Callable[[bytes], object]) -> None:
        self._line = line
        self._write = write
        self._loop = asyncio.get_running_loop()
        self._open = True
        line.ears.append(self._hear)

    def receive(self, data: bytes) -> None:
        pass

    def close(self) -> None:
        self._open = False
        self._line.ears.remove(self._hear)

    def _hear(self, data: bytes, passed_at: float) -> None:
        """What still takes its time is heard when it has passed, not before."""
        self._loop.call_at(passed_at, self._tell, data)

    def _tell(self, data: bytes) -> None:
        if self._open:
            self._write(data)


async def serve(line: SimulatedLine, where: str, *, spin: bool = False) -> Listener:
    """Serve a line at `tcp://HOST:PORT` (port 0: any free one) or `pty[:LINK]`.

    Raises `UsageError` for another address, `PortError` where it cannot listen.
    """
    return await listen(where, lambda caller: _End(line, caller.write, spin))


async def serve_ears(line: SimulatedLine, where: str) -> Listener:
    """Serve those who only listen to a line: every byte that passes, both ways. As `serve`."""
    return await listen(where, lambda caller: _Ear(line, caller.write))
