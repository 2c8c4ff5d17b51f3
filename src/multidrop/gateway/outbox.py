"""Records that wait on disk for a server that is away: in order, bounded, the oldest go first.

One SQLite file. Every `put` is safe when the process is killed; against loss of power it is made
safe once a second. What was delivered is taken out with the next `put`: after a crash in between
it is delivered again, so whoever receives must know a record that came already.
"""

from __future__ import annotations

import sqlite3
import threading
import time
from collections import deque
from contextlib import closing, suppress
from dataclasses import dataclass
from pathlib import Path

from multidrop.errors import PortError, UsageError
from multidrop.gateway.durable import Durable
from multidrop.gateway.gaps import Gap

APPLICATION = 0x6D645F6F  # "md_o", which says whose file it is

SCHEMA = f"""
BEGIN;
PRAGMA application_id = {APPLICATION};
CREATE TABLE records (
    number INTEGER PRIMARY KEY AUTOINCREMENT, first INTEGER NOT NULL, last INTEGER NOT NULL,
    samples INTEGER NOT NULL, data BLOB NOT NULL,
    lost_from INTEGER, lost_until INTEGER, lost INTEGER NOT NULL DEFAULT 0
);
COMMIT;
"""

RATE_OVER = 600.0
"""s over which the present rate is reckoned."""

OVERFLOW = "the outbox was full"


@dataclass(frozen=True, slots=True)
class Waiting:
    """A record; `lost` is what went before it because there was no more room."""

    number: int
    data: bytes
    lost: Gap | None


