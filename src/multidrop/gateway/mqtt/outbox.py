"""States that wait on disk for a broker that is away, and follow in order when it is back.

While the broker confirms what it is given nothing is written. What it has not confirmed for half
a second goes into the outbox with all that is behind it, and from then on everything takes that
way until nothing waits any more. docs/reference/mqtt.md says what a subscriber can rely on.
"""

from __future__ import annotations

import asyncio
import contextlib
import sqlite3
import time
import zlib
from collections import deque
from collections.abc import Callable, Collection, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ParamSpec, Self, TypeVar

from multidrop.errors import UsageError
from multidrop.gateway.gaps import Gap
from multidrop.gateway.mqtt.broker import AT_ONCE, aiomqtt, publish_together
from multidrop.gateway.mqtt.lots import Lot, State, joined, packed, unpack
from multidrop.gateway.mqtt.topics import Topics, gap_payload, state_payload
from multidrop.gateway.outbox import OVERFLOW, Outbox, demand_outbox
from multidrop.gateway.settings import demand_writable, objections
from multidrop.gateway.stamps import microseconds
from multidrop.gateway.values import Update

if TYPE_CHECKING:
    from multidrop.gateway.outbox import Waiting
    from multidrop.gateway.settings import Settings

KEEP_EVERY = 0.5
"""s between two looks at what the broker has not confirmed; what is that old goes to the disk."""

FORGET_EVERY = 1.0
"""s after which what was delivered leaves the disk, while more of it follows."""

MOST_IN_MEMORY = 10_000
"""States that wait where the disk takes none; beyond it the oldest go."""

WEIGH_EVERY = 10.0
"""s after which it is found out again how many bytes a state takes."""

RECEIVED = 1
"""QoS of states: the broker confirms each."""

ParamsT = ParamSpec("ParamsT")
ResultT = TypeVar("ResultT")


@dataclass(frozen=True, slots=True)
class MqttState:
    """`error`: why nothing goes to the broker. `waiting`: states it has not confirmed.

    `hours`: how long it may be away at the present rate. The last two are None without an outbox.
    """

    error: str | None
    waiting: int | None = None
    hours: float | None = None


