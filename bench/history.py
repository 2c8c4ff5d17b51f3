"""History: samples written, bytes on the disk, a day of one point out of many rows."""

from __future__ import annotations

import contextlib
import random
import tempfile
import time
import uuid
from collections.abc import Callable, Iterator
from itertools import accumulate, islice
from pathlib import Path

from bench.measure import Result
from bench.postgres_server import server
from multidrop.gateway.history.batching import Batching
from multidrop.gateway.history.blocks import encode
from multidrop.gateway.history.buckets import contents_of
from multidrop.gateway.history.records import Batch, Kept, Sample, kept
from multidrop.gateway.history.sqlite import SqliteStore
from multidrop.gateway.history.store import Store

POINTS = 2000
START = 1_790_000_000_000_000
GOAL_RATE, GOAL_BYTES, GOAL_DAY = 20_000, 40, 0.050
DAY = 86_400
BLOCK = 100
"""Samples of a block where 2,000 points are recorded once a second."""

TOGETHER = 20
"""Lots of 20,000 samples that are written to PostgreSQL one after the other, as they would come, and then waited for."""

ROWS, MOST_ROWS = 20_000_000, 100_000_000
"""Samples out of which a day is asked for; those of `large` take some 1.2 GB and a quarter of an hour."""


def rows(quick: bool) -> list[Result]:
    results = []
    seconds = 200 if quick else 600
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        results.append(
            _written("SQLite", "for each 20,000", *_write_sqlite(folder / "written.db", seconds))
        )
        results += _asked(folder / "large.db", ROWS, quick)
        with server() as dsn:
            if dsn is not None:
                with _schema(dsn) as schema:
                    results.append(_write_postgres(dsn, schema, folder, seconds))
                results += _asked_postgres(dsn, ROWS, quick)
    return results


def large(quick: bool) -> list[Result]:
    """The same question to as many samples as a plant has after some weeks."""
    with tempfile.TemporaryDirectory() as name, server() as dsn:
        results = _asked(Path(name) / "large.db", MOST_ROWS, quick)
        return results if dsn is None else [*results, *_asked_postgres(dsn, MOST_ROWS, quick)]


