"""The history of a gateway: what is polled becomes samples, and samples go to a store twice a second.

A store that takes nothing (a full disk) costs nothing but the oldest samples once
`MOST_WAITING` of them wait in memory; what was lost is recorded as a gap. Polling never waits.
"""

from __future__ import annotations

import asyncio
import uuid
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from datetime import UTC, datetime
from functools import partial
from itertools import islice
from pathlib import Path
from typing import TypeVar

from multidrop.errors import PortError
from multidrop.gateway.gaps import Gap
from multidrop.gateway.gateway import Gateway
from multidrop.gateway.history.batching import Batching
from multidrop.gateway.history.records import Bucket, Kept, Sample, kept
from multidrop.gateway.history.reporting import Reporting, Rule
from multidrop.gateway.history.store import MOST_BUCKETS, Store
from multidrop.gateway.history.telling import HistoryState, metrics_of, trouble_of
from multidrop.gateway.settings import HistorySettings, Settings, demand_writable, objections
from multidrop.gateway.stamps import microseconds
from multidrop.gateway.telling import Metric, Trouble
from multidrop.gateway.values import Key, Update
from multidrop.io.poller import Polled, Quality
from multidrop.plant import Plant

EVERY = 0.5
"""s between two writings: what came since the last one is lost when the process is killed."""

MOST_SAMPLES = 100_000
"""Samples that one `range` returns."""

SOON = 5.0
"""s from an answer to its update at most; it is a matter of milliseconds."""

DAY = 86_400.0

ResultT = TypeVar("ResultT")


class History:
    """A part of the gateway. `take` is a listener of `Values`; the rest is for charts and exports.

    `rule_of` says by which rule a device's point is reported. `keep` (s): how long; 0 for ever.
    `news` is told when it cannot be written, and when it can again.
    """

    name = "history"

    def __init__(
        self,
        store: Store,
        rule_of: Callable[[str, str], Rule] = lambda device, point: Rule(),
        *,
        keep: float = 0.0,
        every: float = EVERY,
        news: Callable[[str], None] = lambda text: None,
    ) -> None:
        self.store = store
        self._news = news
        self._troubled: datetime | None = None  # since when
        self._rule_of = rule_of
        self._keep = keep
        self._every = every
        self._reporting: dict[Key, Reporting] = {}
        self._batching = Batching(uuid.uuid4().hex)
        self._writing = ThreadPoolExecutor(1, "history-write")
        self._asking = ThreadPoolExecutor(1, "history-ask")
        self._error: str | None = None
        self.recorded = 0  # samples in this run
        self.written = 0  # of them: safe in the store, or on their way in its outbox

    # -- what comes ----------------------------------------------------------------------------

    def take(self, update: Update) -> None:
        """A listener: records what is worth it."""
        device, point, polled, monotonic, _ = update
        reporting = self._reporting.get((device, point))
        rule = self._rule_of(device, point)
        if reporting is None:
            reporting = self._reporting[device, point] = Reporting(rule)
        reporting.rule = rule
        if reporting.repeats(value_of(polled), polled.quality, monotonic):
            reporting.hold(partial(sample_of, update))
        else:
            self.append(reporting.report(sample_of(update)))

    def forget(self, update: Update) -> None:
        """A listener: its point is no longer polled, and from here on nobody knows its value."""
        self.take(update)
        del self._reporting[update.key]

    def append(self, samples: Iterable[Sample]) -> None:
        """Record these as they are, in the order in which they happened."""
        samples = tuple(samples)
        if samples:
            self.recorded += len(samples)
            self._batching.take(samples)

    async def run(self) -> None:
        """Write twice a second, until cancelled; then what is left, and that the gateway stopped."""
        loop = asyncio.get_running_loop()
        try:
            while True:
                await asyncio.sleep(self._every)
                await self._write(loop.time())
                self._tell()
        finally:
            try:
                await asyncio.shield(self._end(loop.time()))
            finally:
                self.close()

    def close(self) -> None:
        """End the threads and the store; `run` does it when it ends."""
        self._writing.shutdown(wait=True)
        self._asking.shutdown(wait=True)
        self.store.close()

    async def _write(self, now: float, *, stop: bool = False) -> None:
        batches = self._batching.cut(now, stop=stop)
        if not batches:
            return
        newest = self._batching.settled
        forget = newest - round(self._keep * 1e6) if self._keep and newest is not None else None
        try:
            await _done(self._writing, lambda: self.store.write(batches, forget))
        except self.store.failures as error:
            self._error = str(error)
        else:
            self._error = None
            self._batching.written(len(batches))
            self.written += sum(len(batch.rows) for batch in batches)

    async def _end(self, now: float) -> None:
        await self._write(now, stop=True)

    def _tell(self) -> None:
        """Each change once: a disk that is full at night should stand in a log."""
        error = self.state.error
        if (error is None) is not (self._troubled is None):
            self._troubled = None if error is None else datetime.now(UTC)
            self._news(f"history: {error}" if error else "history: it is written again")

    @property
    def state(self) -> HistoryState:
        state = self.store.state
        waiting = self._batching.samples + state.waiting
        return HistoryState(self._error or state.error, waiting, self._batching.lost, state.hours)

    @property
    def trouble(self) -> Trouble | None:
        """Why samples are not where they should be, if they are not."""
        if self._troubled is None:
            return None
        waits = self._error is None
        return trouble_of(self.state, self._troubled, self.store.left, waits=waits)

    def metrics(self) -> Iterable[Metric]:
        return metrics_of(self.state)

    # -- what is asked -------------------------------------------------------------------------

    async def series(self) -> list[tuple[str, str]]:
        """Device and point of everything there is."""
        return await self._ask(self.store.series)

    async def latest(self, device: str, point: str) -> Sample | None:
        """The newest sample. Raises `UsageError` for a point without history."""
        return await self._ask(lambda: self.store.latest(device, point))

    async def range(
        self, device: str, point: str, start: int, end: int, most: int = MOST_SAMPLES
    ) -> list[Sample]:
        """The first `most` samples in `start` <= time < `end` (µs), in order."""

        def first() -> list[Sample]:
            with closing(self.store.range(device, point, start, end)) as samples:
                return list(islice(samples, most))

        return await self._ask(first)

    async def buckets(
        self, device: str, point: str, start: int, end: int, most: int = MOST_BUCKETS
    ) -> list[Bucket]:
        """What was in `start` <= time < `end` (µs), in at most `most` equal buckets."""
        return await self._ask(lambda: self.store.buckets(device, point, start, end, most))

    async def gaps(self, start: int, end: int) -> list[Gap]:
        """Where nothing was recorded, or recorded samples were lost."""
        return await self._ask(lambda: self.store.gaps(start, end))

    async def _ask(self, question: Callable[[], ResultT]) -> ResultT:
        """Raises `UsageError`, and `PortError` where the store does not answer."""
        try:
            return await _done(self._asking, question)
        except self.store.failures as error:
            raise PortError(f"the history cannot be read: {error}") from None
        except ValueError as error:
            raise PortError(f"the history is damaged: {error}") from None


