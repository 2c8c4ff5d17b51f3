"""A shared line in the test's own loop: the simulated line, `share`, and masters on real sockets."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

from multidrop.events import FrameReceived
from multidrop.io.async_line import AsyncLine, opened
from multidrop.io.audit import AuditLog
from multidrop.io.listen import Listener
from multidrop.io.ports import tcp_address
from multidrop.protocols import PROTOCOLS
from multidrop.sim.devices import simulated_device
from multidrop.sim.line import Pace, SimulatedLine
from multidrop.sim.serve import serve
from multidrop.tools.share.port import targets
from multidrop.tools.share.share import Event, Rules, Share

PATIENCE = 20.0


class Sharing:
    """What is shared: where, what was said of it, and what passed on the wire."""

    def __init__(self, protocol: str) -> None:
        self.protocol = PROTOCOLS[protocol]
        self.port = ""
        self.events: list[Event] = []
        self.passed: list[tuple[bool, Any]] = []  # whether it was sent, and the frame
        self.share: Share
        self._decoder = self.protocol.line.decoder()
        self._said = asyncio.Event()

    def tap(self, data: bytes, sent: bool, now: float, damaged: bool) -> None:
        decoder = self.protocol.line.decoder() if sent else self._decoder
        for event in decoder.receive_data(data):
            if isinstance(event, FrameReceived):
                self.passed.append((sent, event.frame))

    def tell(self, event: Event) -> None:
        self.events.append(event)
        self._said.set()

    def kinds(self) -> list[str]:
        return [event.kind for event in self.events]

    async def told(self, kind: str, count: int = 1) -> Event:
        """Wait until something was said so often."""
        async with asyncio.timeout(PATIENCE):
            while self.kinds().count(kind) < count:
                self._said.clear()
                await self._said.wait()
        return [event for event in self.events if event.kind == kind][-1]

    def took_turns(self) -> bool:
        """Whether no request went out before the answer to the one before."""
        sent = [sent for sent, _ in self.passed]
        return sent == [True, False] * (len(sent) // 2)

    @contextlib.asynccontextmanager
    async def master(self) -> AsyncIterator[AsyncLine]:
        """A master of its own, as any program would be."""
        line = await opened(self.port, self.protocol.line, targets(self.port, {})["slink3"].options)
        async with line:
            yield line

    @contextlib.asynccontextmanager
    async def socket(self) -> AsyncIterator[tuple[asyncio.StreamReader, asyncio.StreamWriter]]:
        """A program that sends what it wants."""
        reader, writer = await asyncio.open_connection(*tcp_address(self.port))
        try:
            yield reader, writer
        finally:
            writer.close()
            with contextlib.suppress(ConnectionError):
                await writer.wait_closed()


def wire(protocol: str, *devices: tuple[str, int], pace: float = 0.0) -> SimulatedLine:
    """Simulated devices whose bytes take `pace` s each."""
    return SimulatedLine(
        [simulated_device(profile, address) for profile, address in devices],
        PROTOCOLS[protocol].line.decoder,
        pace=Pace(pace),
        character=PROTOCOLS[protocol].line.character,
    )


@contextlib.asynccontextmanager
async def shared(
    protocol: str,
    line: SimulatedLine | str,
    *,
    allow_writes: bool = False,
    told: bool = False,
    audit: Path | None = None,
    where: str = "tcp://127.0.0.1:0",
    **keys: str,
) -> AsyncIterator[Sharing]:
    """Share a simulated line, or a port; `told` says its protocol from the start."""
    sharing = Sharing(protocol)
    behind = await serve(line, "tcp://127.0.0.1:0") if isinstance(line, SimulatedLine) else None
    port = behind.port if behind is not None else str(line)
    rules = Rules(AuditLog(audit, origin="share"), allow_writes, protocol if told else None)
    ready = asyncio.Event()

    def listening(listener: Listener) -> None:
        sharing.port = listener.port
        ready.set()

    share = sharing.share = Share(
        targets(port, keys), rules, sharing.tell, lambda taps, target: taps.append(sharing.tap)
    )
    running = asyncio.ensure_future(share.run(where, listening))
    waiting = asyncio.ensure_future(ready.wait())
    await asyncio.wait((running, waiting), return_when=asyncio.FIRST_COMPLETED)
    waiting.cancel()
    try:
        if running.done():
            await running
        yield sharing
    finally:
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)
        if behind is not None:
            behind.close()
        for _ in range(5):  # let what is open be closed: the other sides have gone
            await asyncio.sleep(0)
