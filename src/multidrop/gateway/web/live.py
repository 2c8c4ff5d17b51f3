"""Live values for many browsers: each update is written as JSON once, however many listen.

A listener who is slow is never waited for and never fills the memory: it is told the
newest of every point that changed since it was told last.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from dataclasses import dataclass

from multidrop.gateway.values import Key, Update, Values

SOON = 0.01
"""s that updates wait for others, to travel together."""

FOR_EACH = 0.0002
"""s more for each listener: a hundred of them must not keep the lines waiting."""

LATEST = 0.1
"""s that they wait at most."""


@dataclass(slots=True)
class _Entry:
    number: int
    update: Update
    text: str = ""


class Live:
    """The newest of all points, numbered as they came. Stands among the listeners of `values`.

    `write` makes an update JSON.
    """

    def __init__(self, values: Values, write: Callable[[Update], str]) -> None:
        self.listeners = 0
        self.closed = False
        self._values = values
        self._write = write
        self._number = 0
        self._entries: dict[Key, _Entry] = {}
        self._next: asyncio.Future[None] = asyncio.get_running_loop().create_future()
        self._called = False
        self._told: dict[tuple[int, frozenset[str] | None], tuple[int, str]] = {}
        for update in values.latest.values():
            self._take(update)
        values.listeners.append(self._take)

    def _take(self, update: Update) -> None:
        self._number += 1
        key = update.key
        entry = self._entries.pop(key, None)
        if entry is None:
            entry = _Entry(self._number, update)
        else:
            entry.number, entry.update, entry.text = self._number, update, ""
        self._entries[key] = entry  # the newest are at the end
        if self.listeners and not self._called:
            self._called = True
            wait = min(LATEST, SOON + FOR_EACH * self.listeners)
            asyncio.get_running_loop().call_later(wait, self._call)

    def _call(self) -> None:
        self._called = False
        self._told.clear()
        called, self._next = self._next, asyncio.get_running_loop().create_future()
        called.set_result(None)

    def close(self) -> None:
        """Every listener is let go."""
        self.closed = True
        self._call()

    async def wait(self, timeout: float) -> None:
        """Until something is new, or `timeout` s."""
        await asyncio.wait([self._next], timeout=timeout)

    def since(self, number: int, devices: frozenset[str] | None = None) -> tuple[int, str]:
        """What is new after `number`: up to which number, and a JSON list; "" where nothing is.

        `devices` are those that are wanted, None all.
        """
        known = self._told.get((number, devices))
        if known is None:
            known = self._told[number, devices] = self._number, self._text(number, devices)
        return known

    def _text(self, number: int, devices: frozenset[str] | None) -> str:
        texts = []
        for key, entry in reversed(self._entries.items()):
            if entry.number <= number:
                break
            if (devices is None or key[0] in devices) and key in self._values.latest:
                entry.text = entry.text or self._write(entry.update)
                texts.append(entry.text)
        return f"[{','.join(reversed(texts))}]" if texts else ""
