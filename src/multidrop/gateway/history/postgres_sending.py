"""From the outbox to the server: everything, in order, and once.

The server remembers the last batch of each run, in the transaction that takes it, so a batch that
comes again, since its acknowledgement was lost, is left out.
"""

from __future__ import annotations

import sqlite3
import threading
import time
import zlib
from collections import Counter
from collections.abc import Callable
from contextlib import closing
from typing import Any

import psycopg

from multidrop.errors import Error, UsageError
from multidrop.gateway.history import postgres_sql as sql
from multidrop.gateway.history.packing import unpack
from multidrop.gateway.history.records import Batch, Row, Span
from multidrop.gateway.history.store import FORGET_AT_ONCE, SEAL_ALL, SEAL_ONE
from multidrop.gateway.outbox import Outbox, Waiting

MUCH = 10_000
"""Samples that wait, and are written at once; fewer wait until they may be committed too."""

AT_ONCE = 30
"""Records that are taken out of the outbox together."""

RETRY = 1.0
"""s between two attempts to reach the server."""

LAST_WITHIN = 5.0
"""s that remain, once the store is closed, for what still waits."""

Connection = psycopg.Connection[tuple[Any, ...]]


class Sender:
    """A thread that delivers what waits in an outbox, for as long as it is open.

    `every` is the s from one commit to the next: each makes the server wait for its disk. One has
    all that came since the last, however much that is.
    """

    def __init__(self, connect: Callable[[], Connection], outbox: Outbox, every: float) -> None:
        self.error: str | None = None
        self.forget: int | None = None
        self._connect = connect
        self._outbox = outbox
        self._every = every
        self._due = float("-inf")  # when the next commit may be
        self._until = float("inf")
        self._stop = threading.Event()
        self._wake = threading.Event()
        self._thread = threading.Thread(target=self._send, name="history-send", daemon=True)
        self._thread.start()

    def wake(self) -> None:
        """Something was put into the outbox."""
        self._wake.set()

    def close(self, within: float) -> None:
        """What waits stays in the outbox, after one more attempt to deliver it."""
        self._until = time.monotonic() + LAST_WITHIN
        self._stop.set()
        self._wake.set()
        self._thread.join(within)

    def _send(self) -> None:
        while True:
            stopping = self._stop.is_set()
            try:
                with closing(self._connect()) as connection:
                    writing = Writing(connection)
                    self.error = None
                    while self._deliver(writing) or not stopping:
                        stopping = self._stop.is_set()
                return
            except (psycopg.Error, sqlite3.Error, Error) as error:
                self.error = str(error).strip()
                self._outbox.put_back()
            if stopping or self._stop.wait(RETRY):
                return

    def _deliver(self, writing: Writing) -> bool:
        """One transaction of what waits; returns whether there was anything."""
        if self._outbox.samples < MUCH:
            self._stop.wait(self._due - time.monotonic())
        number = self._fill(writing)
        if number:
            writing.commit(self.forget)
            self._due = time.monotonic() + self._every
            self._outbox.done(number)
        elif not self._stop.is_set():
            self._wake.wait(RETRY)
        return number > 0

    def _fill(self, writing: Writing) -> int:
        """Write what waits, and what comes until it may be committed; the last record's number."""
        number = 0
        while time.monotonic() < self._until:
            self._wake.clear()
            waiting = self._outbox.take(AT_ONCE, number)
            for item in waiting:
                try:
                    writing.take(self._unpacked(item))
                except UsageError:
                    if not number:
                        raise
                    return number  # what was before it is delivered first
                number = item.number
            left = self._due - time.monotonic()
            more = len(waiting) == AT_ONCE
            if not number or left <= 0 or (self._stop.is_set() and not more):
                break
            if not more:
                self._wake.wait(left)
        return number

    def _unpacked(self, waiting: Waiting) -> Batch:
        try:
            return unpack(waiting.data, waiting.lost)
        except (zlib.error, ValueError, LookupError, TypeError):
            raise UsageError(
                f"history.outbox {self._outbox.path}: what waits in it is damaged, or MQTT's: move it away"
            ) from None


class Writing:
    """What one connection writes; whatever goes wrong ends both, and the next ones start afresh."""

    def __init__(self, connection: Connection) -> None:
        self._connection = connection
        self._series: dict[tuple[str, str], int] = {
            (device, point): key
            for key, device, point in connection.execute(sql.ALL_SERIES.encode())
        }
        self._fresh: Counter[int] = Counter(dict(connection.execute(sql.COUNT_FRESH.encode())))
        self._newest: dict[str, int] = {}  # the last batch of each run
        self._spans: dict[Span, int] = {}
        self._forgetting = 0
        connection.commit()

    def take(self, batch: Batch) -> None:
        """Not before `commit` is it there; one that came before is left out."""
        rows = self._new_rows(batch)
        if not rows:
            return
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

    def commit(self, forget: int | None) -> None:
        """Everything that was taken. Some of what is older than `forget` goes."""
        if forget is not None:
            self._forget_some(forget)
        self._connection.commit()

    def _new_rows(self, batch: Batch) -> list[tuple[int, int, Row]]:
        execute = self._connection.execute
        run = batch.span.run
        if run not in self._newest:
            newest = "SELECT coalesce(max(batch), 0) FROM spans WHERE run = %s"
            self._newest[run] = _first(execute(newest, (run,)))
        if self._newest[run] >= batch.number:
            return []
        self._newest[run] = batch.number
        if batch.span not in self._spans:
            self._spans[batch.span] = self._span(batch.span)
        span = self._spans[batch.span]
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