class Backlog:
    """Everything that the broker has not confirmed, in order: in memory, else in the outbox.

    Use it in an `async with`: at its end what is in memory goes to the disk. Raises `UsageError`
    where nothing can be written.
    """

    def __init__(self, outbox: Outbox, now: Callable[[], float] = time.monotonic) -> None:
        self.error: str | None = None
        self.followed = 0  # states out of the outbox, since the last `put_back`
        self.confirmed: set[str] = set()  # topics, since the last `put_back`
        self._outbox = outbox
        self._now = now
        try:
            self._run = outbox.begin_run()
        except sqlite3.Error as error:
            raise UsageError(f"{outbox.path}: no outbox can be kept here: {error}") from None
        self._number = 0
        self._newest: dict[str, tuple[Update, State]] = {}
        self._fresh: deque[State] = deque()
        self._lost: Gap | None = None
        self._flying: Lot | None = None
        self._behind = not outbox.delivered
        self._forgot = now()
        self._rate = Rate(now)
        self._turn = asyncio.Lock()
        self._disk = ThreadPoolExecutor(1, "mqtt-outbox")
        self._keeper: asyncio.Task[None] | None = None

    async def __aenter__(self) -> Self:
        self._keeper = asyncio.create_task(self._keep())
        return self

    async def __aexit__(self, *_: object) -> None:
        await asyncio.shield(self._end())

    @property
    def waiting(self) -> int:
        """States that are not confirmed."""
        flying = self._flying
        in_flight = len(flying.states) if flying is not None and flying.number is None else 0
        return self._outbox.samples + len(self._fresh) + in_flight

    @property
    def hours(self) -> float | None:
        """How long the broker may be away at the present rate; None before it is known."""
        return self._outbox.hours

    def __str__(self) -> str:
        """Where what waits is, and how long it may."""
        hours = self.hours
        room = "" if hours is None else f", with room for {hours:.3g} h"
        return f"states wait in {self._outbox.path}{room}"

    def add(self, topic: str, update: Update) -> None:
        """A state that is to be published; the same update again is the same record."""
        now = self._now()
        known = self._newest.get(topic)
        if known is not None and known[0] is update:
            state = known[1]._replace(added=now)
        else:
            self._number += 1
            record = self._run, self._number
            when = microseconds(update.polled.time)
            state = State(topic, state_payload(update, record), when, record, now)
            self._newest[topic] = update, state
            self._rate.take(state)
        if len(self._fresh) >= MOST_IN_MEMORY:
            gone = self._fresh.popleft()
            self._lost = joined(self._lost, Gap(gone.time, gone.time, OVERFLOW, 1))
        self._fresh.append(state)

    # -- to the broker -------------------------------------------------------------------------

    async def deliver(
        self, client: aiomqtt.Client, topics: Topics, retained: Collection[str]
    ) -> None:
        """Until nothing waits; only `retained` topics are. Raises `MqttError`, `UsageError`.

        What it leaves unconfirmed it still has; `put_back` says that it will not be.
        """
        while (lot := await self._next()) is not None:
            messages = [
                (state.topic, state.payload, state.topic in retained) for state in lot.states
            ]
            if lot.lost is not None:
                gap = gap_payload(lot.lost, lot.states[0].record)
                messages.insert(0, (topics.gap, gap, False))
            await publish_together(client, messages, RECEIVED)
            await self._done(lot)
            await asyncio.sleep(0)  # publishing may not wait, and others want to run

    async def put_back(self) -> None:
        """The connection is gone: what was sent and not confirmed is sent again on the next."""
        async with self._turn:
            lot, self._flying = self._flying, None
            if lot is not None and lot.number is None:
                self._fresh.extendleft(reversed(lot.states))
                self._lost = joined(lot.lost, self._lost)
            self.confirmed.clear()
            self.followed = 0
            await self._on_disk(self._outbox.put_back)

    async def _next(self) -> Lot | None:
        async with self._turn:
            if self._behind:
                waiting = await self._read(self._outbox.take)
                if waiting:
                    self._flying = self._unpacked(waiting[0])
                    return self._flying
                await self._forget()
                self._behind = False
            if not self._fresh:
                return None
            count = min(AT_ONCE, len(self._fresh))
            lot = Lot([self._fresh.popleft() for _ in range(count)], self._lost)
            self._lost, self._flying = None, lot
            return lot

    def _unpacked(self, waiting: Waiting) -> Lot:
        try:
            return unpack(waiting)
        except (zlib.error, ValueError, KeyError, TypeError):
            raise UsageError(
                f"mqtt.outbox {self._outbox.path}: what waits in it is damaged, or history's: move it away"
            ) from None

    async def _done(self, lot: Lot) -> None:
        async with self._turn:
            if lot.number is not None:
                await self._read(self._outbox.done, lot.number)
                self.followed += len(lot.states)
                if self._now() - self._forgot >= FORGET_EVERY:
                    await self._forget()
            self._flying = None
            self.confirmed.update(state.topic for state in lot.states)

    async def _forget(self) -> None:
        """What is not forgotten comes again after a kill, with the same record."""
        self._forgot = self._now()
        with contextlib.suppress(sqlite3.Error):
            await self._on_disk(self._outbox.forget)

    # -- to the disk ---------------------------------------------------------------------------

    async def _keep(self) -> None:
        while True:
            await asyncio.sleep(KEEP_EVERY)
            await self.keep()

    async def keep(self, age: float = KEEP_EVERY) -> None:
        """Put on the disk what has waited for `age` s, with all that is behind it."""
        async with self._turn:
            flying = self._flying
            if flying is not None and flying.number is not None:
                flying = None
            oldest = flying.states[0] if flying else self._fresh[0] if self._fresh else None
            if oldest is None or self._now() - oldest.added < age:
                self._outbox.note(self._rate.would_be())
            else:
                await self._put(flying)

    async def _put(self, flying: Lot | None) -> None:
        fresh, self._fresh = list(self._fresh), deque()
        lost, self._lost = self._lost, None
        lots = [Lot(fresh[at : at + AT_ONCE]) for at in range(0, len(fresh), AT_ONCE)]
        if lots:
            lots[0].lost = lost
        else:
            self._lost = lost
        if flying is not None:
            lots.insert(0, flying)
        records = [packed(lot) for lot in lots]
        try:
            await self._on_disk(self._outbox.put, records)
        except sqlite3.Error as error:
            self.error = f"{self._outbox.path}: {error}"
            self._fresh.extendleft(reversed(fresh))
            self._lost = joined(lost, self._lost)
            return
        self.error = None
        self._behind = True
        self._rate.would_be()  # the outbox has counted these itself
        if flying is not None:
            flying.number = await self._number_of(records[0][0])

    async def _number_of(self, data: bytes) -> int:
        """Of the first that waits in the outbox; 0 where that is another: the bound pushed it out."""
        with contextlib.suppress(sqlite3.Error):  # then it comes again, with the same records
            for first in await self._on_disk(self._outbox.take):
                if first.data == data:
                    return first.number
        return 0

    async def _end(self) -> None:
        async with self._turn:  # so that nothing is ended while it writes
            if self._keeper is not None:
                self._keeper.cancel()
        await self.put_back()
        await self.keep(0.0)
        await self._on_disk(self._outbox.close)
        self._disk.shutdown()

    async def _read(
        self, work: Callable[ParamsT, ResultT], *given: ParamsT.args, **more: ParamsT.kwargs
    ) -> ResultT:
        """An outbox that cannot be read ends the connection: another attempt is made later."""
        try:
            return await self._on_disk(work, *given, **more)
        except sqlite3.Error as error:
            raise aiomqtt.MqttError(f"{self._outbox.path}: {error}") from None

    async def _on_disk(
        self, work: Callable[ParamsT, ResultT], *given: ParamsT.args, **more: ParamsT.kwargs
    ) -> ResultT:
        """In a thread, one after the other: a disk may take long."""
        loop = asyncio.get_running_loop()
        return await loop.run_in_executor(self._disk, lambda: work(*given, **more))


