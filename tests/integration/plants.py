"""Simulated plants for the gateway, on ports of this machine: drives that can be unplugged, and devices that fall silent."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import Any

from integration.processes import PATIENCE
from multidrop.catalog import load_profile
from multidrop.gateway.gateway import Gateway, Part
from multidrop.gateway.settings import settings_of
from multidrop.io.audit import AuditLog
from multidrop.io.listen import Listener
from multidrop.plantfile import Plant, parse_plant
from multidrop.protocols import PROTOCOLS, slink3
from multidrop.sim.devices import simulated_device
from multidrop.sim.line import SimulatedLine
from multidrop.sim.serve import serve
from multidrop.sim.slink3 import FlexMax

LOOK = 0.005
"""s between two looks whether something has happened."""

DRIVE = """
[line.{line}.device.{name}]
profile = "flexmax"
address = {address}
on_fault = ["status_word", "9999:int16"]
[line.{line}.device.{name}.points]
speed = {{ at = "actual_speed", every = 0.1 }}
feed = {{ at = "8236:int16", every = 0.1, scale = 0.1, unit = "m/min", write = {{ min = 0, max = 150 }} }}
"""


async def until(happened: Callable[[], Any]) -> None:
    """Wait until something has happened."""
    async with asyncio.timeout(PATIENCE):
        while not happened():
            await asyncio.sleep(LOOK)


class DriveLine:
    """Some FlexMax on a line, and what the plant file says of it.

    The line is behind a TCP port, or behind a pseudo-terminal with this link, which can be unplugged.
    """

    def __init__(self, name: str, *addresses: int, link: Path | None = None) -> None:
        self.name = name
        self.drives = {address: FlexMax(address) for address in addresses}
        self.simulated = SimulatedLine(list(self.drives.values()), slink3.decoder)
        self.port = "tcp://127.0.0.1:0" if link is None else str(link)
        self._listener: Listener | None = None

    async def plug_in(self) -> None:
        network = "://" in self.port
        self._listener = await serve(self.simulated, self.port if network else f"pty:{self.port}")
        self.port = self._listener.port

    def unplug(self) -> None:
        if self._listener is not None:
            self._listener.close()

    def silence(self, address: int) -> None:
        self.simulated.devices.remove(self.drives[address])

    def revive(self, address: int) -> None:
        self.simulated.devices.append(self.drives[address])

    @property
    def toml(self) -> str:
        devices = (
            DRIVE.format(line=self.name, name=f"{self.name}{address}", address=address)
            for address in self.drives
        )
        return "".join(
            (f'[line.{self.name}]\nport = "{self.port}"\ntimeout = 0.2\nbaud = 115200\n', *devices)
        )


@contextlib.asynccontextmanager
async def plugged_in(*lines: DriveLine) -> AsyncIterator[None]:
    for line in lines:
        await line.plug_in()
    try:
        yield
    finally:
        for line in lines:
            line.unplug()


def simulated_line(profile: str, address: int) -> SimulatedLine:
    """One device of any profile on a line of its own."""
    settings = PROTOCOLS[load_profile(profile).protocol].line
    return SimulatedLine([simulated_device(profile, address)], settings.decoder)


def plant(folder: Path, *texts: str) -> Plant:
    return parse_plant("\n".join(texts), str(folder / "multidrop.toml"), load_profile)


def gateway(
    folder: Path, *texts: str, parts: tuple[Part, ...] = (), news: list[str] | None = None
) -> Gateway:
    """A gateway with its log of writes in the folder; parts are added by the test."""
    found = plant(folder, *texts)
    log = AuditLog(folder / "audit.jsonl", origin="gateway")
    told = [] if news is None else news
    made = Gateway(found, settings_of(found), audit=log, news=told.append)
    for part in parts:
        made.add(part)
    return made
