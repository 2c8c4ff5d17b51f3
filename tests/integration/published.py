"""A gateway in the test's own loop, on a simulated line whose devices stay within the test's reach."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass
from pathlib import Path

from integration.processes import PATIENCE
from multidrop.catalog import load_profile
from multidrop.gateway.gateway import Gateway
from multidrop.gateway.settings import settings_of
from multidrop.gateway.values import Update
from multidrop.io.poller import Polled, Quality
from multidrop.plantfile import Plant, parse_plant
from multidrop.protocols import slink3
from multidrop.sim.line import Pace, SimulatedLine
from multidrop.sim.serve import serve
from multidrop.sim.slink3 import FlexMax, ax_v

DEVICES = """
[line.press]
port = "{port}"
baud = 115200
timeout = 1
attempts = 1

[line.press.device.infeed]
profile = "flexmax"
address = 0
[line.press.device.infeed.points]
torque = {{ at = "8236:int16", every = 0.1, unit = "Nm", write = {{ min = -200, max = 1500 }} }}
speed = {{ at = "actual_speed", every = 0.1, unit = "rpm" }}
bus_address = {{ at = "8511:uint16", every = 0.2 }}

[line.press.device.unwinder]
profile = "ax-v"
address = 2
[line.press.device.unwinder.points]
tension = {{ at = "1009:int16", scale = 0.1, unit = "N", every = 0.1, write = {{ min = 0.1, max = 20 }} }}
missing = {{ at = "9999:int16", every = 0.1, write = {{ min = 0, max = 500 }} }}
"""


@dataclass
class Published:
    """The gateway, its line, and what it said."""

    gateway: Gateway
    line: SimulatedLine
    said: list[str]
    text: str
    port: str
    file: str
    answer_delay: Callable[[float], None]

    async def until(self, right: Callable[[], bool]) -> None:
        """Wait until something is so; it is looked at with every update."""
        news = asyncio.Event()

        def told(update: Update) -> None:
            news.set()

        self.gateway.values.listeners.append(told)
        try:
            async with asyncio.timeout(PATIENCE):
                while not right():
                    news.clear()
                    await news.wait()
        finally:
            self.gateway.values.listeners.remove(told)

    async def until_value(self, device: str, point: str, value: object) -> None:
        def right() -> bool:
            update = self.gateway.values.get(device, point)
            return update is not None and update.good and update.value == value

        await self.until(right)

    async def read_now(self, device: str, point: str) -> None:
        """As if it were polled just now: a point that is polled rarely may not be for long."""
        place = self.gateway.line_of(device).service.device(device).device.point(point)
        reading = await self.gateway.read(device, point)
        self.gateway.values.take(Polled(device, place, Quality.GOOD, reading.time, reading))

    async def until_said(self, device: str, point: str, quality: str) -> None:
        def right() -> bool:
            update = self.gateway.values.get(device, point)
            return update is not None and update.quality == quality

        await self.until(right)

    def plant(self, more: str = "") -> Plant:
        """The plant file with something added."""
        return parse_plant(self.text.format(port=self.port) + more, self.file, load_profile)


@contextlib.asynccontextmanager
async def published(folder: Path, tables: str, devices: str = DEVICES) -> AsyncIterator[Published]:
    """Run a gateway with these tables of a plant file, its files in `folder`."""
    line = SimulatedLine([FlexMax(0), ax_v(2)], slink3.decoder, pace=Pace())
    listener = await serve(line, "tcp://127.0.0.1:0")
    said: list[str] = []

    def delay(seconds: float) -> None:
        line.pace = Pace(answer_delay=seconds)

    file = str(folder / "multidrop.toml")
    try:
        text = tables.replace("{", "{{").replace("}", "}}") + devices
        plant = parse_plant(text.format(port=listener.port), file, load_profile)
        gateway = Gateway(plant, settings_of(plant), say=said.append)
        gateway.add_parts()
        async with gateway:
            yield Published(gateway, line, said, text, listener.port, file, delay)
    finally:
        listener.close()


async def ran(*command: str, stdin: bytes = b"") -> tuple[int, str]:
    """A foreign program to its end: exit status, and what it printed on both outputs."""
    process = await asyncio.create_subprocess_exec(
        *command,
        stdin=asyncio.subprocess.PIPE,
        stdout=asyncio.subprocess.PIPE,
        stderr=asyncio.subprocess.STDOUT,
    )
    async with asyncio.timeout(PATIENCE):
        out, _ = await process.communicate(stdin)
    assert process.returncode is not None
    return process.returncode, out.decode(errors="replace")
