"""History in one SQLite file: nothing to install, nothing to set up.

docs/reference/history.md describes the schema. One thread writes, one asks; WAL lets them at the
same time, and other processes too.
"""

from __future__ import annotations

import sqlite3
from collections import Counter
from collections.abc import Generator, Iterator, Sequence
from pathlib import Path

from multidrop.errors import PortError, UsageError
from multidrop.gateway.durable import Durable
from multidrop.gateway.gaps import Gap
from multidrop.gateway.history.blocks import Chunk, decode, encode
from multidrop.gateway.history.buckets import Contents, Summary, contents_of
from multidrop.gateway.history.records import GOOD, Batch, Kept, Row, Span
from multidrop.gateway.history.store import (
    FORGET_AT_ONCE,
    SEAL_ALL,
    SEAL_ONE,
    Store,
    StoredSpan,
    StoreState,
)

APPLICATION = 0x6D645F68  # "md_h", which says whose file it is
VERSION = 1

SCHEMA = """
CREATE TABLE series (
    id INTEGER PRIMARY KEY, device TEXT NOT NULL, point TEXT NOT NULL, UNIQUE (device, point)
);
CREATE TABLE spans (
    id INTEGER PRIMARY KEY, run TEXT NOT NULL, number INTEGER NOT NULL,
    start INTEGER NOT NULL, until INTEGER NOT NULL, shift INTEGER NOT NULL,
    synchronised INTEGER, ended TEXT NOT NULL, batch INTEGER NOT NULL, UNIQUE (run, number)
);
CREATE TABLE gaps (
    start INTEGER NOT NULL, until INTEGER NOT NULL, reason TEXT NOT NULL, samples INTEGER
);
CREATE TABLE recent (
    series INTEGER NOT NULL, span INTEGER NOT NULL, time INTEGER NOT NULL, value, quality INTEGER NOT NULL
);
CREATE INDEX recent_of_series ON recent (series);
CREATE TABLE blocks (
    series INTEGER NOT NULL, span INTEGER NOT NULL, first INTEGER NOT NULL, last INTEGER NOT NULL,
    count INTEGER NOT NULL, minimum, maximum, final, gap INTEGER NOT NULL, data BLOB NOT NULL
);
CREATE INDEX blocks_of_series ON blocks (series, span, first, last, count, minimum, maximum, final, gap);
"""

SETTINGS = """
PRAGMA journal_mode = WAL;
PRAGMA wal_autocheckpoint = 4000;
PRAGMA busy_timeout = 10000;
"""


