"""Turns on one wire: who speaks next.

One conversation owns the wire from its first to its last step. Whoever wants it
next waits in `Waiting`, which is pure; `Turns` wakes the tasks of one asyncio loop.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections import deque
from collections.abc import Hashable
from enum import IntEnum
from typing import Generic, TypeVar

WaiterT = TypeVar("WaiterT")


class Priority(IntEnum):
    """Whose conversation goes first when a turn is over."""

    WRITE = 0
    OPERATOR = 1  # a person waits for the answer
    POLL = 2
    BACKGROUND = 3  # scans, probes of silent devices


PASSED_OVER = 16
"""Polls in a row that go before somebody in the background; then it has one turn."""


class Waiting(Generic[WaiterT]):
    """Those who wait for a turn, and which of them is next. No clock and no loop in here.

    A higher priority always goes first, but for one thing: after `PASSED_OVER`
    polls in a row the background has one turn. So a line full of polls does not
    starve it, and a write or a person never waits for more than the turn that
    is under way and those of their own kind.

    Within a priority the devices take turns: while one waits, each other device
    is served at most once. Those who wait for the same device are served in
    the order in which they came.
    """

    def __init__(self) -> None:
        self._queues: tuple[dict[Hashable, deque[WaiterT]], ...] = tuple({} for _ in Priority)
        self._count = 0
        self._passed_over = 0

    def __len__(self) -> int:
        return self._count

    def add(self, waiter: WaiterT, priority: Priority, device: Hashable) -> None:
        """`device` is who the conversation is with; those with None share one place."""
        self._queues[priority].setdefault(device, deque()).append(waiter)
        self._count += 1

    def remove(self, waiter: WaiterT, priority: Priority, device: Hashable) -> None:
        """Somebody gave up waiting. Raises `ValueError` where it does not wait."""
        queue = self._queues[priority].get(device, deque())
        queue.remove(waiter)
        if not queue:
            del self._queues[priority][device]
        self._count -= 1

    @property
    def only_background(self) -> bool:
        """Whether those who wait, if any, are all in the background."""
        return not any(self._queues[: Priority.BACKGROUND])

    def pop(self) -> WaiterT | None:
        """Whose turn it is now; None if nobody waits."""
        if not self._count:
            return None
        priority = self._next_priority()
        devices = self._queues[priority]
        device = next(iter(devices))
        queue = devices.pop(device)
        waiter = queue.popleft()
        if queue:
            devices[device] = queue  # behind the others
        self._count -= 1
        return waiter

    def _next_priority(self) -> Priority:
        first = next(priority for priority in Priority if self._queues[priority])
        if first is Priority.POLL and self._queues[Priority.BACKGROUND]:
            if self._passed_over >= PASSED_OVER:
                first = Priority.BACKGROUND
            else:
                self._passed_over += 1
        if first is Priority.BACKGROUND:
            self._passed_over = 0
        return first


class Turns:
    """The turn on one wire, for the tasks of one loop::

    if not turns.take():
        await turns.wait(priority, device)
    try:
        ...
    finally:
        turns.release()
    """

    def __init__(self) -> None:
        self.taken = False
        self._waiting: Waiting[asyncio.Future[None]] = Waiting()

    def __len__(self) -> int:
        """How many wait."""
        return len(self._waiting)

    def take(self) -> bool:
        """Take the turn if it is free and nobody waits."""
        if self.taken or len(self._waiting):
            return False
        self.taken = True
        return True

    async def wait(self, priority: Priority, device: Hashable) -> None:
        """Wait until the turn is the caller's. Who is cancelled leaves no trace."""
        turn = asyncio.get_running_loop().create_future()
        self._waiting.add(turn, priority, device)
        self._give()
        try:
            await turn
        except asyncio.CancelledError:
            if turn.cancelled():
                with contextlib.suppress(ValueError):  # `_give` met it first
                    self._waiting.remove(turn, priority, device)
            else:  # it had just been given the turn
                self.release()
            raise

    def release(self) -> None:
        """The turn is over: the next one has it.

        The background has it only when the loop comes round: until then the caller may
        ask for the next poll, which goes first although it did not wait.
        """
        self.taken = False
        if not len(self._waiting):
            return
        if self._waiting.only_background:
            asyncio.get_running_loop().call_soon(self._give)
        else:
            self._give()

    def _give(self) -> None:
        """Give a turn that is free to the first of those who wait."""
        while not self.taken and (turn := self._waiting.pop()) is not None:
            if not turn.cancelled():
                self.taken = True
                turn.set_result(None)