def backlog_of(settings: Settings) -> Backlog | None:
    """The one that `[mqtt]` names, if it does. Raises `UsageError`."""
    table = settings.mqtt
    if table is None or table.outbox is None:
        return None
    return Backlog(Outbox(settings.path(table.outbox), round(table.outbox_size * 1e6)))


def state_of(error: str | None, backlog: Backlog | None) -> MqttState:
    if backlog is None:
        return MqttState(error)
    return MqttState(error or backlog.error, backlog.waiting, backlog.hours)


def wrong_with_outbox(settings: Settings) -> Iterator[str]:
    """What is wrong with the outbox that `[mqtt]` names."""
    table = settings.mqtt
    if table is None or table.outbox is None:
        return
    path = settings.path(table.outbox)
    yield from objections(
        lambda: _demand_own(path, settings),
        lambda: demand_writable("mqtt.outbox", path),
        lambda: demand_outbox(path, "mqtt.outbox"),
    )


def _demand_own(path: Path, settings: Settings) -> None:
    """Raises `UsageError` where history has the same file."""
    history = settings.history
    if history is None:
        return
    key = "path" if history.dsn is None else "outbox"
    if settings.path(getattr(history, key)) == path:
        raise UsageError(f"mqtt.outbox is {path}, and so is history.{key}")


class Rate:
    """How many bytes of an outbox the states would take, while none is written."""

    def __init__(self, now: Callable[[], float]) -> None:
        self._now = now
        self._count = 0
        self._newest: deque[State] = deque(maxlen=AT_ONCE)
        self._each = 0.0  # bytes
        self._weighed = float("-inf")

    def take(self, state: State) -> None:
        self._count += 1
        self._newest.append(state)

    def would_be(self) -> int:
        """Bytes of what came since the last time it was asked."""
        if self._newest and self._now() - self._weighed >= WEIGH_EVERY:
            self._weighed = self._now()
            self._each = len(packed(Lot(list(self._newest)))[0]) / len(self._newest)
        count, self._count = self._count, 0
        return round(count * self._each)
