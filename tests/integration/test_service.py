"""A line service on real ports: polled, unplugged and plugged in again, beside strangers."""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
import socket
import time
import tty
from collections import Counter
from collections.abc import AsyncIterator, Callable, Iterator
from pathlib import Path

import pytest

from integration.processes import PATIENCE, simulator
from integration.servers import Connected, reply_to, serving
from multidrop.errors import PortError
from multidrop.io.async_line import SWALLOWED, open_async_line
from multidrop.io.listen import Listener
from multidrop.io.service import LineService, Polled, Quality
from multidrop.protocols import slink3
from multidrop.sim.line import Pace, SimulatedLine
from multidrop.sim.serve import serve
from multidrop.sim.slink3 import FlexMax

POINT = "8236:int16"
EVERY = 0.2
DRIVES = 3
PATIENT = ",timeout=5,silence=5"
"""A loaded machine stops the simulated wire in the middle of an answer. 37 ms of that would cut it
short, and the rest of `timeout` that this costs would make the values of the others stale."""

SOON = 5.0
"""s from plugging in to the first value; bench/service.py measures it on a quiet machine."""


class Log(list[tuple[float, Polled]]):
    """What polling said, and when."""

    def __init__(self) -> None:
        self._now = asyncio.get_running_loop().time
        self._news = asyncio.Event()

    def __call__(self, polled: Polled) -> None:
        self.append((self._now(), polled))
        self._news.set()

    def good(self, since: float) -> list[float]:
        return [at for at, polled in self if polled.good and at > since]

    async def await_good(self, since: float, count: int = 1) -> None:
        async with asyncio.timeout(PATIENCE):
            while len(self.good(since)) < count:
                self._news.clear()
                await self._news.wait()


@contextlib.asynccontextmanager
async def polled(port: str) -> AsyncIterator[tuple[LineService, Log]]:
    names = {f"d{number}": f"flexmax:{number}@{port}{PATIENT}" for number in range(DRIVES)}
    async with LineService(names) as service:
        log = Log()
        plan = service.plan([(name, POINT, EVERY) for name in names])
        task = asyncio.create_task(service.poll(plan, log))
        try:
            yield service, log
        finally:
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)


def lost_only_while_away(log: Log, gone: float, back: float) -> None:
    """No more polls than those of the time away, and every device is polled again."""
    lost = Counter(one.device for _, one in log if one.quality is Quality.PORT_LOST)
    assert {one.quality for _, one in log} == {Quality.GOOD, Quality.PORT_LOST}
    for number in range(DRIVES):
        name = f"d{number}"
        times = [at for at, one in log if one.device == name and one.good]
        first = min(at for at in times if at > back)
        assert lost[name] <= (first - gone) / EVERY + 2


def devices() -> SimulatedLine:
    return SimulatedLine(
        [FlexMax(number) for number in range(DRIVES)],
        slink3.decoder,
        pace=Pace(slink3.LINE.character),
    )


def test_a_pseudo_terminal_that_is_closed_and_made_again(tmp_path: Path) -> None:
    link = f"{tmp_path}/adapter"

    async def plug_in() -> Listener:
        return await serve(devices(), f"pty:{link}")

    async def main() -> None:
        now = asyncio.get_running_loop().time
        adapter = await plug_in()
        async with polled(link) as (service, log):
            for times_opened in (1, 2, 3):
                await log.await_good(now(), 2 * DRIVES)
                assert service.times_opened == times_opened
                adapter.close()
                gone = now()
                await asyncio.sleep(0.5)
                with pytest.raises(PortError):
                    await service.read("d0", POINT)
                assert service.lost is not None
                back = now()
                adapter = await plug_in()
                await log.await_good(back, 2 * DRIVES)
                assert log.good(back)[0] - back < SOON
                lost_only_while_away(log, gone, back)
                log.clear()
        adapter.close()

    asyncio.run(main())


