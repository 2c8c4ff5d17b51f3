"""The simulated line of the paced rows, in a process of its own.

`python -m bench.simulator PROFILE LISTEN BURST_MS` serves the device of a profile
at address 0 as `multidrop simulate --pace --delay 0` does, spinning before a byte
is due. It prints its port as a line of JSON, answers every line on its standard
input with what it noted of each request, and ends with its standard input. Many
lines are `bench.many_simulated`'s.
"""

from __future__ import annotations

import asyncio
import json
import sys
from typing import Any

from multidrop.catalog import load_profile
from multidrop.decoder import Decoder
from multidrop.io.connection import line_settings
from multidrop.naming import LineOptions
from multidrop.protocols import PROTOCOLS
from multidrop.sim.devices import simulated_device
from multidrop.sim.line import Connection, Pace, SimulatedLine
from multidrop.sim.serve import serve


class Watched(Connection):
    """An end of a line that notes when a request came and when the last byte of its answer left."""

    def __init__(self, line: SimulatedLine, decoder: Decoder[Any]) -> None:
        super().__init__(line, decoder)
        self.passed: list[tuple[float, float]] = []  # of each request: it came, its answer was out
        self._asked = 0.0

    def receive(self, data: bytes, now: float) -> None:
        self._asked = now
        super().receive(data, now)

    def send(self, now: float) -> bytes:
        data = super().send(now)
        if data and not self._waiting:
            self.passed.append((self._asked, now))
        return data


class WatchedLine(SimulatedLine):
    """A simulated line whose ends keep notes."""

    def __init__(self, profile: str, burst_ms: float) -> None:
        described = load_profile(profile)
        protocol = PROTOCOLS[described.protocol]
        settings = line_settings(protocol, described, LineOptions())
        pace = Pace(settings.character, burst_ms / 1000)
        super().__init__([simulated_device(described, 0)], settings.decoder, pace=pace)
        self.ends: list[Watched] = []

    def attach(self) -> Watched:
        end = Watched(self, self._decoder())
        self.ends.append(end)
        return end


async def one(profile: str, listen: str, burst_ms: str) -> None:
    line = WatchedLine(profile, float(burst_ms))
    listener = await serve(line, listen, spin=True)
    print(json.dumps(listener.port), flush=True)
    loop = asyncio.get_running_loop()
    while await loop.run_in_executor(None, sys.stdin.readline):
        print(json.dumps([request for end in line.ends for request in end.passed]), flush=True)
    listener.close()


if __name__ == "__main__":
    asyncio.run(one(*sys.argv[1:]))