class Outbox:
    """Keeps up to `most` bytes of records in the file at `path`. Any thread may use it.

    Raises `UsageError` where the file is something else, `PortError` where the disk does not take it.
    """

    def __init__(self, path: Path, most: int) -> None:
        self.path = path
        self.most = most
        self._lock = threading.Lock()
        self._delivered = 0
        self._taken = 0
        self._rates: deque[tuple[float, int]] = deque()
        self._asking = threading.Lock()  # of the rates: the other one waits for the disk
        try:
            self._file = _open(path)
        except (sqlite3.OperationalError, OSError) as error:
            raise PortError(f"{path}: no outbox can be kept here: {error}") from None
        except sqlite3.Error as error:
            raise UsageError(f"{path}: no outbox can be kept here: {error}") from None
        self._durable = Durable(self._file)
        self._size, self._count = self._file.execute(
            "SELECT coalesce(sum(length(data)), 0), coalesce(sum(samples), 0) FROM records"
        ).fetchone()

    @property
    def samples(self) -> int:
        """How many wait, those included that are just being delivered."""
        return int(self._count)

    @property
    def delivered(self) -> bool:
        """Whether everything was."""
        with self._lock:
            (newest,) = self._file.execute("SELECT max(number) FROM records").fetchone()
        return newest is None or newest <= self._delivered

    @property
    def size(self) -> int:
        """Bytes of the records that wait."""
        return int(self._size)

    @property
    def hours(self) -> float | None:
        """How long a server may be away at the rate of the last ten minutes; None before it is known."""
        with self._asking:
            if len(self._rates) < 2:
                return None
            took = self._rates[-1][0] - self._rates[0][0]
            size = sum(size for _, size in self._rates) - self._rates[0][1]
        return self.most / size * took / 3600 if took and size else None

    @property
    def left(self) -> float | None:
        """How much longer it has room, h, at that rate; None before it is known."""
        hours = self.hours
        return None if hours is None else hours * max(0.0, 1 - self._size / self.most)

    def put(self, records: list[tuple[bytes, int, int, int]]) -> None:
        """Add records: data, time of their first and last sample (µs), how many samples.

        All or none; raises `sqlite3.Error` for none. Those that have no room push the oldest out.
        """
        with self._lock:
            kept = self._size, self._count
            try:
                self._durable.choose()
                self._file.execute("BEGIN IMMEDIATE")
                self._forget_delivered()
                for data, first, last, samples in records:
                    self._file.execute(
                        "INSERT INTO records (data, first, last, samples) VALUES (?, ?, ?, ?)",
                        (data, first, last, samples),
                    )
                    self._size += len(data)
                    self._count += samples
                self._bound()
                self._file.execute("COMMIT")
            except BaseException:
                if self._file.in_transaction:
                    self._file.execute("ROLLBACK")
                self._size, self._count = kept
                raise
            self._note_rate(sum(len(record[0]) for record in records))

    def take(self, most: int = 1, after: int = 0) -> list[Waiting]:
        """The oldest records that were not yet delivered; until they are, or `put_back`, they stay.

        `after`: the next ones after that number, up to which all stay too.
        """
        with self._lock:
            rows = self._file.execute(
                "SELECT number, data, lost_from, lost_until, lost FROM records "
                "WHERE number > ? ORDER BY number LIMIT ?",
                (max(self._delivered, after), most),
            ).fetchall()
            self._taken = rows[-1][0] if rows else after
        return [
            Waiting(number, data, Gap(start, end, OVERFLOW, lost) if start is not None else None)
            for number, data, start, end, lost in rows
        ]

    def done(self, number: int) -> None:
        """Everything up to this number was delivered."""
        with self._lock:
            size, count = self._file.execute(
                "SELECT coalesce(sum(length(data)), 0), coalesce(sum(samples), 0) FROM records "
                "WHERE number > ? AND number <= ?",
                (self._delivered, number),
            ).fetchone()
            self._size -= size
            self._count -= count
            self._delivered, self._taken = max(self._delivered, number), 0

    def put_back(self) -> None:
        """What was taken was not delivered: it may be pushed out again."""
        with self._lock:
            self._taken = 0

    def forget(self) -> None:
        """Take out what was delivered now, and not with the next `put`. Raises `sqlite3.Error`."""
        with self._lock:
            self._durable.choose()
            self._forget_delivered()

    def begin_run(self) -> int:
        """A number for a run of the program, higher than before: also in a new file, by the clock.

        Raises `sqlite3.Error`.
        """
        with self._lock:
            (before,) = self._file.execute("PRAGMA user_version").fetchone()
            run = max(int(before) + 1, int(time.time() // 60))
            self._file.execute(f"PRAGMA user_version = {run}")
        return run

    def note(self, size: int) -> None:
        """So many bytes would have come, were the server away: for the present rate."""
        self._note_rate(size)

    def close(self) -> None:
        with self._lock:
            with suppress(sqlite3.Error):  # then it is delivered again, which does no harm
                self._forget_delivered()
            self._file.close()

    def _forget_delivered(self) -> None:
        self._file.execute("DELETE FROM records WHERE number <= ?", (self._delivered,))

    def _bound(self) -> None:
        """The oldest go, except what is just being delivered, and the next one says what went."""
        while self._size > self.most:
            rows = self._file.execute(
                "SELECT number, length(data), first, last, samples, lost_from, lost_until, lost "
                "FROM records WHERE number > ? ORDER BY number LIMIT 2",
                (max(self._taken, self._delivered),),
            ).fetchall()
            if len(rows) < 2:
                return
            number, size, first, last, samples, lost_from, lost_until, lost = rows[0]
            before = [] if lost_from is None else [(lost_from, lost_until)]
            gone = [*before, (first, last)] if samples else before
            if gone:
                start, end = min(gap[0] for gap in gone), max(gap[1] for gap in gone)
                self._file.execute(
                    "UPDATE records SET lost_from = ?, lost_until = ?, lost = ? WHERE number = ?",
                    (start, end, lost + samples, rows[1][0]),
                )
            self._file.execute("DELETE FROM records WHERE number = ?", (number,))
            self._size -= size
            self._count -= samples

    def _note_rate(self, size: int) -> None:
        now = time.monotonic()
        with self._asking:
            self._rates.append((now, size))
            while now - self._rates[0][0] > RATE_OVER:
                self._rates.popleft()


def _open(path: Path) -> sqlite3.Connection:
    file = sqlite3.connect(path, isolation_level=None, check_same_thread=False)
    try:
        empty = _is_empty(file, path)
        file.executescript("PRAGMA journal_mode = WAL;")
        if empty:
            file.executescript(SCHEMA)
    except BaseException:
        file.close()
        raise
    return file


def _is_empty(file: sqlite3.Connection, path: Path) -> bool:
    """Whether nothing is in it yet. Raises `UsageError` for somebody else's file."""
    (application,) = file.execute("PRAGMA application_id").fetchone()
    (tables,) = file.execute("SELECT count(*) FROM sqlite_master").fetchone()
    if tables and application != APPLICATION:
        raise UsageError(f"{path}: not an outbox of multidrop")
    return not tables


def demand_outbox(path: Path, key: str = "history.outbox") -> None:
    """Raises `UsageError` where a file is there that is no outbox; `key` names it."""
    if not path.is_file():
        return
    try:
        with closing(sqlite3.connect(f"{path.absolute().as_uri()}?mode=rw", uri=True)) as file:
            _is_empty(file, path)
    except sqlite3.Error as error:
        raise UsageError(f"{key} {path}: no outbox: {error}") from None
    except UsageError as error:
        raise UsageError(f"{key} {error}") from None
