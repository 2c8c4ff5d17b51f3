"""History in PostgreSQL, for plants that have outgrown one machine.

What is written goes into the outbox on the local disk first, and from there to the server in
order, whenever it is there: one way for the good and for the bad days. The server remembers the
last batch of each run, in the transaction that takes it, so nothing comes twice.
docs/reference/history.md describes the schema.
"""

from __future__ import annotations

import contextlib
import threading
from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Any, TypeVar

from multidrop.errors import Error, PortError, UsageError
from multidrop.gateway.durable import SAFE_EVERY
from multidrop.gateway.gaps import Gap
from multidrop.gateway.history import postgres_sql as sql
from multidrop.gateway.history.blocks import Chunk
from multidrop.gateway.history.buckets import Summary
from multidrop.gateway.history.packing import pack, unpack
from multidrop.gateway.history.records import GOOD, Batch, Kept, Row, Span, whole
from multidrop.gateway.history.store import (
    FORGET_AT_ONCE,
    SEAL_ALL,
    SEAL_ONE,
    Store,
    StoredSpan,
    StoreState,
)
from multidrop.gateway.outbox import Outbox

try:
    import psycopg
    from psycopg import conninfo
except ImportError as missing:
    raise UsageError(
        "history in PostgreSQL needs psycopg: pip install 'multidrop[postgres]'"
    ) from missing

AT_ONCE = 30
"""Batches that go to the server in one transaction, when many wait."""

RETRY = 1.0
"""s between two attempts to reach the server."""

CONNECT_WITHIN = 5
"""s that an attempt may take."""

ResultT = TypeVar("ResultT")
Connection = psycopg.Connection[tuple[Any, ...]]


def demand_dsn(dsn: str) -> None:
    """Raises `UsageError` for what names no database."""
    try:
        conninfo.conninfo_to_dict(dsn)
    except psycopg.ProgrammingError as error:
        raise UsageError(f"history.dsn is wrong: {str(error).strip()}") from None