async def _done(threads: ThreadPoolExecutor, work: Callable[[], ResultT]) -> ResultT:
    return await asyncio.get_running_loop().run_in_executor(threads, work)


def value_of(polled: Polled) -> Kept:
    """The value that was just read; None where none was."""
    if polled.reading is None or polled.quality is not Quality.GOOD:
        return None
    return kept(polled.reading.value)


def sample_of(update: Update) -> Sample:
    """What history makes of an update: a value with its own time, or the mark that there is none."""
    polled = update.polled
    time = polled.reading.time if polled.good and polled.reading is not None else polled.time
    ago = (polled.time - time).total_seconds()
    if not 0 <= ago <= SOON:  # the clock stepped in between
        ago = 0.0
    return Sample(
        update.device,
        update.point,
        microseconds(time),
        update.monotonic - ago,
        update.synchronised,
        value_of(polled),
        polled.quality,
    )


def open_store(
    settings: HistorySettings, path_of: Callable[[str], Path], *, only_read: bool = False
) -> Store:
    """The store that `[history]` names. Raises `UsageError`."""
    if settings.dsn is None:
        from multidrop.gateway.history.sqlite import SqliteStore

        return SqliteStore(path_of(settings.path), only_read=only_read)
    from multidrop.gateway.history.postgres import PostgresStore

    if only_read:
        return PostgresStore(settings.dsn)
    from multidrop.gateway.outbox import Outbox

    outbox = Outbox(path_of(settings.outbox), round(settings.outbox_size * 1e6))
    return PostgresStore(settings.dsn, outbox)


class _Rules:
    """The rules of the plant file that counts now; `longest` is for points that have none."""

    def __init__(self, gateway: Gateway, longest: float) -> None:
        self._gateway = gateway
        self._longest = longest
        self._plant = gateway.plant
        self._known: dict[Key, Rule] = {}

    def of(self, device: str, point: str) -> Rule:
        if self._plant is not self._gateway.plant:
            self._plant = self._gateway.plant
            self._known.clear()
        rule = self._known.get((device, point))
        if rule is None:
            rule = self._known[device, point] = self._read(device, point)
        return rule

    def _read(self, device: str, point: str) -> Rule:
        found = self._plant.devices.get(device)
        named = found.points.get(point) if found is not None else None
        if named is None:
            return Rule(longest=self._longest)
        return Rule(named.deadband, self._longest if named.longest is None else named.longest)


def part(gateway: Gateway) -> History:
    """The history of a gateway, as its plant and `[history]` say. Raises `UsageError`."""
    settings = gateway.settings
    table = settings.history
    assert table is not None

    rules = _Rules(gateway, table.longest)
    store = open_store(table, settings.path)
    history = History(store, rules.of, keep=table.keep * DAY, news=gateway.news)
    gateway.values.listeners.append(history.take)
    gateway.values.forgetting.append(history.forget)
    return history


def wrong(plant: Plant, settings: Settings) -> Iterator[str]:
    """What is wrong with `[history]`; no server is asked."""
    table = settings.history
    assert table is not None
    if table.dsn is None:
        from multidrop.gateway.history.sqlite import demand_history

        path = settings.path(table.path)
        yield from objections(
            lambda: demand_writable("history.path", path), lambda: demand_history(path)
        )
        return
    from multidrop.gateway.history.postgres import demand_dsn
    from multidrop.gateway.outbox import demand_outbox

    dsn, outbox = table.dsn, settings.path(table.outbox)
    yield from objections(
        lambda: demand_dsn(dsn),
        lambda: demand_writable("history.outbox", outbox),
        lambda: demand_outbox(outbox),
    )
