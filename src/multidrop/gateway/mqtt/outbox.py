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
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, ParamSpec, Self, TypeVar

from multidrop.errors import PortError, UsageError
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

LOTS_AT_ONCE = 16
"""Lots that are taken out of the outbox together: a disk that is asked for each alone keeps a quick broker waiting."""

RECEIVED = 1
"""QoS of states: the broker confirms each."""

ParamsT = ParamSpec("ParamsT")
ResultT = TypeVar("ResultT")


class Backlog:
    """Everything that the broker has not confirmed, in order: in memory, else in the outbox.

    Use it in an `async with`: at its end what is in memory goes to the disk. `news` is told when
    the disk takes nothing, and when it does again. Raises `PortError` where it takes nothing now.
    """

    def __init__(
        self,
        outbox: Outbox,
        now: Callable[[], float] = time.monotonic,
        *,
        news: Callable[[str], None] = lambda text: None,
    ) -> None:
        self.error: str | None = None
        self.since: datetime | None = None  # of the error
        self.followed = 0  # states out of the outbox, since the last `put_back`
        self.confirmed: set[str] = set()  # topics, since the last `put_back`
        self._outbox = outbox
        self._now = now
        self._news = news
        try:
            self._run = outbox.begin_run()
        except sqlite3.Error as error:
            raise PortError(f"{outbox.path}: no outbox can be kept here: {error}") from None
        self._number = 0
        self._newest: dict[str, tuple[Update, State]] = {}
        self._fresh: deque[State] = deque()
        self._lost: Gap | None = None
        self._flying: Lot | None = None
        self._ahead: deque[Waiting] = deque()  # out of the outbox, to be sent next
        self._confirmed_to = 0  # number of the last record that was confirmed
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

    @property
    def left(self) -> float | None:
        """How much longer, with what waits already."""
        return self._outbox.left

    def __str__(self) -> str:
        """Where what waits is, and how long it may."""
        room = "" if self.left is None else f", with room for {self.left:.3g} h"
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
        self,
        client: aiomqtt.Client,
        topics: Topics,
        retained: Collection[str],
        ends: Callable[[], bool] = lambda: False,
    ) -> None:
        """Until all is sent that waited, or `ends`; only `retained` topics are. Raises `MqttError`.

        What comes meanwhile gathers for the next time. What it leaves unconfirmed it still has;
        `put_back` says that it will not be.
        """
        while not ends() and (lot := await self._next()) is not None:
            messages = [
                (state.topic, state.payload, state.topic in retained) for state in lot.states
            ]
            if lot.lost is not None:
                gap = gap_payload(lot.lost, lot.states[0].record)
                messages.insert(0, (topics.gap, gap, False))
            await publish_together(client, messages, RECEIVED)
            in_memory = lot.number is None
            await self._done(lot)
            if in_memory and len(lot.states) < AT_ONCE:
                return
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
            self._ahead.clear()
            with contextlib.suppress(sqlite3.Error):  # then it comes again, with the same records
                await self._on_disk(self._outbox.done, self._confirmed_to)
            await self._on_disk(self._outbox.put_back)

    async def _next(self) -> Lot | None:
        async with self._turn:
            if self._behind and not self._ahead:
                self._ahead.extend(await self._read(self._take))
                if not self._ahead:
                    await self._forget()
                    self._behind = False
                elif self._now() - self._forgot >= FORGET_EVERY:
                    await self._forget()
            if self._ahead:
                self._flying = self._unpacked(self._ahead.popleft())
                return self._flying
            if not self._fresh:
                return None
            count = min(AT_ONCE, len(self._fresh))
            lot = Lot([self._fresh.popleft() for _ in range(count)], self._lost)
            self._lost, self._flying = None, lot
            return lot

    def _take(self) -> list[Waiting]:
        """In the thread of the disk. Until the next time nothing of it can be pushed out."""
        self._outbox.done(self._confirmed_to)
        return self._outbox.take(LOTS_AT_ONCE)

    def _unpacked(self, waiting: Waiting) -> Lot:
        try:
            return unpack(waiting)
        except (zlib.error, ValueError, KeyError, TypeError):
            raise aiomqtt.MqttError(  # the plant goes on, and the page says it
                f"mqtt.outbox {self._outbox.path}: what waits in it is damaged, or history's: move it away"
            ) from None

    async def _done(self, lot: Lot) -> None:
        async with self._turn:
            if lot.number is not None:
                self._confirmed_to = max(self._confirmed_to, lot.number)
                self.followed += len(lot.states)
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
            elif self.error is None or await self._put(flying, AT_ONCE):
                await self._put(flying if flying and flying.number is None else None)

    async def _put(self, flying: Lot | None, most: int = MOST_IN_MEMORY) -> bool:
        """So many states at most; where the disk took none, little is tried first. Whether it takes them."""
        count = min(most, len(self._fresh))
        fresh = [self._fresh.popleft() for _ in range(count)]
        lots = [Lot(fresh[at : at + AT_ONCE]) for at in range(0, count, AT_ONCE)]
        lost = None
        if lots:
            lots[0].lost, lost, self._lost = self._lost, self._lost, None
        if flying is not None:
            lots.insert(0, flying)
        if not lots:
            return True
        try:
            first = await self._on_disk(self._write, lots)
        except sqlite3.Error as error:
            self._fresh.extendleft(reversed(fresh))
            self._lost = joined(lost, self._lost)
            self._is_written(str(error))
            return False
        self._is_written(None)
        self._behind = True
        self._rate.would_be()  # the outbox has counted these itself
        if flying is not None:
            flying.number = await self._number_of(first)
        return True

    def _write(self, lots: list[Lot]) -> bytes:
        """In the thread of the disk: to make thousands of states smaller takes long. The bytes of the first."""
        records = [packed(lot) for lot in lots]
        self._outbox.put(records)
        return records[0][0]

    def _is_written(self, error: str | None) -> None:
        """Each change once: it should stand in a log."""
        if error is not None and self.error is None:
            self.since = datetime.now(UTC)
            self._news(f"mqtt: {self._outbox.path}: {error}")
        elif error is None and self.error is not None:
            self._news(f"mqtt: {self._outbox.path} is written again")
        self.error = None if error is None else f"{self._outbox.path}: {error}"

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
        if self._fresh:
            self._news(f"mqtt: {len(self._fresh)} states that waited in memory are lost")
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


def backlog_of(settings: Settings, news: Callable[[str], None]) -> Backlog | None:
    """The one that `[mqtt]` names, if it does. Raises `UsageError`, and `PortError` where the disk is full."""
    table = settings.mqtt
    if table is None or table.outbox is None:
        return None
    return Backlog(Outbox(settings.path(table.outbox), round(table.outbox_size * 1e6)), news=news)


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