class SqliteStore(Store):
    """History in the file at `path`, which is made where it is missing.

    `only_read`: for another process than the one that writes. Raises `UsageError` where the
    file is something else, and `PortError` where it cannot be opened: the disk is full, say.
    """

    def __init__(self, path: Path, *, only_read: bool = False) -> None:
        self.path = path
        if only_read and not path.exists():
            raise UsageError(f"{path}: there is no history")
        try:
            self._reader = self._open(path, only_read)
            self._writer = self._reader if only_read else self._open(path, only_read)
        except (sqlite3.OperationalError, OSError) as error:
            raise PortError(f"{path}: no history can be kept here: {error}") from None
        except sqlite3.Error as error:
            raise UsageError(f"{path}: no history can be kept here: {error}") from None
        self._durable = Durable(self._writer)
        self._series: dict[tuple[str, str], int] = {}
        self._fresh: Counter[int] = Counter()
        if not only_read:
            self._count_fresh()
        self._forgetting = 0
        self._error: str | None = None

    @property
    def state(self) -> StoreState:
        return StoreState(self._error)

    def close(self) -> None:
        self._reader.close()
        self._writer.close()

    # -- writing -------------------------------------------------------------------------------

    def write(self, batches: Sequence[Batch], forget: int | None = None) -> None:
        fresh = self._fresh.copy()
        try:
            self._durable.choose()
            self._writer.execute("BEGIN IMMEDIATE")
            for batch in batches:
                self._take(batch)
            if self._fresh.total() >= SEAL_ALL or max(self._fresh.values(), default=0) >= SEAL_ONE:
                self._seal()
            if forget is not None:
                self._forget(forget)
            self._writer.execute("COMMIT")
        except BaseException as error:
            if self._writer.in_transaction:
                self._writer.execute("ROLLBACK")
            self._fresh = fresh
            self._series.clear()
            self._error = str(error)
            raise
        self._error = None

    def _take(self, batch: Batch) -> None:
        execute = self._writer.execute
        (newest,) = execute(
            "SELECT max(batch) FROM spans WHERE run = ?", (batch.span.run,)
        ).fetchone()
        if newest is not None and newest >= batch.number:
            return
        span = self._span(batch.span)
        execute(
            "UPDATE spans SET until = ?, ended = ?, batch = ? WHERE id = ?",
            (batch.until, batch.ended, batch.number, span),
        )
        for gap in batch.lost:
            execute(
                "INSERT INTO gaps VALUES (?, ?, ?, ?)",
                (gap.start, gap.end, gap.reason, gap.samples),
            )
        keys = [self._series_of(row) for row in batch.rows]
        self._fresh.update(keys)
        self._writer.executemany(
            "INSERT INTO recent VALUES (?, ?, ?, ?, ?)",
            (
                (key, span, row.time, row.value, row.code)
                for key, row in zip(keys, batch.rows, strict=True)
            ),
        )

    def _span(self, span: Span) -> int:
        named = (span.run, span.number)
        find = "SELECT id FROM spans WHERE run = ? AND number = ?"
        found = self._writer.execute(find, named).fetchone()
        if found is None:
            self._writer.execute(
                "INSERT INTO spans (run, number, start, until, shift, synchronised, ended, batch) "
                "VALUES (?, ?, ?, ?, ?, ?, '', 0)",
                (*named, span.start, span.start, span.shift, span.synchronised),
            )
            found = self._writer.execute(find, named).fetchone()
        return int(found[0])

    def _series_of(self, row: Row) -> int:
        named = row.device, row.point
        key = self._series.get(named)
        if key is None:
            self._writer.execute(
                "INSERT INTO series (device, point) VALUES (?, ?) ON CONFLICT DO NOTHING", named
            )
            (key,) = self._writer.execute(
                "SELECT id FROM series WHERE device = ? AND point = ?", named
            ).fetchone()
            self._series[named] = key
        return key

    def _seal(self) -> None:
        """Put all fresh samples into blocks.

        In columns: an object for each of hundreds of thousands of samples would make Python's
        garbage collector stop everything for a tenth of a second.
        """
        rows = self._writer.execute(
            "SELECT series, span, time, value, quality FROM recent ORDER BY rowid"
        )
        found: dict[tuple[int, int], tuple[list[int], list[Kept], list[int]]] = {}
        for series, span, time, value, code in rows:
            columns = found.get((series, span))
            if columns is None:
                columns = found[series, span] = [], [], []
            columns[0].append(time)
            columns[1].append(value)
            columns[2].append(code)
        for series, span in sorted(found):
            times, values, codes = found[series, span]
            for at in range(0, len(times), SEAL_ONE):
                part = slice(at, at + SEAL_ONE)
                self._block(series, span, times[part], values[part], codes[part])
        self._writer.execute("DELETE FROM recent")
        self._fresh.clear()

    def _block(
        self,
        series: int,
        span: int,
        times: Sequence[int],
        values: Sequence[Kept],
        codes: Sequence[int],
    ) -> None:
        plain = set(map(type, values)) <= {int, float}
        minimum, maximum, final, count, gap = contents_of(values, codes, plain=plain)
        self._writer.execute(
            "INSERT INTO blocks VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
            (
                *(series, span, times[0], times[-1], count, minimum, maximum, final, gap),
                encode(times, values, codes),
            ),
        )

    def _forget(self, before: int) -> None:
        """The oldest blocks of the next series: with each writing another one has its turn."""
        execute = self._writer.execute
        series = "SELECT id FROM series WHERE id > ? ORDER BY id LIMIT 1"
        found = execute(series, (self._forgetting,)).fetchone()
        self._forgetting = found[0] if found else 0
        execute(
            "DELETE FROM blocks WHERE rowid IN (SELECT rowid FROM blocks "
            "WHERE series = ? AND last < ? ORDER BY span, first LIMIT ?)",
            (self._forgetting, before, FORGET_AT_ONCE),
        )
        if not found:
            execute("DELETE FROM gaps WHERE until < ?", (before,))

    def _count_fresh(self) -> None:
        for key, count in self._writer.execute(
            "SELECT series, count(*) FROM recent GROUP BY series"
        ):
            self._fresh[key] = count

    # -- asking --------------------------------------------------------------------------------

    def _snapshot(self) -> None:
        self._reader.execute("BEGIN")

    def _done(self) -> None:
        self._reader.execute("ROLLBACK")

    def _points(self) -> list[tuple[str, str]]:
        return self._reader.execute("SELECT device, point FROM series ORDER BY 1, 2").fetchall()

    def _key(self, device: str, point: str) -> int | None:
        found = self._reader.execute(
            "SELECT id FROM series WHERE device = ? AND point = ?", (device, point)
        ).fetchone()
        return found[0] if found else None

    def _spans(self) -> list[StoredSpan]:
        rows = self._reader.execute(
            "SELECT id, start, until, shift, synchronised, ended FROM spans ORDER BY id"
        )
        return [
            StoredSpan(key, start, until, shift, None if known is None else bool(known), ended)
            for key, start, until, shift, known, ended in rows
        ]

    def _losses(self, start: int, end: int) -> list[Gap]:
        rows = self._reader.execute(
            "SELECT start, until, reason, samples FROM gaps WHERE start < ? AND until >= ?",
            (end, start),
        )
        return [Gap(*row) for row in rows]

    def _chunks(self, series: int, span: int, start: int, end: int) -> Generator[Chunk, None, None]:
        blocks = self._reader.execute(
            "SELECT first, data FROM blocks WHERE series = ? AND span = ? AND first < ? AND last >= ? "
            "ORDER BY first",
            (series, span, end, start),
        )
        for first, data in blocks:
            yield decode(first, data)
        yield from self._fresh_chunk(series, span, start, end)

    def _pieces(
        self, series: int, span: int, start: int, end: int, width: int
    ) -> Generator[Chunk | Summary, None, None]:
        blocks = self._reader.execute(
            "SELECT first, count, minimum, maximum, final, gap, "
            "CASE WHEN first < :start OR last >= :end OR (first - :start) / :width <> (last - :start) / :width "
            "THEN data END FROM blocks WHERE series = :series AND span = :span "
            "AND first < :end AND last >= :start ORDER BY first",
            {"series": series, "span": span, "start": start, "end": end, "width": width},
        )
        for first, count, minimum, maximum, final, gap, data in blocks:
            if data is None:
                yield Summary(first, Contents(minimum, maximum, final, count, bool(gap)))
            else:
                yield decode(first, data)
        yield from self._fresh_chunk(series, span, start, end)

    def _fresh_chunk(self, series: int, span: int, start: int, end: int) -> Iterator[Chunk]:
        rows = self._reader.execute(
            "SELECT time, value, quality FROM recent "
            "WHERE series = ? AND span = ? AND time >= ? AND time < ? ORDER BY rowid",
            (series, span, start, end),
        ).fetchall()
        if rows:
            times, values, codes = zip(*rows, strict=True)
            plain = set(map(type, values)) <= {int, float}
            yield Chunk(times, values, codes if any(codes) else None, plain)

    def _newest(
        self, series: int, span: int | None, before: int | None
    ) -> tuple[int, Chunk] | None:
        narrowed = " AND span = :span" if span is not None else ""
        given = {"series": series, "span": span, "before": before}
        earlier = " AND time < :before" if before is not None else ""
        row = self._reader.execute(
            f"SELECT span, time, value, quality FROM recent WHERE series = :series{narrowed}{earlier} "
            "ORDER BY rowid DESC LIMIT 1",
            given,
        ).fetchone()
        if row is not None:
            return row[0], Chunk(row[1:2], row[2:3], row[3:4])
        earlier = " AND first < :before" if before is not None else ""
        row = self._reader.execute(
            f"SELECT span, first, data FROM blocks WHERE series = :series{narrowed}{earlier} "
            "ORDER BY span DESC, first DESC LIMIT 1",
            given,
        ).fetchone()
        if row is None:
            return None
        chunk = decode(row[1], row[2])
        at = len(chunk.times) - 1
        while before is not None and chunk.times[at] >= before:
            at -= 1
        codes = chunk.codes or bytes([GOOD]) * len(chunk.times)
        return row[0], Chunk([chunk.times[at]], [chunk.values[at]], [codes[at]])

    @staticmethod
    def _open(path: Path, only_read: bool) -> sqlite3.Connection:
        connection = sqlite3.connect(path, isolation_level=None, check_same_thread=False)
        try:
            (application,) = connection.execute("PRAGMA application_id").fetchone()
            (version,) = connection.execute("PRAGMA user_version").fetchone()
            (tables,) = connection.execute("SELECT count(*) FROM sqlite_master").fetchone()
            if tables and application != APPLICATION:
                raise UsageError(f"{path}: not a history of multidrop")
            if tables and version != VERSION:
                raise UsageError(
                    f"{path}: version {version} of a history; this is version {VERSION}"
                )
            connection.executescript(SETTINGS)
            if only_read:
                connection.execute("PRAGMA query_only = 1")
            elif not tables:
                connection.executescript(
                    f"BEGIN; PRAGMA application_id = {APPLICATION}; PRAGMA user_version = {VERSION}; "
                    f"{SCHEMA} COMMIT;"
                )
        except BaseException:
            connection.close()
            raise
        return connection


def demand_history(path: Path) -> None:
    """Raises `UsageError` where a file is there that is no history of this version."""
    if path.is_file() and path.stat().st_size:
        try:
            SqliteStore(path, only_read=True).close()
        except UsageError as error:
            raise UsageError(f"history.path {error}") from None
