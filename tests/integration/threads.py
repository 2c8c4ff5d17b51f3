"""Simulated devices behind a TCP port, in a thread of the test: quicker to start than a process."""

from __future__ import annotations

import asyncio
import contextlib
import threading
from collections.abc import Iterator

from integration.processes import PATIENCE, Address
from multidrop.naming import parse_simulated
from multidrop.protocols import slink3
from multidrop.sim.devices import simulated_device
from multidrop.sim.line import SimulatedLine
from multidrop.sim.serve import serve


@contextlib.contextmanager
def simulated(*devices: str) -> Iterator[Address]:
    """These devices with their default values, as `multidrop simulate` would serve them."""
    made = [simulated_device(*parse_simulated(text)) for text in devices]
    with served(SimulatedLine(made, slink3.decoder)) as address:
        yield address


@contextlib.contextmanager
def served(line: SimulatedLine) -> Iterator[Address]:
    """A simulated line behind a TCP port; its devices stay within the test's reach."""
    loop = asyncio.new_event_loop()
    listener = loop.run_until_complete(serve(line, "tcp://127.0.0.1:0"))
    thread = threading.Thread(target=loop.run_forever, daemon=True)
    thread.start()
    try:
        yield Address(listener.port)
    finally:
        loop.call_soon_threadsafe(listener.close)
        asyncio.run_coroutine_threadsafe(_gone(), loop).result(PATIENCE)
        loop.call_soon_threadsafe(loop.stop)
        thread.join(PATIENCE)
        loop.close()


async def _gone() -> None:
    """Let what is open be closed: the other sides have gone."""
    await asyncio.sleep(0)
