"""A line service on a simulated wire that can be unplugged, in a time of its own."""

from __future__ import annotations

import asyncio
from collections import Counter
from collections.abc import Awaitable, Callable

import pytest
from integration.virtual_time import WireTransport

from multidrop.errors import PortError
from multidrop.io import kept_port
from multidrop.io.async_line import AsyncLine
from multidrop.io.service import LineService, Polled, Quality
from multidrop.naming import LineOptions
from multidrop.protocols import slink3
from multidrop.sim.faults import Fault
from multidrop.sim.line import LineFaults, Pace, SimulatedLine
from multidrop.sim.slink3 import FlexMax
from multidrop.timing import LineSettings
from unit.io.lines import in_virtual_time

PACE = Pace(11 / 9600, answer_delay=0.005)
TRANSACTION = 24 * PACE.character + PACE.answer_delay + 0.002
TIME_OUT = 0.2


class Faulty:
    """The next answers have these faults."""

    def __init__(self) -> None:
        self.next: list[Fault | None] = []

    def draw(self) -> Fault | None:
        return self.next.pop(0) if self.next else None


class World:
    """The wire, its devices, and the adapter."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, count: int) -> None:
        self.faults = Faulty()
        self.wire = SimulatedLine(
            [FlexMax(address) for address in range(count)],
            slink3.decoder,
            pace=PACE,
            faults=LineFaults(self.faults, late=0.5),
        )
        self.all = list(self.wire.devices)
        self.plugged = True
        self.attempts: list[float] = []
        self.transport: WireTransport | None = None
        self.line: AsyncLine | None = None
        monkeypatch.setattr(kept_port, "opened", self._open)

    async def _open(self, port: str, settings: LineSettings, options: LineOptions) -> AsyncLine:
        self.attempts.append(asyncio.get_running_loop().time())
        if not self.plugged:
            raise PortError(f"cannot open {port}: no such port")
        self.line = AsyncLine(settings, options, network=False, name=port)
        self.transport = WireTransport(self.wire.attach(), self.line)
        return self.line

    def unplug(self) -> None:
        self.plugged = False
        assert self.transport is not None
        assert self.line is not None
        self.transport.close()
        self.line.connection_lost(OSError("unplugged"))

    def switch_off(self, *addresses: int) -> None:
        self.wire.devices[:] = [one for one in self.all if one.address not in addresses]

    def service(self, **keys: object) -> LineService:
        keys = {"timeout": TIME_OUT, **keys}
        options = "".join(f",{key}={value}" for key, value in keys.items())
        return LineService(
            {f"d{one.address}": f"flexmax:{one.address}@wire{options}" for one in self.all}
        )


class Log:
    """What polling said, and when."""

    def __init__(self) -> None:
        self.all: list[tuple[float, Polled]] = []
        self._now = asyncio.get_running_loop().time

    def __call__(self, polled: Polled) -> None:
        self.all.append((self._now(), polled))

    def count(self, since: float = 0.0) -> Counter[tuple[str, Quality]]:
        return Counter((one.device, one.quality) for at, one in self.all if at >= since)

    def qualities(self, name: str) -> list[Quality]:
        return [one.quality for _, one in self.all if one.device == name]

    def times(self, name: str, quality: Quality = Quality.GOOD) -> list[float]:
        return [at for at, one in self.all if (one.device, one.quality) == (name, quality)]


Test = Callable[[World], Awaitable[None]]


def in_world(monkeypatch: pytest.MonkeyPatch, count: int, test: Test) -> None:
    async def main() -> None:
        await test(World(monkeypatch, count))

    in_virtual_time(main)
