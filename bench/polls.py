"""What a poll costs the processor: a line service on each of 20 lines that take no time.

Each part is a process of its own: `python -m bench.polls lines` simulates the lines
and prints their ports, `python -m bench.polls service SECONDS PORT...` polls them,
and `python -m bench.polls bare SECONDS PORT...` asks as often and looks at no byte;
these two print their processor time for each poll in s.
"""

from __future__ import annotations

import asyncio
import sys
from collections.abc import Callable
from itertools import islice
from statistics import median
from time import process_time

from bench.measure import Result, interleaved, line_of, start
from multidrop.catalog import load_profile
from multidrop.io.service import LineService, Polled
from multidrop.points import Point
from multidrop.protocols import ultra3000
from multidrop.protocols.ultra3000 import Frame
from multidrop.protocols.ultra3000.device import Ultra3000Device
from multidrop.sim.devices import simulated_device
from multidrop.sim.line import SimulatedLine
from multidrop.sim.serve import serve

PROFILE = "ultra3000"
LINES, DEVICES, POINTS = 20, 5, 20
EVERY = 1.0  # s, the period of each of the 2,000 points
SETTLE = 1.5  # s that do not count
GOAL = 0.5


# -- the lines -----------------------------------------------------------------------------------


async def lines() -> None:
    served = []
    for _ in range(LINES):
        devices = [simulated_device(PROFILE, address) for address in range(DEVICES)]
        served.append(await serve(SimulatedLine(devices, ultra3000.decoder), "tcp://127.0.0.1:0"))
    print(*(line.port for line in served), flush=True)
    await asyncio.to_thread(sys.stdin.read)


def polled_points() -> list[Point]:
    """As many points of a drive as are polled, each with a message of its own."""
    device = Ultra3000Device(0, load_profile(PROFILE))
    return list(islice(device.readable(), POINTS))


# -- those who poll them -------------------------------------------------------------------------


async def service(seconds: float, ports: list[str]) -> float:
    count = 0

    def heard(polled: Polled) -> None:
        nonlocal count
        assert polled.good, polled
        count += 1

    points = polled_points()
    tasks = []
    for port in ports:
        names = [f"{PROFILE}:{address}@{port}" for address in range(DEVICES)]
        line = await LineService(names).__aenter__()
        plan = line.plan([(name, points, EVERY) for name in line.devices])
        tasks.append(asyncio.create_task(line.poll(plan, heard)))
    return await _cost(seconds, lambda: count)


class Bare(asyncio.BufferedProtocol):
    """asyncio alone: it asks as often, and looks at no byte."""

    def __init__(self) -> None:
        self._buffer = bytearray(4096)
        self.count = 0

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.WriteTransport)
        self._transport = transport
        self._loop = asyncio.get_running_loop()
        self._question = Frame(0, 0x000).encode()

    def ask(self) -> None:
        self._transport.write(self._question)
        self._loop.call_later(EVERY / (DEVICES * POINTS), self.ask)

    def get_buffer(self, sizehint: int) -> bytearray:
        return self._buffer

    def buffer_updated(self, nbytes: int) -> None:
        self.count += 1


async def bare(seconds: float, ports: list[str]) -> float:
    asking = []
    for port in ports:
        host, _, number = port.removeprefix("tcp://").rpartition(":")
        loop = asyncio.get_running_loop()
        _, protocol = await loop.create_connection(Bare, host, int(number))
        protocol.ask()
        asking.append(protocol)
    return await _cost(seconds, lambda: sum(one.count for one in asking))


async def _cost(seconds: float, count: Callable[[], int]) -> float:
    await asyncio.sleep(SETTLE)
    before, used = count(), process_time()
    await asyncio.sleep(seconds)
    return (process_time() - used) / (count() - before)


# -- the row -------------------------------------------------------------------------------------


def polls(quick: bool) -> list[Result]:
    """Processor time, so that other programs disturb little."""
    seconds = 3.0 if quick else 6.0

    def cost(who: str) -> float:
        simulator = start("polls", "lines")
        try:
            ports = line_of(simulator.stdout).split()
            polling = start("polls", who, str(seconds), *ports)
            found = float(line_of(polling.stdout))
            polling.communicate()
        finally:
            simulator.communicate()
        return found

    found = interleaved(
        2 if quick else 5,
        {"service": lambda: cost("service"), "bare": lambda: cost("bare")},
    )
    own, alone = median(found["service"]), median(found["bare"])
    rate = LINES * DEVICES * POINTS / EVERY
    return [
        Result(
            f"{rate:,.0f} polls of one point a second on {LINES} unpaced TCP lines with a line "
            "service each",
            "",
            f"< {GOAL} of a core",
            f"{own * rate:.2f}",
            own * rate < GOAL,
            [
                f"{own * 1e6:.0f} µs of processor time a poll, asyncio's included",
                f"asyncio alone, with as many questions and answers: {alone * 1e6:.0f} µs",
            ],
        )
    ]


if __name__ == "__main__":
    if sys.argv[1] == "lines":
        asyncio.run(lines())
    else:
        poll = service if sys.argv[1] == "service" else bare
        print(asyncio.run(poll(float(sys.argv[2]), sys.argv[3:])), flush=True)
