"""A line to a simulated AX-V and two drives, blocking or asyncio, in a time of its own."""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from typing import TypeVar

from integration.virtual_time import VirtualTimeLoop, WireTransport

from multidrop.io.async_line import AsyncLine
from multidrop.io.line import Line
from multidrop.io.memory import MemoryPort
from multidrop.naming import LineOptions
from multidrop.protocols import slink3
from multidrop.protocols.slink3 import AX_V, FLEXMAX, Format, Master
from multidrop.sim.line import SimulatedLine
from unit.sim.wires import scripted, simulated

ResultT = TypeVar("ResultT")

DRIVE, OTHER, AX = Master(0, FLEXMAX), Master(1, FLEXMAX), Master(2, AX_V)
INT = Format.SHORT_INT


def blocking(wire: SimulatedLine | None = None, *, marks: bool = False) -> Line:
    port = MemoryPort((wire or simulated()).attach(), marks=marks)
    return Line(port, slink3.LINE, LineOptions())


def asyncio_line(wire: SimulatedLine | None = None) -> AsyncLine:
    """To be called in a running loop."""
    line = AsyncLine(slink3.LINE, LineOptions(), network=False)
    WireTransport((wire or simulated()).attach(), line)
    return line


def in_virtual_time(main: Callable[[], Awaitable[ResultT]]) -> ResultT:
    """Run a coroutine in a loop whose clock moves only when nothing is left to do."""

    async def run() -> ResultT:
        return await main()

    loop = VirtualTimeLoop()
    try:
        return loop.run_until_complete(run())
    finally:
        loop.run_until_complete(loop.shutdown_asyncgens())
        loop.close()


__all__ = [
    "AX",
    "DRIVE",
    "INT",
    "OTHER",
    "asyncio",
    "asyncio_line",
    "blocking",
    "in_virtual_time",
    "scripted",
    "simulated",
]