def test_a_device_server_that_is_started_again() -> None:
    async def main() -> None:
        now = asyncio.get_running_loop().time
        names = [f"flexmax:{number}" for number in range(DRIVES)]
        with contextlib.ExitStack() as stack:
            first = stack.enter_context(simulator(*names))
            async with polled(first.port) as (service, log):
                await log.await_good(0.0, 2 * DRIVES)
                transport = service.device("d0").line._transport
                assert transport is not None
                own = transport.get_extra_info("socket")
                assert own.getsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT) == SWALLOWED
                gone = now()
                first.program.end(signal.SIGKILL)
                await asyncio.sleep(0.3)
                with pytest.raises(PortError):
                    await service.read("d0", POINT)
                stack.enter_context(simulator(*names, listen=first.port))
                back = now()
                await log.await_good(back, 2 * DRIVES)
                assert log.good(back)[0] - back < SOON
                lost_only_while_away(log, gone, back)
                assert service.times_opened == 2

    asyncio.run(main())


def test_strangers_on_a_real_line() -> None:
    """Each answer comes with noise, another slave's frame and an old answer around it."""
    numbers = iter(range(10**6))

    def behave(line: Connected) -> None:
        for request in line.requests():
            number = next(numbers)
            right = reply_to(request, 0, request.data + number.to_bytes(2, "little"))
            other = slink3.Frame(99, request.control, 1, 0, request.data + b"\xff\x7f")
            late = slink3.Frame(
                request.address, (request.control + 8) & 0x3C, 1, 0, request.data + b"\xff\x7f"
            )
            line.send(b"\x55" + other.encode() + late.encode() + right.encode() + late.encode())

    async def main(port: str) -> None:
        async with polled(port) as (service, log):
            await log.await_good(0.0, 10)
            values = [one.value for _, one in log if one.good]
            assert values == sorted(values, key=lambda value: int(str(value)))
            assert 0x7FFF not in values
            counters = service.counters
            assert counters.foreign >= 2 * counters.answers
            assert counters.damaged >= counters.answers
            assert counters.no_reply == 0

    with serving(behave) as server:
        asyncio.run(main(server.port))


@contextlib.contextmanager
def wire(way: str) -> Iterator[tuple[str, Callable[[bytes], object]]]:
    """A port, and how to put bytes on its wire."""
    if way == "pty":
        ours, theirs = os.openpty()
        tty.setraw(ours)
        try:
            yield os.ttyname(theirs), lambda data: os.write(ours, data)
        finally:
            os.close(ours)
            os.close(theirs)
        return
    with socket.create_server(("127.0.0.1", 0)) as server, contextlib.ExitStack() as stack:
        accepted: list[socket.socket] = []

        def send(data: bytes) -> None:
            if not accepted:
                accepted.append(stack.enter_context(server.accept()[0]))
            accepted[0].sendall(data)

        yield f"tcp://127.0.0.1:{server.getsockname()[1]}", send


@pytest.mark.parametrize("way", ["pty", "tcp"])
def test_a_program_that_stood_still_believes_what_came_meanwhile(way: str) -> None:
    """The rest of an answer lies there when it goes on, and was late by no fault of the device."""

    async def main(port: str, send: Callable[[bytes], object]) -> None:
        line = await open_async_line(port, slink3.LINE)
        rest = b""

        def hear(data: bytes, out: bool, at: float, damaged: bool) -> None:
            nonlocal rest
            if out:
                request = slink3.Frame.decode(data)
                answer = reply_to(request, 0, request.data + b"\x05\x00").encode()
                send(answer[:5])
                rest = answer[5:]
            elif rest:
                send(rest)
                rest = b""
                time.sleep(2 * line.settings.timing(network="://" in port).silence)

        line.taps.append(hear)
        async with line, asyncio.timeout(PATIENCE):
            asked = slink3.Master(0).read_typed(8236, slink3.Format.SHORT_INT)
            assert (await line.run(asked)).value == 5
        assert (line.counters.requests, line.counters.damaged) == (1, 0)

    with wire(way) as (port, send):
        asyncio.run(main(port, send))
