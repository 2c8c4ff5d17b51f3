"""The simulated line of the paced rows, in a process of its own.

`python -m bench.simulator LISTEN BURST_MS` serves one line as `multidrop simulate
--pace` does, spinning before a byte is due. It prints its port as a line of JSON,
answers every line on its standard input with what it noted of each read, and
ends with its standard input. Many lines are `bench.many_simulated`'s.
"""

from __future__ import annotations

import asyncio
import json
import sys
from typing import Any

from multidrop.decoder import Decoder
from multidrop.protocols import slink3
from multidrop.sim.line import Connection, Pace, SimulatedLine
from multidrop.sim.serve import serve
from multidrop.sim.slink3 import FlexMax

ANSWER = 13  # bytes of the answer to a typed read of a short int


def pace(burst_ms: float) -> Pace:
    """9600 baud, 8E1; an answer comes at once, its bytes one by one or in bursts."""
    return Pace(slink3.LINE.character, burst_ms / 1000)


class Watched(Connection):
    """An end of a line that notes when a request came and when the last byte of its answer left."""

    def __init__(self, line: SimulatedLine, decoder: Decoder[Any]) -> None:
        super().__init__(line, decoder)
        self.passed: list[tuple[float, float]] = []  # of each read: request came, answer was out
        self._asked = 0.0
        self._left = 0

    def receive(self, data: bytes, now: float) -> None:
        self._asked = now
        self._left = ANSWER
        super().receive(data, now)

    def send(self, now: float) -> bytes:
        data = super().send(now)
        if data:
            self._left -= len(data)
            if self._left == 0:
                self.passed.append((self._asked, now))
        return data


class WatchedLine(SimulatedLine):
    """A simulated line whose ends keep notes."""

    def __init__(self, burst_ms: float) -> None:
        super().__init__([FlexMax(0)], slink3.decoder, pace=pace(burst_ms))
        self.ends: list[Watched] = []

    def attach(self) -> Watched:
        end = Watched(self, self._decoder())
        self.ends.append(end)
        return end


async def one(listen: str, burst_ms: float) -> None:
    line = WatchedLine(burst_ms)
    listener = await serve(line, listen, spin=True)
    print(json.dumps(listener.port), flush=True)
    loop = asyncio.get_running_loop()
    while await loop.run_in_executor(None, sys.stdin.readline):
        print(json.dumps([read for end in line.ends for read in end.passed]), flush=True)
    listener.close()


if __name__ == "__main__":
    asyncio.run(one(sys.argv[1], float(sys.argv[2])))
