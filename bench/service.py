"""The line service: silent devices, an operator on a full line, an adapter that is plugged in again."""

from __future__ import annotations

import asyncio
import contextlib
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import AsyncIterator, Iterator
from pathlib import Path
from statistics import median
from time import monotonic

from bench.measure import Result, line_of
from bench.polls import polls
from bench.service_lines import service_lines
from multidrop.io.listen import Listener
from multidrop.io.polling import Plan
from multidrop.io.service import LineService, Polled
from multidrop.protocols import slink3
from multidrop.sim.line import Pace, SimulatedLine
from multidrop.sim.serve import serve
from multidrop.sim.slink3 import FlexMax

POINT = "8236:int16"
DEVICES = 20
FULL = 0.9  # of the line, with every device there
READ = (11 + 13) * slink3.LINE.character + slink3.LINE.gap  # s on the line
EVERY = DEVICES * READ / FULL


@contextlib.contextmanager
def simulated(addresses: range) -> Iterator[str]:
    """The port of `multidrop simulate --pace` with drives at these addresses."""
    devices = [f"flexmax:{address}" for address in addresses]
    process = subprocess.Popen(
        [
            sys.executable,
            "-m",
            "multidrop",
            "simulate",
            *devices,
            *("--pace", "--listen", "tcp://127.0.0.1:0"),
        ],
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        port = ""
        while not port.startswith("listening on "):
            port = line_of(process.stdout)
        yield port.removeprefix("listening on ")
    finally:
        process.terminate()
        process.communicate()


class Log:
    """The good values since a time: of which device, and when."""

    def __init__(self) -> None:
        self.good: list[tuple[float, str]] = []

    def __call__(self, polled: Polled) -> None:
        if polled.good:
            self.good.append((monotonic(), polled.device))

    def counts(self, since: float) -> Counter[str]:
        return Counter(name for at, name in self.good if at >= since)


@contextlib.asynccontextmanager
async def polling(service: LineService, plan: Plan) -> AsyncIterator[Log]:
    log = Log()
    task = asyncio.create_task(service.poll(plan, log))
    try:
        yield log
    finally:
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)


def service_on(port: str, count: int) -> LineService:
    return LineService({f"d{number}": f"flexmax:{number}@{port}" for number in range(count)})


def every(service: LineService, seconds: float) -> Plan:
    return service.plan([(name, [POINT], seconds) for name in service.devices])


# -- silent devices ------------------------------------------------------------------------------


async def kept_polls(dead: int, seconds: float) -> tuple[float, float, int]:
    """Of the devices that answer: the least share of polls kept; the probes' share; their number."""
    with simulated(range(dead, DEVICES)) as port:
        async with (
            service_on(port, DEVICES) as service,
            polling(service, every(service, EVERY)) as log,
        ):
            while len(service.health.silent) < dead:
                await asyncio.sleep(0.05)
            await asyncio.sleep(4.0)  # the first probe of who fell silent last
            begin = monotonic()
            silent = [service.device(f"d{number}").counters for number in range(dead)]
            busy, probes = (sum(one.busy for one in silent), sum(one.requests for one in silent))
            await asyncio.sleep(seconds)
            lasted = monotonic() - begin
            counts = log.counts(begin)
            kept = min(counts[f"d{number}"] for number in range(dead, DEVICES))
            used = sum(one.busy for one in silent) - busy
            sent = sum(one.requests for one in silent) - probes
            return kept / (lasted / EVERY), used / lasted, sent


def silent_devices(quick: bool) -> list[Result]:
    async def both() -> list[tuple[float, float, int]]:
        seconds = 45.0 if quick else 150.0
        return list(await asyncio.gather(*(kept_polls(dead, seconds) for dead in (1, 10))))

    goals = {1: 0.95, 10: 0.94}
    return [
        Result(
            f"{DEVICES} devices polled at 9600 baud, {FULL:.0%} of the line, {dead} of them dead",
            "the polls of the plan",
            f">= {goals[dead]} of its polls, every device that answers",
            f"{kept:.3f}",
            kept >= goals[dead],
            [f"{sent} probes took {used:.1%} of the line's time; a time-out is 1.8 s"],
        )
        for dead, (kept, used, sent) in zip(goals, asyncio.run(both()), strict=True)
    ]


# -- an operator on a full line --------------------------------------------------------------------


async def waits(count: int) -> tuple[list[float], float]:
    """How long operators' reads waited before they were sent, and how full the line was, s."""
    with simulated(range(DEVICES)) as port:
        async with service_on(port, DEVICES) as service, polling(service, every(service, 0.1)):
            await asyncio.sleep(1.0)
            found = []
            for number in range(count):
                await asyncio.sleep(0.1 + 0.0137 * (number % 7))
                asked = monotonic()
                (reading,) = await service.read(f"d{number % DEVICES}", POINT)
                found.append(monotonic() - asked - reading.ms / 1000)
            return found, service.load


def operator(quick: bool) -> list[Result]:
    found, load = asyncio.run(waits(50 if quick else 300))
    worst = max(found)
    return [
        Result(
            "an operator's read on a line that is full of polls, until it is sent",
            f"one transaction, {READ * 1000:.1f} ms",
            "<= one transaction and 5 ms, the longest wait",
            f"{worst * 1000:.1f} ms",
            worst <= READ + 0.005,
            [f"{len(found)} reads, median {median(found) * 1000:.1f} ms; line {load:.0%} full"],
        )
    ]


# -- plugged in again ------------------------------------------------------------------------------


async def first_values(rounds: int) -> list[float]:
    """s from a pseudo-terminal that was made again to the first good value."""
    with tempfile.TemporaryDirectory() as folder:
        link = Path(folder) / "adapter"

        async def plug_in() -> Listener:
            devices = [FlexMax(address) for address in range(3)]
            pace = Pace(slink3.LINE.character)
            return await serve(SimulatedLine(devices, slink3.decoder, pace=pace), f"pty:{link}")

        adapter = await plug_in()
        found = []
        async with (
            service_on(str(link), 3) as service,
            polling(service, every(service, 0.2)) as log,
        ):
            for number in range(rounds):
                await asyncio.sleep(1.0)
                adapter.close()
                await asyncio.sleep(0.3 + 0.17 * number)
                adapter = await plug_in()
                begin = monotonic()
                while not log.counts(begin):
                    await asyncio.sleep(0.002)
                found.append(log.good[-1][0] - begin)
        adapter.close()
        return found


def plugged_in(quick: bool) -> list[Result]:
    found = asyncio.run(first_values(3 if quick else 12))
    return [
        Result(
            "an adapter that is plugged in again, until the first good value",
            "",
            "< 2 s, every time",
            f"{max(found):.2f} s",
            max(found) < 2.0,
            [f"{len(found)} times, median {median(found):.2f} s; 3 devices polled every 0.2 s"],
        )
    ]


def rows(quick: bool) -> list[Result]:
    return [
        *silent_devices(quick),
        *operator(quick),
        *plugged_in(quick),
        *service_lines(quick),
        *polls(quick),
    ]