class PostgresStore(Store):
    """History in the schema `multidrop`, or another, of the database that `dsn` names.

    `outbox` None: it only reads. `every` is the s between two transactions, each of which
    makes the server wait for its disk. Raises `UsageError` for a `dsn` that is none.
    """

    def __init__(
        self,
        dsn: str,
        outbox: Outbox | None = None,
        *,
        schema: str = "multidrop",
        every: float = SAFE_EVERY,
    ) -> None:
        demand_dsn(dsn)
        self._dsn = dsn
        self._schema = schema
        self._outbox = outbox
        self._every = every
        self._reader: Connection | None = None
        self._error: str | None = None
        self._forget: int | None = None
        self._stop = threading.Event()
        self._wake = threading.Event()
        self._sender: threading.Thread | None = None
        if outbox is not None:
            self._sender = threading.Thread(target=self._send, name="history-send", daemon=True)
            self._sender.start()

    @property
    def state(self) -> StoreState:
        if self._outbox is None:
            return StoreState(self._error)
        return StoreState(self._error, self._outbox.samples, self._outbox.hours)

    @property
    def delivered(self) -> bool:
        """Whether the server has everything that was written."""
        return self._outbox is None or self._outbox.delivered

    def close(self) -> None:
        """What waits stays in the outbox, after one more attempt to deliver it."""
        self._stop.set()
        self._wake.set()
        if self._sender is not None:
            self._sender.join(CONNECT_WITHIN + 5)
        if self._reader is not None:
            self._reader.close()
        if self._outbox is not None:
            self._outbox.close()

    # -- writing -------------------------------------------------------------------------------

    def write(self, batches: Sequence[Batch], forget: int | None = None) -> None:
        assert self._outbox is not None, "this store was opened for reading"
        self._outbox.put([(pack(batch), *_times(batch), len(batch.rows)) for batch in batches])
        self._forget = forget
        self._wake.set()

    def _send(self) -> None:
        """The sender's thread: deliver what waits, in order, for as long as the store is open."""
        while True:
            stopping = self._stop.is_set()
            try:
                with Writing(self._connect()) as writing:
                    self._error = None
                    while self._deliver(writing) or not stopping:
                        stopping = self._stop.is_set()
                return
            except (psycopg.Error, Error) as error:
                self._error = str(error).strip()
                assert self._outbox is not None
                self._outbox.put_back()
            if stopping or self._stop.wait(RETRY):
                return

    def _deliver(self, writing: Writing) -> bool:
        """Some of what waits; returns whether there was anything."""
        assert self._outbox is not None
        self._wake.clear()
        waiting = self._outbox.take(AT_ONCE)
        if not waiting:
            if not self._stop.is_set():
                self._wake.wait(RETRY)
            return False
        batches = [unpack(item.data, item.lost) for item in waiting]
        writing.take(batches, self._forget)
        self._outbox.done(waiting[-1].number)
        if len(waiting) < AT_ONCE:
            self._stop.wait(self._every)
        return True

    def _connect(self) -> Connection:
        """A connection whose tables are there. Raises `PortError`."""
        try:
            connection = psycopg.connect(
                self._dsn,
                connect_timeout=CONNECT_WITHIN,
                keepalives_idle=10,
                keepalives_interval=5,
                keepalives_count=3,
                tcp_user_timeout=20_000,
                application_name="multidrop history",
            )
        except psycopg.Error as error:
            raise PortError(f"the database server does not answer: {error}") from None
        try:
            sql.prepare(connection, self._schema)
        except BaseException:
            connection.close()
            raise
        return connection

    @property
    def left(self) -> float | None:
        return None if self._outbox is None else self._outbox.left

    # -- asking --------------------------------------------------------------------------------

    def _rows(self, query: str, *values: object) -> list[tuple[Any, ...]]:
        assert self._reader is not None
        return self._reader.execute(query.encode(), values, binary=True).fetchall()

    def series(self) -> list[tuple[str, str]]:
        self._snapshot()
        return [(device, point) for device, point in self._rows(sql.SERIES)]

    def _snapshot(self) -> None:
        if self._reader is not None and not self._reader.closed:
            with contextlib.suppress(psycopg.Error):
                self._reader.execute("SELECT 1")
                return
            self._reader.close()
        self._reader = self._connect()
        self._reader.isolation_level = psycopg.IsolationLevel.REPEATABLE_READ
        self._reader.read_only = True

    def _done(self) -> None:
        if self._reader is not None and not self._reader.closed:
            with contextlib.suppress(psycopg.Error):
                self._reader.rollback()

    def _key(self, device: str, point: str) -> int | None:
        rows = self._rows(sql.SERIES_ID, device, point)
        return rows[0][0] if rows else None

    def _spans(self) -> list[StoredSpan]:
        return [StoredSpan(*row) for row in self._rows(sql.SPANS)]

    def _losses(self, start: int, end: int) -> list[Gap]:
        return [Gap(*row) for row in self._rows(sql.LOSSES, end, start)]

    def _chunks(self, series: int, span: int, start: int, end: int) -> Iterator[Chunk]:
        for row in self._rows(sql.CHUNKS, series, span, end, start):
            yield _chunk(*row)
        yield from self._fresh_chunk(series, span, start, end)

    def _pieces(
        self, series: int, span: int, start: int, end: int, width: int
    ) -> Iterator[Chunk | Summary]:
        inside = (start, end, start, width, start, width)
        for row in self._rows(sql.PIECES, *inside, series, span, end, start):
            first, count, minimum, maximum, final, text, gap, *block = row
            if block[0] is None:
                last = text if final is None else whole(final)
                yield Summary(first, count, whole(minimum), whole(maximum), last, gap)
            else:
                yield _chunk(*block)
        yield from self._fresh_chunk(series, span, start, end)

    def _fresh_chunk(self, series: int, span: int, start: int, end: int) -> Iterator[Chunk]:
        rows = self._rows(sql.FRESH, series, span, start, end)
        if rows:
            times, numbers, texts, codes = (list(column) for column in zip(*rows, strict=True))
            yield _chunk(
                times, numbers, texts if any(texts) else None, codes if any(codes) else None
            )

    def _newest(
        self, series: int, span: int | None, before: int | None
    ) -> tuple[int, Chunk] | None:
        rows = self._rows(sql.NEWEST_FRESH, series, span, span, before, before)
        if rows:
            found, time, number, text, code = rows[0]
            return found, _chunk([time], [number], [text], [code])
        rows = self._rows(sql.NEWEST_BLOCK, series, span, span, before, before)
        if not rows:
            return None
        found, *block = rows[0]
        chunk = _chunk(*block)
        at = len(chunk.times) - 1
        while before is not None and chunk.times[at] >= before:
            at -= 1
        code = GOOD if chunk.codes is None else chunk.codes[at]
        return found, Chunk([chunk.times[at]], [chunk.values[at]], [code])


