"""The port that clients share: opened once its protocol is known, and again when it was lost."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Mapping

from multidrop.errors import PortError, UsageError
from multidrop.io.async_line import AsyncLine, opened
from multidrop.io.connection import Target
from multidrop.io.kept_port import KeptPort
from multidrop.io.line import Tap
from multidrop.naming import DeviceName, LineOptions
from multidrop.protocols import PROTOCOLS

Watch = Callable[[list[Tap], Target], None]
"""Adds to the taps of a line whose protocol was just told. Raises `UsageError`."""


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
    """Keeps the port open once its protocol is known, and says when it is lost and back."""

    def __init__(
        self, say: Callable[[str, str], None], watch: Watch, lost: Callable[[], None]
    ) -> None:
        self.target: Target | None = None
        self.open = asyncio.Event()
        self._known = asyncio.Event()
        self._say = say
        self._watch = watch
        self._lost = lost
        self._kept: KeptPort | None = None

    @property
    def line(self) -> AsyncLine:
        """Raises `PortError` while the port is away."""
        if self._kept is None:
            raise PortError("nobody has spoken yet, the port is not open")
        return self._kept.line

    @property
    def away(self) -> bool:
        """Whether it was open, and is not."""
        return not self.open.is_set() and self._kept is not None and self._kept.times_opened > 0

    def settle(self, target: Target) -> None:
        """The protocol is known, and so are the settings."""
        self.target = target
        self._kept = KeptPort(target, self._was_opened, self._was_lost)
        self._known.set()

    async def keep_open(self) -> None:
        """Until cancelled. Raises `UsageError`."""
        await self._known.wait()
        assert self._kept is not None
        assert self.target is not None
        self._watch(self._kept.taps, self.target)  # a capture goes on over all openings
        await self._kept.keep_open()

    async def first_try(self) -> None:
        """Wait until it was tried to open it. Raises `PortError` where that failed."""
        await self._known.wait()
        assert self._kept is not None
        await self._kept.tried.wait()
        if self._kept.lost is not None:
            raise self._kept.lost

    def _was_opened(self) -> None:
        assert self._kept is not None
        assert self.target is not None
        again = " again" if self._kept.times_opened > 1 else ""
        settings = self.target.settings
        self._say(
            "port-open",
            f"{self.target.port} is open{again}: {self.target.protocol.name} {settings.baud} "
            f"{settings.format}",
        )
        self.open.set()

    def _was_lost(self) -> None:
        assert self._kept is not None
        self.open.clear()
        self._lost()
        self._say(
            "port-lost", f"{self._kept.lost}; clients hear nothing until it is back, trying again"
        )


async def try_port(target: Target) -> None:
    """Open a port and close it: its protocol, and so its settings, are not known yet. Raises `PortError`."""
    line = await opened(target.port, target.settings, target.options)
    await line.close()