def _asked(path: Path, samples: int, quick: bool) -> list[Result]:
    return [_day("SQLite", *_large_sqlite(path, samples // (10 if quick else 1)))]


def _asked_postgres(dsn: str, samples: int, quick: bool) -> list[Result]:
    with _schema(dsn) as schema:
        points = samples // (10 if quick else 1) // DAY
        return [_day("PostgreSQL", *_large_postgres(dsn, schema, points), [])]


def _values() -> Callable[[], list[Kept]]:
    """The next second of all points: half of them noisy floats, half counts."""
    chance = random.Random(1)
    level = [100.0] * POINTS

    def following() -> list[Kept]:
        found: list[Kept] = []
        for number in range(POINTS):
            level[number] += chance.gauss(0, 1)
            found.append(kept(level[number]) if number % 2 else int(level[number] * 10))
        return found

    return following


def _seconds(seconds: int) -> Iterator[list[Sample]]:
    following = _values()
    chance = random.Random(2)
    for second in range(seconds):
        samples = []
        for number, value in enumerate(following()):
            monotonic = second + number / POINTS + chance.random() * 0.005
            device, point = f"d{number // 20}", f"p{number % 20}"
            time_ = START + round(monotonic * 1e6)
            samples.append(Sample(device, point, time_, monotonic, True, value))
        yield samples


def _batches(seconds: int) -> Iterator[tuple[float, list[Batch]]]:
    """Ten seconds at once, as 20,000 samples/s would come; and the processor's seconds for it."""
    batching = Batching(uuid.uuid4().hex)
    together: list[Sample] = []
    for second, samples in enumerate(_seconds(seconds)):
        together += samples
        if second % 10 == 9:
            began = time.process_time()
            batching.take(together)
            batches = batching.cut(float(second + 1))
            yield time.process_time() - began, batches
            batching.written(len(batches))
            together = []


def _write_sqlite(path: Path, seconds: int) -> tuple[float, float, int, float]:
    """Samples/s of processor time and of wall time, samples, bytes for each on the disk."""
    store = SqliteStore(path)
    took = wall = 0.0
    for cutting, batches in _batches(seconds):
        began, began_wall = time.process_time(), time.monotonic()
        store.write(batches)
        took += time.process_time() - began + cutting
        wall += time.monotonic() - began_wall + cutting
    store.close()
    count = POINTS * seconds
    return count / took, count / wall, count, path.stat().st_size / count


def _written(name: str, commit: str, rate: float, wall: float, count: int, size: float) -> Result:
    return Result(
        f"history written to {name}, {count:,} samples of {POINTS:,} points, a commit {commit}",
        "",
        f">= {GOAL_RATE:,} samples/s, <= {GOAL_BYTES} bytes each",
        f"{wall:,.0f} samples/s, {size:.1f} bytes each",
        wall >= GOAL_RATE and size <= GOAL_BYTES,
        [f"{rate:,.0f} samples for each second of our processor time"],
    )


def _large_sqlite(path: Path, samples: int) -> tuple[int, list[float], list[str]]:
    """A history of whole days of as many points as make so many rows, as it lies on the disk."""
    points = max(1, samples // DAY)
    store = SqliteStore(path)
    batching = Batching("large")
    batching.take(Sample("d", f"p{n}", START, 0.0, True, 0) for n in range(points))
    store.write(batching.cut(float(DAY)))
    _fill(store, points)
    asked = []
    for number in (points // 2, points // 3, points // 2, points // 5, 0):
        began = time.monotonic()
        buckets = store.buckets("d", f"p{number}", START, START + DAY * 1_000_000)
        asked.append(time.monotonic() - began)
        assert sum(bucket.count for bucket in buckets) >= DAY
        assert 1900 < len(buckets) <= 2000
    store.close()
    beside = [f"the file has {path.stat().st_size / 1e6:,.0f} MB"]
    return points * DAY, asked, beside


def _fill(store: SqliteStore, points: int) -> None:
    """Blocks as sealing makes them, in its order; without the way there, which is the row above."""
    chance = random.Random(3)
    blocks: list[tuple[list[int], list[Kept], bytes]] = []
    for _ in range(50):  # blocks that differ, again and again
        steps = [1_000_000 + chance.randrange(-3000, 3000) for _ in range(BLOCK - 1)]
        values: list[Kept] = [100 + chance.gauss(0, 10) for _ in range(BLOCK)]
        times = list(accumulate(steps, initial=0))
        blocks.append((times, values, encode(times, values, [0] * BLOCK)))
    execute = store._writer.execute
    for block in range(DAY // BLOCK):
        execute("BEGIN")
        for point in range(points):
            times, values, data = blocks[(point + block) % 50]
            minimum, maximum, final, count, gap = contents_of(values, None, plain=True)
            first = START + block * BLOCK * 1_000_000 + 1000
            place = (point + 1, 1, first, first + times[-1])
            execute(
                "INSERT INTO blocks VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?)",
                (*place, count, minimum, maximum, final, gap, data),
            )
        execute("COMMIT")


def _day(name: str, samples: int, asked: list[float], beside: list[str]) -> Result:
    worst = max(asked)
    every = ", ".join(f"{seconds * 1000:.0f}" for seconds in asked)
    return Result(
        f"a day of one point at 1 s out of {samples / 1e6:,.0f} million samples in {name}, as 2,000 buckets",
        "",
        f"< {GOAL_DAY * 1000:.0f} ms",
        f"{worst * 1000:.0f} ms",
        worst < GOAL_DAY,
        [f"one after the other: {every} ms", *beside],
    )


# -- PostgreSQL ----------------------------------------------------------------------------------


@contextlib.contextmanager
def _schema(dsn: str) -> Iterator[str]:
    """A schema of our own."""
    import psycopg
    from psycopg import sql

    schema = f"bench_{uuid.uuid4().hex[:8]}"
    try:
        yield schema
    finally:
        with psycopg.connect(dsn, autocommit=True) as connection:
            connection.execute(sql.SQL("DROP SCHEMA {} CASCADE").format(sql.Identifier(schema)))


def _write_postgres(dsn: str, schema: str, folder: Path, seconds: int) -> Result:
    from multidrop.gateway.history.postgres import PostgresStore
    from multidrop.gateway.outbox import Outbox

    store: Store = PostgresStore(dsn, Outbox(folder / "outbox.db", 10**9), schema=schema)
    took = wall = 0.0
    batches = _batches(seconds)
    while lots := list(islice(batches, TOGETHER)):  # made beforehand: the sender does not rest
        began, began_wall = time.process_time(), time.monotonic()
        for _, lot in lots:
            store.write(lot)
        while not store.delivered:
            time.sleep(0.01)
        cutting = sum(seconds for seconds, _ in lots)
        took += time.process_time() - began + cutting
        wall += time.monotonic() - began_wall + cutting
    store.close()
    count = POINTS * seconds
    return _written("PostgreSQL", "a second", count / took, count / wall, count, _size(dsn, schema))


def _size(dsn: str, schema: str) -> float:
    """Bytes for each sample in a block; the fresh ones are left out."""
    import psycopg

    size = (
        "SELECT sum(pg_total_relation_size(c.oid)) FROM pg_class c JOIN pg_namespace n "
        "ON n.oid = c.relnamespace WHERE n.nspname = %s AND c.relkind = 'r' AND c.relname <> 'recent'"
    )
    count = f"SELECT sum(cardinality(times)) FROM {schema}.blocks"
    with psycopg.connect(dsn) as connection:
        (taken,) = connection.execute(size, (schema,)).fetchone() or (0,)
        (samples,) = connection.execute(count.encode()).fetchone() or (1,)
    return float(taken) / float(samples)


def _large_postgres(dsn: str, schema: str, points: int) -> tuple[int, list[float]]:
    """A day of so many points, made by the server itself, a hundred at a time."""
    from multidrop.gateway.history.postgres import PostgresStore

    with contextlib.closing(PostgresStore(dsn, schema=schema)) as store:
        store.gaps(START, START + 1)  # it is connected, as a gateway is, and has made its tables
        _fill_postgres(dsn, schema, points)
        return points * DAY, _ask_postgres(store, points)


def _fill_postgres(dsn: str, schema: str, points: int) -> None:
    import psycopg

    with psycopg.connect(dsn) as connection:
        connection.execute(f"SET search_path TO {schema}".encode())
        connection.execute(
            "INSERT INTO series (device, point) SELECT 'd', 'p' || n FROM generate_series(1, %s) n",
            (points,),
        )
        connection.execute(
            "INSERT INTO spans (run, number, start, until, shift, ended, batch) VALUES ('r', 1, %s, %s, 0, '', 1)",
            (START, START + DAY * 1_000_000),
        )
        for first in range(1, points + 1, BLOCK):
            connection.execute(
                "INSERT INTO blocks SELECT min(t), max(t), min(v), max(v), max(v), p, 1, count(*), false, NULL, "
                "array_agg(t), array_agg(v) FROM (SELECT p, %s + s * 1000000::bigint AS t, random() AS v, s / %s AS b "
                "FROM generate_series(0, %s) s, generate_series(%s::int, %s::int) p ORDER BY b, p, s) AS x GROUP BY b, p ORDER BY b, p",
                (START, BLOCK, DAY - 1, first, min(first + BLOCK - 1, points)),
            )
    with psycopg.connect(dsn, autocommit=True) as connection:
        connection.execute(f"VACUUM ANALYZE {schema}.blocks".encode())
        with contextlib.suppress(psycopg.errors.InsufficientPrivilege):
            connection.execute("CHECKPOINT")  # else who asks writes what was just put there


def _ask_postgres(store: Store, points: int) -> list[float]:
    asked = []
    for number in (points // 2, points // 3, points // 2, points // 5, 1):
        began = time.monotonic()
        buckets = store.buckets("d", f"p{number}", START, START + DAY * 1_000_000)
        asked.append(time.monotonic() - began)
        assert sum(bucket.count for bucket in buckets) == DAY
    return asked
