"""History in PostgreSQL, for plants that have outgrown one machine.

What is written goes into the outbox on the local disk first, and from there to the server in
order, whenever it is there: one way for the good and for the bad days.
docs/reference/history.md describes the schema.
"""

from __future__ import annotations

import contextlib
from collections.abc import Generator, Iterator, Sequence
from contextlib import closing
from typing import Any

from multidrop.errors import PortError, UsageError
from multidrop.gateway.durable import SAFE_EVERY
from multidrop.gateway.gaps import Gap
from multidrop.gateway.history import postgres_sql as sql
from multidrop.gateway.history.blocks import Chunk
from multidrop.gateway.history.buckets import Contents, Summary
from multidrop.gateway.history.packing import pack
from multidrop.gateway.history.records import GOOD, Batch, Kept, whole
from multidrop.gateway.history.store import Store, StoredSpan, StoreState
from multidrop.gateway.outbox import Outbox

try:
    import psycopg
    from psycopg import conninfo

    from multidrop.gateway.history.postgres_sending import LAST_WITHIN, Connection, Sender
except ImportError as missing:
    raise UsageError(
        "history in PostgreSQL needs psycopg: pip install 'multidrop[postgres]'"
    ) from missing

ROWS_AT_ONCE = 50 if psycopg.capabilities.has_stream_chunked() else 1
"""Rows of an answer that the client's library hands over together."""

CONNECT_WITHIN = 5
"""s that an attempt may take."""


def demand_dsn(dsn: str) -> None:
    """Raises `UsageError` for what names no database."""
    try:
        conninfo.conninfo_to_dict(dsn)
    except psycopg.ProgrammingError as error:
        raise UsageError(f"history.dsn is wrong: {str(error).strip()}") from None


class PostgresStore(Store):
    """History in the schema `multidrop`, or another, of the database that `dsn` names.

    `outbox` None: it only reads. `every` is the s from one commit to the next, each of which
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
        self._reader: Connection | None = None
        self._sender = None if outbox is None else Sender(self._connect, outbox, every)

    @property
    def state(self) -> StoreState:
        if self._outbox is None or self._sender is None:
            return StoreState()
        return StoreState(self._sender.error, self._outbox.samples, self._outbox.hours)

    @property
    def delivered(self) -> bool:
        """Whether the server has everything that was written."""
        return self._outbox is None or self._outbox.delivered

    def close(self) -> None:
        """What waits stays in the outbox, after one more attempt to deliver it."""
        if self._sender is not None:
            self._sender.close(CONNECT_WITHIN + LAST_WITHIN)
        if self._reader is not None:
            self._reader.close()
        if self._outbox is not None:
            self._outbox.close()

    # -- writing -------------------------------------------------------------------------------

    def write(self, batches: Sequence[Batch], forget: int | None = None) -> None:
        assert self._outbox is not None, "this store was opened for reading"
        assert self._sender is not None
        self._outbox.put([(pack(batch), *_times(batch), len(batch.rows)) for batch in batches])
        self._sender.forget = forget
        self._sender.wake()

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

    def _stream(self, query: str, *values: object) -> Generator[tuple[Any, ...], None, None]:
        """The same one after the other, as they come: there may be any number. Close it."""
        assert self._reader is not None
        with self._reader.cursor() as cursor:
            yield from cursor.stream(query.encode(), values, binary=True, size=ROWS_AT_ONCE)

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

    def _points(self) -> list[tuple[str, str]]:
        return [(device, point) for device, point in self._rows(sql.SERIES)]

    def _key(self, device: str, point: str) -> int | None:
        rows = self._rows(sql.SERIES_ID, device, point)
        return rows[0][0] if rows else None

    def _spans(self) -> list[StoredSpan]:
        return [StoredSpan(*row) for row in self._rows(sql.SPANS)]

    def _losses(self, start: int, end: int) -> list[Gap]:
        return [Gap(*row) for row in self._rows(sql.LOSSES, end, start)]

    def _chunks(self, series: int, span: int, start: int, end: int) -> Generator[Chunk, None, None]:
        with closing(self._stream(sql.CHUNKS, series, span, end, start)) as rows:
            for row in rows:
                yield _chunk(*row)
        yield from self._fresh_chunk(series, span, start, end)

    def _pieces(
        self, series: int, span: int, start: int, end: int, width: int
    ) -> Generator[Chunk | Summary, None, None]:
        inside = (start, end, start, width, start, width)
        with closing(self._stream(sql.PIECES, *inside, series, span, end, start)) as rows:
            for first, count, minimum, maximum, final, text, gap, *block in rows:
                if block[0] is None:
                    last = text if final is None else final
                    yield Summary(first, Contents(minimum, maximum, last, count, gap))
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
