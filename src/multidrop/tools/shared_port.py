"""The port that clients share: opened once its protocol is known, and again when it was lost."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping

from multidrop.errors import PortError, UsageError
from multidrop.io.async_line import AsyncLine, opened
from multidrop.io.connection import Target
from multidrop.io.line import Tap
from multidrop.naming import DeviceName, LineOptions
from multidrop.protocols import PROTOCOLS

FIRST_PAUSE, LONGEST_PAUSE = 0.25, 5.0
"""s between two attempts to open the port again: each time twice as long."""

Watch = Callable[[AsyncLine, Target], None]
"""Puts taps on a line that was just opened for the first time."""


def targets(port: str, options: Mapping[str, str]) -> dict[str, Target]:
    """The port as each protocol would have it. Raises `UsageError` for keys that none has."""
    own = {name: protocol.options for name, protocol in PROTOCOLS.items()}
    everybody = {key: text for keys in own.values() for key, text in keys.items()}
    if LineOptions.parse(options, everybody).attempts is not None:
        raise UsageError("attempts: a shared line asks once, its clients repeat what they want to")
    found = {}
    for name, keys in own.items():
        mine = {key: text for key, text in options.items() if key in keys or key not in everybody}
        target = Target(DeviceName(name, None, port, mine))
        target.settings = target.settings.with_options(attempts=1)
        found[name] = target
    return found


class SharedPort:
    """Keeps the port of `target` open. `line` is None while it is not."""

    def __init__(self, say: Callable[[str, str], None], watch: Watch) -> None:
        self.line: AsyncLine | None = None
        self.open = asyncio.Event()
        self.was_open = False
        self._say = say
        self._watch = watch
        self._taps: list[Tap] = []

    async def open_first(self, target: Target) -> None:
        """Open it, for what it is worth: a port that is not there is told at once. Raises `PortError`."""
        await self._open(target)

    async def keep(self, target: Target, lost: Callable[[], None]) -> None:
        """Open it, and open it again whenever it is lost; calls `lost` each time."""
        pause = FIRST_PAUSE
        said = ""
        loop = asyncio.get_running_loop()
        while True:
            if self.line is None:
                try:
                    await self._open(target)
                except PortError as error:
                    if str(error) != said:
                        said = str(error)
                        self._say("port-closed", f"{error}; trying again")
                    await asyncio.sleep(pause)
                    pause = min(2 * pause, LONGEST_PAUSE)
                    continue
            assert self.line is not None
            opened_at, said = loop.time(), ""
            why = await self.line.gone()
            self.line = None
            self.open.clear()
            lost()
            self._say("port-lost", f"{why}; clients hear nothing until it is back, trying again")
            if loop.time() - opened_at > LONGEST_PAUSE:
                pause = FIRST_PAUSE
            await asyncio.sleep(pause)
            pause = min(2 * pause, LONGEST_PAUSE)

    async def _open(self, target: Target) -> None:
        line = await opened(target.port, target.settings, target.options)
        if not self.was_open:
            self._watch(line, target)
            self._taps = line.taps
        line.taps = self._taps  # a capture goes on where it was
        settings = target.settings
        again = "open again" if self.was_open else "open"
        self.line = line
        self.was_open = True
        self.open.set()
        self._say(
            "port-open",
            f"{target.port} is {again}: {target.protocol.name} {settings.baud} {settings.format}",
        )

    async def close(self) -> None:
        if self.line is not None:
            await self.line.close()


async def try_port(target: Target) -> None:
    """Open a port and close it: its protocol, and so its settings, are not known yet. Raises `PortError`."""
    line = await opened(target.port, target.settings, target.options)
    await line.close()