def _times(batch: Batch) -> tuple[int, int]:
    """Of the first and the last row."""
    if not batch.rows:
        return batch.until, batch.until
    return batch.rows[0].time, batch.rows[-1].time


def _chunk(
    times: Sequence[int],
    numbers: Sequence[float | None],
    texts: Sequence[str | None] | None,
    codes: Sequence[int] | None,
) -> Chunk:
    if texts is None and None not in numbers:
        return Chunk(times, numbers, codes, plain=True)
    values: list[Kept] = [whole(number) for number in numbers]
    if texts is not None:
        values = [
            number if text is None else text for number, text in zip(values, texts, strict=True)
        ]
    return Chunk(times, values, codes)


class Writing:
    """One connection that writes; whatever goes wrong ends it, and the next one starts afresh."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        self._series: dict[tuple[str, str], int] = {
            (device, point): key
            for key, device, point in connection.execute(sql.ALL_SERIES.encode())
        }
        self._fresh: Counter[int] = Counter(dict(connection.execute(sql.COUNT_FRESH.encode())))
        self._forgetting = 0
        connection.commit()

    def __enter__(self) -> Writing:
        return self

    def __exit__(self, *_: object) -> None:
        self._connection.close()

    def take(self, batches: Sequence[Batch], forget: int | None) -> None:
        """All of them in one transaction; those that came before are left out."""
        rows: list[tuple[int, int, Row]] = []
        for batch in batches:
            rows += self._new_rows(batch)
        copy_to = b"COPY recent (series, span, time, number, text, quality) FROM STDIN"
        with self._connection.cursor() as cursor, cursor.copy(copy_to) as copy:
            for key, span, row in rows:
                text = isinstance(row.value, str)
                number, text_value = (None, row.value) if text else (row.value, None)
                copy.write_row((key, span, row.time, number, text_value, row.code))
        self._fresh.update(key for key, _, _ in rows)
        if self._fresh.total() >= SEAL_ALL or max(self._fresh.values(), default=0) >= SEAL_ONE:
            self._connection.execute(sql.SEAL.encode(), (SEAL_ONE,))
            self._connection.execute("DELETE FROM recent")
            self._fresh.clear()
        if forget is not None:
            self._forget_some(forget)
        self._connection.commit()

    def _new_rows(self, batch: Batch) -> list[tuple[int, int, Row]]:
        execute = self._connection.execute
        newest = _first(execute("SELECT max(batch) FROM spans WHERE run = %s", (batch.span.run,)))
        if newest is not None and newest >= batch.number:
            return []
        span = self._span(batch.span)
        execute(
            "UPDATE spans SET until = %s, ended = %s, batch = %s WHERE id = %s",
            (batch.until, batch.ended, batch.number, span),
        )
        for gap in batch.lost:
            execute(
                "INSERT INTO gaps VALUES (%s, %s, %s, %s)",
                (gap.start, gap.end, gap.reason, gap.samples),
            )
        return [(self._series_of(row), span, row) for row in batch.rows]

    def _span(self, span: Span) -> int:
        named = span.run, span.number
        find = "SELECT id FROM spans WHERE run = %s AND number = %s"
        found = _first(self._connection.execute(find, named))
        if found is None:
            found = _first(
                self._connection.execute(
                    "INSERT INTO spans (run, number, start, until, shift, synchronised, ended, batch) "
                    "VALUES (%s, %s, %s, %s, %s, %s, '', 0) RETURNING id",
                    (*named, span.start, span.start, span.shift, span.synchronised),
                )
            )
        return int(found)

    def _series_of(self, row: Row) -> int:
        named = row.device, row.point
        key = self._series.get(named)
        if key is None:
            insert = "INSERT INTO series (device, point) VALUES (%s, %s) RETURNING id"
            key = self._series[named] = int(_first(self._connection.execute(insert, named)))
        return key

    def _forget_some(self, before: int) -> None:
        """The oldest blocks of the next series: with each writing another one has its turn."""
        execute = self._connection.execute
        after = "SELECT id FROM series WHERE id > %s ORDER BY id LIMIT 1"
        self._forgetting = _first(execute(after, (self._forgetting,))) or 0
        execute(sql.FORGET.encode(), (self._forgetting, before, FORGET_AT_ONCE))
        if not self._forgetting:
            execute("DELETE FROM gaps WHERE until < %s", (before,))


def _first(cursor: psycopg.Cursor[tuple[Any, ...]]) -> Any:
    row = cursor.fetchone()
    return None if row is None else row[0]
