"""A port that is kept open: opened again when it was lost, with a pause that grows."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable

from multidrop.errors import PortError, UsageError
from multidrop.io.async_line import AsyncLine, opened
from multidrop.io.connection import Target
from multidrop.io.health import total
from multidrop.io.line import Tap
from multidrop.io.ports import port_error
from multidrop.session import Counters

FIRST_PAUSE, LONGEST_PAUSE = 0.1, 1.0
"""s before a port is tried again, and what that grows to: an adapter is found within a second."""

STEADY = 5.0
"""s after which an open port counts as one that stays: the next pause is a short one again."""

CLOSING = 2.0
"""s that a lost port is given to be let go."""


class KeptPort:
    """The line on a port, while it is there.

    `on_open` is called whenever it is there again, `on_lost` whenever it is not any more.
    """

    def __init__(
        self,
        target: Target,
        on_open: Callable[[], None],
        on_lost: Callable[[], None] = lambda: None,
    ) -> None:
        self._target = target
        self._on_open = on_open
        self._on_lost = on_lost
        self._line: AsyncLine | None = None
        self._past = Counters()
        self.taps: list[Tap] = []
        self.times_opened = 0
        self.lost: PortError | None = PortError(f"{target.port} was not opened yet")
        self.tried = asyncio.Event()

    @property
    def line(self) -> AsyncLine:
        """Raises `PortError` while the port is away."""
        if self._line is None:
            assert self.lost is not None
            raise PortError(str(self.lost)) from self.lost
        return self._line

    @property
    def counters(self) -> Counters:
        """Of all the times that the port was open."""
        return total([self._past] if self._line is None else [self._past, self._line.counters])

    async def keep_open(self) -> None:
        """Open the port, and open it again whenever it is lost. Raises `UsageError`."""
        pause = FIRST_PAUSE
        now = asyncio.get_running_loop().time
        while True:
            began = now()
            try:
                line = await opened(self._target.port, self._target.settings, self._target.options)
            except UsageError:
                raise
            except Exception as why:  # also what nobody foresaw: it is tried again for months
                self.lost = (
                    why if isinstance(why, PortError) else port_error(self._target.port, why)
                )
                self.tried.set()
            else:
                await self._until_lost(line)
            if now() - began >= STEADY:
                pause = FIRST_PAUSE
            await asyncio.sleep(pause)
            pause = min(2 * pause, LONGEST_PAUSE)

    async def _until_lost(self, line: AsyncLine) -> None:
        gone = asyncio.Event()
        line.on_lost = gone.set
        line.taps = self.taps
        self._line, self.lost = line, None
        self.times_opened += 1
        self.tried.set()
        self._on_open()
        try:
            if line.lost is None:
                await gone.wait()
        finally:
            self.lost = line.lost or PortError(f"{line.name} was closed")
            self._past, self._line = self.counters, None
            if line.lost is not None:
                self._on_lost()
            with contextlib.suppress(Exception):  # what is gone cannot always be closed in order
                async with asyncio.timeout(CLOSING):
                    await line.close()
