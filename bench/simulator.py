"""The simulated lines of the paced rows, in a process of their own.

`python -m bench.simulator one LISTEN BURST_MS` serves one line as `multidrop
simulate --pace` does, spinning before a byte is due. `python -m bench.simulator
many COUNT BURST_MS CPU` serves COUNT lines from a loop that never sleeps.

Each prints its ports as a line of JSON, then answers every line on its standard
input with what it has to say of itself, and ends with its standard input.
"""

from __future__ import annotations

import asyncio
import heapq
import json
import os
import select
import socket
import sys
from collections import deque
from time import monotonic
from typing import Any

from bench.measure import percentile
from multidrop.decoder import Decoder
from multidrop.protocols import slink3
from multidrop.sim.line import Connection, Pace, SimulatedLine
from multidrop.sim.serve import serve
from multidrop.sim.slink3 import FlexMax

ANSWER = 13  # bytes of the answer to a typed read of a short int
FOREVER = float("inf")
AT_ONCE = 8  # things done before the many lines are looked at again


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


class ManyLines:
    """Many lines in one loop that never sleeps: absolute times, one heap of what is due."""

    def __init__(self, count: int, burst_ms: float) -> None:
        self.lateness: list[float] = []  # s, of every piece of bytes
        self._poll = select.epoll()
        self._poll.register(sys.stdin, select.EPOLLIN)
        self._listening: dict[int, tuple[socket.socket, SimulatedLine]] = {}
        self._ends: dict[int, tuple[socket.socket, Connection]] = {}
        self._heard: deque[tuple[int, bytes, float]] = deque()
        self._due: list[tuple[float, int]] = []  # at most one of each end
        self._scheduled: set[int] = set()
        for _ in range(count):
            listener = socket.create_server(("127.0.0.1", 0))
            line = SimulatedLine([FlexMax(0)], slink3.decoder, pace=pace(burst_ms))
            self._listening[listener.fileno()] = (listener, line)
            self._poll.register(listener, select.EPOLLIN)

    @property
    def ports(self) -> list[str]:
        sockets = [listener for listener, _ in self._listening.values()]
        return [f"tcp://127.0.0.1:{listener.getsockname()[1]}" for listener in sockets]

    def run(self) -> None:
        """Serve until the standard input ends. What is due goes first; an answer can wait a little."""
        while True:
            for fd, _ in self._poll.poll(0):
                if fd in self._ends:
                    self._hear(fd)
                elif fd in self._listening:
                    self._accept(fd)
                elif not sys.stdin.readline():
                    return
                else:
                    self._report()
            for _ in range(AT_ONCE):
                if self._due and self._due[0][0] <= monotonic():
                    self._send_due()
                elif self._heard:
                    self._answer()
                else:
                    break

    def _accept(self, fd: int) -> None:
        listener, line = self._listening[fd]
        client, _ = listener.accept()
        client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._ends[client.fileno()] = (client, line.attach())
        self._poll.register(client, select.EPOLLIN)

    def _hear(self, fd: int) -> None:
        client, _ = self._ends[fd]
        data = client.recv(4096)
        if data:
            self._heard.append((fd, data, monotonic()))
        else:
            self._poll.unregister(fd)
            del self._ends[fd]
            client.close()

    def _answer(self) -> None:
        """The answer is due 12 characters after the request came: there is time to work it out."""
        fd, data, came = self._heard.popleft()
        if fd in self._ends:
            _, end = self._ends[fd]
            end.receive(data, came)
            self._schedule(fd, end)

    def _schedule(self, fd: int, end: Connection) -> None:
        if fd not in self._scheduled and end.deadline != FOREVER:
            self._scheduled.add(fd)
            heapq.heappush(self._due, (end.deadline, fd))

    def _send_due(self) -> None:
        due, fd = heapq.heappop(self._due)
        self._scheduled.discard(fd)
        if fd not in self._ends:
            return
        client, end = self._ends[fd]
        now = monotonic()
        data = end.send(now)
        if data:
            self.lateness.append(now - due)
            client.send(data)
        self._schedule(fd, end)

    def _report(self) -> None:
        late = self.lateness or [0.0]
        print(json.dumps([percentile(late, 0.5), percentile(late, 0.99)]), flush=True)
        self.lateness.clear()


if __name__ == "__main__":
    if sys.argv[1] == "one":
        asyncio.run(one(sys.argv[2], float(sys.argv[3])))
    else:
        os.sched_setaffinity(0, {int(sys.argv[4])})
        lines = ManyLines(int(sys.argv[2]), float(sys.argv[3]))
        print(json.dumps(lines.ports), flush=True)
        lines.run()
